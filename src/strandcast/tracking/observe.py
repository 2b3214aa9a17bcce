"""The tracker's points and markers in metres, projected back into the pixels of the camera that saw them."""

import numpy as np

from strandcast.camera.mapping import metre_to_pixel, pixel_per_metre
from strandcast.camera.markers import corners_of
from strandcast.core.pose import Pose
from strandcast.records.camera import Camera
from strandcast.records.observations import MarkerPixels, MarkerShape, Observations, StringPixels
from strandcast.tracking.result import Tracked

CORNER_SHARE = 2.0  # a corner's standard error over that of the centre, the mean of four


def observe(tracked: Tracked, camera: Camera, name: str, shapes: dict[int, MarkerShape]) -> Observations:
    """Return a tracking result as pixels of the camera with this name, and the hand's markers by id.

    The tracker works in the plane of motion. The exact map of the camera's record carries its places to
    pixels; `strandcast.reconstruction` inverts it. The covariance in pixels is that of the tracker's sigma,
    isotropic in the plane.
    """
    offset_m = camera.string_offset_m
    string = StringPixels(
        np.arange(len(tracked.camera_time_s)),
        tracked.camera_time_s,
        metre_to_pixel(camera, tracked.points_m, offset_m),
        _covariance_px2(camera, tracked.points_m, tracked.sigma_m, offset_m),
        tracked.sigma_m,
        tracked.flags,
    )
    return Observations(name, string, _markers(tracked.markers, camera, shapes), shapes)


def _markers(markers: dict[str, np.ndarray], camera: Camera, shapes: dict[int, MarkerShape]) -> MarkerPixels:
    count = len(markers["frame"])
    corners_px, covariance_px2 = np.empty((count, 4, 2)), np.empty((count, 4, 2, 2))
    for marker in np.unique(markers["marker"]).tolist():
        mine, shape = markers["marker"] == marker, shapes[marker]
        offset_m = camera.string_offset_m + shape.offset_m
        poses = np.stack([markers[name][mine] for name in ("x_m", "y_m", "angle_rad")], axis=-1)
        corners_m = Pose.from_array(poses[:, None]).place(corners_of(shape.size_m))
        sigma_m = np.repeat(CORNER_SHARE * markers["sigma_m"][mine, None], 4, axis=1)
        corners_px[mine] = metre_to_pixel(camera, corners_m, offset_m)
        covariance_px2[mine] = _covariance_px2(camera, corners_m, sigma_m, offset_m)
    return MarkerPixels(
        markers["frame"],
        markers["camera_time_s"],
        markers["marker"],
        corners_px,
        covariance_px2,
        markers["sigma_m"],
    )


def _covariance_px2(camera: Camera, places_m: np.ndarray, sigma_m: np.ndarray, offset_m: float) -> np.ndarray:
    """Return the covariances (..., 2, 2) [px²] of places (..., 2) with sigmas (...) per axis."""
    jacobian = sigma_m[..., None, None] * pixel_per_metre(camera, places_m, offset_m)
    return np.asarray(jacobian @ np.swapaxes(jacobian, -1, -2))
