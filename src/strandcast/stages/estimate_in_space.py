"""The string in space that explains the newest trials: the same files as of one in the plane."""

from dataclasses import dataclass

import numpy as np

from strandcast.dynamics.model import StringModel
from strandcast.dynamics.spatial.clamps import POSE
from strandcast.errors import StrandcastError
from strandcast.estimation.cable_estimate import PreviousCable, Rolls, estimate_cable
from strandcast.estimation.cable_fit import EVALUATIONS, THROWN_EVALUATIONS, frames_fitted
from strandcast.estimation.cable_series import CableSeries, DrivenEnd, series_between
from strandcast.estimation.cable_space import POINTS, STEP_S, CableSpace, space_of_cable
from strandcast.records.alignment import HAND, Alignment, ends_of
from strandcast.records.estimate import ENSEMBLE, SIMULATED, FittedPart
from strandcast.records.tables import read_facts, read_table, write_table
from strandcast.records.track import Track, TrackSummary, read_track
from strandcast.seeds import rng
from strandcast.stages.arms import arm_of
from strandcast.stages.context import Context
from strandcast.stages.estimate_record import ensemble_table, estimate_record, points_table
from strandcast.stages.files import past, recent
from strandcast.stages.job import Files, Job
from strandcast.stages.past_trials import hashes_of, read_trial, thrown_cable

# Settings of the estimate that apply in space: to every string, to captures alone, to throws alone.
APPLY = {"trials", "evaluations", "ensemble", "profiles", "dt_s"}
TO_CAPTURES, TO_THROWS = {"friction_stick", "marker_shift"}, {"contact_radius_m"}
# Of a throw; chosen.
FITTED_BEFORE_S, FITTED_AFTER_S = 0.08, 0.10  # around the motion
FASTEST_M_S = 40.0  # faster markers are errors: no tip is as fast


@dataclass(frozen=True, eq=False)
class TrialInSpace:
    """A trial in space: its track, and its motion with every roll that the driven ends may have."""

    number: int
    track: Track
    series: Rolls

    def kind(self) -> tuple[int, bool]:
        """Return columns of the driven ends, and whether they are points."""
        series = next(iter(self.series.values()))
        return series.pose.shape[1], series.pinned


def estimate_in_space(job: Job, files: Files) -> None:
    """Estimate the string after one trial: from the recent ones, starting from the estimate before."""
    context = job.context
    refuse_settings_of_the_plane(context)
    settings = context.settings.estimate
    trials = [read_trial_in_space(files, number) for number in recent(job)]
    if context.settings.aims_in_space:
        model, space = thrown_cable(context, arm_of(context))
    else:
        model, space = _captured_cable(files, trials)
    found = estimate_cable(
        [trial.series for trial in trials],
        model,
        space,
        settings,
        rng(context.name, context.settings.seed, job.trial, "estimate"),
        _previous(files, space) if past(job) else None,
        evaluations=THROWN_EVALUATIONS if context.settings.aims_in_space else EVALUATIONS,
    )
    read = [files.input(role, t.number) for t in trials for role in ("track", "alignment", "hand", "summary")]
    numbers, fit = [trial.number for trial in trials], found.fit
    record = estimate_record(context, model, space.layout, numbers, fit, None, hashes_of(read))
    record.fitted = _fitted_parts(trials, found.roll)
    paths = [
        ("fitted", fit.fitted_m),
        ("predicted", found.predicted_m),
        ("string", found.string_m),
        ("predicted_string", found.predicted_string_m),
    ]
    unknowns = dict(zip(fit.space.names, fit.member_unknowns.T, strict=True))
    members = ensemble_table(fit.members, fit.member_values_m)
    members |= {name: unknowns[name] for name in fit.space.parameter_units}
    write_table(files.output("ensemble"), ENSEMBLE, members, {"roll": found.roll})
    write_table(files.output("simulated"), SIMULATED, points_table(paths, fit, trials[-1].track))
    record.write(files.output("estimate"))


def _fitted_parts(trials: list[TrialInSpace], roll: str) -> list[FittedPart]:
    """Return how much of each trial the fit has read."""
    read = frames_fitted([trial.series[roll] for trial in trials])
    parts = []
    for trial, frames in zip(trials, read, strict=True):
        # A frame stands for the time to the next one.
        between_s = np.diff(trial.series[roll].time_s, append=trial.series[roll].time_s[-1])
        counts = {"frames": int(frames.sum()), "recorded_frames": len(frames)}
        seconds = {"seconds": float(between_s[frames].sum()), "recorded_s": float(between_s.sum())}
        parts.append(FittedPart(trial=trial.number, **counts, **seconds))
    return parts


