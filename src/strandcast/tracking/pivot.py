"""Tracking without a hand: a thread with a ball that swings from a fixed pivot (`track.hand: pivot`)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from strandcast.camera.mapping import pixel_to_metre
from strandcast.records.camera import Camera
from strandcast.records.manifest import VideoFacts
from strandcast.records.track import PREDICTED
from strandcast.tracking.ball import SIGMA_PX, follow_ball
from strandcast.tracking.counts import check_size
from strandcast.tracking.result import StringHint, Tracked, as_columns
from strandcast.tracking.strobe import choose_instants, strobe_picture
from strandcast.video.ingest import camera_times

LEAST_SIGMA_M = 1e-4


def track_pivot(
    path: str | Path, facts: VideoFacts, camera: Camera, string: StringHint, background_frames: int = 40
) -> Tracked:
    """Track a pendulum whose pivot is the world's origin, e.g. of a camera made by `calibrate_arc`.

    The tip is the ball's centre. The thread between is too thin to be measured in such videos: its points
    are left out, but for point 0, the pivot, which is flagged as predicted.

    Parameters
    ----------
    path, facts
        The video and its manifest entry.
    camera
        With the world's origin at the pivot.
    string
        Length from the pivot to the ball's centre, and number of points.
    background_frames
        Frames of which the background is the median.

    Raises
    ------
    StrandcastError
        SC-T001 the decoded count differs from the manifest's; SC-T002 the picture's size is not the
        calibration's; SC-T005 no ball is seen.
    """
    check_size(facts, camera, path)
    ball = follow_ball(path, facts, background_frames)
    tip_m = pixel_to_metre(camera, ball.centre_px, camera.string_offset_m)
    count = ball.decoded
    points = np.full((count, string.points + 1, 2), np.nan)
    sigma = np.full((count, string.points + 1), np.nan)
    flags = np.zeros((count, string.points + 1), dtype=np.int32)
    points[:, -1] = tip_m
    radial_m = np.linalg.norm(tip_m, axis=1) - string.length_m
    seen_sigma_m = float(np.sqrt(np.nanmean(radial_m**2)))
    sigma[np.isfinite(tip_m[:, 0]), -1] = max(seen_sigma_m, SIGMA_PX * camera.scale_m_per_px)
    points[:, 0] = 0.0
    sigma[:, 0] = max(seen_sigma_m, LEAST_SIGMA_M)
    flags[:, 0] = PREDICTED
    instants = choose_instants(np.arange(count), points)
    return Tracked(
        camera_time_s=camera_times(facts),
        points_m=points,
        sigma_m=sigma,
        flags=flags,
        markers=as_columns(np.zeros((0, 7))),
        strobe=strobe_picture(ball.background, [], points[instants], camera),
        decoded_frames=count,
        choices={
            "hand": "pivot",
            "background_frames": background_frames,
            "ball_radius_m": ball.radius_px * camera.scale_m_per_px,
            "length_residual_m": seen_sigma_m,
            "strobe_frames": " ".join(map(str, instants)),
        },
        warnings=ball.complaints,
    )
