"""The region that hand and string can reach during a motion, including a stop at any instant."""

from dataclasses import dataclass
from itertools import product

import numpy as np

from strandcast.arm.load import Arm
from strandcast.arm.stop import SoftStop, turned_in_stop
from strandcast.core.trajectory import JointTrajectory

# Chosen; not sensitive: the hand moves some centimetres in between.
EVERY_S = 0.004
ROUGHLY_EVERY_S = 0.008
FEW_JOINTS = 4  # for which the middle of each joint's stop is checked too


@dataclass(frozen=True, eq=False)
class Reach:
    """The region that a motion sweeps.

    Attributes
    ----------
    hand_m
        (2 or 3, 2) least and greatest coordinates of the hand on its path [m].
    swept_m
        The same for the hand and the string, wherever the arm is stopped.
    stop_rad
        (J,) how far each joint still turns when it is stopped at the worst instant [rad].
    beyond_rad
        (J,) how far that may carry it beyond its range less the margin, or zero [rad].
    """

    hand_m: np.ndarray
    swept_m: np.ndarray
    stop_rad: np.ndarray
    beyond_rad: np.ndarray


def reach_of(arm: Arm, motion: JointTrajectory, hanging_m: float) -> Reach:
    """Return the region that a densely sampled motion sweeps.

    The string may be anywhere within `hanging_m` from the hand. A joint may come to rest anywhere between its
    angle and the further of two stops: the player's soft stop, and the controller's own (see
    `turned_in_stop`). The joints need not stop together.
    """
    time_s = motion.time_s
    every = max(1, round(EVERY_S / float(np.median(np.diff(time_s)))))
    rows = np.unique(np.append(np.arange(0, len(time_s), every), len(time_s) - 1))
    q, qd, qdd = motion.q_rad[rows], motion.qd_rad_s[rows], motion.qdd_rad_s2[rows]
    soft = SoftStop(arm.stop.acceleration_rad_s2, arm.stop.jerk_rad_s3).resting_place(q, qd, qdd) - q
    hard = arm.stop.distance_rad * qd / arm.limits.velocity_rad_s
    low, high = np.minimum(np.minimum(soft, hard), 0.0), np.maximum(np.maximum(soft, hard), 0.0)
    hand = _box(arm.hand_m(q))
    swept = _box(_resting_hands(arm, q, low, high))
    beyond = np.maximum((q + high) - arm.limits.upper_rad, arm.limits.lower_rad - (q + low)).max(axis=0)
    return Reach(
        hand_m=hand,
        swept_m=swept + hanging_m * np.array([-1.0, 1.0]),
        stop_rad=np.maximum(high, -low).max(axis=0),
        beyond_rad=np.maximum(beyond, 0.0),
    )


def roughly_outside_m(arm: Arm, q: np.ndarray, step_s: float, hanging_m: float) -> np.ndarray:
    """Return (P,) how far outside the arm's workspace P motions may end if stopped, for a search [m].

    It takes a quarter of `reach_of`'s time and is an upper bound, except for stops that swing back.

    Parameters
    ----------
    q
        (P, T, J) angles [rad], every `step_s`.
    """
    every = max(1, round(ROUGHLY_EVERY_S / step_s))
    qd = np.gradient(q, step_s, axis=1)
    qdd = np.gradient(qd, step_s, axis=1)[:, ::every]
    q, qd = q[:, ::every], qd[:, ::every]
    further, _ = turned_in_stop(arm.stop, arm.limits.velocity_rad_s, qd, qdd)
    hands = _resting_hands(arm, q, np.minimum(further, 0.0), np.maximum(further, 0.0))
    workspace = arm.box_m
    beyond = np.maximum(workspace[:, 0] - hands, hands - workspace[:, 1]) + hanging_m
    return np.asarray(np.maximum(beyond.max(axis=(1, 2, 3)), 0.0))


def _resting_hands(arm: Arm, q: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return resting positions (..., W, 2) of the hand, its joints (..., J) turning by low to high."""
    shares = (0.0, 0.5, 1.0) if len(arm.joints) <= FEW_JOINTS else (0.0, 1.0)
    corners = np.array(list(product(shares, repeat=len(arm.joints))))
    rest = (q + low)[..., None, :] + corners * (high - low)[..., None, :]
    return arm.hand_m(rest)


def outside_m(arm: Arm, box_m: np.ndarray) -> float:
    """Return how far a box (2 or 3, 2) extends beyond the arm's workspace, zero if nowhere [m]."""
    workspace = arm.box_m
    return float(max(0.0, (workspace[:, 0] - box_m[:, 0]).max(), (box_m[:, 1] - workspace[:, 1]).max()))


def _box(points: np.ndarray) -> np.ndarray:
    flat = points.reshape(-1, points.shape[-1])
    return np.stack([flat.min(axis=0), flat.max(axis=0)], axis=1)
