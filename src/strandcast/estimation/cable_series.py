"""Recorded motions of a string in space: its driven ends, the markers seen on it, and its start."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy

from strandcast.core.jumps import GLITCH_M_S, jumps
from strandcast.core.strings import StringBatch
from strandcast.dynamics.batch import HANGING_AT_REST, HandPath, StringStart
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import GRAVITY_M_S2, Array
from strandcast.dynamics.spatial.clamps import POSE, clamp_poses, hanging_clamp_poses
from strandcast.estimation.fit_objective import simulate_throw
from strandcast.estimation.throws import PreparedThrow
from strandcast.records.alignment import EndPath

# All chosen.
SMOOTHING_S = 0.07  # of the driven ends: their markers' noise would shake the string
START_S, LONGEST_START_S = 0.08, 0.5  # around a start, from which its shape and velocity are taken
LONGER = 1.5  # of the time before: the next longer one
LIKE_NOISE = 1.3  # of the markers' noise, at most, beside parabolas through all that time
LEAST_NOISE_M = 1e-4
INDEPENDENT_S = 0.01  # between frames with independent noise, also of a tracker that follows
FOURTH = 0.6745 * 70.0**0.5  # median size of a fourth difference of noise, over its standard deviation
FEWEST_FRAMES = 3  # of a start, also of slow cameras
MOTION_S = 0.25  # over which markers move, so that their noise hardly counts
STILL_M_S = 0.01  # velocities of a start are not known better
SLOW = 0.05  # of the speed of a fall over its length: there, a string nearly has its rest shape
FEWEST = 4  # known places of a shape, the driven ends included; through fewer, the ends' directions help
UPWARDS = 0.995  # cosine of the angle to straight up: near there, a hanging roll spins
TOO_LONG = 1.1  # of the way along the string to a marker: the marker's distance is never as long
# Weight of a marker's squared distance beside the squared change of the curvature, integrated along a string
# of length 1: waves shorter than a quarter of the string are smoothed. From 1e6 to 1e8, drawn captures are
# fitted as well; ten times more, and markers side by side make a kink that whips.
ROUGHNESS, KEPT = 3e7, 1e4
CLEAR_OF_ENDS = 1e-6  # of the length: a marker nearer to a driven end is that end

Roll = Callable[[Array, Array], Array]
# How a driven end turns about its own axis where that was not measured, as fits better.
ROLLS: Mapping[str, Roll] = {"transported": clamp_poses, "hanging": hanging_clamp_poses}


def end_pose(end: EndPath, roll: str) -> Array:
    """Return poses (F, 9) of a driven end; one that is only a point holds downwards, without force."""
    if end.direction is None:
        down = np.broadcast_to([0.0, 0.0, -1.0], end.place_m.shape)
        return clamp_poses(end.place_m, down)
    if end.normal is None:
        return ROLLS[roll](end.place_m, end.direction)
    return np.hstack([end.place_m, end.direction, end.normal])


def _smoothed_end(end: EndPath, time_s: Array) -> EndPath:
    """Return a driven end's path without single wrong samples and with little noise."""
    place_m = smoothed(time_s, end.place_m)
    # Each is smoothed as a point: a wrong sample of a marker is wrong in one of its coordinates.
    return EndPath(
        place_m,
        *(
            None if away is None else smoothed(time_s, end.place_m + away) - place_m
            for away in (end.direction, end.normal)
        ),
    )


def _in_order(end: EndPath, vertices_m: Array, places: Array) -> EndPath:
    """Return a driven end's path with its two markers in order where they were taken for each other.

    The order changes wherever the direction is reversed from one frame to the next. It is wrong at first
    if the string would have to be longer than it is to reach its nearest marker.

    Parameters
    ----------
    vertices_m, places
        (F, m, 3) markers of the string [m] and (m,) their distances from this end over its length,
        the nearest first.
    """
    if end.direction is None or end.normal is not None or len(places) < 2:
        return end
    kept = (end.direction[1:] * end.direction[:-1]).sum(axis=1) >= 0.0
    order = np.cumprod(np.r_[1.0, np.where(kept, 1.0, -1.0)])
    seen = np.flatnonzero(~np.isnan(vertices_m[:, :2, 0]).any(axis=1) & (order == 1.0))[:FEWEST_FRAMES]
    if len(seen):
        apart_m = np.linalg.norm(np.diff(vertices_m[seen], axis=1), axis=2) / np.diff(places)
        longest_m = TOO_LONG * float(np.nanmedian(apart_m)) * places[0]
        reach_m, behind_m = (
            float(np.median(np.linalg.norm(vertices_m[seen, 0] - place_m[seen], axis=1)))
            for place_m in (end.place_m, end.place_m - end.direction)
        )
        order = -order if reach_m > longest_m >= behind_m else order
    exchanged = (order < 0.0)[:, None]
    return EndPath(
        np.where(exchanged, end.place_m - end.direction, end.place_m),
        np.where(exchanged, -end.direction, end.direction),
    )


