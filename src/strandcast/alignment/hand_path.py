"""The hand's path on the robot's clock: commanded, measured, and from the video."""

from dataclasses import replace

import numpy as np

from strandcast.alignment.log_rows import log_rows_of
from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import PlanarArm
from strandcast.core.pose import Pose
from strandcast.records.alignment import Alignment
from strandcast.records.joint_log import JointLog
from strandcast.rig.model import Rig, RigError, detections_of, hand_poses, rig_of


def hand_table(
    alignment: Alignment, markers: dict[str, np.ndarray], log: JointLog, arm: PlanarArm
) -> dict[str, np.ndarray]:
    """Return the columns of hand.parquet from an alignment, columns of markers.parquet, and the joint log.

    Commanded and measured poses follow from the logged joints and the arm's file alone; rows without a
    command give no commanded pose. Those from the video (`seen`) are the mean of a frame's markers, less each
    marker's fitted shift and turn.
    """
    rows = log_rows_of(log, arm)
    measured = hand_pose(arm.chain, arm.clamp, rows.q_rad)
    columns = [log.joint_names.index(name) for name in arm.joints]
    has_command = np.isfinite(log.q_cmd_rad[:, columns]).all(axis=1)
    commanded = hand_pose(arm.chain, arm.clamp, log.q_cmd_rad[has_command][:, columns])
    video_s, video = _video_path(alignment, markers, arm)
    return hand_columns(
        {
            "commanded": (log.time_s[has_command], commanded),
            "measured": (rows.time_s, measured),
            "seen": (video_s, video.near(np.interp(video_s, rows.time_s, measured.angle_rad))),
        }
    )


def hand_columns(paths: dict[str, tuple[np.ndarray, Pose]]) -> dict[str, np.ndarray]:
    """Return the columns of hand.parquet from robot times (T,) [s] and poses (T,) by source."""
    poses = np.concatenate([pose.array() for _, pose in paths.values()])
    return {
        "source": np.repeat(np.array(list(paths), dtype=object), [len(pose) for _, pose in paths.values()]),
        "robot_time_s": np.concatenate([times for times, _ in paths.values()]),
        **dict(zip(("x_m", "y_m", "angle_rad"), poses.T, strict=True)),
    }


def _video_path(
    alignment: Alignment, markers: dict[str, np.ndarray], arm: PlanarArm
) -> tuple[np.ndarray, Pose]:
    """Return robot times (F,) and hand poses (F,), each the weighted mean of a frame's markers."""
    rig, detections = rig_of(arm), detections_of(markers, arm)
    poses = hand_poses(rig, detections, _marker_errors(alignment, rig))
    times, frame = np.unique(detections.time_s, return_inverse=True)
    weight = detections.sigma_m**-2.0
    total = np.bincount(frame, weight)
    sine = np.bincount(frame, weight * np.sin(poses.angle_rad))
    cosine = np.bincount(frame, weight * np.cos(poses.angle_rad))
    mean = [np.bincount(frame, weight * column) / total for column in poses.position_m.T]
    return alignment.robot_time_s(times), Pose(np.column_stack(mean), np.arctan2(sine, cosine))


def _marker_errors(alignment: Alignment, rig: Rig) -> RigError:
    """Return the markers' errors on the hand alone: errors of base and camera stay in the path."""
    fitted = {fit.marker: fit for fit in alignment.markers}
    shift = [fitted[name].shift_m if name in fitted else [0.0, 0.0] for name in rig.ids]
    turn = [fitted[name].turn_rad if name in fitted else 0.0 for name in rig.ids]
    return replace(RigError.none(rig), shift_m=np.array(shift), turn_rad=np.array(turn))
