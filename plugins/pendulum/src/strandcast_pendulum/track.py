"""The pendulum tracker: a bead on a thread that swings from a fixed pivot, without a hand or markers."""

import numpy as np

from strandcast.camera.mapping import pixel_to_metre
from strandcast.config.track import TrackSettings
from strandcast.records.track import PREDICTED
from strandcast.tracking.preconditions import check_size
from strandcast.tracking.result import Tracked, marker_columns
from strandcast.tracking.strobe import choose_instants, strobe_picture
from strandcast.tracking.tracker import Tracker, TrackerInput
from strandcast.video.ingest import camera_times
from strandcast_pendulum.arc import calibrate_arc
from strandcast_pendulum.ball import SIGMA_PX, track_ball
from strandcast_pendulum.period import check_period

LEAST_SIGMA_M = 1e-4  # chosen: of the pivot


def track_pendulum(given: TrackerInput, settings: TrackSettings) -> Tracked:
    """Track a pendulum whose pivot is the world's origin, e.g. of a camera made by `calibrate_arc`.

    The tip is the bead's centre. The thread is too thin to be measured in such videos: its points are NaN,
    except for point 0, the pivot, which is flagged as predicted.

    Raises
    ------
    StrandcastError
        SC-V005 the decoded count differs from the manifest's; SC-C012 the frames' size is not the
        calibration's; SC-T004 no bead is found, or its period is not that of the length.
    """
    camera, string = given.camera, given.hint
    check_size(given.facts, camera, given.video)
    ball = track_ball(given.video, given.facts)
    tip_m = pixel_to_metre(camera, ball.centre_px, camera.string_offset_m)
    time_s = camera_times(given.facts)
    swung_s = check_period(time_s, np.arctan2(tip_m[:, 0], -tip_m[:, 1]), string.length_m, given.video)
    count = ball.decoded
    points = np.full((count, string.points + 1, 2), np.nan)
    sigma = np.full((count, string.points + 1), np.nan)
    flags = np.zeros((count, string.points + 1), dtype=np.int32)
    points[:, -1] = tip_m
    radial_m = np.linalg.norm(tip_m, axis=1) - string.length_m
    radial_sigma_m = float(np.sqrt(np.nanmean(radial_m**2)))
    sigma[np.isfinite(tip_m[:, 0]), -1] = max(radial_sigma_m, SIGMA_PX * camera.scale_m_per_px)
    points[:, 0] = 0.0
    sigma[:, 0] = max(radial_sigma_m, LEAST_SIGMA_M)
    flags[:, 0] = PREDICTED
    instants = choose_instants(np.arange(count), points)
    return Tracked(
        camera_time_s=time_s,
        points_m=points,
        sigma_m=sigma,
        flags=flags,
        markers=marker_columns(np.zeros((0, 7))),
        strobe=strobe_picture(ball.background, [], points[instants], camera),
        choices={
            "tracker": "pendulum",
            "ball_radius_m": ball.radius_px * camera.scale_m_per_px,
            "length_residual_m": radial_sigma_m,
            "period_s": swung_s if np.isfinite(swung_s) else None,
            "strobe_frames": " ".join(map(str, instants)),
        },
        warnings=tuple(ball.warnings),
    )


PENDULUM = Tracker(
    track_pendulum,
    unused_settings=(
        "track.background_picture",
        "track.polarity",
        "track.contrast_grey",
        "camera.exposure_s",
        "align.led",
    ),
    calibrate=calibrate_arc,
)