def _captured_cable(files: Files, trials: list[TrialInSpace]) -> tuple[StringModel, CableSpace]:
    """Return the model of a captured string, and the box of its unknowns; refuse trials of unlike ends."""
    string, settings = files.job.context.settings.string, files.job.context.settings.estimate
    columns, pinned = trials[-1].kind()
    for trial in trials:
        if trial.kind() != (columns, pinned):
            raise StrandcastError(
                "SC-E009",
                f"trials {trial.number} and {trials[-1].number} have other driven ends",
                file=files.input("hand", trial.number),
                fix="make an experiment for each way in which the string was driven",
            )
    return space_of_cable(
        string.length_m,
        columns > POSE,
        pinned=pinned,
        points=string.points or POINTS,
        step_s=settings.dt_s if "dt_s" in settings.model_fields_set else STEP_S,
        weight_places_m=[weight.place_m for weight in string.weights],
        **{name: getattr(settings, name) for name in TO_CAPTURES},
    )


def refuse_settings_of_the_plane(context: Context) -> None:
    """Refuse settings of fits in the plane (SC-E008), for a throw in space or a captured string."""
    thrown = context.settings.aims_in_space
    apply = APPLY | (TO_THROWS if thrown else TO_CAPTURES)
    wrong = [f"estimate.{name}" for name in sorted(context.settings.estimate.model_fields_set - apply)]
    wrong += ["string.stiff_sections"] if context.settings.string.stiff_sections else []
    if wrong:
        does, it = ("does", "it") if len(wrong) == 1 else ("do", "them")
        raise StrandcastError(
            "SC-E008",
            f"{', '.join(wrong)} {does} not apply to {'a throw' if thrown else 'a string'} in space",
            file=context.file,
            field=wrong[0],
            fix=f"leave {it} out; of estimate, {', '.join(sorted(apply))} apply",
        )


def _hand(files: Files, number: int) -> dict[str, np.ndarray]:
    return read_table(files.input("hand", number), HAND)


def read_trial_in_space(files: Files, number: int) -> TrialInSpace:
    """Read one trial's results: a throw of an arm, or a capture."""
    return (_read_throw if files.job.context.settings.aims_in_space else _read_capture)(files, number)


def _read_throw(files: Files, number: int) -> TrialInSpace:
    """Read an arm's throw: the frames around its motion, until the tip may have touched the target."""
    trial, settings = read_trial(files, number), files.job.context.settings.estimate
    until_s, reach_m = trial.alignment.motion_end_s + FITTED_AFTER_S, settings.contact_radius_m
    nearest = trial.shortfall(reach_m or 0.0)
    if nearest and reach_m is not None and nearest.miss_m <= reach_m:
        until_s = min(until_s, nearest.time_s)
    time_s, known_s = trial.frame_time_s, trial.hand_time_s
    used = time_s >= max(trial.alignment.motion_start_s - FITTED_BEFORE_S, known_s[0])
    used &= time_s <= min(until_s, known_s[-1])
    pose = np.column_stack([np.interp(time_s[used], known_s, column) for column in trial.hand_pose.T])
    places = trial.summary.places_m()[1:] / trial.summary.length_m
    points_m = trial.track.detected_m()[used, 1:]
    series = CableSeries(time_s[used], pose, points_m, places, fastest_m_s=FASTEST_M_S)
    return TrialInSpace(number, trial.track.rows(used), {"measured": series})


def _read_capture(files: Files, number: int) -> TrialInSpace:
    """Read a trial's results; the driven ends are interpolated at its frames."""
    summary = TrackSummary.read(files.input("summary", number))
    track = read_track(files.input("track", number), summary.points)
    hand = _hand(files, number)
    time_s = Alignment.read(files.input("alignment", number)).robot_time_s(track.camera_time_s)
    known_s = hand["robot_time_s"]

    def at_frames(path: np.ndarray | None) -> np.ndarray | None:
        if path is None:
            return None
        return np.column_stack([np.interp(time_s, known_s, column) for column in path.T])

    ends = []
    for end in ends_of(hand):
        place_m = at_frames(end.place_m)
        assert place_m is not None
        ends.append(DrivenEnd(place_m, at_frames(end.direction), at_frames(end.normal)))
    if not ends or track.points_m.shape[2] != 3:
        raise StrandcastError(
            "SC-E009",
            f"trial {number} is in the plane",
            file=files.input("track", number),
            fix="keep captures in the plane and in space in experiments of their own",
        )
    inside = (time_s >= known_s[0]) & (time_s <= known_s[-1])
    points_m = np.where(inside[:, None, None], track.detected_m()[:, 1:], np.nan)
    places = summary.places_m()[1:] / summary.length_m
    return TrialInSpace(number, track, series_between(time_s, ends, points_m, places))


def _previous(files: Files, space: CableSpace) -> PreviousCable | None:
    """Return the estimate before, if it was of such a string."""
    path = files.input("previous")
    rows = read_table(path, ENSEMBLE)
    if any(name not in rows for name in space.names):
        return None
    values = {name: float(rows[name][0]) for name in space.names}
    return PreviousCable(values, str(read_facts(path, ENSEMBLE).get("roll", "")))
