"""The detections of cameras with clocks of their own, at the same instants."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from strandcast.core.interpolation import lagrange_weights
from strandcast.records.alignment import Alignment
from strandcast.records.observations import StringPixels
from strandcast.records.track import OCCLUDED, PREDICTED

LONGEST_GAP = 3.5  # chosen: of the median frame interval, across which nothing is interpolated
STEP_SHARE = 1e-3  # of a frame interval: step of the numerical speed
CUBIC_SHARE = 3.0 / 128.0  # of the fourth difference: largest error of a cubic through four even samples


class PixelsAt(NamedTuple):
    """Mass points in the pixels of one camera at F instants."""

    points_px: np.ndarray  # (F, n+1, 2)
    covariance_px2: np.ndarray  # (F, n+1, 2, 2)
    clock_px: np.ndarray  # (F, n+1, 2), by how much one standard deviation of the clock moves them
    flags: np.ndarray  # (F, n+1)


def measured_pixels(pixels: StringPixels) -> PixelsAt:
    """Return what a camera measured in its own frames: NaN where a place was inferred or predicted."""
    inferred = (pixels.flags & (OCCLUDED | PREDICTED)) > 0
    points_px = np.where(inferred[..., None], np.nan, pixels.points_px)
    return PixelsAt(points_px, pixels.covariance_px2, np.zeros_like(points_px), pixels.flags)


def pixels_at(
    pixels: StringPixels, time_s: np.ndarray, wanted_s: np.ndarray, sigma_s: np.ndarray
) -> PixelsAt:
    """Return a camera's detections at other instants: piecewise cubic in time.

    Parameters
    ----------
    pixels
        In the camera's own frames.
    time_s
        (F,) those frames on the common clock [s].
    wanted_s
        (G,) instants on the common clock [s]; NaN is returned outside the camera's frames and across gaps.
    sigma_s
        (G,) standard error of this clock against the one of `wanted_s`: all points of an instant share it.
    """
    own = measured_pixels(pixels)
    count = len(time_s)
    if count < 5:
        shape = (len(wanted_s), *own.points_px.shape[1:])
        nothing = np.full(shape, np.nan)
        return PixelsAt(nothing, np.full((*shape, 2), np.nan), nothing, np.zeros(shape[:2], np.int32))
    interval_s = float(np.median(np.diff(time_s)))
    before = np.searchsorted(time_s, wanted_s, side="right") - 1
    four = np.clip(before - 1, 0, count - 4)[:, None] + np.arange(4)
    within = (wanted_s >= time_s[0]) & (wanted_s <= time_s[-1])
    within &= np.diff(time_s[four], axis=1).max(axis=1) <= LONGEST_GAP * interval_s
    weights = lagrange_weights(time_s[four], wanted_s)
    points_px = np.einsum("gk,gkpi->gpi", weights, own.points_px[four])
    half_s = STEP_SHARE * interval_s
    later, earlier = (lagrange_weights(time_s[four], wanted_s + step_s) for step_s in (half_s, -half_s))
    speed_px_s = np.einsum("gk,gkpi->gpi", (later - earlier) / (2.0 * half_s), own.points_px[four])
    fourth_px = np.abs(np.pad(np.diff(own.points_px, n=4, axis=0), ((2, 2), (0, 0), (0, 0)), mode="edge"))
    error_px = CUBIC_SHARE * np.nan_to_num(fourth_px)[four].max(axis=1)
    covariance_px2 = np.einsum("gk,gkpij->gpij", weights**2, own.covariance_px2[four])
    covariance_px2 += error_px[..., None] ** 2 * np.eye(2)
    nearest = np.stack([np.clip(before, 0, count - 1), np.clip(before + 1, 0, count - 1)], axis=1)
    flags = np.bitwise_or.reduce(own.flags[nearest], axis=1)
    points_px = np.where(within[:, None, None], points_px, np.nan)
    return PixelsAt(points_px, covariance_px2, speed_px_s * sigma_s[:, None, None], flags)


def clock_sigma_s(alignment: Alignment, camera_time_s: np.ndarray) -> np.ndarray:
    """Return the standard error (F,) of robot time at camera times (F,); 0 of a clock that is the robot's."""
    if alignment.middle_se_s is None or alignment.middle_camera_time_s is None:
        return np.full(len(camera_time_s), alignment.offset_se_s or 0.0)
    off_s = (alignment.drift_se or 0.0) * (camera_time_s - alignment.middle_camera_time_s)
    return np.hypot(alignment.middle_se_s, off_s)
