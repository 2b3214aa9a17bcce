"""Marker poses predicted from the joints, and hand poses from detected markers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy

from strandcast.arm.kinematics import PlanarChain, hand_pose, link_angles, link_points
from strandcast.arm.load import PlanarArm
from strandcast.arm.settings import Clamp
from strandcast.core.pose import Pose, rotated
from strandcast.errors import StrandcastError

SURE_SD = 3.0  # standard deviations from which a number of the arm's file is wrong
MEDIAN = 5  # detections of a marker; chosen, removes single misread ones


@dataclass(frozen=True, eq=False)
class Rig:
    """The arm's chain, its moving joints' names, and the K hand markers.

    These are given by id, place (K, 2) [m] and turn (K,) [rad] in the hand's frame.
    """

    joints: tuple[str, ...]
    chain: PlanarChain
    clamp: Clamp
    ids: tuple[int, ...]
    place_m: np.ndarray
    turn_rad: np.ndarray
    size_m: np.ndarray


@dataclass(frozen=True, eq=False)
class Detections:
    """Markers detected in the video, m in order of time.

    Attributes
    ----------
    time_s
        (m,) camera time [s].
    marker
        (m,) which of the rig's K markers.
    pose
        (m,) measured poses.
    sigma_m
        (m,) standard errors of the positions [m].
    """

    time_s: np.ndarray
    marker: np.ndarray
    pose: Pose
    sigma_m: np.ndarray

    def where(self, keep: np.ndarray) -> Detections:
        """Return the detections selected by a mask (m,)."""
        return Detections(self.time_s[keep], self.marker[keep], self.pose[keep], self.sigma_m[keep])

    def scaled(self, ratio: float) -> Detections:
        """Return the same detections on a camera clock that runs `ratio` times as fast."""
        return Detections(self.time_s * ratio, self.marker, self.pose, self.sigma_m)

    def travel_m(self) -> float:
        """Return how far the marker that moves most does [m], unaffected by single misread ones."""
        return max(float(np.linalg.norm(np.ptp(path_m, axis=0))) for _, path_m in self._paths_m())

    def speed_m_s(self) -> np.ndarray:
        """Return the speed of each marker (m,) [m/s], unaffected by single misread markers."""
        speed = np.zeros(len(self.time_s))
        for mine, path_m in self._paths_m():
            if len(mine) > 1:
                speed[mine] = np.linalg.norm(np.gradient(path_m, self.time_s[mine], axis=0), axis=1)
        return speed

    def top_speed_m_s(self) -> float:
        """Return the greatest speed of the hand [m/s], however short its motion is among rest."""
        speed = self.speed_m_s()
        # Runs of misread markers pass the median of the positions, hardly that of the speeds.
        most = max(_median_filter(speed[self.marker == marker]).max() for marker in np.unique(self.marker))
        return float(np.quantile(speed[speed >= 0.1 * most], 0.98))

    def _paths_m(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield of each detected marker the detections' indices, and its positions without outliers."""
        for marker in np.unique(self.marker):
            mine = np.flatnonzero(self.marker == marker)
            yield mine, _median_filter(self.pose.position_m[mine])


def _median_filter(values: np.ndarray) -> np.ndarray:
    """Return running medians along the first axis."""
    size = (MEDIAN,) + (1,) * (values.ndim - 1)
    return np.asarray(scipy.ndimage.median_filter(values, size, mode="nearest"))


