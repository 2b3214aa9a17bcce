"""Where the hand's markers must be for the joints measured, and the hand's pose from markers seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from strandcast.arm.kinematics import Clamp, PlanarChain, hand_pose, link_angles, link_points
from strandcast.arm.load import Arm
from strandcast.errors import StrandcastError

MEDIAN = 5  # sightings


@dataclass(frozen=True, eq=False)
class Rig:
    """The arm's chain and its K hand markers: id, place (K, 2) [m], turn (K,) [rad] in the hand's frame."""

    chain: PlanarChain
    clamp: Clamp
    ids: tuple[int, ...]
    place_m: np.ndarray
    turn_rad: np.ndarray
    size_m: np.ndarray


@dataclass(frozen=True, eq=False)
class Seen:
    """Markers as the video saw them, m times: camera time, which of the K, pose (m, 3), standard error."""

    time_s: np.ndarray
    marker: np.ndarray
    pose: np.ndarray
    sigma_m: np.ndarray

    def where(self, keep: np.ndarray) -> Seen:
        """Return the sightings that `keep` (m,) names."""
        return Seen(self.time_s[keep], self.marker[keep], self.pose[keep], self.sigma_m[keep])

    def scaled(self, ratio: float) -> Seen:
        """Return the same sightings by a camera clock that runs `ratio` times as fast."""
        return Seen(self.time_s * ratio, self.marker, self.pose, self.sigma_m)

    def speed_m_s(self) -> np.ndarray:
        """Return how fast each marker moves (m,) [m/s]; single misread ones make no speed of their own."""
        speed = np.zeros(len(self.time_s))
        for marker in np.unique(self.marker):
            mine = np.flatnonzero(self.marker == marker)
            if len(mine) > 1:
                smooth_m = median_filter(self.pose[mine, :2], (MEDIAN, 1), mode="nearest")
                speed[mine] = np.linalg.norm(np.gradient(smooth_m, self.time_s[mine], axis=0), axis=1)
        return speed


@dataclass(frozen=True, eq=False)
class Misfit:
    """Small constant errors of a rig, which the fit frees within priors.

    Attributes
    ----------
    base_m
        (2,) the arm's base in the world.
    stretch
        (3,) of the camera's map: along x, along y, shear (what turns it counts as the first joint's zero).
    zero_rad, length_m
        (J,) zeros of the joints, errors of the links' lengths.
    shift_m, turn_rad
        (K, 2) and (K,) each marker on the hand, in the hand's frame, about its own middle.
    """

    base_m: np.ndarray
    stretch: np.ndarray
    zero_rad: np.ndarray
    length_m: np.ndarray
    shift_m: np.ndarray
    turn_rad: np.ndarray

    def vector(self) -> np.ndarray:
        """Return all of it (5 + 2 J + 3 K,), in the order of the attributes."""
        parts = (self.base_m, self.stretch, self.zero_rad, self.length_m, self.shift_m.ravel(), self.turn_rad)
        return np.concatenate(parts)


def misfit_of(vector: np.ndarray, rig: Rig) -> Misfit:
    """Return the misfit that `Misfit.vector` makes this vector of."""
    joints, markers = len(rig.chain.lengths_m), len(rig.place_m)
    base, stretch, zero, length, shift, turn = np.split(
        vector, np.cumsum([2, 3, joints, joints, 2 * markers])
    )
    return Misfit(base, stretch, zero, length, shift.reshape(markers, 2), turn)


def no_misfit(rig: Rig) -> Misfit:
    """Return a rig that is as its files say."""
    return misfit_of(np.zeros(5 + 2 * len(rig.chain.lengths_m) + 3 * len(rig.place_m)), rig)


def rig_of(arm: Arm) -> Rig:
    """Return what the alignment needs of an arm.

    Raises
    ------
    StrandcastError
        The arm's file names no markers on the hand.
    """
    if not arm.markers:
        raise StrandcastError(
            "SC-A001",
            "the arm's file names no markers on the hand",
            file=arm.path,
            field="markers.hand",
            fix="put an ArUco marker on the hand and write its id, size and place into the arm's file",
        )
    return Rig(
        arm.chain,
        arm.clamp,
        tuple(marker.id for marker in arm.markers),
        np.array([marker.place_m for marker in arm.markers]),
        np.array([marker.angle_rad for marker in arm.markers]),
        np.array([marker.size_m for marker in arm.markers]),
    )


def seen_of(table: dict[str, np.ndarray], arm: Arm) -> Seen:
    """Return the sightings of the hand's own markers from columns of markers.parquet, in order of time."""
    index = {marker.id: place for place, marker in enumerate(arm.markers)}
    mine = np.array([marker in index for marker in table["marker"]], bool)
    mine &= np.isfinite(table["x_m"]) & np.isfinite(table["y_m"]) & np.isfinite(table["angle_rad"])
    order = np.flatnonzero(mine)[np.argsort(table["camera_time_s"][mine], kind="stable")]
    return Seen(
        table["camera_time_s"][order],
        np.array([index[int(marker)] for marker in table["marker"][order]], int),
        np.column_stack([table[name][order] for name in ("x_m", "y_m", "angle_rad")]),
        table["sigma_m"][order],
    )


