"""Bring the capture of a throw in space to the arm's clock and frame."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import OptimizeResult, least_squares
from scipy.spatial.transform import Rotation

from strandcast.core.interpolation import resampled
from strandcast.records.alignment import EndPath
from strandcast.records.record import refusal

# All chosen.
# The tracked hand is compared with the arm's around the motion, and from so long before it, while the clocks
# hardly drift, where it moves [m/s, rad/s]: it may turn there as it does not in the motion.
AROUND_S, BEFORE_S, STILL = 0.3, 30.0, 0.05
STEP_S = 4e-3  # of the search for the clock's offset
FEWEST = 30  # frames in which the hand is tracked
ON_HAND_M = 0.1  # the tracked place is about this near to where the string leaves
SCALE_M = 1e-3  # of residuals
SHARED_S = 0.016  # time for which a tracker's errors last
CLEARLY_BETTER = 0.99  # of the cost: another minimum, not the same one
TURN_RAD = np.pi  # of the capture before anything is known
DOUBT_M, WRONG_M = 3e-3, 20e-3  # rms of the tracked hand from the arm's; error of the string's place
PLACED = (
    "the hand's turns hardly show where the tracked body is on it: hand and tip are placed to {:.0f} mm only "
    "(one standard error)"
)
MORE_TURNS = (
    "turn the hand slowly about other axes before the throw, within 30 s, in capture and joint log alike, or "
    "give --offset for a capture in the arm's frame"
)


class ThrownBy(NamedTuple):
    """An arm's throw: times of its log (T,), poses of its hand (T, 9), the motion's start and end [s, m]."""

    time_s: np.ndarray
    pose: np.ndarray
    motion_s: tuple[float, float]

    def at(self, time_s: np.ndarray) -> np.ndarray:
        """Return the poses (F, 9) of the hand at times (F,)."""
        return resampled(time_s, self.time_s, self.pose)

    def end(self) -> EndPath:
        """Return the path of the driven end, at the times of the log."""
        return EndPath(*np.hsplit(self.pose, 3))


class Placement(NamedTuple):
    """From a capture to the arm: x to turn x + shift [m], and what is added to its times [s].

    None where turn, shift and offset were given: `offset_se_s`; `rms_m`, of the tracked hand from the arm's;
    `string_se_m`, the standard error of hand and tip during the motion.
    """

    turn: np.ndarray
    shift_m: np.ndarray
    offset_s: float
    offset_se_s: float | None = None
    rms_m: float | None = None
    string_se_m: float | None = None

    def placed(self, points_m: np.ndarray) -> np.ndarray:
        """Return points (..., 3) of the capture in the arm's frame."""
        return np.asarray(points_m @ self.turn.T + self.shift_m)


