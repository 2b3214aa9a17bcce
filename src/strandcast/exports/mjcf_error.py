"""An exported string in MuJoCo, moved by the measured path of the hand, to compare it with the track."""

from __future__ import annotations

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import savgol_filter

from strandcast.dynamics.batch import HandPath
from strandcast.estimation.throws import PreparedThrow
from strandcast.exports.mjcf import HAND_KG, StringInMuJoCo, string_on_hand

# Rigid links pass the encoders' noise on to all masses as accelerations of a hundred g; chosen.
SMOOTHED_S = 0.05
FASTEST_RAD_S = 2e4


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
    at = np.stack([np.interp(throw.time_s, time_s, column) for column in q.T], axis=1)
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
