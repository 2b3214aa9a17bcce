"""Outputs of a simulation: positions and the value of E, at given times within the steps."""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from strandcast.dynamics.parameters import Array
from strandcast.dynamics.simd import INLINED, inverse_root, load, maximum, splat, store
from strandcast.dynamics.string_state import StringMotion

FAR_M = 100.0

# Running results of each candidate beside its positions.
RESULTS = 3
LONGEST, SHORTEST, VALUE = range(RESULTS)


class Outputs(NamedTuple):
    """What is observed of a batch of B candidates; an observer with empty arrays is not in use.

    Attributes
    ----------
    at
        (F,) increasing times of the outputs, in steps.
    measured, per_metre
        (F, n, 2 or 3) measured points and (F, n) their weights in E; with a common hand only.
    out
        (B, F, n+1, 2 or 3) positions [m]; those of points 1…n are written.
    """

    at: Array
    measured: Array
    per_metre: Array
    out: Array


@njit(**INLINED)
def _place(spec: Any, n: int, s: float, step: float, share: float, motion: StringMotion, place: Any) -> None:
    """Points 1…n relative to the hand at the step's end, at part `s` of the step: a parabola in time."""
    d, v, dv, _ = motion
    back, bent = (s - 1.0) * step, 0.5 * s / share
    x, y = splat(spec, 0.0), splat(spec, 0.0)
    for i in range(n):
        x += load(spec, d, 2 * i)
        y += load(spec, d, 2 * i + 1)
        vx, vy = load(spec, v, 2 * i + 2), load(spec, v, 2 * i + 3)
        store(spec, place, 2 * i, x + back * (vx + bent * load(spec, dv, 2 * i + 2)))
        store(spec, place, 2 * i + 1, y + back * (vy + bent * load(spec, dv, 2 * i + 3)))


@njit(**INLINED)
def _value(
    spec: Any, n: int, place: Any, measured: Any, per_metre: Any, x: float, y: float, shift: Any, kept: Any
) -> None:
    """Add one frame's share of E: weighted distances between measured and simulated points."""
    total = load(spec, kept, VALUE)
    sx, sy = load(spec, shift, 0), load(spec, shift, 1)
    for i in range(n):
        if per_metre[i] > 0.0:
            dx = load(spec, place, 2 * i) + (sx - (measured[i, 0] - x))
            dy = load(spec, place, 2 * i + 1) + (sy - (measured[i, 1] - y))
            squared = maximum(dx * dx + dy * dy, 1e-20)
            total += per_metre[i] * (squared * inverse_root(spec, squared))
    store(spec, kept, VALUE, total)


@njit(**INLINED)
def scatter(place: Any, first: int, f: int, hand: Any, out: Any) -> None:
    """Write positions of all lanes, relative to the hand's, to `out`; NaN where they are out of reach."""
    axes = len(hand)
    for lane in range(min(place.shape[1], len(out) - first)):
        for i in range(len(place) // axes):
            near = True
            for c in range(axes):
                near = near and math.fabs(place[axes * i + c, lane]) < FAR_M
            for c in range(axes):
                at_m = hand[c, lane if hand.shape[1] > 1 else 0] + place[axes * i + c, lane]
                out[first + lane, f, i + 1, c] = at_m if near else np.nan


@njit(**INLINED)
def observe(
    spec: Any,
    k: int,
    f: int,
    step: float,
    motion: StringMotion,
    place: Any,
    hand: Any,
    outputs: Outputs,
    shift: Any,
    first: int,
    results: Any,
) -> None:
    """Output f, which falls into step k; `hand` (2, width or 1) is the hand's place at the step's end."""
    n = place.shape[0] // 2
    share = 0.5 if k == 0 else 1.0
    _place(spec, n, outputs.at[f] - k, step, share, motion, place)
    if len(outputs.measured):
        measured, per_metre = outputs.measured[f], outputs.per_metre[f]
        _value(spec, n, place, measured, per_metre, hand[0, 0], hand[1, 0], shift, results)
    if len(outputs.out):
        scatter(place, first, f, hand, outputs.out)
