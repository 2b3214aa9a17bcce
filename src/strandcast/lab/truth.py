"""The truth of a lab throw, only for tests and the report's "lab truth" section."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from strandcast.lab.film import interpolated
from strandcast.lab.scene import LabScene, hand_corners_m
from strandcast.lab.swing import LabSwing
from strandcast.lab.variation import LabClocks
from strandcast.records.lab_truth import LAB_TRUTH
from strandcast.records.tables import write_table
from strandcast.records.track import AXES

MISS_AFTER_S = 0.3  # the miss counts until 0.3 s after the motion, by definition


class RecordedThrow(NamedTuple):
    """A throw that was filmed or captured.

    `variation` has its deviations by name, `robot_time_s` (F,) the times of the frames; `start_s` and
    `motion_s` are the motion's start and its duration.
    """

    swing: LabSwing
    variation: dict[str, Any]
    clocks: LabClocks
    robot_time_s: np.ndarray
    start_s: float
    motion_s: float


def write_truth(path: Path, throw: RecordedThrow, target_m: np.ndarray, more: dict[str, Any]) -> None:
    """Write lab_truth.parquet: the string's nodes at the middle of each frame's exposure, and metadata.

    Metadata: the clocks (``robot_time = camera_time · (1 + drift) + offset``; camera time is the frame's time
    stamp, at the middle of its exposure), the true miss, this throw's deviations, the true joint angles per
    frame, and what `more` says of the camera or the capture.
    """
    swing, robot_time_s, start_s = throw.swing, throw.robot_time_s, throw.start_s
    q, nodes = interpolated(swing, robot_time_s - start_s)
    frames, count = nodes.shape[:2]
    miss_m, miss_time_s = true_miss(swing, target_m, throw.motion_s)
    facts = {
        "offset_s": float(robot_time_s[0]),
        "drift": throw.clocks.drift,
        "motion_start_s": start_s,
        "miss_m": miss_m,
        "miss_robot_time_s": start_s + miss_time_s,
        "variation": {k: np.asarray(v).tolist() for k, v in throw.variation.items()},
        "joint_angles_rad": np.round(q, 9).tolist(),
    }
    columns = {
        "frame": np.repeat(np.arange(frames), count),
        "robot_time_s": np.repeat(robot_time_s, count),
        "place_m": np.tile(swing.places_m, frames),
    }
    columns |= dict(zip(AXES, nodes.reshape(frames * count, -1).T, strict=False))
    write_table(path, LAB_TRUTH, columns, facts | more)


def film_facts(scene: LabScene, throw: RecordedThrow) -> dict[str, Any]:
    """Return what the truth has of a film: the camera, and the centres of the hand's markers per frame."""
    q, _ = interpolated(throw.swing, throw.robot_time_s - throw.start_s)
    corners = [hand_corners_m(scene, angles)[1:] for angles in q]  # the plate comes first
    view = scene.view
    return {
        "hand_markers": {
            str(marker.id): np.round([c[k].mean(axis=0) for c in corners], 7).tolist()
            for k, marker in enumerate(scene.arm.markers)
        },
        "camera": {
            "matrix": view.matrix.tolist(),
            "distortion": view.distortion.tolist(),
            "rotation": view.rotation.tolist(),
            "translation_m": view.translation_m.tolist(),
        },
    }


def true_miss(swing: LabSwing, target_m: np.ndarray, motion_s: float) -> tuple[float, float]:
    """Return the tip path's least distance from the target [m], and its time since the motion's start [s]."""
    within = (swing.time_s >= 0.0) & (swing.time_s <= motion_s + MISS_AFTER_S)
    tip, time_s = swing.nodes_m[within, -1], swing.time_s[within]
    step = np.diff(tip, axis=0)
    square = np.maximum((step**2).sum(axis=1), 1e-30)
    along = np.clip(((target_m - tip[:-1]) * step).sum(axis=1) / square, 0.0, 1.0)
    distance = np.linalg.norm(tip[:-1] + along[:, None] * step - target_m, axis=1)
    k = int(np.argmin(distance))
    return float(distance[k]), float(time_s[k] + along[k] * (time_s[k + 1] - time_s[k]))