@dataclass(frozen=True, eq=False)
class RigError:
    """Small constant errors of a rig, fitted within priors.

    Attributes
    ----------
    base_m
        (2,) position of the arm's base in the world.
    stretch
        (3,) of the camera's map: along x, along y, shear (its rotation is part of the first joint's zero).
    zero_rad, length_m
        (J,) zeros of the joints, errors of the links' lengths.
    shift_m, turn_rad
        (K, 2) and (K,) of each marker on the hand, in the hand's frame, about the marker's own centre.
    """

    base_m: np.ndarray
    stretch: np.ndarray
    zero_rad: np.ndarray
    length_m: np.ndarray
    shift_m: np.ndarray
    turn_rad: np.ndarray

    @classmethod
    def none(cls, rig: Rig) -> RigError:
        """Return the errors of a rig that is exactly as its files say."""
        return cls.from_vector(np.zeros(sum(error_counts(rig))), rig)

    @classmethod
    def from_vector(cls, vector: np.ndarray, rig: Rig) -> RigError:
        """Return the errors in a vector (5 + 2 J + 3 K,), the inverse of `vector`."""
        base, stretch, zero, length, shift, turn = np.split(vector, np.cumsum(error_counts(rig))[:-1])
        return cls(base, stretch, zero, length, shift.reshape(-1, 2), turn)

    def vector(self) -> np.ndarray:
        """Return all errors as a vector (5 + 2 J + 3 K,), in the order of the attributes."""
        parts = (self.base_m, self.stretch, self.zero_rad, self.length_m, self.shift_m.ravel(), self.turn_rad)
        return np.concatenate(parts)

    def hand_shift_m(self, clamp: Clamp) -> np.ndarray:
        """Return the displacement (K, 2) of the markers in the hand's frame [m].

        The last link's length, the clamp and the markers' places cannot be separated along the link.
        """
        link_m = rotated(np.array([self.length_m[-1], 0.0]), np.array(-clamp.angle_rad))
        return np.asarray(self.shift_m + link_m)


def error_counts(rig: Rig) -> list[int]:
    """Return how many numbers each attribute of a rig's `RigError` has."""
    joints, markers = len(rig.chain.lengths_m), len(rig.place_m)
    return [2, 3, joints, joints, 2 * markers, markers]


@dataclass(frozen=True)
class RigPriors:
    """Standard deviations of the rig's errors, see `RigError`; 0 fixes a value at its nominal one.

    Chosen: the errors of measurements in a careful lab. Constant errors look like a time shift while the hand
    moves one way. Estimating them costs some certainty; ignoring them would bias the clocks' offset (1 mm at
    2 m/s: 0.5 ms).
    """

    base_shift_m: float = 1e-3
    stretch: float = 2e-3
    joint_zero_rad: float = 1e-3
    link_length_m: float = 1e-3
    marker_shift_m: float = 3e-3
    marker_turn_rad: float = 0.02

    def of(self, rig: Rig) -> np.ndarray:
        """Return the standard deviation of each of a rig's errors, as `RigError.vector`."""
        common = self.base_shift_m, self.stretch, self.joint_zero_rad, self.link_length_m
        return np.repeat([*common, self.marker_shift_m, self.marker_turn_rad], error_counts(rig))


def rig_of(arm: PlanarArm) -> Rig:
    """Return the arm's chain and hand markers (SC-C022: the arm's file names none)."""
    if not arm.markers:
        raise StrandcastError(
            "SC-C022",
            "the arm's file names no markers on the hand",
            file=arm.path,
            field="markers.hand",
            fix="put an ArUco marker on the hand and write its id, size and place into the arm's file",
        )
    return Rig(
        arm.joints,
        arm.chain,
        arm.clamp,
        tuple(marker.id for marker in arm.markers),
        np.array([marker.place_m for marker in arm.markers]),
        np.array([marker.angle_rad for marker in arm.markers]),
        np.array([marker.size_m for marker in arm.markers]),
    )


def detections_of(table: dict[str, np.ndarray], arm: PlanarArm) -> Detections:
    """Return the detections of the hand's own markers from columns of markers.parquet, in order of time."""
    index = {marker.id: place for place, marker in enumerate(arm.markers)}
    mine = np.array([marker in index for marker in table["marker"]], bool)
    mine &= np.isfinite(table["x_m"]) & np.isfinite(table["y_m"]) & np.isfinite(table["angle_rad"])
    order = np.flatnonzero(mine)[np.argsort(table["camera_time_s"][mine], kind="stable")]
    return Detections(
        table["camera_time_s"][order],
        np.array([index[int(marker)] for marker in table["marker"][order]], int),
        Pose(np.column_stack([table["x_m"][order], table["y_m"][order]]), table["angle_rad"][order]),
        table["sigma_m"][order],
    )