def place_capture(
    thrown: ThrownBy,
    time_s: np.ndarray,
    hand_m: np.ndarray | None,
    tip_m: np.ndarray,
    offset_s: float | None,
    file: Path,
) -> Placement:
    """Return clock and place of a capture: as given, or from a tracked place on the hand.

    The tracked place may be anywhere on the link that holds the string, and the capture's origin and axes
    anywhere: where the hand is during the motion determines them all.

    `time_s` (F,) are the capture's times, `hand_m` and `tip_m` (F, 3) the tracked place and the string's tip,
    NaN where not seen. `offset_s` is robot time less the capture's; then the capture is in the arm's frame.

    Raises
    ------
    StrandcastError
        SC-I054 neither is given, or both; the hand was not tracked during the motion, or does not move as the
        arm's, or its turns do not show where the tracked place is on it.
    """
    if (hand_m is None) == (offset_s is None):
        what = (
            "neither a tracked hand nor the clock's offset is given" if hand_m is None else "both are given"
        )
        fix = "name a body on the arm's hand (--hand), or give --offset for a capture in the arm's frame"
        raise refusal("SC-I054", file, "hand, offset", what, fix)
    if hand_m is None:
        assert offset_s is not None
        return Placement(np.eye(3), np.zeros(3), offset_s)
    seen = np.isfinite(hand_m).all(axis=1)
    coarse_s = _coarse_offset_s(thrown, time_s[seen], hand_m[seen], file)
    at_s = time_s + coarse_s
    logged = seen & (at_s >= thrown.time_s[0]) & (at_s <= thrown.time_s[-1])
    around = logged & (at_s >= thrown.motion_s[0] - AROUND_S) & (at_s <= thrown.motion_s[1] + AROUND_S)
    # Frames in which the hand stands still show nothing new, and would hide an error during the motion.
    before = logged & (at_s < thrown.motion_s[0]) & (at_s >= thrown.motion_s[0] - BEFORE_S)
    near = around | (before & (_speed(at_s, thrown.at(at_s)) > STILL))
    if around.sum() < FEWEST:
        raise _not_tracked(file, f"the hand is seen in {around.sum()} frames of the motion")
    found, covariance = _fitted(thrown, time_s[near], hand_m[near], coarse_s, around[near])
    robot_s = time_s + found.offset_s
    during = (robot_s >= thrown.motion_s[0]) & (robot_s <= thrown.motion_s[1])
    middle_m = found.placed(hand_m[near].mean(axis=0))
    ends_m = (thrown.at(robot_s[during])[:, :3], found.placed(tip_m[during]))
    string_se_m = max(standard_error_m(end_m - middle_m, covariance) for end_m in ends_m)
    assert found.rms_m is not None
    if found.rms_m > WRONG_M:
        what = (
            f"the tracked hand stays {1e3 * found.rms_m:.0f} mm rms from the arm's, wherever the arm stands"
        )
        fix = (
            "capture and joint log must be of one throw, the body fixed to the link that holds the string; "
            "check length_unit"
        )
        raise refusal("SC-I054", file, "hand", what, fix)
    if string_se_m > WRONG_M:
        what = PLACED.format(1e3 * string_se_m)
        if found.rms_m >= DOUBT_M:
            what += f"; and the hand stays {1e3 * found.rms_m:.0f} mm rms from the arm's, as in another throw"
        raise refusal("SC-I054", file, "hand", what, MORE_TURNS)
    return found._replace(string_se_m=string_se_m)


def placement_warnings(found: Placement) -> list[str]:
    """Return warnings that the tracked hand is not where the arm's is, or hardly places the string."""
    warnings = []
    if found.rms_m is not None and found.rms_m >= DOUBT_M:
        warnings.append(
            f"the tracked hand stays {1e3 * found.rms_m:.1f} mm rms from the arm's: the capture of another "
            "throw, a loose marker, a link's length or a joint's zero in the arm's file, or a drifting clock"
        )
    if found.string_se_m is not None and found.string_se_m >= DOUBT_M:
        warnings.append(f"{PLACED.format(1e3 * found.string_se_m)}: {MORE_TURNS}")
    return warnings


def _not_tracked(file: Path, what: str) -> Exception:
    return refusal(
        "SC-I054", file, "hand", what, "capture the whole motion, with the hand in view; check time_unit"
    )


def _coarse_offset_s(thrown: ThrownBy, time_s: np.ndarray, hand_m: np.ndarray, file: Path) -> float:
    """Return the offset at which the tracked hand is as fast as the arm's throughout the motion."""
    start_s, end_s = thrown.motion_s
    first_s, last_s = (end_s - time_s[-1], start_s - time_s[0]) if len(time_s) else (0.0, -1.0)
    if last_s < first_s:
        raise _not_tracked(
            file, f"the motion takes {end_s - start_s:.2f} s, and the hand is not seen as long"
        )
    at_s = np.arange(start_s, end_s, STEP_S)
    arm_m_s = _speed(at_s, thrown.at(at_s)[:, :3])
    even_s = np.arange(time_s[0], time_s[-1], STEP_S)
    seen_m_s = _speed(even_s, resampled(even_s, time_s, hand_m))
    offsets_s = np.arange(first_s, last_s + STEP_S, STEP_S)
    off = [np.mean((np.interp(at_s - offset_s, even_s, seen_m_s) - arm_m_s) ** 2) for offset_s in offsets_s]
    return float(offsets_s[int(np.argmin(off))])


def _speed(time_s: np.ndarray, place_m: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(np.gradient(place_m, time_s, axis=0), axis=1))


