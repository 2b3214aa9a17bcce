"""Geometry shared by several panels: distances, arc lengths, instants."""

import numpy as np
from numpy.typing import NDArray

from strandcast.core.closest_approach import nearest_of_bar
from strandcast.errors import StrandcastError
from strandcast.records.estimate import CARRIED, HANGING, Estimate
from strandcast.records.verdict import Verdict
from strandcast.report.results import FILES, Array, HandPoses, SimulatedThrow, TrialResults

GUESSES = (HANGING, CARRIED)  # made without a model


def arc_length_m(path_m: Array) -> Array:
    """Return the length (T,) along a path (T, 2) from its start, with straight lines across gaps."""
    known = np.isfinite(path_m).all(axis=1)
    length = np.zeros(len(path_m))
    steps = np.linalg.norm(np.diff(path_m[known], axis=0), axis=1)
    length[known] = np.concatenate([[0.0], np.cumsum(steps)])[: known.sum()]
    return np.maximum.accumulate(length)


def equal_instants(tip_m: Array, count: int, forced: int | None) -> NDArray[np.int64]:
    """Return rows of a tip path (T, 2) at equal arc length, including the forced row, in order of time."""
    known = np.nonzero(np.isfinite(tip_m).all(axis=1))[0]
    if len(known) == 0:
        return known
    length = arc_length_m(tip_m)[known]
    rows = known[np.searchsorted(length, np.linspace(0.0, length[-1], count)).clip(0, len(known) - 1)]
    if forced is not None:
        rows[np.argmin(np.abs(rows - forced))] = forced
    return np.unique(rows)


def target_distance_m(verdict: Verdict, places_m: Array) -> Array:
    """Return the distance (…) of places (…, 2) from the target or the bar."""
    return np.asarray(np.linalg.norm(places_m - nearest_of_bar(places_m, target_ends_m(verdict)), axis=-1))


def target_ends_m(verdict: Verdict) -> Array:
    """Return the target (1, 2 or 3), or both ends of the bar (2, 2)."""
    return np.array(verdict.bar_m or [verdict.target()])


def within_motion(results: TrialResults) -> dict[str, HandPoses]:
    """Return the hand's paths between the motion's start and 0.1 s after its end."""
    alignment = results.need("alignment")
    paths = {}
    for name, path in results.need("hand").items():
        inside: NDArray[np.bool_] = (path.robot_time_s >= alignment.motion_start_s) & (
            path.robot_time_s <= alignment.motion_end_s + 0.1
        )
        if inside.sum() > 1:
            paths[name] = HandPoses(path.robot_time_s[inside], path.pose[inside])
    return paths


def path_distance_m(points_m: Array, path_m: Array) -> Array:
    """Return the least distance (K,) from points (K, 2) to a path's segments (T, 2)."""
    path_m = path_m[np.isfinite(path_m).all(axis=1)]
    start, step = path_m[:-1], np.diff(path_m, axis=0)
    square = np.maximum((step**2).sum(axis=1), 1e-30)
    away = points_m[:, None, :] - start
    along = np.clip((away * step).sum(axis=2) / square, 0.0, 1.0)
    return np.asarray(np.linalg.norm(away - along[..., None] * step, axis=2).min(axis=1))


def at_times(path: HandPoses, time_s: Array) -> Array:
    """Return a hand path's places (K, 2) at robot times, NaN outside of it."""
    columns = [np.interp(time_s, path.robot_time_s, path.pose[:, k], np.nan, np.nan) for k in (0, 1)]
    return np.column_stack(columns)


def with_gaps(time_s: Array, values: Array) -> tuple[Array, Array]:
    """Return times (T,) and values (T, …) with NaN where samples are missing, so that lines break there."""
    steps = np.diff(time_s)
    holes = np.nonzero(steps > 2.5 * np.median(steps))[0] + 1 if len(steps) else np.zeros(0, dtype=int)
    return np.insert(time_s, holes, np.nan), np.insert(values, holes, np.nan, axis=0)


def fit_errors_m(results: TrialResults, throw: SimulatedThrow) -> tuple[NDArray[np.int64], Array]:
    """Return the rows (K,) of the track that a throw simulates, and their points' distances (K, n+1)."""
    track = results.need("track")
    _, mine, theirs = np.intersect1d(track.frame, throw.frame, return_indices=True)
    return mine, np.linalg.norm(track.points_m[mine] - throw.points_m[theirs], axis=2)


def tip_error_m(results: TrialResults, throw: SimulatedThrow) -> tuple[Array, Array]:
    """Return robot times (K,) and the distance (K,) of the simulated tip from the measured one."""
    rows, apart_m = fit_errors_m(results, throw)
    return results.robot_time_s()[rows], apart_m[:, -1]


def closest_row(results: TrialResults) -> int | None:
    """Return the row of the track at which the tip was closest to the target, or None."""
    verdict, track = results.get("verdict"), results.get("track")
    if verdict is None or track is None or verdict.closest_frame is None:
        return None
    rows = np.nonzero(track.frame == verdict.closest_frame)[0]
    return int(rows[0]) if len(rows) else None


def strobe_rows(results: TrialResults, count: int = 11) -> NDArray[np.int64]:
    """Return rows of the track for a strobe figure: equal arc length of the tip within the motion."""
    track = results.need("track")
    window = np.nonzero(results.in_window())[0]
    if len(window) == 0:
        raise StrandcastError("SC-E002", "no tracked frame lies in the motion's window", file=FILES["track"])
    closest = closest_row(results)
    forced = None if closest is None or closest not in window else int(closest - window[0])
    rows = equal_instants(track.points_m[window, -1], count, forced)
    if len(rows) == 0:
        raise StrandcastError(
            "SC-T004", "the tip was never detected in the motion's window", file=FILES["track"]
        )
    return np.asarray(window[rows])


def fit_window(results: TrialResults) -> str:
    """Return in words which frames of the throw are in E and in the fit's distances."""
    estimate, alignment = results.need("estimate"), results.get("alignment")
    frames = f"{estimate.frames_used} frames"
    if estimate.window_s is None or alignment is None:
        return f"{frames} of the fit"
    first, last = (f"{1e3 * (time_s - alignment.motion_start_s):.0f}" for time_s in estimate.window_s)
    return f"{frames} from {first} to {last} ms after the motion’s start"


def fitted_rows(results: TrialResults) -> NDArray[np.bool_]:
    """Return which frames of the track (F,) lie within those of the fit; none if these are not known."""
    estimate, time_s = results.need("estimate"), results.robot_time_s()
    first_s, last_s = estimate.window_s or (np.inf, -np.inf)
    return np.asarray((time_s >= first_s) & (time_s <= last_s))


def best_guess_m(estimate: Estimate) -> float | None:
    """Return the lower E of the guesses without a model; None if there is none."""
    return min((each for what in GUESSES if (each := estimate.held_out_m(what)) is not None), default=None)


def runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last index of each run of true flags (K,)."""
    edges = np.diff(np.concatenate([[False], flags, [False]]).astype(int))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return list(zip(starts.tolist(), ends.tolist(), strict=True))


def rms(values: Array) -> float:
    """Return the root mean square of the finite values."""
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(np.square(finite)))) if len(finite) else float("nan")