def marker_poses(rig: Rig, q_rad: np.ndarray, marker: np.ndarray, error: RigError) -> Pose:
    """Return the poses (m,) of markers (m,) on the hand at joint angles (m, J) [rad]."""
    hand = hand_pose(_with_lengths(rig, error), rig.clamp, q_rad + error.zero_rad)
    centre = hand.place((rig.place_m + error.shift_m)[marker])
    angle = hand.angle_rad + (error.turn_rad + rig.turn_rad)[marker]
    stretch = _stretch(error)
    skew = np.stack([np.cos(angle), np.sin(angle)], axis=1) @ (stretch - np.eye(2))
    return Pose(
        centre @ stretch + error.base_m,
        angle + np.cos(angle) * skew[:, 1] - np.sin(angle) * skew[:, 0],
    )


def marker_path_m(rig: Rig, q_rad: np.ndarray, marker: int) -> np.ndarray:
    """Return the path (T, 2) [m] of one marker for joint angles (T, J) [rad] on a rig without errors."""
    return marker_poses(rig, q_rad, np.full(len(q_rad), marker), RigError.none(rig)).position_m


def marker_jacobian(
    rig: Rig, q_rad: np.ndarray, marker: np.ndarray, error: RigError
) -> tuple[np.ndarray, np.ndarray]:
    """Return the derivatives of marker poses: by joints (m, 3, J) and errors (m, 3, 5 + 2 J + 3 K).

    Errors are ordered as in `RigError.vector` and enter to first order; only the joints' zeros and the
    lengths are evaluated at their values.
    """
    chain, q = _with_lengths(rig, error), q_rad + error.zero_rad
    count, joints, markers = len(q), q.shape[1], len(rig.place_m)
    hand = hand_pose(chain, rig.clamp, q)
    centre = hand.place((rig.place_m + error.shift_m)[marker])
    pivots = link_points(chain, q)[:, :-1]
    about = centre[:, None] - pivots
    joint = np.stack([-about[..., 1], about[..., 0], np.ones((count, joints))], axis=1) * chain.signs
    angles = link_angles(chain, q)
    length = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    base = np.zeros((count, 3, 2))
    base[:, 0, 0] = base[:, 1, 1] = 1.0
    x, y = centre.T
    cos, sin = np.cos(hand.angle_rad), np.sin(hand.angle_rad)
    along = hand.angle_rad + (error.turn_rad + rig.turn_rad)[marker]
    twice_sin, twice_cos = 0.5 * np.sin(2 * along), np.cos(2 * along)
    none = np.zeros(count)
    stretch = np.stack(
        [
            np.stack([x, none, -twice_sin], axis=1),
            np.stack([none, y, twice_sin], axis=1),
            np.stack([y, x, twice_cos], axis=1),
        ],
        axis=2,
    )
    shift, turn = np.zeros((count, 3, markers, 2)), np.zeros((count, 3, markers))
    rows = np.arange(count)
    shift[rows, 0, marker] = np.stack([cos, -sin], axis=1)
    shift[rows, 1, marker] = np.stack([sin, cos], axis=1)
    turn[rows, 2, marker] = 1.0
    whole = [base, stretch, joint, length, shift.reshape(count, 3, 2 * markers), turn]
    return joint, np.concatenate(whole, axis=2)


def hand_poses(rig: Rig, detections: Detections, error: RigError) -> Pose:
    """Return the hand's pose (m,) from each marker detection.

    Errors of the camera, the base and the markers are removed, so that the path can be compared with that of
    the joints; the joints' zeros and the links' lengths stay as in the log and the arm's file.
    """
    along = detections.pose.angle_rad
    angle = along - (error.turn_rad + rig.turn_rad)[detections.marker]
    skew = np.stack([np.cos(along), np.sin(along)], axis=1) @ (_stretch(error) - np.eye(2))
    angle = angle - np.cos(along) * skew[:, 1] + np.sin(along) * skew[:, 0]
    centre = (detections.pose.position_m - error.base_m) @ np.linalg.inv(_stretch(error))
    place = (rig.place_m + error.shift_m)[detections.marker]
    return Pose(centre - rotated(place, angle), angle)


def _with_lengths(rig: Rig, error: RigError) -> PlanarChain:
    return rig.chain._replace(lengths_m=rig.chain.lengths_m + error.length_m)


def _stretch(error: RigError) -> np.ndarray:
    along_x, along_y, shear = error.stretch
    return np.array([[1.0 + along_x, shear], [shear, 1.0 + along_y]])
