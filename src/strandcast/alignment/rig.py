"""Where the hand's markers must be for the joints measured, and the hand's pose from markers seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strandcast.arm.kinematics import Clamp, PlanarChain, hand_pose
from strandcast.arm.load import Arm
from strandcast.errors import StrandcastError


@dataclass(frozen=True)
class Rig:
    """The arm's chain and its K hand markers: place (K, 2) [m], turn (K,) [rad] in the hand's frame."""

    chain: PlanarChain
    clamp: Clamp
    place_m: np.ndarray
    turn_rad: np.ndarray
    size_m: np.ndarray


@dataclass(frozen=True)
class Seen:
    """Markers as the video saw them, m times: camera time, which of the K, pose (m, 3), standard error."""

    time_s: np.ndarray
    marker: np.ndarray
    pose: np.ndarray
    sigma_m: np.ndarray

    def where(self, keep: np.ndarray) -> Seen:
        """Return the sightings that `keep` (m,) names."""
        return Seen(self.time_s[keep], self.marker[keep], self.pose[keep], self.sigma_m[keep])


@dataclass(frozen=True)
class Misfit:
    """Small constant errors of a rig, which the fit frees within priors.

    Attributes
    ----------
    shift_m, turn_rad
        (2,) and scalar: the markers' carrier on the hand, in the hand's frame, about its origin.
    base_m
        (2,) the arm's base in the world.
    zero_rad
        (J,) zeros of the joints.
    """

    shift_m: np.ndarray
    turn_rad: float
    base_m: np.ndarray
    zero_rad: np.ndarray


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


def no_misfit(rig: Rig) -> Misfit:
    """Return a rig that is as its files say."""
    return Misfit(np.zeros(2), 0.0, np.zeros(2), np.zeros(len(rig.chain.lengths_m)))


def marker_poses(rig: Rig, q_rad: np.ndarray, marker: np.ndarray, misfit: Misfit) -> np.ndarray:
    """Return the poses (m, 3) [m, rad] of markers (m,) on the hand at joint angles (m, J) [rad]."""
    hand = hand_pose(rig.chain, rig.clamp, q_rad + misfit.zero_rad)
    place = _turned(rig.place_m, misfit.turn_rad)[marker] + misfit.shift_m
    centre = hand[:, :2] + misfit.base_m + _turned(place, hand[:, 2])
    return np.column_stack([centre, hand[:, 2] + misfit.turn_rad + rig.turn_rad[marker]])


def hand_poses(rig: Rig, seen: Seen, misfit: Misfit) -> np.ndarray:
    """Return the hand's poses (m, 3) as each marker sighting tells them: the inverse of `marker_poses`.

    The base's misfit is taken off too, so that the path can be held against the joints'.
    """
    angle = seen.pose[:, 2] - misfit.turn_rad - rig.turn_rad[seen.marker]
    place = _turned(rig.place_m, misfit.turn_rad)[seen.marker] + misfit.shift_m
    return np.column_stack([seen.pose[:, :2] - misfit.base_m - _turned(place, angle), angle])


def _turned(vectors: np.ndarray, angle_rad: float | np.ndarray) -> np.ndarray:
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    x, y = vectors[:, 0], vectors[:, 1]
    return np.column_stack([cosine * x - sine * y, sine * x + cosine * y])
