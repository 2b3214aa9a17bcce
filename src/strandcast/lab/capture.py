"""The lab's motion capture in space: markers on the string and one on the hand, as a file of its own axes."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from strandcast.arm.load import SpatialArm
from strandcast.imports.capture_mapping import CaptureMapping, capture_mapping_of
from strandcast.lab.film import interpolated
from strandcast.lab.swing import LabSwing
from strandcast.lab.tracked_points import TrackerNoise, points_at, with_tracker_noise
from strandcast.records.files import write_text

CAPTURE = "capture.csv"
HAND = "hand"
# Chosen.
CAPTURE_RATE_HZ = 500.0
MARKERS = 8
TILT_RAD = 0.05  # of the capture's vertical axis: a calibration square is never quite level
FARTHEST_M, ON_HAND_M = 2.0, 0.05  # of the capture's origin from the arm's base, and of the hand's marker


@dataclass(frozen=True, eq=False)
class CaptureRig:
    """Where the motion capture and the hand's marker are, which the pipeline has to find out.

    Attributes
    ----------
    turn, origin_m
        A place x in the arm's frame is at turn · x + origin_m in the capture's, z up.
    on_hand_m
        The hand's marker, in the axes of the hand: direction of the string, normal, and across both.
    """

    turn: Rotation
    origin_m: np.ndarray
    on_hand_m: np.ndarray

    def facts(self) -> dict[str, Any]:
        """Return it as plain values."""
        return {
            "capture": {
                "turn": self.turn.as_matrix().tolist(),
                "origin_m": self.origin_m.tolist(),
                "on_hand_m": self.on_hand_m.tolist(),
            }
        }


def draw_capture_rig(random: np.random.Generator) -> CaptureRig:
    """Draw where the capture's origin, its axes and the hand's marker are."""
    tilt_rad = random.uniform(-TILT_RAD, TILT_RAD, 2)
    return CaptureRig(
        Rotation.from_euler("xyz", [*tilt_rad, random.uniform(-np.pi, np.pi)]),
        random.uniform(-FARTHEST_M, FARTHEST_M, 3),
        random.uniform(-ON_HAND_M, ON_HAND_M, 3),
    )


def marker_places_m(length_m: float) -> np.ndarray:
    """Return the places of the markers along a string's free length, the last on its tip [m]."""
    return np.linspace(0.0, length_m, MARKERS + 1)[1:]


def captured(
    rig: CaptureRig,
    arm: SpatialArm,
    swing: LabSwing,
    places_m: np.ndarray,
    since_s: np.ndarray,
    random: np.random.Generator,
) -> dict[str, np.ndarray]:
    """Return the columns of a capture by name [s, mm]: y points up, and its clock begins with its first row.

    Parameters
    ----------
    places_m
        (m,) the markers' true places along the string, from the clamp.
    since_s
        (F,) times since the motion's start on the robot's clock.
    """
    markers_m = points_at(swing, places_m, since_s)
    hand_m, along, normal = np.hsplit(arm.hand_path(interpolated(swing, since_s)[0]), 3)
    axes = np.stack([along, normal, np.cross(along, normal)], axis=2)
    every_m = np.concatenate([(hand_m + axes @ rig.on_hand_m)[:, None], markers_m], axis=1)
    seen_m = with_tracker_noise(every_m, 1.0 / CAPTURE_RATE_HZ, TrackerNoise(), random)
    there_m = rig.turn.apply(seen_m.reshape(-1, 3)).reshape(seen_m.shape) + rig.origin_m
    columns = {"t": np.arange(len(since_s)) / CAPTURE_RATE_HZ}
    for name, path_m in zip([HAND, *_names(len(places_m))], np.moveaxis(there_m, 1, 0), strict=True):
        x, y, z = 1e3 * path_m.T
        columns |= {f"{name}.x": x, f"{name}.y": z, f"{name}.z": -y}
    return columns


def capture_mapping(length_m: float) -> CaptureMapping:
    """Return what the columns of a capture mean, of a string with this free length."""
    places_m = marker_places_m(length_m)
    markers = [f"{place_m:.6f}:{name}" for place_m, name in zip(places_m, _names(len(places_m)), strict=True)]
    return capture_mapping_of(HAND, markers, up="y", length_unit="mm", time="t", time_unit="s")


def write_capture(path: Path, columns: dict[str, np.ndarray]) -> None:
    """Write a capture as a CSV file, with empty cells where a marker was not seen."""
    rows = np.column_stack(list(columns.values()))
    lines = [",".join("" if np.isnan(cell) else f"{cell:.6f}" for cell in row) for row in rows]
    write_text(path, "\n".join([",".join(columns), *lines, ""]))


def _names(count: int) -> list[str]:
    return [f"m{k}" for k in range(1, count + 1)]
