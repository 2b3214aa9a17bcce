"""Scale and pivot of a pendulum from its arc: the ball moves on a circle of known radius in metres."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from skimage.measure import CircleModel

from strandcast.camera.flat import flat_camera
from strandcast.config.track import TrackSettings
from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera
from strandcast.records.manifest import VideoFacts
from strandcast.video.ingest import camera_times
from strandcast_pendulum.ball import track_ball
from strandcast_pendulum.period import check_period

LEAST_SWING_RAD = 0.02  # half of the arc; a shorter one does not determine its radius
WORST_SHARE = 0.1  # standard error of the radius over the radius


@dataclass(frozen=True)
class Arc:
    """A circle through the ball's places."""

    centre_px: np.ndarray  # (2,)
    radius_px: float
    radius_sigma_px: float  # standard error
    rms_px: float  # of the residuals
    half_angle_rad: float


def fit_arc(places_px: np.ndarray) -> Arc:
    """Fit a circle to places (F, 2) px by least squares of the distances to it; NaN rows are left out."""
    known_px = places_px[np.isfinite(places_px).all(axis=1)]
    middle = known_px.mean(axis=0)
    about = known_px - middle
    start = CircleModel.from_estimate(about)  # linear: it starts the geometric fit
    if not start:  # fewer than three places, or all on a line
        return Arc(middle, np.nan, np.inf, 0.0, 0.0)

    def off_circle(circle: np.ndarray) -> np.ndarray:
        return np.asarray(np.hypot(about[:, 0] - circle[0], about[:, 1] - circle[1]) - circle[2])

    fit = least_squares(off_circle, [*start.center, start.radius], loss="soft_l1", f_scale=0.5, x_scale="jac")
    rms = float(np.sqrt((fit.fun**2).mean()))
    slopes = np.asarray(fit.jac)
    covariance = np.linalg.pinv(slopes.T @ slopes) * rms**2
    angles = np.arctan2(about[:, 0] - fit.x[0], about[:, 1] - fit.x[1])
    half = 0.5 * float(np.percentile(angles, 99) - np.percentile(angles, 1))
    return Arc(fit.x[:2] + middle, float(fit.x[2]), float(np.sqrt(covariance[2, 2])), rms, half)


def calibrate_arc(
    path: Path, facts: VideoFacts, length_m: float, settings: TrackSettings
) -> tuple[Camera, np.ndarray]:
    """Return a camera whose scale comes from a pendulum of known length, and the scene without the ball.

    `length_m` is the distance from the pivot to the ball's centre. The world's origin is the pivot.

    Raises
    ------
    StrandcastError
        SC-T004 as `track_ball`; the arc is too short to determine its radius; its period is not that of
        the length.
    """
    ball = track_ball(path, facts)
    arc = fit_arc(ball.centre_px)
    if arc.half_angle_rad < LEAST_SWING_RAD or arc.radius_sigma_px > WORST_SHARE * arc.radius_px:
        raise StrandcastError(
            "SC-T004",
            f"an arc of ±{arc.half_angle_rad:.3f} rad does not determine its radius "
            f"({arc.radius_px:.0f} ± {arc.radius_sigma_px:.0f} px)",
            file=path,
            cost="metres would be wrong",
            fix="film a wider swing, or use markers for the scale",
        )
    across, down = (ball.centre_px - arc.centre_px).T
    check_period(camera_times(facts), np.arctan2(across, down), length_m, path)
    return arc_camera(arc, facts, length_m), ball.background


def arc_camera(arc: Arc, facts: VideoFacts, length_m: float) -> Camera:
    """Return the distant camera in whose image the arc's centre is the pivot and its radius the length."""
    centre_px = (float(arc.centre_px[0]), float(arc.centre_px[1]))
    camera = flat_camera(facts.width_px, facts.height_px, length_m / arc.radius_px, centre_px, source="arc")
    return camera.model_copy(update={"plane_rms_px": arc.rms_px})
