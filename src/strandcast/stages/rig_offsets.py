"""What the arm's file states wrongly, by all trials with a joint log; for estimate and `strandcast rig`."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from strandcast.alignment.joints import joint_path
from strandcast.arm.load import PlanarArm
from strandcast.core.strings import CLAMP_OFFSET
from strandcast.records.camera import Camera
from strandcast.records.estimate import Estimate, RigOffsets
from strandcast.rig.offsets import LEAST_FRAMES, HandSeen, fit_offsets
from strandcast.rig.words import StringInClamp, rig_offsets_record
from strandcast.stages.past_trials import Trial

LATERAL = ("lateral_offset_m", "lateral_offset_sigma_m")  # of the tracker's choices


def rig_offsets_of(
    arm: PlanarArm, trials: Sequence[Trial], cameras: Iterable[Path], estimate: Estimate | None
) -> RigOffsets | None:
    """Return what the trials with a joint log show of the arm's file; None for fewer than two of them.

    `estimate` holds the string that was fitted to them, if one was.
    """
    found = {trial.number: _hand_seen(arm, trial) for trial in trials if trial.log is not None}
    seen = {number: hand for number, hand in found.items() if hand is not None}
    fit = fit_offsets(arm, list(seen.values()), max(map(_plane_sd_m, cameras), default=0.0))
    if fit is None:
        return None
    known = [
        [trial.summary.choices.get(name) for name in LATERAL] for trial in trials if trial.number in seen
    ]
    left_m, error_m = np.array(known, float).T  # None is NaN
    turn = None if estimate is None else _fitted_turn(estimate)
    point_m = trials[-1].summary.length_m / trials[-1].summary.points
    return rig_offsets_record(arm, list(seen), fit, StringInClamp(left_m, error_m, turn, point_m))


def _hand_seen(arm: PlanarArm, trial: Trial) -> HandSeen | None:
    """Return the tracked hand of a trial, and the joints by its log then, without the rows' noise.

    None if too few frames or rows are there.
    """
    log = trial.log
    assert log is not None
    hand_m = trial.track.detected_m()[:, 0]
    known = np.isfinite(hand_m).all(axis=1)
    known &= (trial.frame_time_s >= log.time_s[0]) & (trial.frame_time_s <= log.time_s[-1])
    known &= np.diff(trial.frame_time_s, prepend=-np.inf) > 0.0
    time_s, (log_s, q_rad) = trial.frame_time_s[known], log.in_order(arm.joints)
    if len(time_s) < LEAST_FRAMES or ((log_s >= time_s[0]) & (log_s <= time_s[-1])).sum() < LEAST_FRAMES:
        return None
    path = joint_path(log_s, q_rad, (float(time_s[0]), float(time_s[-1])))
    return HandSeen(time_s, hand_m[known], path.at(time_s))


def _plane_sd_m(camera: Path) -> float:
    """Return the largest standard error of a point in a camera's plane; 0 where it is not known."""
    error = Camera.read(camera).plane_error
    return 0.0 if error is None else error.worst_m


def _fitted_turn(estimate: Estimate) -> tuple[float, float] | None:
    """Return the fitted turn of the string in the clamp and its standard deviation, None if not fitted."""
    known = estimate.uncertainty
    if known is None or CLAMP_OFFSET not in estimate.options or CLAMP_OFFSET not in known.unknowns:
        return None
    return estimate.options[CLAMP_OFFSET], known.marginal_sd[known.unknowns.index(CLAMP_OFFSET)]
