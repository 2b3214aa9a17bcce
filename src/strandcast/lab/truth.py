"""What really happened in a throw: for tests and the report's "lab truth" section alone."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np

from strandcast.lab.film import at
from strandcast.lab.scene import Scene, hand_corners_m
from strandcast.lab.swing import Swing
from strandcast.lab.variation import Clocks, Variation
from strandcast.records.lab_truth import LAB_TRUTH
from strandcast.records.tables import write_table

MISS_AFTER_S = 0.3


def write_truth(
    path: Path,
    scene: Scene,
    swing: Swing,
    variation: Variation,
    clocks: Clocks,
    robot_time_s: np.ndarray,
    motion_start_s: float,
    motion_s: float,
    target_m: np.ndarray,
) -> None:
    """Write lab_truth.parquet: the string's nodes at the middle of each frame's exposure, and facts.

    Facts: the clocks (``robot_time = camera_time · (1 + drift) + offset``, camera time = the frame's time
    stamp = the middle of its exposure), the true miss, this throw's deviations, the camera, and by frame
    the true joint angles and the middles of the hand's markers.
    """
    q, nodes = at(swing, robot_time_s - motion_start_s)
    frames, count = nodes.shape[:2]
    corners = [hand_corners_m(scene, angles)[1:] for angles in q]  # the plate comes first
    miss_m, miss_time_s = true_miss(swing, target_m, motion_s)
    facts = {
        "offset_s": float(robot_time_s[0]),
        "drift": clocks.drift,
        "motion_start_s": motion_start_s,
        "miss_m": miss_m,
        "miss_robot_time_s": motion_start_s + miss_time_s,
        "variation": {k: np.asarray(v).tolist() for k, v in asdict(variation).items()},
        "joint_angles_rad": np.round(q, 9).tolist(),
        "hand_markers": {
            str(marker.id): np.round([c[k].mean(axis=0) for c in corners], 7).tolist()
            for k, marker in enumerate(scene.arm.markers)
        },
        "camera": {
            "matrix": scene.view.matrix.tolist(),
            "distortion": scene.view.distortion.tolist(),
            "rotation": scene.view.rotation.tolist(),
            "translation_m": scene.view.translation_m.tolist(),
        },
    }
    write_table(
        path,
        LAB_TRUTH,
        {
            "frame": np.repeat(np.arange(frames), count),
            "robot_time_s": np.repeat(robot_time_s, count),
            "place_m": np.tile(swing.places_m, frames),
            "x_m": nodes[:, :, 0].ravel(),
            "y_m": nodes[:, :, 1].ravel(),
        },
        facts,
    )


def true_miss(swing: Swing, target_m: np.ndarray, motion_s: float) -> tuple[float, float]:
    """Return the target's least distance from the tip's path [m], and when [s from the motion's start]."""
    within = (swing.time_s >= 0.0) & (swing.time_s <= motion_s + MISS_AFTER_S)
    tip, time_s = swing.nodes_m[within, -1], swing.time_s[within]
    step = np.diff(tip, axis=0)
    square = np.maximum((step**2).sum(axis=1), 1e-30)
    along = np.clip(((target_m - tip[:-1]) * step).sum(axis=1) / square, 0.0, 1.0)
    distance = np.linalg.norm(tip[:-1] + along[:, None] * step - target_m, axis=1)
    k = int(np.argmin(distance))
    return float(distance[k]), float(time_s[k] + along[k] * (time_s[k + 1] - time_s[k]))
