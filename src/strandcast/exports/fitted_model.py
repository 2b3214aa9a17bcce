"""`export mjcf`: the string fitted after a trial as a MuJoCo model, checked against that trial's track."""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import savgol_filter

from strandcast.api import TrialView
from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import load_arm
from strandcast.core.interpolation import resampled
from strandcast.core.strings import CAMERA_OFFSET
from strandcast.dynamics.batch import HANGING_AT_REST, HandPath
from strandcast.dynamics.simulate import simulate_batch
from strandcast.estimation.evaluation import distances, evaluation_of_points, point_values
from strandcast.estimation.measured import prepare
from strandcast.estimation.throws import PreparedThrow
from strandcast.exports.mjcf import (
    HAND_KG,
    STRING_KG,
    StringInMuJoCo,
    arm_with_string,
    in_mujoco,
    string_on_hand,
)
from strandcast.exports.throw import refuse_in_space
from strandcast.records.files import write_bytes
from strandcast.stages.declarations import STAGES
from strandcast.stages.estimate import throw_of
from strandcast.stages.job import Files, Job
from strandcast.stages.past_trials import read_members, read_trial, string_model

# Rigid links pass the encoders' noise on to all masses as accelerations of a hundred g; chosen.
SMOOTHED_S = 0.05
FASTEST_RAD_S = 2e4


@dataclass(frozen=True)
class ExportedModel:
    """An exported model, and E on the trial's track [m]: in MuJoCo (infinite if it diverges), in ours."""

    file: Path
    E_m: float
    own_E_m: float


def export_mjcf(trial: TrialView, out: Path, total_kg: float = STRING_KG) -> ExportedModel:
    """Write the string fitted after a trial, on the experiment's arm, as MJCF.

    Parameters
    ----------
    total_kg
        Mass of the string with all it carries: video and joints cannot show it.
    """
    refuse_in_space(trial)
    context = trial.context
    arm, settings = load_arm(context.arm_file).planar(), context.settings.estimate
    model, layout = string_model(context, arm)
    measured = read_trial(Files(STAGES["estimate"], Job(context, trial.number)), trial.number)
    string = read_members(trial.folder.results / "ensemble.parquet", layout).first(1)
    shifted = settings.camera_offset_sd_m is not None
    throw = prepare(
        throw_of(measured, settings), model.places_m(), settings.start_shape, from_measured_hand=shifted
    )
    start_m = simulate_batch(model, string, throw.hand, throw.hand.time_s[:1], throw.start)[0][0, 0]
    plain = in_mujoco(string, model.length_m, float(string.masses.sum()))
    points_m = play(throw, start_m, plain) + np.array([string[name][0] for name in CAMERA_OFFSET])
    apart_m = distances(throw.points_m, points_m, settings.evaluation)
    E_m = float(evaluation_of_points(point_values(apart_m, throw.weight)))
    posture = np.zeros(len(arm.joints))
    if measured.motion is not None:
        posture = measured.motion.trajectory().q_rad[0]
    pose = hand_pose(arm.chain, arm.clamp, posture).array()
    still = HandPath(np.array([0.0, 1.0]), np.stack([pose, pose]))
    at_rest = simulate_batch(model, string, still, np.zeros(1), HANGING_AT_REST)[0][0, 0]
    steps = np.diff(at_rest, axis=0)
    bends = np.diff(np.unwrap(np.r_[pose[2], np.arctan2(steps[:, 1], steps[:, 0])]))
    xml = arm_with_string(arm, in_mujoco(string, model.length_m, total_kg), posture, bends)
    write_bytes(out, xml.encode())
    return ExportedModel(out, E_m if np.isfinite(E_m) else np.inf, trial.estimate.record.E_m)


def play(
    throw: PreparedThrow, start_m: np.ndarray, string: StringInMuJoCo, step_s: float | None = None
) -> np.ndarray:
    """Return the points (G, n+1, 2) at the throw's frames, NaN from a divergence on [m].

    `start_m` are the string's points (n+1, 2) at the start of the hand's path [m]; the string is in units of
    its plain points' mass.
    """
    step_s = step_s or string.step_s
    model = string_on_hand(string, step_s)
    data = mujoco.MjData(model)
    hand = _smooth(throw.hand)
    start_s, end_s = throw.hand.time_s[0], throw.time_s[-1]
    time_s = start_s + np.arange(int(np.ceil((end_s - start_s) / step_s)) + 1) * step_s
    pose, rate = hand(time_s), hand(time_s, 1)
    kinds = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
    # The first three joints are the hand's.
    bends, stretches = (np.flatnonzero(model.jnt_type[3:] == int(kind)) + 3 for kind in kinds)
    turned, longer = _start(throw, start_m, string.spacing_m, pose[0], rate[0])
    (data.qpos[bends], data.qvel[bends]) = turned
    if len(stretches):
        (data.qpos[stretches], data.qvel[stretches]) = longer
    q = np.full((len(time_s), model.nq), np.nan)
    push = HAND_KG * np.diff(rate, axis=0) / step_s
    for k in range(len(time_s)):
        data.qpos[:3], data.qvel[:3] = pose[k], rate[k]  # without the rounding that adds up
        q[k] = data.qpos
        if k == len(push) or not np.abs(data.qvel).max() < FASTEST_RAD_S:
            break
        data.qfrc_applied[:3] = push[k]
        mujoco.mj_step(model, data)
    at = resampled(throw.time_s, time_s, q)
    angle = at[:, 2:3] + np.cumsum(at[:, bends], axis=1)
    length = string.spacing_m + (at[:, stretches] if len(stretches) else 0.0)
    steps = np.stack([length * np.cos(angle), length * np.sin(angle)], axis=-1)
    return np.cumsum(np.concatenate([at[:, None, :2], steps], axis=1), axis=1)


def _start(
    throw: PreparedThrow, start_m: np.ndarray, spacing_m: float, pose: np.ndarray, rate: np.ndarray
) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Return the hinges' angles and rates, and the links' stretch and its rate, at the start: (n,) each."""
    segment = np.diff(start_m, axis=0)
    length = np.linalg.norm(segment, axis=1)
    angle = np.unwrap(np.r_[pose[2], np.arctan2(segment[:, 1], segment[:, 0])])
    velocity = np.zeros((len(start_m), 2))
    if throw.start.velocity_m_s is not None:
        velocity[1:], velocity[0] = throw.start.velocity_m_s, rate[:2]
    change = np.diff(velocity, axis=0)
    across = segment[:, 0] * change[:, 1] - segment[:, 1] * change[:, 0]
    along = (segment * change).sum(axis=1) / length
    turning = np.r_[rate[2], across / length**2]
    return (np.diff(angle), np.diff(turning)), (length - spacing_m, along)


def _smooth(hand: HandPath) -> CubicSpline:
    """Return the hand's path x, y [m], angle [rad] without its samples' noise; it rests after the last."""
    step_s = float(np.median(np.diff(hand.time_s)))
    window = min(2 * round(0.5 * SMOOTHED_S / step_s) + 1, (len(hand.time_s) - 1) // 2 * 2 + 1)
    pose = savgol_filter(hand.pose, window, 3, axis=0) if window > 3 else hand.pose
    rest_s = hand.time_s[-1] + step_s * np.arange(1, window + 1)
    return CubicSpline(np.r_[hand.time_s, rest_s], np.r_[pose, np.tile(pose[-1], (len(rest_s), 1))])
