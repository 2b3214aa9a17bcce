"""Arrays of an estimate from a motion-capture series: hand pose and a few marked places of the string."""

import numpy as np

from strandcast.estimation.evaluation import Array
from strandcast.estimation.measured import Throw


def throw_from_markers(
    time_s: Array,
    hand_pose: Array,
    markers_m: dict[float, Array],
    length_m: float,
    points: int,
    *,
    hand_smoothing_s: float = 0.0,
) -> Throw:
    """Throw whose points are measured only where a marker sits.

    Parameters
    ----------
    time_s
        (F,) times of the series [s].
    hand_pose
        (F, 3) x, y [m] and direction in which the hand points the string [rad], unwrapped.
    markers_m
        Place along the string [m] to (F, 2) positions [m], NaN where lost; each belongs to the nearest point.
    length_m, points
        Free length [m] and number n of points.
    hand_smoothing_s
        Half-width of the local parabola through the hand's path [s]; 0 for none. At 30 Hz a millimetre of
        noise is an acceleration of a metre per second squared.
    """
    spacing_m = length_m / points
    points_m = np.full((len(time_s), points + 1, 2), np.nan)
    points_m[:, 0] = hand_pose[:, :2]
    for place_m, positions in markers_m.items():
        points_m[:, round(place_m / spacing_m)] = positions
    pose = smoothed(time_s, hand_pose, hand_smoothing_s) if hand_smoothing_s > 0 else hand_pose
    return Throw(time_s, points_m, time_s, pose, np.ones(len(time_s), dtype=bool))


def smoothed(time_s: Array, values: Array, half_width_s: float) -> Array:
    """Values (F, c) of local parabolas through the samples within `half_width_s` on either side."""
    out = np.empty_like(values)
    for k, t in enumerate(time_s):
        near = np.flatnonzero(np.abs(time_s - t) <= half_width_s)
        degree = min(2, len(near) - 1)
        out[k] = np.polynomial.polynomial.polyfit(time_s[near] - t, values[near], degree)[0]
    return out
