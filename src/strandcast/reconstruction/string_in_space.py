"""A string in space from the curves that several cameras see of it.

A camera measures a string well across its picture and badly along it: how far along a pixel lies depends on
how much of the string points towards the camera. So the n-th points of two cameras are not the same material
point. Here each mass point lies on every camera's curve, wherever along it, and at its known distance along
the string from its neighbours; only the string's two ends are points that the cameras see as such. On strings
that sway by a third of their length and more, this locates points to 1.5 mm, point numbers to 16 to 24 mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy

from strandcast.reconstruction.rays import CameraRays
from strandcast.reconstruction.triangulate import (
    INCONSISTENT,
    INCONSISTENT_SIGMA,
    LEAST_ANGLE_RAD,
    ONE_CAMERA,
    PARALLEL,
    SpacePoints,
    inverse,
    largest_angle_rad,
    triangulate,
)

# All chosen on simulated strings that leave the plane; a factor of two changes the errors by about a tenth.
ROUNDS = 14
SOFT_ROUNDS = 5  # that begin with larger pixel errors, halved each time: curves far apart do not lock on
ALONG_SHARE = 0.02  # of the string's length: how far along its curve a camera's point may lie from its place
SPACING_SHARE = 0.01  # of a spacing: its standard deviation
BEND_RAD = 0.3  # standard deviation of the bend between neighbouring segments
LARGEST_SLIDE = 0.5  # of a spacing: of a point along its curve in one round
FEWEST_SHARE = 0.5  # of the mass points that two cameras must see
# A cubic spline's error between two points is at most 1/384 of the fourth difference where that varies
# slowly; where an apparent string turns sharply, ten times this gave errors of the stated size.
SPLINE_SHARE = 10.0 * 16.0 / 384.0


class CurvesSeen(NamedTuple):
    """The curves of F strings in one camera, as cubic splines over the number of the mass point."""

    coefficients: np.ndarray  # (4, n, F, 2)
    seen: np.ndarray  # (F, n+1): which points were detected
    rough: np.ndarray  # (F, n, 2): fourth differences, to which a spline's error is proportional
    covariance: np.ndarray  # (F, n+1, 2, 2)
    shared: np.ndarray  # (F, n+1, 2), as in `CameraRays`

    def at(self, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the rays and their slopes (F, n+1, 2) at places (F, n+1) along the curves, 0 to n."""
        knot = np.clip(np.floor(place).astype(int), 0, self.coefficients.shape[1] - 1)
        part = (place - knot)[..., None]
        a, b, c, d = self.coefficients[:, knot, np.arange(len(place))[:, None]]
        return ((a * part + b) * part + c) * part + d, (3.0 * a * part + 2.0 * b) * part + c

    def known(self, place: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return which places (F, n+1) were measured, with covariances and shared errors."""
        each, nearest = np.arange(len(place))[:, None], np.rint(place).astype(int)
        knot = np.clip(np.floor(place).astype(int), 0, self.coefficients.shape[1] - 1)
        part = (place - knot)[..., None]
        error = SPLINE_SHARE * (part * (1.0 - part)) ** 2 * self.rough[each, knot]
        covariance = self.covariance[each, nearest] + error[..., None] ** 2 * np.eye(2)
        return self.seen[each, nearest], covariance, self.shared[each, nearest]


def string_in_space(views: Sequence[CameraRays], length_m: float) -> SpacePoints:
    """Return the mass points (F, n+1, 3) of a string of known length from the curves of several cameras.

    Parameters
    ----------
    views
        Rays (F, n+1, 2) of each camera at the same F instants: points in order along the string, the first
        and the last at its ends. NaN where not detected.
    length_m
        From point 0 to point n along the string.

    Returns
    -------
    SpacePoints
        `misfit_sigma` of a point is its largest error over its standard deviation: of the ends' reprojection,
        of an inner point's distance from the curves, and of the spacing to its neighbours.
    """
    start = triangulate(views)
    usable = (np.isfinite(start.points_m).all(axis=-1).mean(axis=1) >= FEWEST_SHARE) & np.isfinite(
        start.points_m[:, [0]]
    ).all(axis=(1, 2))
    points_m = np.full_like(start.points_m, np.nan)
    covariance_m2, misfit_sigma = np.full((*points_m.shape, 3), np.nan), np.full(points_m.shape[:2], np.nan)
    if usable.any():
        found = _fit([view.at(usable) for view in views], _filled(start.points_m[usable]), length_m)
        points_m[usable], covariance_m2[usable], misfit_sigma[usable] = found
    seen = sum(np.isfinite(view.rays).all(axis=-1).astype(int) for view in views)
    doubts = INCONSISTENT * ~(misfit_sigma <= INCONSISTENT_SIGMA) | ONE_CAMERA * (seen < 2)
    doubts = doubts | PARALLEL * ~(largest_angle_rad(views) >= LEAST_ANGLE_RAD) * (seen >= 2)
    return SpacePoints(points_m, covariance_m2, misfit_sigma, doubts)


def _fit(
    views: Sequence[CameraRays], points_m: np.ndarray, length_m: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points, covariances and misfits of strings by Gauss-Newton from first points (F, n+1, 3)."""
    count = points_m.shape[1]
    spacing_m = length_m / (count - 1)
    curves = [_curves(view) for view in views]
    places = [np.tile(np.arange(count, dtype=float), (len(points_m), 1)) for _ in views]
    for turn in range(ROUNDS + 1):
        information = np.zeros((len(points_m), count, 3, count, 3))
        pull = np.zeros_like(points_m)
        soft = 4.0 ** max(0, SOFT_ROUNDS - turn)
        pairs = zip(views, curves, places, strict=True)
        pulls = [_add_view(information, view, curve, place, points_m, soft) for view, curve, place in pairs]
        misfit = np.fmax.reduce([each.misfit for each in pulls])
        misfit = np.fmax(misfit, _add_spacings(information, pull, points_m, spacing_m))
        _add_bends(information, pull, points_m, spacing_m)
        flat = information.reshape(len(points_m), 3 * count, 3 * count)
        flat[~np.isfinite(flat).all(axis=(1, 2))] = np.eye(3 * count)  # a string that left a camera's sight
        if turn < ROUNDS:
            pull += sum(each.pull for each in pulls)
            step_m = np.linalg.solve(flat, pull.reshape(-1, 3 * count, 1))
            points_m = points_m + step_m.reshape(points_m.shape)
    each = np.arange(count)
    covariance = np.moveaxis(np.linalg.inv(flat).reshape(-1, count, 3, count, 3)[:, each, :, each], 0, 1)
    for one in pulls:
        moved_m = np.linalg.solve(flat, one.shared.reshape(-1, 3 * count, 1)).reshape(points_m.shape)
        covariance = covariance + moved_m[..., :, None] * moved_m[..., None, :]
    return points_m, covariance, misfit


def _curves(view: CameraRays) -> CurvesSeen:
    """Return the curves through a camera's points; across gaps they are straight, and not measurements."""
    seen = np.isfinite(view.rays).all(axis=-1)
    seen &= seen.sum(axis=1, keepdims=True) >= 2  # through one point there is no curve
    rays = np.nan_to_num(_filled(view.rays))
    spline = scipy.interpolate.CubicSpline(np.arange(rays.shape[1]), rays, axis=1)
    fourth = np.pad(np.abs(np.diff(rays, n=4, axis=1)), ((0, 0), (2, 2), (0, 0)), mode="edge")
    rough = np.maximum(fourth[:, 1:], fourth[:, :-1])
    covariance = np.where(seen[..., None, None], view.covariance, np.eye(2))
    shared = np.where(seen[..., None], view.shared, 0.0)
    return CurvesSeen(np.asarray(spline.c), seen, rough, covariance, shared)


class CameraPull(NamedTuple):
    """What one camera's curve adds to the normal equations.

    The gradients of its rays and of the error that they share (F, n+1, 3); errors over sigma (F, n+1).
    """

    pull: np.ndarray
    shared: np.ndarray
    misfit: np.ndarray


def _add_view(
    information: np.ndarray,
    view: CameraRays,
    curve: CurvesSeen,
    place: np.ndarray,
    points_m: np.ndarray,
    soft: float,
) -> CameraPull:
    """Add one camera's curve to the information, after sliding `place` (F, n+1) along it to the points.

    `soft` is a factor on the covariance of the pixels.
    """
    count = place.shape[1]
    rays, slope = view.projected(points_m)
    on_curve, along = curve.at(place)
    square = np.maximum((along**2).sum(axis=-1), 1e-18)
    slide = np.nan_to_num(((rays - on_curve) * along).sum(axis=-1) / square)
    place[:, 1:-1] += np.clip(slide[:, 1:-1], -LARGEST_SLIDE, LARGEST_SLIDE)
    np.clip(place, 0.0, count - 1.0, out=place)
    on_curve, along = curve.at(place)
    seen, covariance, shared = curve.known(place)
    seen = seen & np.isfinite(rays).all(axis=-1)
    loose = soft * covariance + (ALONG_SHARE * count) ** 2 * along[..., :, None] * along[..., None, :]
    ends = np.isin(np.arange(count), (0, count - 1))
    weight = inverse(np.where(ends[:, None, None], soft * covariance, loose)) * seen[..., None, None]
    off = np.where(seen[..., None], on_curve - rays, 0.0)
    slope = np.where(seen[..., None, None], slope, 0.0)
    gain = np.swapaxes(slope, -1, -2) @ weight
    index = np.arange(count)
    information[:, index, :, index] += np.moveaxis(gain @ slope, 1, 0)
    misfit = np.sqrt((off[..., None, :] @ weight @ off[..., None])[..., 0, 0] / 2.0)
    return CameraPull((gain @ off[..., None])[..., 0], (gain @ shared[..., None])[..., 0], misfit)


def _add_spacings(
    information: np.ndarray, pull: np.ndarray, points_m: np.ndarray, spacing_m: float
) -> np.ndarray:
    """Add the distances between neighbours, return the larger error over sigma of each point's two (F, n+1).

    Where the string bends by θ between its segments, a chord is shorter than its arc by the share θ²/24.
    """
    chord = np.diff(points_m, axis=1)
    size = np.linalg.norm(chord, axis=-1)
    unit = chord / size[..., None]
    bend = np.arccos(np.clip((unit[:, 1:] * unit[:, :-1]).sum(axis=-1), -1.0, 1.0))
    around = np.concatenate([bend[:, :1], bend, bend[:, -1:]], axis=1)
    wanted = spacing_m * (1.0 - (0.5 * (around[:, 1:] + around[:, :-1])) ** 2 / 24.0)
    sigma_m = SPACING_SHARE * spacing_m
    block = unit[..., :, None] * unit[..., None, :] / sigma_m**2
    force = ((wanted - size) / sigma_m**2)[..., None] * unit
    k = np.arange(chord.shape[1])
    for one, other, sign in ((k, k, 1.0), (k + 1, k + 1, 1.0), (k, k + 1, -1.0), (k + 1, k, -1.0)):
        information[:, one, :, other] += sign * np.moveaxis(block, 1, 0)
    pull[:, :-1] -= force
    pull[:, 1:] += force
    off = np.abs(wanted - size) / sigma_m
    outer = np.concatenate([np.zeros_like(off[:, :1]), off, np.zeros_like(off[:, :1])], axis=1)
    return np.asarray(np.maximum(outer[:, 1:], outer[:, :-1]))


def _add_bends(information: np.ndarray, pull: np.ndarray, points_m: np.ndarray, spacing_m: float) -> None:
    """Add that a string bends little from one segment to the next."""
    second = points_m[:, 2:] - 2.0 * points_m[:, 1:-1] + points_m[:, :-2]
    weight = 1.0 / (BEND_RAD * spacing_m) ** 2
    rows = ((0, 1.0), (1, -2.0), (2, 1.0))
    k = np.arange(second.shape[1])
    for one, factor in rows:
        pull[:, k + one] -= weight * factor * second
        for other, other_factor in rows:
            information[:, k + one, :, k + other] += weight * factor * other_factor * np.eye(3)


def _filled(points: np.ndarray) -> np.ndarray:
    """Return points (F, n+1, k), gaps filled linearly along the string, straight on beyond the last."""
    filled = points.copy()
    each = np.arange(points.shape[1])
    for k in np.flatnonzero(~np.isfinite(points).all(axis=(1, 2))):
        row = filled[k]
        known = np.flatnonzero(np.isfinite(row).all(axis=-1))
        if len(known) < 2:
            continue
        before = np.clip(np.searchsorted(known, each, side="right") - 1, 0, len(known) - 2)
        first, second = known[before], known[before + 1]
        share = ((each - first) / (second - first))[:, None]
        filled[k] = row[first] + share * (row[second] - row[first])
    return filled
