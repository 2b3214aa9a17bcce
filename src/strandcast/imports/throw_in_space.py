"""Bring the capture of a throw in space to the arm's clock and frame."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from strandcast.records.alignment import Alignment, EndPath
from strandcast.records.record import refusal

# All chosen.
AROUND_S = 0.3  # before and after the motion, in which the tracked hand is compared with the arm's
STEP_S = 4e-3  # of the search for the clock's offset
FEWEST = 30  # frames in which the hand is tracked
ON_HAND_M = 0.1  # the tracked place is about this near to where the string leaves
SCALE_M = 1e-3  # of residuals
DOUBT_M, WRONG_M = 3e-3, 20e-3  # rms of the tracked hand from the arm's


class ThrownBy(NamedTuple):
    """An arm's throw: times of its log (T,), poses of its hand (T, 9), the motion's start and end [s, m]."""

    time_s: np.ndarray
    pose: np.ndarray
    motion_s: tuple[float, float]

    def at(self, time_s: np.ndarray) -> np.ndarray:
        """Return the poses (F, 9) of the hand at times (F,)."""
        return np.column_stack([np.interp(time_s, self.time_s, column) for column in self.pose.T])

    def end(self) -> EndPath:
        """Return the path of the driven end, at the times of the log."""
        return EndPath(*np.hsplit(self.pose, 3))


class Placement(NamedTuple):
    """From a capture to the arm: x to turn x + shift [m], and what is added to its times [s].

    `offset_se_s` and `rms_m`, of the tracked hand from the arm's, are None where these were given.
    """

    turn: np.ndarray
    shift_m: np.ndarray
    offset_s: float
    offset_se_s: float | None = None
    rms_m: float | None = None

    def placed(self, points_m: np.ndarray) -> np.ndarray:
        """Return points (..., 3) of the capture in the arm's frame."""
        return np.asarray(points_m @ self.turn.T + self.shift_m)

    def alignment(self, experiment: str, trial: int, frames: int, motion_s: tuple[float, float]) -> Alignment:
        """Return the alignment of the capture's clock with the robot's."""
        return Alignment(
            experiment=experiment,
            trial=trial,
            source="supplied",
            offset_s=self.offset_s,
            offset_se_s=self.offset_se_s,
            drift=0.0,
            drift_se=None,
            drift_prior=None,
            residual_rms_m=self.rms_m,
            frames=frames,
            motion_start_s=motion_s[0],
            motion_end_s=motion_s[1],
        )


def place_capture(
    thrown: ThrownBy, time_s: np.ndarray, hand_m: np.ndarray | None, offset_s: float | None, file: Path
) -> Placement:
    """Return clock and place of a capture: as given, or from a tracked place on the hand.

    The tracked place may be anywhere on the link that holds the string, and the capture's origin and axes
    anywhere: where the hand is during the motion determines them all.

    Parameters
    ----------
    time_s, hand_m
        (F,) times of the capture [s], and (F, 3) the tracked place, NaN where not seen [m].
    offset_s
        Robot time less the capture's; then the capture is in the arm's frame.

    Raises
    ------
    StrandcastError
        SC-I054 neither is given, or both; the hand was not tracked during the motion, or does not move as the
        arm's.
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
    near = seen & (time_s + coarse_s >= max(thrown.motion_s[0] - AROUND_S, thrown.time_s[0]))
    near &= time_s + coarse_s <= min(thrown.motion_s[1] + AROUND_S, thrown.time_s[-1])
    if near.sum() < FEWEST:
        raise _not_tracked(file, f"the hand is seen in {near.sum()} frames of the motion")
    found = _fitted(thrown, time_s[near], hand_m[near], coarse_s)
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
    return found


def placement_warnings(found: Placement) -> list[str]:
    """Return the warning that the tracked hand is hardly where the arm's is."""
    if found.rms_m is None or found.rms_m < DOUBT_M:
        return []
    return [
        f"the tracked hand stays {1e3 * found.rms_m:.1f} mm rms from the arm's: the capture of another "
        "throw, a loose marker, a link's length or a joint's zero in the arm's file, or a drifting clock"
    ]


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
    seen_m_s = _speed(even_s, np.column_stack([np.interp(even_s, time_s, axis) for axis in hand_m.T]))
    offsets_s = np.arange(first_s, last_s + STEP_S, STEP_S)
    off = [np.mean((np.interp(at_s - offset_s, even_s, seen_m_s) - arm_m_s) ** 2) for offset_s in offsets_s]
    return float(offsets_s[int(np.argmin(off))])


def _speed(time_s: np.ndarray, place_m: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(np.gradient(place_m, time_s, axis=0), axis=1))


def _fitted(thrown: ThrownBy, time_s: np.ndarray, hand_m: np.ndarray, coarse_s: float) -> Placement:
    """Fit the offset, the capture's turn and shift, and the tracked place in the hand's axes."""
    centre_m = hand_m.mean(axis=0)
    arm_m = thrown.at(time_s + coarse_s)[:, :3]
    turn = Rotation.align_vectors(arm_m - arm_m.mean(axis=0), hand_m - centre_m)[0]

    def apart(unknowns: np.ndarray) -> np.ndarray:
        turned = (turn * Rotation.from_rotvec(unknowns[:3])).apply(hand_m - centre_m)
        place_m, along, normal = np.hsplit(thrown.at(time_s + unknowns[9]), 3)
        axes = np.stack([along, normal, np.cross(along, normal)], axis=2)
        off_m = turned + unknowns[3:6] - place_m - axes @ unknowns[6:9]
        return np.concatenate([off_m.ravel() / SCALE_M, unknowns[6:9] / ON_HAND_M])

    begin = np.concatenate([np.zeros(3), arm_m.mean(axis=0), np.zeros(3), [coarse_s]])
    scales = [0.1] * 3 + [0.1] * 3 + [ON_HAND_M] * 3 + [STEP_S]
    fit = least_squares(apart, begin, x_scale=scales, loss="soft_l1", f_scale=3.0)
    off = apart(fit.x)[:-3]
    slopes = np.asarray(fit.jac)
    covariance = np.linalg.pinv(slopes.T @ slopes) * np.mean(off**2)
    turned = (turn * Rotation.from_rotvec(fit.x[:3])).as_matrix()
    return Placement(
        turned,
        fit.x[3:6] - turned @ centre_m,
        float(fit.x[9]),
        float(np.sqrt(covariance[9, 9])),
        float(SCALE_M * np.sqrt(3.0 * np.mean(off**2))),
    )
