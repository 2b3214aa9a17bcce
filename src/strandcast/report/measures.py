"""Geometry that several figures share: distances, arc lengths, instants."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from strandcast.errors import StrandcastError
from strandcast.report.results import FILES, HandPath, Results, Simulated

Array = NDArray[np.float64]


def arc_length_m(path_m: Array) -> Array:
    """Return the length (T,) along a path (T, 2) from its start, straight over what was not seen."""
    seen = np.isfinite(path_m).all(axis=1)
    length = np.zeros(len(path_m))
    steps = np.linalg.norm(np.diff(path_m[seen], axis=0), axis=1)
    length[seen] = np.concatenate([[0.0], np.cumsum(steps)])[: seen.sum()]
    return np.maximum.accumulate(length)


def equal_instants(tip_m: Array, count: int, forced: int | None) -> NDArray[np.int64]:
    """Return rows of a tip path (T, 2) at equal arc length, the forced row among them, in order of time."""
    seen = np.nonzero(np.isfinite(tip_m).all(axis=1))[0]
    if len(seen) == 0:
        return seen
    length = arc_length_m(tip_m)[seen]
    rows = seen[np.searchsorted(length, np.linspace(0.0, length[-1], count)).clip(0, len(seen) - 1)]
    if forced is not None:
        rows[np.argmin(np.abs(rows - forced))] = forced
    return np.unique(rows)


def path_distance_m(points_m: Array, path_m: Array) -> Array:
    """Return the least distance (K,) from points (K, 2) to a path's segments (T, 2)."""
    path_m = path_m[np.isfinite(path_m).all(axis=1)]
    start, step = path_m[:-1], np.diff(path_m, axis=0)
    square = np.maximum((step**2).sum(axis=1), 1e-30)
    away = points_m[:, None, :] - start
    along = np.clip((away * step).sum(axis=2) / square, 0.0, 1.0)
    return np.linalg.norm(away - along[..., None] * step, axis=2).min(axis=1)


def at_times(path: HandPath, time_s: Array) -> Array:
    """Return a hand path's places (K, 2) at robot times, NaN outside of it."""
    columns = [np.interp(time_s, path.robot_time_s, path.pose[:, k], np.nan, np.nan) for k in (0, 1)]
    return np.column_stack(columns)


def with_gaps(time_s: Array, values: Array) -> tuple[Array, Array]:
    """Return times (T,) and values (T, …) with NaN where samples are missing, so that no line crosses."""
    steps = np.diff(time_s)
    holes = np.nonzero(steps > 2.5 * np.median(steps))[0] + 1 if len(steps) else np.zeros(0, dtype=int)
    return np.insert(time_s, holes, np.nan), np.insert(values, holes, np.nan, axis=0)


def matched(results: Results, throw: Simulated) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the rows of the track and of a simulated throw that speak of the same frames."""
    _, mine, theirs = np.intersect1d(results.need("track").frame, throw.frame, return_indices=True)
    return mine, theirs


def tip_error_m(results: Results, throw: Simulated) -> tuple[Array, Array]:
    """Return robot times (K,) and the distance (K,) of the simulated tip from the measured one."""
    mine, theirs = matched(results, throw)
    difference = results.need("track").points_m[mine, -1] - throw.points_m[theirs, -1]
    return results.robot_time_s()[mine], np.linalg.norm(difference, axis=1)


def closest_row(results: Results) -> int | None:
    """Return the row of the track at which the tip was closest to the target, or None."""
    verdict, track = results.get("verdict"), results.get("track")
    if verdict is None or track is None or verdict.closest_frame is None:
        return None
    rows = np.nonzero(track.frame == verdict.closest_frame)[0]
    return int(rows[0]) if len(rows) else None


def strobe_rows(results: Results, count: int = 11) -> NDArray[np.int64]:
    """Return the rows of the track for a strobe figure: equal arc length of the tip in the miss's window."""
    track = results.need("track")
    window = np.nonzero(results.in_window())[0]
    if len(window) == 0:
        raise StrandcastError(
            "SC-H011",
            "no tracked frame lies in the motion's window",
            file=FILES["track"],
            fix="look at the alignment: its offset may be wrong",
        )
    closest = closest_row(results)
    forced = None if closest is None or closest not in window else int(closest - window[0])
    rows = equal_instants(track.points_m[window, -1], count, forced)
    if len(rows) == 0:
        raise StrandcastError("SC-H012", "the tip was never seen in the motion's window", file=FILES["track"])
    return np.asarray(window[rows])


def rms(values: Array) -> float:
    """Return the root mean square of the finite values."""
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(np.square(finite)))) if len(finite) else float("nan")
