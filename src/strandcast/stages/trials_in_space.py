"""Trials in space as the fit takes them: throws of an arm, and captures."""

from dataclasses import dataclass

import numpy as np

from strandcast.dynamics.model import StringModel
from strandcast.dynamics.spatial.clamps import POSE
from strandcast.errors import StrandcastError
from strandcast.estimation.cable_series import CableSeries, DrivenEnd, series_between
from strandcast.estimation.cable_space import POINTS, CableSpace
from strandcast.estimation.throws import TrialParts
from strandcast.estimation.windows import parts_by_roll
from strandcast.imports.track_checks import DrivenPath
from strandcast.records.alignment import HAND, Alignment, ends_of
from strandcast.records.estimate import FittedPart
from strandcast.records.record import refusal
from strandcast.records.tables import read_table
from strandcast.records.track import LONGEST_PLACE, Track, TrackSummary, read_track
from strandcast.stages.arms import arm_of
from strandcast.stages.context import Context, free_length_m
from strandcast.stages.job import Files
from strandcast.stages.past_trials import cable_of, read_trial, spatial_settings, thrown_cable, until_s

# Of a throw; chosen.
FITTED_BEFORE_S, FITTED_AFTER_S = 0.08, 0.10  # around the motion
FASTEST_M_S = 40.0  # faster markers are errors: no tip is as fast


@dataclass(frozen=True, eq=False)
class TrialInSpace:
    """A trial in space: its track, and its motion with every roll that the driven ends may have."""

    number: int
    track: Track
    series: dict[str, CableSeries]

    def kind(self) -> tuple[int, bool, bool]:
        """Return columns of the driven ends, and whether they are points, and their roll is measured."""
        series = next(iter(self.series.values()))
        return series.pose.shape[1], series.pinned, "measured" in self.series


def parts_in_space(files: Files, trials: list[TrialInSpace], points: int) -> dict[str, TrialParts]:
    """Return what is fitted of trials, for strings of n = `points`; see `parts_by_roll`."""
    settings = spatial_settings(files.job.context)
    kept = trials[-1:] if settings.trials == "latest" else trials
    series, skipped = [trial.series for trial in kept], len(trials) - len(kept)
    return parts_by_roll(series, points, start_shape=settings.start_shape, skipped=skipped)


def fitted_parts(trials: list[TrialInSpace], parts: TrialParts) -> list[FittedPart]:
    """Return how much of each trial a fit has read."""
    found = []
    for number, trial in enumerate(trials):
        time_s = next(iter(trial.series.values())).time_s
        frames = np.zeros(len(time_s), dtype=bool)
        for row in np.flatnonzero(parts.trial == number):
            frames[parts.throws[row].frames] = True
        # A frame stands for the time to the next one.
        between_s = np.diff(time_s, append=time_s[-1])
        counts = {"frames": int(frames.sum()), "recorded_frames": len(frames)}
        seconds = {"seconds": float(between_s[frames].sum()), "recorded_s": float(between_s.sum())}
        found.append(FittedPart(trial=trial.number, **counts, **seconds))
    return found


def cable_of_trials(files: Files, trials: list[TrialInSpace]) -> tuple[StringModel, CableSpace]:
    """Return the model of a string in space, and the box of its unknowns; refuse trials of unlike ends."""
    context = files.job.context
    if context.settings.aims_in_space:
        return thrown_cable(context, arm_of(context))
    string, (columns, pinned, _) = context.settings.string, trials[-1].kind()
    for trial in trials:
        if trial.kind() != trials[-1].kind():
            raise StrandcastError(
                "SC-E009",
                f"trials {trial.number} and {trials[-1].number} have other driven ends",
                file=files.input("hand", trial.number),
                fix="name the ends alike, all with an orientation or all with behind; or make an experiment "
                "for each way in which the string was driven",
            )
    return cable_of(context, string.length_m, columns > POSE, string.points or POINTS, pinned=pinned)


def read_trial_in_space(files: Files, number: int) -> TrialInSpace:
    """Read one trial's results: a throw of an arm, or a capture."""
    return (_read_throw if files.job.context.settings.aims_in_space else _read_capture)(files, number)


def _read_throw(files: Files, number: int) -> TrialInSpace:
    """Read an arm's throw: the frames around its motion, until the tip may have touched the target."""
    trial = read_trial(files, number)
    last_s = trial.alignment.motion_end_s + FITTED_AFTER_S
    last_s = min(last_s, until_s(trial, spatial_settings(files.job.context)))
    time_s, known_s = trial.frame_time_s, trial.hand_time_s
    used = time_s >= max(trial.alignment.motion_start_s - FITTED_BEFORE_S, known_s[0])
    used &= time_s <= min(last_s, known_s[-1])
    pose = np.column_stack([np.interp(time_s[used], known_s, column) for column in trial.hand_pose.T])
    places = _places(files, number, trial.summary)
    points_m = trial.track.detected_m()[used, 1:]
    series = CableSeries(time_s[used], pose, points_m, places, fastest_m_s=FASTEST_M_S)
    return TrialInSpace(number, trial.track.rows(used), {"measured": series})


def _read_capture(files: Files, number: int) -> TrialInSpace:
    """Read a trial's results; the driven ends are interpolated at its frames."""
    summary = TrackSummary.read(files.input("summary", number))
    track = read_track(files.input("track", number), summary.points)
    hand = read_table(files.input("hand", number), HAND)
    time_s = Alignment.read(files.input("alignment", number)).robot_time_s(track.camera_time_s)
    known_s = hand["robot_time_s"]
    ends = [DrivenEnd(*end) for end in DrivenPath(known_s, ends_of(hand)).at(time_s).ends]
    if not ends or track.points_m.shape[2] != 3:
        raise StrandcastError(
            "SC-E009",
            f"trial {number} is in the plane",
            file=files.input("track", number),
            fix="keep captures in the plane and in space in experiments of their own",
        )
    inside = (time_s >= known_s[0]) & (time_s <= known_s[-1])
    points_m = np.where(inside[:, None, None], track.detected_m()[:, 1:], np.nan)
    places = _places(files, number, summary)
    return TrialInSpace(number, track, series_between(time_s, ends, points_m, places))


def length_in_space_m(context: Context) -> float:
    """Return the present length of the free string [m]."""
    thrown = context.settings.aims_in_space
    return free_length_m(context, arm_of(context).clamp.clamped_length_m if thrown else 0.0)


def _places(files: Files, number: int, summary: TrackSummary) -> np.ndarray:
    """Return where the track's points are (m,) along the present string, 0 to 1."""
    length_m = length_in_space_m(files.job.context)
    places_m = summary.places_m(length_m)[1:]
    if places_m.max() > LONGEST_PLACE * length_m:
        what = f"a marker at {places_m.max():g} m lies beyond the string's {length_m:g} m"
        fix = "correct string.length_m in experiment.yaml, or import the trial again with other places"
        raise refusal("SC-I013", files.input("summary", number), "choices", what, fix)
    return places_m / length_m
