"""`export rerun`: a throw as a recording for the Rerun viewer, on the robot's clock."""

from pathlib import Path
from typing import Any

import numpy as np

from strandcast.exports.throw import ThrowData
from strandcast.packages import optional_package

CLOCK = "robot_time"
ARM, MEASURED, FITTED, TARGET = (90, 90, 90), (0, 114, 178), (213, 94, 0), (0, 158, 115)
RADIUS_M = 0.003


def export_rerun(throw: ThrowData, out: Path) -> None:
    """Write arm, measured and fitted string, video, joints and distance between both strings as .rrd.

    Raises
    ------
    StrandcastError
        SC-W012 the package rerun-sdk is not installed.
    """
    rr = optional_package("rerun", "rerun-sdk", "rerun")
    recording = rr.RecordingStream("strandcast", recording_id=throw.name)
    recording.save(out)
    if throw.target_m is not None:
        target = rr.Points3D([throw.in_space(throw.target_m)], colors=TARGET, radii=0.01)
        recording.log("target", target, static=True)

    def lines(entity: str, time_s: np.ndarray, points_m: np.ndarray, color: tuple[int, int, int]) -> None:
        for at_s, line in zip(time_s, throw.in_space(points_m), strict=True):
            known = line[np.isfinite(line).all(axis=1)]
            recording.set_time(CLOCK, duration=at_s)
            recording.log(entity, rr.LineStrips3D([known], colors=color, radii=RADIUS_M))

    def curves(entity: str, time_s: np.ndarray, values: np.ndarray, names: list[str]) -> None:
        recording.log(entity, rr.SeriesLines(names=names), static=True)
        known = np.isfinite(values).all(axis=1)
        columns = rr.Scalars.columns(scalars=values[known])
        if known.any():
            recording.send_columns(entity, [rr.TimeColumn(CLOCK, duration=time_s[known])], columns)

    times_s, joints = throw.robot_time_s, list(throw.arm.joints)
    if len(throw.joint_time_s):
        lines("arm", times_s, throw.arm_m(throw.joints_at(times_s, throw.q_rad)), ARM)
    lines("string/measured", times_s, throw.points_m, MEASURED)
    lines("string/fitted", times_s, throw.fitted_m, FITTED)
    curves("joints/measured", throw.joint_time_s, throw.q_rad, joints)
    curves("joints/commanded", throw.joint_time_s, throw.q_cmd_rad, joints)
    apart_mm = 1e3 * np.linalg.norm(throw.points_m - throw.fitted_m, axis=2)[:, 1:]
    curves("apart_mm/tip", times_s, apart_mm[:, -1:], ["tip"])
    _video(rr, recording, throw)
    recording.flush()


def _video(rr: Any, recording: Any, throw: ThrowData) -> None:
    """Add the video of a container that Rerun reads: each tracked frame at its time."""
    if throw.video is None or throw.video.suffix.lower() != ".mp4":
        return
    video = rr.AssetVideo(path=throw.video)
    recording.log("video", video, static=True)
    stamps = np.asarray(video.read_frame_timestamps_nanos())
    inside = throw.frame < len(stamps)
    recording.send_columns(
        "video",
        [rr.TimeColumn(CLOCK, duration=throw.robot_time_s[inside])],
        rr.VideoFrameReference.columns_nanos(stamps[throw.frame[inside]]),
    )
