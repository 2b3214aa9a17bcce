"""What a trial shows of the rig's scatter: how the string hung, how it was held, how the joints followed."""

import numpy as np

from strandcast.arm.kinematics import hand_pose
from strandcast.arm.servo import Servo, respond
from strandcast.core.strings import StringBatch
from strandcast.planning.past_trials import SWAY_BEFORE_S, Measured, PastTrial, resampled
from strandcast.planning.rig_scatter import TrialDeviations
from strandcast.planning.rollouts import RolloutConditions, simulate_rollouts
from strandcast.planning.task import PlanningTask

# Errors of a tracked point and how long neighbouring frames share them, as measured for the tracker
# (docs/explanation/tracking.md); the string's model at rest is no better than that. The rest is chosen.
POINT_M, SHARED_S = 5e-4, 0.016
LENGTH_ERROR_M = 5e-4
STEP_RAD = 0.02  # of finite differences
LEAST_TRAVEL_RAD = 0.1  # a joint that moves less shows no gain


def trial_deviations(
    task: PlanningTask,
    best: StringBatch,
    trial: PastTrial,
    measured: Measured,
    servo: Servo | None,
    length_m: tuple[float, float] | None,
) -> TrialDeviations:
    """Return what a trial shows of the quantities of `planning.rig_scatter.UNITS`, as far as it was seen.

    Parameters
    ----------
    best
        The fitted string: how it would hang at rest.
    trial, measured
        The trial on its motion's clock, and as it was measured.
    servo
        The response of the joints, common to all trials; None: gain and lag are not measured.
    length_m
        Length of the string out of the clamp and its standard error, as the tracker measured it; None: it is
        taken along the points.
    """
    values: dict[str, np.ndarray] = {}
    errors: dict[str, np.ndarray] = {}
    for found in (
        _hanging(task, best, trial, measured),
        _length(measured, length_m),
        _zeros(task, measured),
        {} if servo is None else _following(task, trial, servo),
    ):
        values |= {name: value for name, (value, _) in found.items()}
        errors |= {name: error for name, (_, error) in found.items()}
    return TrialDeviations(trial.trial, values, errors)


Found = dict[str, tuple[np.ndarray, np.ndarray]]  # quantity -> values, standard errors


def _still(measured: Measured) -> np.ndarray:
    """Return the string before the start, from its hand: (F, n, 2), only whole frames."""
    before = (measured.frame_s <= 0.0) & (measured.frame_s >= -SWAY_BEFORE_S)
    points = measured.points_m[before]
    points = points[np.isfinite(points).all(axis=(1, 2))]
    return np.asarray(points[:, 1:] - points[:, :1])


def _point_error_m(still: np.ndarray, measured: Measured) -> float:
    """Return the standard error of a point's mean over the still frames."""
    step_s = float(np.median(np.diff(measured.frame_s)))
    return POINT_M * float(np.sqrt(max(SHARED_S / step_s, 1.0) / len(still)))


def _hanging(task: PlanningTask, best: StringBatch, trial: PastTrial, measured: Measured) -> Found:
    """Return the turn about the hand that takes the string at rest to how it hung, and its rate.

    A turn in the clamp moves a hanging string almost as a whole: it looks like a turn about the
    hand.
    """
    still = _still(measured)
    resting = np.tile(trial.q_rad[0], (1, 2, 1))
    rollouts = simulate_rollouts(task, best.first(1), RolloutConditions(), resting, np.array([1]))
    shape = rollouts.points_m[0, 0]
    if len(still) < 3 or not np.isfinite(shape).all():
        return {}
    rest = shape[1:] - shape[0]
    across = np.stack([-rest[:, 1], rest[:, 0]], axis=1)
    off, lever_m = still.mean(axis=0) - rest, float(np.sqrt((rest**2).sum()))
    sway = float((across * off).sum() / lever_m**2)
    # The tracker's errors, and those of the model at rest, which neighbouring points share.
    left_m = float(np.sqrt(np.mean((off - sway * across) ** 2)))
    point_m = _point_error_m(still, measured)
    rate_error = point_m * np.sqrt(12.0) / (SWAY_BEFORE_S * lever_m)
    sway_error = np.hypot(point_m / lever_m, left_m / np.linalg.norm(rest[-1]))
    return {"sway_rad": _one(sway, sway_error), "sway_rad_s": _one(trial.sway_rad_s, rate_error)}


