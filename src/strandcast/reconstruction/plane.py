"""One camera's pixels to metres in the plane of motion."""

import numpy as np

from strandcast.camera.mapping import metre_to_pixel, pixel_per_metre, pixel_to_metre
from strandcast.camera.marker_pose import marker_pose
from strandcast.records.camera import Camera
from strandcast.records.observations import Observations, StringPixels
from strandcast.records.track import Track


def reconstruct(observed: Observations, camera: Camera) -> tuple[Track, dict[str, np.ndarray]]:
    """Return the track in metres, where rays meet the plane of motion, and the columns of markers.parquet.

    Several cameras need their clocks too: `strandcast.reconstruction.views`.
    """
    return intersect_plane(observed.string, camera), marker_poses(observed, camera)


def intersect_plane(pixels: StringPixels, camera: Camera) -> Track:
    """Return the mass points where their rays meet the plane of motion, with covariance.

    `sigma_m` is the tracker's own where it states one, else the root of the two variances' mean.
    """
    points_m = exact_places(pixels.points_px, camera, camera.string_offset_m)
    inverse = np.linalg.inv(pixel_per_metre(camera, points_m, camera.string_offset_m))
    covariance_m2 = inverse @ pixels.covariance_px2 @ np.swapaxes(inverse, -1, -2)
    own_m = np.sqrt(0.5 * np.trace(covariance_m2, axis1=-2, axis2=-1))
    sigma_m = np.where(np.isfinite(pixels.sigma_m), pixels.sigma_m, own_m)
    return Track(pixels.frame, pixels.camera_time_s, points_m, sigma_m, pixels.flags, covariance_m2)


def exact_places(uv_px: np.ndarray, camera: Camera, offset_m: float) -> np.ndarray:
    """Return the places (..., 2) of pixels (..., 2), with one more Newton step in the plane itself.

    `pixel_to_metre` ends at 1e-12 of a ray; the step leaves rounding errors alone.
    """
    places_m = pixel_to_metre(camera, uv_px, offset_m)
    off_px = uv_px - metre_to_pixel(camera, places_m, offset_m)
    inverse = np.linalg.inv(pixel_per_metre(camera, places_m, offset_m))
    return np.asarray(places_m + (inverse @ off_px[..., None])[..., 0])


def marker_poses(observations: Observations, camera: Camera) -> dict[str, np.ndarray]:
    """Return the columns of markers.parquet; angles of one marker are continuous over the frames."""
    markers = observations.markers
    pose, sigma_m = np.empty((len(markers.frame), 3)), np.empty(len(markers.frame))
    for marker in np.unique(markers.marker).tolist():
        mine, shape = markers.marker == marker, observations.shapes[marker]
        offset_m = camera.string_offset_m + shape.offset_m
        pose[mine], fitted_m = marker_pose(camera, markers.corners_px[mine], shape.size_m, offset_m)
        pose[mine, 2] = np.unwrap(pose[mine, 2])
        sigma_m[mine] = np.where(np.isfinite(markers.sigma_m[mine]), markers.sigma_m[mine], fitted_m)
    return {
        "frame": markers.frame,
        "camera_time_s": markers.camera_time_s,
        "marker": markers.marker,
        "x_m": pose[:, 0],
        "y_m": pose[:, 1],
        "angle_rad": pose[:, 2],
        "sigma_m": sigma_m,
    }
