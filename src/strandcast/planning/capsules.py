"""The string at the start, hanging beside the arm's capsules."""

import numpy as np

from strandcast.arm.load import Arm

NEAR_HAND_M = 0.06  # string this near to the hand cannot be far from it; chosen
HANGING_SPACING_M = 0.015  # between the places of the hanging string that are checked; chosen
LONGER = 1.05  # how much longer than specified a string may be; chosen


def start_violation_m(
    arm: Arm,
    length_m: float,
    box: np.ndarray,
    clearance_m: float,
    q0: np.ndarray,
    clear_of: tuple[np.ndarray, float] | None = None,
) -> np.ndarray:
    """Return how deep the hanging string is in the capsules, out of the box, or at the target, at the start.

    The string hangs straight down from the hand; no model's stretch enters.

    Parameters
    ----------
    length_m
        The string's free length [m].
    box
        (2 or 3, 2) low and high of each coordinate [m].
    clearance_m
        How near to the links it may hang [m].
    q0
        (P, J) postures [rad].
    clear_of
        Places (A, 2 or 3) of the target, and how far from them the string must hang [m].

    Returns
    -------
    (P,) [m], 0 where a start posture is allowed.
    """
    hand = arm.hand_m(q0)
    upwards = np.eye(hand.shape[1])[-1]
    down = np.append(np.arange(NEAR_HAND_M, length_m, HANGING_SPACING_M), LONGER * length_m)
    hanging = hand[:, None] - down[:, None] * upwards
    away = _distances(hanging, arm.capsules(q0))
    deep = np.maximum(arm.capsule_radii(clearance_m) - away, 0.0).max(axis=(1, 2))
    shown = np.concatenate([hand[:, None], hanging], axis=1)
    out = np.maximum(box[:, 0] - shown, shown - box[:, 1]).max(axis=(1, 2))
    wrong = np.maximum(deep, np.maximum(out, 0.0))
    if clear_of is not None:
        places_m, clear_m = clear_of
        apart_m = places_m - hand[:, None]
        apart_m[..., -1] += np.clip(-apart_m[..., -1], 0.0, LONGER * length_m)
        wrong = np.maximum(wrong, clear_m - np.linalg.norm(apart_m, axis=-1).min(axis=1))
    return np.asarray(wrong)


def _distances(points: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return (P, D, S) distances of points (P, D, 2 or 3) to segments (P, S, 2, 2 or 3)."""
    start, step = ends[:, None, :, 0], (ends[:, :, 1] - ends[:, :, 0])[:, None]
    from_start = points[:, :, None] - start
    share = (from_start * step).sum(axis=-1) / np.maximum((step**2).sum(axis=-1), 1e-300)
    return np.asarray(np.linalg.norm(from_start - np.clip(share, 0.0, 1.0)[..., None] * step, axis=-1))