def _length(measured: Measured, length_m: tuple[float, float] | None) -> Found:
    """Return the length of the string out of the clamp: the tracker's, or along the points at rest."""
    if length_m is not None:
        return {"grasp_length_m": _one(*length_m)}
    still = _still(measured)
    if not len(still):
        return {}
    points = np.concatenate([np.zeros((1, 2)), still.mean(axis=0)])
    along_m = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    return {"grasp_length_m": _one(along_m, LENGTH_ERROR_M)}


def _zeros(task: PlanningTask, measured: Measured) -> Found:
    """Return errors of the joints' zeros, from the tracked hand.

    The alignment's zeros are drawn towards zero by their prior, and would hide how much they scatter.
    With them an offset of the string in the clamp is fitted, which turns with the hand. The zero of the last
    joint moves the hand in the same way and is not known.
    """
    joints = measured.q_rad.shape[1]
    hand_m = measured.points_m[:, 0]
    seen = np.isfinite(hand_m).all(axis=1) & (measured.frame_s >= measured.joint_time_s[0])
    seen &= measured.frame_s <= measured.joint_time_s[-1]
    if seen.sum() < 10 * joints:
        return {}
    frame_s = measured.frame_s[seen]
    q_rad = resampled(frame_s, measured.joint_time_s, measured.q_rad)
    chain, clamp = task.arm.chain, task.arm.clamp
    pose = hand_pose(chain, clamp, q_rad).array()
    slopes = [
        (hand_pose(chain, clamp, q_rad + step).position_m - pose[:, :2]) / STEP_RAD
        for step in STEP_RAD * np.eye(joints)[:-1]
    ]
    cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    slopes += [np.stack([cos, sin], axis=1), np.stack([-sin, cos], axis=1)]
    columns = np.stack([slope.ravel() for slope in slopes], axis=1)
    fit, errors = _least_squares(columns, (hand_m[seen] - pose[:, :2]).ravel(), frame_s)
    return {"joint_zero_rad": (np.append(fit[: joints - 1], np.nan), np.append(errors[: joints - 1], np.nan))}


def _following(task: PlanningTask, trial: PastTrial, servo: Servo) -> Found:
    """Return by how much each joint's travel is larger, and its lag longer, than in the response."""
    time_s = np.arange(len(trial.q_rad)) * task.step_s
    answer = respond(servo, time_s, trial.q_command_rad)
    gain, lag = np.full((2, 2, trial.q_rad.shape[1]), np.nan)
    for joint, (expected, seen) in enumerate(zip(answer.T, trial.q_rad.T, strict=True)):
        if np.ptp(expected) < LEAST_TRAVEL_RAD:
            continue
        columns = np.stack(
            [expected - expected[0], -np.gradient(expected, time_s), np.ones_like(time_s)], axis=1
        )
        fit, errors = _least_squares(columns, seen - expected, time_s)
        gain[:, joint], lag[:, joint] = (fit[0], errors[0]), (fit[1], errors[1])
    return {"servo_gain": (gain[0], gain[1]), "servo_lag_s": (lag[0], lag[1])}


def _least_squares(columns: np.ndarray, off: np.ndarray, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the fit and its standard errors, with residuals that frames share for `SHARED_S`."""
    fit, *_ = np.linalg.lstsq(columns, off, rcond=None)
    left = off - columns @ fit
    shared = max(SHARED_S / float(np.median(np.diff(time_s))), 1.0)
    power = float(left @ left) / max(len(off) - columns.shape[1], 1) * shared
    return fit, np.sqrt(power * np.diag(np.linalg.pinv(columns.T @ columns)))


def _one(value: float, error: float) -> tuple[np.ndarray, np.ndarray]:
    return np.array([value]), np.array([error])