def marker_poses(rig: Rig, q_rad: np.ndarray, marker: np.ndarray, misfit: Misfit) -> np.ndarray:
    """Return the poses (m, 3) [m, rad] of markers (m,) on the hand at joint angles (m, J) [rad]."""
    hand = hand_pose(_longer(rig, misfit), rig.clamp, q_rad + misfit.zero_rad)
    centre = hand[:, :2] + _turned((rig.place_m + misfit.shift_m)[marker], hand[:, 2])
    angle = hand[:, 2] + (misfit.turn_rad + rig.turn_rad)[marker]
    stretch = _stretch(misfit)
    skew = np.stack([np.cos(angle), np.sin(angle)], axis=1) @ (stretch - np.eye(2))
    return np.column_stack(
        [
            centre @ stretch + misfit.base_m,
            angle + np.cos(angle) * skew[:, 1] - np.sin(angle) * skew[:, 0],
        ]
    )


def marker_slopes(
    rig: Rig, q_rad: np.ndarray, marker: np.ndarray, misfit: Misfit
) -> tuple[np.ndarray, np.ndarray]:
    """Return how marker poses change: with the joints (m, 3, J), with `Misfit.vector` (m, 3, 5 + 2 J + 3 K).

    To first order in the misfit, of which only the joints' part is taken where it is.
    """
    chain, q = _longer(rig, misfit), q_rad + misfit.zero_rad
    count, joints, markers = len(q), q.shape[1], len(rig.place_m)
    hand = hand_pose(chain, rig.clamp, q)
    lever = _turned((rig.place_m + misfit.shift_m)[marker], hand[:, 2])
    centre = hand[:, :2] + lever
    pivots = link_points(chain, q)[:, :-1]
    about = centre[:, None] - pivots
    joint = np.stack([-about[..., 1], about[..., 0], np.ones((count, joints))], axis=1) * chain.signs
    angles = link_angles(chain, q)
    length = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    base = np.zeros((count, 3, 2))
    base[:, 0, 0] = base[:, 1, 1] = 1.0
    x, y = centre.T
    cos, sin = np.cos(hand[:, 2]), np.sin(hand[:, 2])
    along = hand[:, 2] + (misfit.turn_rad + rig.turn_rad)[marker]
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


def hand_poses(rig: Rig, seen: Seen, misfit: Misfit) -> np.ndarray:
    """Return the hand's poses (m, 3) as each marker sighting tells them.

    What the camera, the base and the markers misplace is taken off, so that the path can be held against the
    joints'; the joints' zeros and the links' lengths are left as the log and the arm's file have them.
    """
    angle = seen.pose[:, 2] - (misfit.turn_rad + rig.turn_rad)[seen.marker]
    along = seen.pose[:, 2]
    skew = np.stack([np.cos(along), np.sin(along)], axis=1) @ (_stretch(misfit) - np.eye(2))
    angle = angle - np.cos(along) * skew[:, 1] + np.sin(along) * skew[:, 0]
    centre = (seen.pose[:, :2] - misfit.base_m) @ np.linalg.inv(_stretch(misfit))
    place = (rig.place_m + misfit.shift_m)[seen.marker]
    return np.column_stack([centre - _turned(place, angle), angle])


def _longer(rig: Rig, misfit: Misfit) -> PlanarChain:
    chain = rig.chain
    return PlanarChain(chain.origin_m, chain.lengths_m + misfit.length_m, chain.angles_rad, chain.signs)


def _stretch(misfit: Misfit) -> np.ndarray:
    along_x, along_y, shear = misfit.stretch
    return np.array([[1.0 + along_x, shear], [shear, 1.0 + along_y]])


def _turned(vectors: np.ndarray, angle_rad: np.ndarray) -> np.ndarray:
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    x, y = vectors[:, 0], vectors[:, 1]
    return np.column_stack([cosine * x - sine * y, sine * x + cosine * y])
