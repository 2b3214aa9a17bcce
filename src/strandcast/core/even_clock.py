"""The even clock that rounded time stamps of a camera fit, and the frames that it shows to be missing."""

from itertools import product
from typing import NamedTuple

import numpy as np

GAP_FACTOR = 1.5  # chosen: interval relative to the usual one above which frames are missing
MAX_MISSING = 0.2  # chosen: largest share of frames missing in gaps
UNEVEN = 0.01  # chosen, of a frame interval: a tip at 10 m/s moves by 0.2 mm in 1 % of 2 ms
SLOPE_SLACK = 0.25  # of a unit from first to last stamp: rounding changes a fitted clock by 0.08
LEAST_RECURRENCES = 2  # of a rounding's pattern, without which a longer step is a missing frame
ROUNDED_HZ = (600, 1000)  # QuickTime's and Matroska's units, which a copy in a finer one keeps


class EvenClock(NamedTuple):
    """A clock that ticks once per frame, in units of the time stamps that it was rounded to."""

    frame: np.ndarray  # (n,) number of each frame on it; missing ones are counted
    step: float
    rounded_to: float


def even_clock(stamps: np.ndarray, base_s: float) -> EvenClock | None:
    """Return the even clock that rounds to `stamps` [ticks]; None: they are exact, or uneven.

    Formats and phones round time stamps: 240 frames/s in QuickTime's 1/600 s last 2 or 3 units. A file that
    was copied to another format keeps the coarser unit: the greatest that divides all stamps, or one that the
    stamps are multiples of, rounded once more.
    """
    numbered = np.concatenate([[0], np.cumsum(frame_steps(stamps, usual_step(stamps)))])
    every = np.arange(len(stamps))
    complete = np.array_equal(numbered, every)
    for (unit, again), frame in product(_units(stamps, base_s), (every, numbered)):
        missing = frame[-1] + 1 - len(frame)
        if missing > MAX_MISSING * (frame[-1] + 1) or (np.diff(frame) == 0).any():
            continue
        fitted = float(np.polyfit(frame, stamps, 1)[0])
        step = _usual(fitted, SLOPE_SLACK * unit / frame[-1], base_s)
        off = 0.5 * min(np.ptp(stamps - each * frame) for each in (fitted, step))
        if off < UNEVEN * step and (complete or frame is numbered):
            return None
        # 500 frames/s in 1/600 s look like 600 with every sixth frame missing: a whole rate is more probable.
        if frame is every and not complete and step == fitted:
            continue
        # Steps of two lengths recur as rounding makes them; a single other one is a frame at another time.
        recurrences = len(stamps) * min(step % unit, -step % unit) / unit
        if off <= 0.55 * unit + again and recurrences >= LEAST_RECURRENCES:
            return EvenClock(frame, step, unit)
    return None


def _units(stamps: np.ndarray, base_s: float) -> list[tuple[float, float]]:
    """Return the units that stamps may have been rounded to, and half a tick if they were rounded again."""
    divisor = float(np.gcd.reduce(stamps))
    coarse = [unit for rate_hz in ROUNDED_HZ if (unit := 1.0 / (rate_hz * base_s)) > divisor]
    again = [unit for unit in coarse if (stamps == np.rint(np.rint(stamps / unit) * unit)).all()]
    return [(divisor, 0.0), *((unit, 0.5) for unit in again)]


def _usual(step: float, slack: float, base_s: float) -> float:
    """Return the step of a whole rate, or of NTSC's 1000/1001 of one, within `slack`; else `step` [ticks]."""
    rate_hz = 1.0 / (step * base_s)
    steps = [1.0 / (each * base_s) for each in (round(rate_hz), round(1.001 * rate_hz) / 1.001) if each > 0]
    near = min(steps, key=lambda each: abs(each - step), default=step)
    return float(near if abs(near - step) <= slack else step)


def usual_step(ticks: np.ndarray) -> float:
    """Return the usual spacing of the time stamps [ticks]: the mean of those near the median of pairs.

    Time bases are coarse (500 frames/s at 1/16384 s steps by 32 or 33 ticks): the median is too inexact, and
    of steps by 2 and 3 it would be either.
    """
    steps = np.diff(ticks).astype(np.float64)
    rising = steps[steps > 0]
    pairs = 0.5 * (rising[1:] + rising[:-1]) if len(rising) > 1 else rising
    median = float(np.median(pairs)) if len(pairs) else 1.0
    near = steps[(steps >= 0.5 * median) & (steps <= GAP_FACTOR * median)]
    return float(near.mean()) if len(near) else median


def frame_steps(ticks: np.ndarray, step: float) -> np.ndarray:
    """Return the frames from each time stamp to the next, in whole numbers; 0 for equal stamps."""
    spans = np.diff(ticks) / step
    return np.where(spans > GAP_FACTOR, spans + 0.5, spans > 0).astype(np.int64)