def _can_hang(end: EndPath) -> bool:
    """Whether a driven end never points straight up, where no least turn leads from downwards."""
    if end.direction is None or end.normal is not None:
        return True
    return bool((end.direction[:, 2] <= UPWARDS * np.linalg.norm(end.direction, axis=1)).all())


@dataclass(frozen=True, eq=False)
class CableSeries:
    """One recorded motion of a string in space.

    Attributes
    ----------
    time_s
        (F,) times [s].
    pose
        (F, 9 or 18) of one driven end or two, see `strandcast.dynamics.batch.HandPath`.
    vertices_m, places
        (F, m, 3) measured markers [m], NaN where not seen, and (m,) their places from the first end, 0 to 1.
    pinned
        Whether the ends are points, which hold the string in no direction.
    fastest_m_s
        See `strandcast.core.jumps`.
    """

    time_s: Array
    pose: Array
    vertices_m: Array
    places: Array
    pinned: bool = False
    fastest_m_s: float = GLITCH_M_S

    def two_ends(self) -> bool:
        """Whether the string's far end is driven, too."""
        return bool(self.pose.shape[1] > POSE)

    def part(self, first: int, last: int) -> CableSeries:
        """Return the frames `first` to before `last`."""
        kept = slice(first, last)
        return replace(self, time_s=self.time_s[kept], pose=self.pose[kept], vertices_m=self.vertices_m[kept])

    @cached_property
    def reliable(self) -> np.ndarray:
        """(F, m) whether a marker is seen, and did not jump on its way there or from there."""
        seen = ~np.isnan(self.vertices_m[..., 0])
        calm = ~jumps(self.time_s, self.vertices_m, self.fastest_m_s)
        return np.asarray(seen & np.vstack([calm[:1], calm[1:] & calm[:-1], calm[-1:]]))

    def motion_m(self, frames: int) -> Array:
        """Return how far the markers move in each part of so many frames, summed over those seen (W,) [m]."""
        lag = min(max(round(MOTION_S / float(np.median(np.diff(self.time_s)))), 1), frames - 1)
        seen = self.reliable[lag:] & self.reliable[:-lag]
        step_m = np.linalg.norm(self.vertices_m[lag:] - self.vertices_m[:-lag], axis=2) / lag
        moved_m = np.r_[0.0, np.cumsum(np.where(seen, step_m, 0.0).sum(axis=1))]
        return np.asarray(moved_m[frames - lag :] - moved_m[: len(moved_m) - frames + lag])

    def shape_is_seen(self) -> bool:
        """Whether the markers of a usual frame and the driven ends show the string's shape."""
        seen = (self.reliable & self._between_the_ends()).sum(axis=1)
        return bool(np.median(seen) + 1 + self.two_ends() >= FEWEST)

    def prepared(self, first: int, last: int, points: int, start_shape: str = "observed") -> PreparedThrow:
        """Return the frames `first` to before `last` as the fit takes them, for strings of n = `points`.

        Simulated strings are compared at the markers' places. `start_shape`: what begins with the series may
        begin ``hanging``, at rest under gravity.
        """
        hangs = start_shape == "hanging" and first == 0
        kept = slice(first, last)
        hand_m = self.pose[kept, None, :3]
        weight = self.reliable[kept] & self._between_the_ends()
        return PreparedThrow(
            np.arange(first, last),
            self.time_s[kept],
            np.concatenate([hand_m, self.vertices_m[kept]], axis=1),
            weight.astype(float),
            HandPath(self.time_s[kept], self.pose[kept]),
            HANGING_AT_REST if hangs else self.start(first, points),
            self.places,
        )

    def predicted(self, model: StringModel, string: StringBatch) -> Array:
        """Return all markers (F, m, 3) [m] under a string (a batch of one), open loop from the start."""
        whole = self.prepared(0, len(self.time_s), model.points)
        return np.asarray(simulate_throw(model, whole, string)[0][0, :, 1:])

    def start(self, frame: int, points: int) -> StringStart:
        """Return shape and velocity (n = `points`) in a frame, by least squares over the frames around it.

        A spline through the markers that are seen and the driven ends. Through few of them, it begins in the
        direction of the ends, and only its directions count; if the string hardly moves, each candidate's own
        rest shape is sought.
        """
        near = self._around(frame)
        markers = self._between_the_ends() & self.reliable[near].any(axis=0)
        known = [value_and_slope(self.time_s[near] - self.time_s[frame], self.pose[near, :3])]
        for k in np.flatnonzero(markers):
            rows = near[self.reliable[near, k]]
            known.append(value_and_slope(self.time_s[rows] - self.time_s[frame], self.vertices_m[rows, k]))
        if self.two_ends():
            far = slice(POSE, POSE + 3)
            known.append(value_and_slope(self.time_s[near] - self.time_s[frame], self.pose[near, far]))
        places = np.r_[0.0, self.places[markers], [1.0] * self.two_ends()]
        if len(places) < 2:
            return HANGING_AT_REST
        values, rates = np.array(known).transpose(1, 0, 2)
        few = len(places) < FEWEST
        along = np.linspace(0.0, 1.0, points + 1)[1:]
        if few:
            ends: Any = self._directions(frame, places, values)
            natural: Any = "natural"
            shape, velocity = (
                _extended(scipy.interpolate.CubicSpline(places, path, bc_type=bc), along)
                for path, bc in ((values, ends), (rates, natural))
            )
        else:
            smoother = smoothest(places, points, self.two_ends())[1:]
            shape, velocity = smoother @ values, smoother @ rates
        reach_m = np.linalg.norm(np.diff(values, axis=0), axis=1).sum()
        fastest = np.linalg.norm(rates, axis=1).max()
        settle = bool(few and fastest <= SLOW * np.sqrt(GRAVITY_M_S2 * reach_m))
        return StringStart(shape, velocity * (fastest > STILL_M_S), respace=few, settle=settle)

    def _around(self, frame: int) -> np.ndarray:
        """Return the frames from which a start is taken: as many as parabolas in time explain.

        A velocity from few noisy frames swings a heavy end by centimetres.
        """
        order = np.argsort(np.abs(self.time_s - self.time_s[frame]), kind="stable")
        step_s, span_s = float(np.median(np.diff(self.time_s))), START_S
        near = np.sort(order[: max(round(span_s / step_s) + 1, FEWEST_FRAMES)])
        while (span_s := LONGER * span_s) <= LONGEST_START_S:
            longer = np.sort(order[: max(round(span_s / step_s) + 1, FEWEST_FRAMES)])
            if not self._beside_parabolas_m(longer) < LIKE_NOISE * self._noise_m:
                break
            near = longer
        return near

    def _beside_parabolas_m(self, rows: np.ndarray) -> float:
        """Return the standard deviation of a marker's coordinate beside parabolas in time in some frames."""
        squares, free = 0.0, 0
        for k in np.flatnonzero(self._between_the_ends()):
            seen = rows[self.reliable[rows, k]]
            if len(seen) > FEWEST_FRAMES:
                powers = np.vander(self.time_s[seen] - self.time_s[seen].mean(), 3)
                _, beside, *_ = np.linalg.lstsq(powers, self.vertices_m[seen, k], rcond=None)
                squares, free = squares + float(beside.sum()), free + beside.size * (len(seen) - 3)
        return float(np.sqrt(squares / free)) if free else np.inf

    @cached_property
    def _noise_m(self) -> float:
        """Standard deviation of a marker's coordinate, by fourth differences, which hardly see the motion."""
        every = max(round(INDEPENDENT_S / float(np.median(np.diff(self.time_s)))), 1)
        fourth = np.diff(self.vertices_m[::every, self._between_the_ends()], 4, axis=0)
        fourth = fourth[np.isfinite(fourth).all(axis=2)]
        by_axis_m = np.median(np.abs(fourth), axis=0) / FOURTH if len(fourth) else np.zeros(3)
        return max(float(np.sqrt(np.mean(by_axis_m**2))), LEAST_NOISE_M)

    def _between_the_ends(self) -> np.ndarray:
        """(m,) which markers are not at a driven end."""
        free = self.places > CLEAR_OF_ENDS
        return np.asarray(free & (self.places < 1.0 - CLEAR_OF_ENDS) if self.two_ends() else free)

    def _directions(self, frame: int, places: Array, values: Array) -> Any:
        """Return the spline's conditions at both ends: a driven end's direction, or straight."""
        straight = (2, np.zeros(3))
        if self.pinned:
            return straight, straight
        chord = float(np.linalg.norm(np.diff(values, axis=0), axis=1).sum() / (places[-1] - places[0]))
        near, far = (
            (1, sign * chord * pose[3:6] / np.linalg.norm(pose[3:6]))
            for sign, pose in ((1.0, self.pose[frame, :POSE]), (-1.0, self.pose[frame, -POSE:]))
        )
        return near, far if self.two_ends() else straight


