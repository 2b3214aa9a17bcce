"""Trials in space as the fit takes them: throws of an arm, and captures."""

from dataclasses import replace

import numpy as np

from strandcast.dynamics.model import StringModel
from strandcast.errors import StrandcastError
from strandcast.estimation.cable_series import CableSeries, end_pose, free_to_roll, series_between
from strandcast.estimation.cable_space import POINTS, CableSpace
from strandcast.estimation.throws import TrialParts
from strandcast.estimation.windows import parts_by_roll
from strandcast.imports.track_checks import DrivenPath
from strandcast.records.alignment import EndPath
from strandcast.records.estimate import FittedPart
from strandcast.records.record import refusal
from strandcast.records.track import LONGEST_PLACE
from strandcast.stages.arms import arm_of
from strandcast.stages.context import Context, free_length_m
from strandcast.stages.job import Files
from strandcast.stages.past_trials import Trial, cable_of, read_trial, spatial_settings, thrown_cable, until_s

# Of a throw; chosen.
FITTED_BEFORE_S, FITTED_AFTER_S = 0.08, 0.10  # around the motion
FASTEST_M_S = 40.0  # faster markers are errors: no tip is as fast


def parts_in_space(files: Files, trials: list[Trial], points: int) -> dict[str, TrialParts]:
    """Return what is fitted of trials, for strings of n = `points`; see `parts_by_roll`."""
    settings = spatial_settings(files.job.context)
    kept = trials[-1:] if settings.trials == "latest" else trials
    series, skipped = [series_of(files, trial) for trial in kept], len(trials) - len(kept)
    return parts_by_roll(series, points, start_shape=settings.start_shape, skipped=skipped)


def fitted_parts(trials: list[Trial], parts: TrialParts) -> list[FittedPart]:
    """Return how much of each trial a fit has read."""
    found = []
    for number, trial in enumerate(trials):
        time_s = trial.frame_time_s
        frames = np.zeros(len(time_s), dtype=bool)
        for row in np.flatnonzero(parts.trial == number):
            frames[parts.throws[row].frames] = True
        # A frame stands for the time to the next one.
        between_s = np.diff(time_s, append=time_s[-1])
        counts = {"frames": int(frames.sum()), "recorded_frames": len(frames)}
        seconds = {"seconds": float(between_s[frames].sum()), "recorded_s": float(between_s.sum())}
        found.append(FittedPart(trial=trial.number, **counts, **seconds))
    return found


def cable_of_trials(files: Files, trials: list[Trial]) -> tuple[StringModel, CableSpace]:
    """Return the model of a string in space, and the box of its unknowns; refuse trials of unlike ends."""
    context = files.job.context
    if context.settings.aims_in_space:
        return thrown_cable(context, arm_of(context))
    string, ends = context.settings.string, trials[-1].ends
    for trial in trials:
        if _kind(trial.ends) != _kind(ends):
            raise StrandcastError(
                "SC-E009",
                f"trials {trial.number} and {trials[-1].number} have other driven ends",
                file=files.input("hand", trial.number),
                fix="name the ends alike, all with an orientation or all with behind; or make an experiment "
                "for each way in which the string was driven",
            )
    points = string.points or POINTS
    length_m, pinned = length_in_space_m(context), ends[0].direction is None
    return cable_of(context, length_m, len(ends) > 1, points, pinned=pinned)


def _kind(ends: list[EndPath]) -> tuple[int, bool, bool]:
    """Return how many driven ends there are, and whether they are points, or of an unknown roll."""
    return len(ends), ends[0].direction is None, free_to_roll(ends)


def read_trial_in_space(files: Files, number: int) -> Trial:
    """Read one trial's results; of an arm's throw the frames around its motion.

    They end before the tip may have touched the target.
    """
    trial, context = read_trial(files, number, in_space=True), files.job.context
    if not trial.ends or trial.track.points_m.shape[2] != 3:
        raise StrandcastError(
            "SC-E009",
            f"trial {number} is in the plane",
            file=files.input("track", number),
            fix="keep captures in the plane and in space in experiments of their own",
        )
    if not context.settings.aims_in_space:
        return trial
    time_s, known_s = trial.frame_time_s, trial.hand_time_s
    last_s = min(trial.alignment.motion_end_s + FITTED_AFTER_S, until_s(trial, spatial_settings(context)))
    used = time_s >= max(trial.alignment.motion_start_s - FITTED_BEFORE_S, known_s[0])
    used &= time_s <= min(last_s, known_s[-1])
    return replace(trial, track=trial.track.rows(used), frame_time_s=time_s[used])


def series_of(files: Files, trial: Trial) -> dict[str, CableSeries]:
    """Return a trial's motion with every roll that the driven ends may have.

    The ends of a capture are smoothed, those of a throw were at its import.
    """
    time_s, known_s, points_m = trial.frame_time_s, trial.hand_time_s, trial.track.detected_m()[:, 1:]
    places, ends = _places(files, trial), DrivenPath(known_s, trial.ends).at(time_s).ends
    if files.job.context.settings.aims_in_space:
        pose = end_pose(ends[0], "measured")
        return {"measured": CableSeries(time_s, pose, points_m, places, fastest_m_s=FASTEST_M_S)}
    inside = (time_s >= known_s[0]) & (time_s <= known_s[-1])
    points_m = np.where(inside[:, None, None], points_m, np.nan)
    return series_between(time_s, ends, points_m, places)


def length_in_space_m(context: Context) -> float:
    """Return the present length of the free string [m]."""
    clamped = context.settings.aims_in_space or context.views  # else the capture begins at a body
    return free_length_m(context, arm_of(context).clamp.clamped_length_m if clamped else 0.0)


def _places(files: Files, trial: Trial) -> np.ndarray:
    """Return where the track's points are (m,) along the present string, 0 to 1."""
    length_m = length_in_space_m(files.job.context)
    places_m = trial.summary.places_m(length_m)[1:]
    if places_m.max() > LONGEST_PLACE * length_m:
        what = f"a marker at {places_m.max():g} m lies beyond the string's {length_m:g} m"
        fix = "correct string.length_m in experiment.yaml, or import the trial again with other places"
        raise refusal("SC-I013", files.input("summary", trial.number), "choices", what, fix)
    return places_m / length_m
