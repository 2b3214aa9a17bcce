"""The parts of recorded motions in space that a fit takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from strandcast.dynamics.parameters import Array
from strandcast.estimation.cable_series import CableSeries
from strandcast.estimation.cable_space import POINTS
from strandcast.estimation.throws import TrialParts

# All chosen.
WINDOWS, WINDOW_S = 10, 4.0  # of motion that are fitted, at most
OVERLAP = 2.0  # times that each instant is in a window, at most, on average
# Series without a shape that is seen: how many are fitted, for how long each, and a single one.
LONG_WINDOWS, LONG_WINDOW_S, LONGEST_WINDOW_S = 8, 20.0, 40.0
REST_EVERY_S = 0.5  # where a window may begin
NEARLY_MOST = 0.95  # of the motion that a window can have: of such, the first, which has more of the rest
LAST_FROM = 0.75  # of the newest series; the rest of it is held out once
_GOLDEN = 0.5 * (5.0**0.5 - 1.0)


def parts_by_roll(
    series: Sequence[Mapping[str, CableSeries]], points: int, **how: Any
) -> dict[str, TrialParts]:
    """Return what is fitted of series, by each roll that all of them may have; see `parts_of_series`."""
    rolls = [roll for roll in series[-1] if all(roll in each for each in series)]
    return {roll: parts_of_series([each[roll] for each in series], points, **how) for roll in rolls}


def parts_of_series(
    series: Sequence[CableSeries],
    points: int,
    start_shape: str = "observed",
    *,
    skipped: int = 0,
    last: bool = True,
) -> TrialParts:
    """Return the parts of series, the newest last, that are fitted, for strings of n = `points`.

    Parameters
    ----------
    start_shape
        See `CableSeries.prepared`.
    skipped
        How many trials there were before these.
    last
        Whether to return the same without the last part of the newest one, too.
    """
    parts, newest = parts_to_fit(series), series[-1]
    first_part = newest.part(0, round(LAST_FROM * len(newest.time_s)))
    before = [*series[:-1], first_part]
    return TrialParts(
        tuple(series[row].prepared(first, end, points, start_shape) for row, first, end in parts),
        np.array([row for row, _, _ in parts]) + skipped,
        len(series) + skipped,
        tuple(each.prepared(0, len(each.time_s), points, start_shape) for each in series),
        parts_of_series(before, points, start_shape, skipped=skipped, last=False) if last else None,
    )


def parts_to_fit(series: Sequence[CableSeries]) -> list[tuple[int, int, int]]:
    """Return series, first frame and frame after the last of each part that is fitted.

    Where the markers show the string's shape, up to `WINDOWS` parts of `WINDOW_S`, spread over the series,
    over time and over motion: over many seconds, errors of wild motions grow until they say nothing about
    the cable. Elsewhere one long part of each of up to `LONG_WINDOWS` series, from where a start is known.
    """
    if not all(each.shape_is_seen() for each in series):
        count = min(len(series), LONG_WINDOWS)
        span_s = max(LONGEST_WINDOW_S / count, LONG_WINDOW_S)
        rows = [k * len(series) // count for k in range(count)]
        return [(row, *_long_part(series[row], span_s)) for row in rows]
    recorded_s = sum(float(each.time_s[-1] - each.time_s[0]) for each in series)
    count = min(WINDOWS, max(round(OVERLAP * recorded_s / WINDOW_S), len(series)))
    parts = []
    for k in range(count):
        row = k * len(series) // count if len(series) >= count else k % len(series)
        each = series[row]
        frames = _frames(each, WINDOW_S)
        first = _at_share(each.motion_m(frames), _GOLDEN * k % 1.0)
        seen = each.reliable[first : first + frames].sum(axis=1)
        first += int(np.argmax(seen)) if len(each.time_s) > frames else 0
        parts.append((row, first, min(first + frames, len(each.time_s))))
    return list(dict.fromkeys(parts))


def _at_share(motion_m: Array, share: float) -> int:
    """Return the window at a share, 0 to 1, of all: half by their number, half by their motion (W,)."""
    weight = 1.0 / len(motion_m) + motion_m / max(motion_m.sum(), 1e-12)
    return int(np.searchsorted(np.cumsum(weight), share * weight.sum()))


def _long_part(series: CableSeries, span_s: float) -> tuple[int, int]:
    """Return the part of a series with the most motion of those that begin at rest, or with the series."""
    frames = _frames(series, span_s)
    motion_m = series.motion_m(frames)
    every = _frames(series, REST_EVERY_S) - 1
    begins = [k for k in range(0, len(motion_m), every) if k == 0 or series.start(k, POINTS).settle]
    moved_m = motion_m[begins]
    first = begins[int(np.argmax(moved_m >= NEARLY_MOST * moved_m.max()))]
    return first, first + frames


def _frames(series: CableSeries, span_s: float) -> int:
    return min(round(span_s / float(np.median(np.diff(series.time_s)))) + 1, len(series.time_s))