def series_between(
    time_s: Array,
    ends: list[EndPath],
    vertices_m: Array,
    places: Array,
) -> dict[str, CableSeries]:
    """Return a motion between driven ends, which are smoothed, by the roll that they may have; see `ROLLS`.

    Parameters
    ----------
    time_s
        (F,) times [s].
    ends
        One driven end or two; only points, or none of them.
    vertices_m, places
        See `CableSeries`.
    """
    calm = [
        _smoothed_end(_in_order(end, vertices_m[:, order], np.abs(places[order] - at)), time_s)
        for end, order, at in zip(ends, _from_each_end(places), (0.0, 1.0), strict=False)
    ]
    rolls = list(ROLLS) if free_to_roll(ends) else ["measured"]
    if free_to_roll(ends) and not all(map(_can_hang, calm)):
        rolls.remove("hanging")
    return {
        roll: CableSeries(
            time_s,
            np.hstack([end_pose(end, roll) for end in calm]),
            vertices_m,
            places,
            ends[0].direction is None,
        )
        for roll in rolls
    }


def free_to_roll(ends: Sequence[EndPath]) -> bool:
    """Return whether an end holds the string in a direction about which its turn was not measured."""
    return any(end.direction is not None and end.normal is None for end in ends)


def _from_each_end(places: Array) -> tuple[np.ndarray, np.ndarray]:
    """Return the markers that are not at an end, in order from the first end and from the far one."""
    inner = np.flatnonzero((places > CLEAR_OF_ENDS) & (places < 1.0 - CLEAR_OF_ENDS))
    order = inner[np.argsort(places[inner])]
    return order, order[::-1]