def _fitted(
    thrown: ThrownBy, time_s: np.ndarray, hand_m: np.ndarray, coarse_s: float, counted: np.ndarray
) -> tuple[Placement, np.ndarray]:
    """Fit the offset, the capture's turn and shift, and the tracked place in the hand's axes.

    The residual is that of the `counted` frames (F,).
    Also return the covariance (6, 6) of a turn about the middle of the placed hand, and of the shift.
    """
    centre_m = hand_m.mean(axis=0)
    arm_m = thrown.at(time_s + coarse_s)[:, :3]
    turn = Rotation.align_vectors(arm_m - arm_m.mean(axis=0), hand_m - centre_m)[0]
    begin = np.concatenate([np.zeros(3), arm_m.mean(axis=0), np.zeros(3), [coarse_s]])
    fit = _fit(thrown, time_s, hand_m - centre_m, turn, begin)
    # Half a turn about a path that hardly bends is a minimum of its own.
    along = np.linalg.svd(hand_m - centre_m, full_matrices=False)[2][0]
    half = turn * Rotation.from_rotvec(np.pi * along)
    other = _fit(thrown, time_s, hand_m - centre_m, half, begin)
    if other.cost < CLEARLY_BETTER * fit.cost:
        fit, turn = other, half
    turn *= Rotation.from_rotvec(fit.x[:3])
    off = fit.fun[:-3].reshape(-1, 3)[counted]
    # The slopes at no further turn, because small turns add up.
    slopes = _fit(thrown, time_s, hand_m - centre_m, turn, np.append(np.zeros(3), fit.x[3:])).jac[:-3]
    shared = max(SHARED_S / float(np.median(np.diff(time_s))), 1.0)
    before = np.repeat([1.0 / TURN_RAD, 0.0, 1.0 / ON_HAND_M, 0.0], [3, 3, 3, 1]) ** 2
    covariance = np.linalg.inv(slopes.T @ slopes / (shared * np.mean(off**2)) + np.diag(before))
    turned = turn.as_matrix()
    placement = Placement(
        turned,
        fit.x[3:6] - turned @ centre_m,
        float(fit.x[9]),
        float(np.sqrt(covariance[9, 9])),
        float(SCALE_M * np.sqrt(3.0 * np.mean(off**2))),
    )
    to_arm = block_diag(turned, np.eye(3))
    return placement, to_arm @ covariance[:6, :6] @ to_arm.T


def _fit(
    thrown: ThrownBy, time_s: np.ndarray, hand_m: np.ndarray, turn: Rotation, begin: np.ndarray
) -> OptimizeResult:
    """Fit a further turn (3) and shift (3) of the hand, its place in the hand's axes (3), and the offset."""

    def apart(unknowns: np.ndarray) -> np.ndarray:
        turned = (turn * Rotation.from_rotvec(unknowns[:3])).apply(hand_m)
        place_m, along, normal = np.hsplit(thrown.at(time_s + unknowns[9]), 3)
        axes = np.stack([along, normal, np.cross(along, normal)], axis=2)
        off_m = turned + unknowns[3:6] - place_m - axes @ unknowns[6:9]
        return np.concatenate([off_m.ravel() / SCALE_M, unknowns[6:9] / ON_HAND_M])

    scales = [0.1] * 3 + [0.1] * 3 + [ON_HAND_M] * 3 + [STEP_S]
    return least_squares(apart, begin, x_scale=scales, loss="soft_l1", f_scale=3.0)


def standard_error_m(lever_m: np.ndarray, covariance: np.ndarray) -> float:
    """Return the rms standard error of places (N, 3), relative to what turns (3) and shifts (3) refer to."""
    lever_m = lever_m[np.isfinite(lever_m).all(axis=1)]
    turns = np.cross(np.eye(3), lever_m[:, None])
    slopes = np.concatenate([turns, np.broadcast_to(np.eye(3), turns.shape)], axis=1)
    variances = np.einsum("nki,kl,nli->n", slopes, covariance, slopes)
    return float(np.sqrt(variances.sum() / max(len(variances), 1)))
