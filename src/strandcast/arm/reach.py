"""Where the hand and what hangs from it can get to during a motion, a stop at any instant included."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import Arm
from strandcast.arm.stop import SoftStop

EVERY_S = 0.004
ROUGHLY_EVERY_S = 0.008
FEW_JOINTS = 4  # for which the middle of each joint's stop is looked at too


@dataclass(frozen=True, eq=False)
class Reach:
    """What a motion sweeps.

    Attributes
    ----------
    hand_m
        (2, 2) low and high of x and y of the hand on its path [m].
    swept_m
        The same of the hand and what hangs from it, wherever the arm is stopped.
    stop_rad
        (J,) how far each joint turns on when it is stopped at the worst instant [rad].
    beyond_rad
        (J,) how far that may carry it past its range, margins taken off, or zero [rad].
    """

    hand_m: np.ndarray
    swept_m: np.ndarray
    stop_rad: np.ndarray
    beyond_rad: np.ndarray


def reach_of(
    arm: Arm, time_s: np.ndarray, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, hanging_m: float
) -> Reach:
    """Return what a motion sweeps.

    Parameters
    ----------
    time_s, q, qd, qdd
        (T,) [s]; (T, J) the motion, densely.
    hanging_m
        Length of what hangs from the hand [m]; it may be anywhere that near to the hand.

    Notes
    -----
    A joint may come to rest anywhere between where it is and the further of two stops: the player's soft
    stop, and the controller's own, whose angle at full speed the arm's file tells (it grows with the square
    of the speed; in proportion to it is on the safe side). The joints need not stop together.
    """
    every = max(1, round(EVERY_S / float(np.median(np.diff(time_s)))))
    rows = np.unique(np.append(np.arange(0, len(time_s), every), len(time_s) - 1))
    q, qd, qdd = q[rows], qd[rows], qdd[rows]
    soft = SoftStop(arm.stop.acceleration_rad_s2, arm.stop.jerk_rad_s3).resting_place(q, qd, qdd) - q
    hard = arm.stop.distance_rad * qd / arm.limits.velocity_rad_s
    low, high = np.minimum(np.minimum(soft, hard), 0.0), np.maximum(np.maximum(soft, hard), 0.0)
    hand = _box(hand_pose(arm.chain, arm.clamp, q)[..., :2])
    swept = _box(_resting_hands(arm, q, low, high))
    beyond = np.maximum((q + high) - arm.limits.upper_rad, arm.limits.lower_rad - (q + low)).max(axis=0)
    return Reach(
        hand_m=hand,
        swept_m=swept + hanging_m * np.array([-1.0, 1.0]),
        stop_rad=np.maximum(high, -low).max(axis=0),
        beyond_rad=np.maximum(beyond, 0.0),
    )


def roughly_outside_m(arm: Arm, q: np.ndarray, step_s: float, hanging_m: float) -> np.ndarray:
    """Return (P,) how far out of the arm's workspace P motions may end if stopped, for a search [m].

    It takes a quarter of `reach_of`'s time and is no less, but for what a stop swings back.

    Parameters
    ----------
    q
        (P, T, J) angles [rad], every `step_s`.
    """
    every = max(1, round(ROUGHLY_EVERY_S / step_s))
    qd = np.gradient(q, step_s, axis=1)
    qdd = np.gradient(qd, step_s, axis=1)[:, ::every]
    q, qd = q[:, ::every], qd[:, ::every]
    brake, jerk = arm.stop.acceleration_rad_s2, arm.stop.jerk_rad_s3
    # First what still speeds a joint up is taken off, then the joint brakes.
    pushed = np.minimum(np.maximum(qdd * np.sign(qd), 0.0), brake)
    speed = np.abs(qd) + pushed**2 / (2.0 * jerk)
    soft = np.abs(qd) * pushed / jerk + pushed**3 / (3.0 * jerk**2)
    soft += speed**2 / (2.0 * brake) + speed * brake / (2.0 * jerk)
    hard = arm.stop.distance_rad * np.abs(qd) / arm.limits.velocity_rad_s
    further = np.sign(qd) * np.maximum(soft, hard)
    hands = _resting_hands(arm, q, np.minimum(further, 0.0), np.maximum(further, 0.0))
    workspace = np.array([arm.workspace.x_m, arm.workspace.y_m])
    beyond = np.maximum(workspace[:, 0] - hands, hands - workspace[:, 1]) + hanging_m
    return np.asarray(np.maximum(beyond.max(axis=(1, 2, 3)), 0.0))


def _resting_hands(arm: Arm, q: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return (..., W, 2) where the hand may come to rest, its joints (..., J) turning on by low to high."""
    shares = (0.0, 0.5, 1.0) if len(arm.joints) <= FEW_JOINTS else (0.0, 1.0)
    ways = np.array(list(product(shares, repeat=len(arm.joints))))
    rest = (q + low)[..., None, :] + ways * (high - low)[..., None, :]
    return hand_pose(arm.chain, arm.clamp, rest)[..., :2]


def outside_m(arm: Arm, box_m: np.ndarray) -> float:
    """Return how far a box (2, 2) reaches out of the arm's workspace, zero if nowhere [m]."""
    workspace = np.array([arm.workspace.x_m, arm.workspace.y_m])
    return float(max(0.0, (workspace[:, 0] - box_m[:, 0]).max(), (box_m[:, 1] - workspace[:, 1]).max()))


def _box(points: np.ndarray) -> np.ndarray:
    flat = points.reshape(-1, 2)
    return np.stack([flat.min(axis=0), flat.max(axis=0)], axis=1)