def smoothed(time_s: Array, path: Array) -> Array:
    """Return paths (F, ...) without single wrong samples and with little noise."""
    frames = max(round(SMOOTHING_S / float(np.median(np.diff(time_s)))) // 2 * 2 + 1, 5)
    flat = path.reshape(len(path), -1)
    clean = np.column_stack(
        [scipy.signal.medfilt(np.pad(column, 2, mode="edge"), 5)[2:-2] for column in flat.T]
    )
    return np.asarray(scipy.signal.savgol_filter(clean, frames, 2, axis=0).reshape(path.shape))


def smoothest(places: Array, points: int, two_ends: bool) -> Array:
    """Return what a smooth string has of values at places in each of its points (n + 1, m).

    Its curvature changes little, and is none at a free end; the driven ends are the first place and, of two
    ends, the last, and are kept. Markers sit beside the string: a curve through two near ones has a kink.
    """
    shares = scipy.interpolate.CubicSpline(np.linspace(0.0, 1.0, points + 1), np.eye(points + 1))(places)
    weight = np.full(len(places), ROUGHNESS)
    weight[[0, *([-1] * two_ends)]] = KEPT * ROUGHNESS
    third = np.diff(np.eye(points + 1), 3, axis=0) * points**2.5
    rough = third.T @ third
    if not two_ends:
        last = np.diff(np.eye(points + 1), 2, axis=0)[-1] * points**2
        rough += KEPT * np.outer(last, last)
    fitted = shares.T * weight
    return np.asarray(np.linalg.solve(fitted @ shares + rough, fitted))


def _extended(spline: Any, along: Array) -> Array:
    """Return a spline's values at places, along its tangents beyond its ends."""
    inside = np.clip(along, spline.x[0], spline.x[-1])
    return np.asarray(spline(inside) + (along - inside)[:, None] * spline(inside, 1))


def value_and_slope(since_s: Array, path: Array) -> tuple[Array, Array]:
    """Return value and slope (...) at 0 of a parabola through a path (k, ...), a line through two frames."""
    degree = min(2, len(since_s) - 1)
    fitted = np.polynomial.polynomial.polyfit(since_s, path.reshape(len(path), -1), degree)
    value = fitted[0].reshape(path.shape[1:])
    return value, fitted[1].reshape(path.shape[1:]) if degree else np.zeros_like(value)
