"""The observations of several cameras to one track in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.reconstruction.one_clock import PixelsAt, clock_sigma_s, measured_pixels, pixels_at
from strandcast.reconstruction.rays import CameraRays, rays_of
from strandcast.reconstruction.string_in_space import string_in_space
from strandcast.reconstruction.triangulate import SpacePoints, triangulate
from strandcast.records.alignment import Alignment
from strandcast.records.camera import Camera
from strandcast.records.observations import StringPixels
from strandcast.records.track import OCCLUDED, UNSURE, Track

# As for a track in the plane: sigma per axis from which a place is unsure, and from which it is none.
UNSURE_M, LOST_M = 0.003, 0.015
LOOSE_SHARE = 1.0  # chosen: of the last spacing, standard deviation of an unsure tip along the string
FEWEST_POINTS = 4  # a spline's error is taken from fourth differences of the hand and these
DISAGREE_SIGMA = 4.0  # chosen: of the ends' median reprojection error, from which the cameras do not fit


@dataclass(frozen=True)
class StringView:
    """What one camera saw of a string: its pixels, the camera's record, and its clock."""

    name: str
    pixels: StringPixels
    camera: Camera
    clock: Alignment


@dataclass(frozen=True, eq=False)
class SpaceReconstruction:
    """A track in space at the frames of the first camera, how well the cameras agree, and warnings.

    Attributes
    ----------
    track
        x to the right, y up, z towards the cameras, from the plane's markers [m].
    robot_time_s
        (F,) of the track's frames.
    ends_px, ends_sigma
        Median reprojection error of hand and tip, and over its standard deviation: 1 is usual.
    """

    track: Track
    robot_time_s: np.ndarray
    ends_px: float
    ends_sigma: float
    warnings: list[str]


def reconstruct_in_space(views: list[StringView], length_m: float) -> SpaceReconstruction:
    """Return the track of a string that several calibrated cameras filmed at the same time.

    All cameras' records are in the world of the same markers of the plane. Their clocks may differ: each has
    its alignment with the robot's. The detections of the others are interpolated to the first one's frames.

    Parameters
    ----------
    views
        Two cameras or more, with the same number of mass points; the track has the first one's frames.
    length_m
        The string's free length.

    Raises
    ------
    StrandcastError
        SC-I047 too few points, no common time, or rays that do not meet in front of the cameras.
    """
    _refuse_few(views)
    first = views[0]
    robot_s = first.clock.robot_time_s(first.pixels.camera_time_s)
    own_sigma_s = clock_sigma_s(first.clock, first.pixels.camera_time_s)
    seen = [measured_pixels(first.pixels)]
    for view in views[1:]:
        time_s = view.clock.robot_time_s(view.pixels.camera_time_s)
        its_sigma_s = np.interp(robot_s, time_s, clock_sigma_s(view.clock, view.pixels.camera_time_s))
        seen.append(pixels_at(view.pixels, time_s, robot_s, np.hypot(own_sigma_s, its_sigma_s)))
    if not all(np.isfinite(each.points_px).any() for each in seen):
        what = f"the cameras {_names(views)} filmed nothing at the same time"
        raise StrandcastError("SC-I047", what, fix="take trials of the same throw; check their alignments")
    rays = [
        rays_of(each.points_px, with_loose_tip(each), view.camera, each.clock_px)
        for each, view in zip(seen, views, strict=True)
    ]
    found = string_in_space(rays, length_m)
    flags = np.bitwise_or.reduce([each.flags for each in seen], axis=0) & ~OCCLUDED
    track = _track(first.pixels, found, flags)
    ends_px, ends_sigma = ends_agreement(rays, [view.camera for view in views])
    if not (np.isfinite(ends_px) and np.isfinite(track.points_m[:, 1:]).any()):
        raise StrandcastError(
            "SC-I047",
            f"nothing that {_names(views)} saw is at one place in front of them",
            fix="take trials of the same throw; check the places of the plane's markers and the alignments",
        )
    warnings = _warnings(views, track, ends_px, ends_sigma)
    return SpaceReconstruction(track, robot_s, ends_px, ends_sigma, warnings)


def with_loose_tip(seen: PixelsAt) -> np.ndarray:
    """Return covariances (F, n+1, 2, 2) in which an unsure tip may lie elsewhere along the string.

    The tracker's chain keeps its length in the plane, so that it ends beyond a string that tilts out of it.
    """
    along_px = LOOSE_SHARE * (seen.points_px[:, -1] - seen.points_px[:, -2])
    unsure = ((seen.flags[:, -1] & UNSURE) > 0) & np.isfinite(along_px).all(axis=-1)
    along_px = np.where(unsure[:, None], along_px, 0.0)
    covariance_px2 = seen.covariance_px2.copy()
    covariance_px2[:, -1] += along_px[:, :, None] * along_px[:, None, :]
    return covariance_px2


def ends_agreement(rays: list[CameraRays], cameras: list[Camera]) -> tuple[float, float]:
    """Return the median reprojection error [px] of hand and tip, and over its standard deviation.

    The ends are the only points of a plain string that every camera sees as such. Wrong poses, wrong clocks
    or exchanged cameras show in them.
    """
    ends = [view.at((slice(None), [0, -1])) for view in rays]
    points = triangulate(ends)
    focal_px = np.mean([camera.lens.matrix[0][0] for camera in cameras])
    off = [np.linalg.norm(view.projected(points.points_m)[0] - view.rays, axis=-1) for view in ends]
    if not np.isfinite(points.misfit_sigma).any():
        return np.inf, np.inf  # the rays meet behind the cameras
    return float(focal_px * np.nanmedian(off)), float(np.nanmedian(points.misfit_sigma))


def _track(pixels: StringPixels, found: SpacePoints, flags: np.ndarray) -> Track:
    sigma_m = np.sqrt(np.trace(found.covariance_m2, axis1=-2, axis2=-1) / 3.0)
    with np.errstate(invalid="ignore"):
        lost, unsure = ~(sigma_m <= LOST_M), sigma_m > UNSURE_M
    return Track(
        pixels.frame,
        pixels.camera_time_s,
        np.where(lost[..., None], np.nan, found.points_m),
        np.where(lost, np.nan, sigma_m),
        np.where(lost, 0, flags | UNSURE * ((found.doubts > 0) | unsure)).astype(np.int32),
        np.where(lost[..., None, None], np.nan, found.covariance_m2),
    )


def _warnings(views: list[StringView], track: Track, ends_px: float, ends_sigma: float) -> list[str]:
    names, warnings = _names(views), []
    if ends_sigma > DISAGREE_SIGMA:
        warnings.append(
            f"the cameras {names} do not fit each other: hand and tip are reprojected with {ends_px:.2g} px, "
            f"{ends_sigma:.1f} standard errors; check the places of the plane's markers in both photos, the "
            "alignments of both clocks, and that no camera's files were exchanged"
        )
    located = np.isfinite(track.points_m).all(axis=-1).mean()
    if located < 0.5:
        warnings.append(f"only {100 * located:.0f} % of the points were located in space by {names}")
    return warnings


def _names(views: list[StringView]) -> str:
    return " and ".join(view.name for view in views)


def _refuse_few(views: list[StringView]) -> None:
    points = min(view.pixels.points_px.shape[1] for view in views) - 1
    if points < FEWEST_POINTS:
        what = f"{points} mass points do not show the shape of a string in space"
        raise StrandcastError("SC-I047", what, fix=f"set string.points to {FEWEST_POINTS} or more, and track")
