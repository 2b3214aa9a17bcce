"""The hand's path on the robot's clock, three times: commanded, measured, seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strandcast.alignment.rig import Misfit, Rig, hand_poses, no_misfit, rig_of, seen_of
from strandcast.alignment.rows import rows_of
from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import Arm
from strandcast.records.alignment import Alignment
from strandcast.records.joint_log import JointLog


def hand_table(
    alignment: Alignment, markers: dict[str, np.ndarray], log: JointLog, arm: Arm
) -> dict[str, np.ndarray]:
    """Return the columns of hand.parquet.

    Parameters
    ----------
    alignment
        From `align`.
    markers
        Columns of markers.parquet.
    log
        The joint log; rows without a command give no commanded pose.
    arm
        The arm.

    Notes
    -----
    Commanded and measured follow from the joints as logged and the arm's file alone. Seen is the mean of the
    markers of a frame, each marker's fitted shift and turn taken off.
    """
    rows = rows_of(log, arm)
    measured = hand_pose(arm.chain, arm.clamp, rows.q_rad)
    columns = [log.joint_names.index(name) for name in arm.joints]
    told = np.isfinite(log.q_cmd_rad[:, columns]).all(axis=1)
    commanded = hand_pose(arm.chain, arm.clamp, log.q_cmd_rad[told][:, columns])
    seen_s, seen = _seen_path(alignment, markers, arm)
    near = np.interp(seen_s, rows.time_s, measured[:, 2])
    seen[:, 2] += 2.0 * np.pi * np.round((near - seen[:, 2]) / (2.0 * np.pi))
    return _table(
        [
            ("commanded", log.time_s[told], commanded),
            ("measured", rows.time_s, measured),
            ("seen", seen_s, seen),
        ]
    )


def _seen_path(
    alignment: Alignment, markers: dict[str, np.ndarray], arm: Arm
) -> tuple[np.ndarray, np.ndarray]:
    """Return robot time (F,) and the hand's pose (F, 3), the frame's markers averaged by their certainty."""
    rig, seen = rig_of(arm), seen_of(markers, arm)
    poses = hand_poses(rig, seen, _misplaced(alignment, rig))
    times, frame = np.unique(seen.time_s, return_inverse=True)
    weight = seen.sigma_m**-2.0
    total = np.bincount(frame, weight)
    turns = np.bincount(frame, weight * np.sin(poses[:, 2])), np.bincount(frame, weight * np.cos(poses[:, 2]))
    mean = [np.bincount(frame, weight * poses[:, axis]) / total for axis in range(2)]
    return alignment.robot_time_s(times), np.column_stack([*mean, np.arctan2(*turns)])


def _misplaced(alignment: Alignment, rig: Rig) -> Misfit:
    """Return the markers' misfit on the hand alone: where base and camera are off, that is to be seen."""
    fitted = {fit.marker: fit for fit in alignment.markers}
    none = no_misfit(rig)
    shift = [fitted[name].shift_m if name in fitted else [0.0, 0.0] for name in rig.ids]
    turn = [fitted[name].turn_rad if name in fitted else 0.0 for name in rig.ids]
    return replace(none, shift_m=np.array(shift), turn_rad=np.array(turn))


def _table(paths: list[tuple[str, np.ndarray, np.ndarray]]) -> dict[str, np.ndarray]:
    pose = np.concatenate([pose for _, _, pose in paths])
    return {
        "source": np.concatenate([np.full(len(times), source, dtype=object) for source, times, _ in paths]),
        "robot_time_s": np.concatenate([times for _, times, _ in paths]),
        "x_m": pose[:, 0],
        "y_m": pose[:, 1],
        "angle_rad": pose[:, 2],
    }
