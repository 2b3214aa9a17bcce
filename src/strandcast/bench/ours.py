"""The string of this package, as the benchmark calls it: precision and width of vectors are chosen here."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal

import numpy as np

from strandcast.bench.swing import COMMON_S, DURATION_S, LENGTH_M, MASSES, SEGMENTS, Swing, knots
from strandcast.string.model import StringModel
from strandcast.string.parameters import Array
from strandcast.string.simulate import evaluate_batch, simulate_batch

REGISTER_BITS = "STRANDCAST_REGISTER_BITS"
FRAMES_HZ = 240.0
FRAMES_S = np.arange(round(DURATION_S * FRAMES_HZ) + 1) / FRAMES_HZ


@dataclass(frozen=True)
class Way:
    """How the strings are simulated.

    Attributes
    ----------
    bits
        Of a number: 64 or 32.
    scalar
        One candidate after the other, by the same source, instead of side by side.
    reading
        Of h and sh. The headline is of ``sign``: there the paper's equations have no jump in time, and a
        smaller step is a smaller error. Under ``rate`` strings with k_sh > k_h feed on their own bending, and
        no step is small enough for all.
    """

    bits: int = 64
    scalar: bool = False
    reading: Literal["rate", "sign"] = "sign"


F64, F32, SCALAR = Way(64), Way(32), Way(64, scalar=True)
RATE_F64, RATE_F32 = (Way(bits, reading="rate") for bits in (64, 32))


def model(way: Way, dt_s: float) -> StringModel:
    """Return the common string at a step."""
    precision: Literal["f64", "f32"] = "f64" if way.bits == 64 else "f32"
    return StringModel(LENGTH_M, SEGMENTS, dt_s=dt_s, precision=precision, reading=way.reading)


@contextmanager
def registers(way: Way) -> Iterator[None]:
    """Hold one candidate per register, if that is the way."""
    before = os.environ.get(REGISTER_BITS)
    if way.scalar:
        os.environ[REGISTER_BITS] = "0"
    try:
        yield
    finally:
        os.environ.pop(REGISTER_BITS, None)
        if before is not None:
            os.environ[REGISTER_BITS] = before


def positions(way: Way, swing: Swing, parameters: Array, dt_s: float, out_time_s: Array = COMMON_S) -> Array:
    """Simulate the strings (B, 10); positions (B, F, n+1, 2) [m] at the common times."""
    time_s, pose = knots(swing)
    with registers(way):
        seen, _ = simulate_batch(model(way, dt_s), parameters, _masses(parameters), time_s, pose, out_time_s)
    return seen


def errors(way: Way, swing: Swing, parameters: Array, dt_s: float, measured: Array) -> Array:
    """Evaluate E (B,) [m] of the strings (B, 10) against points (F, n, 2) measured at `FRAMES_S`."""
    time_s, pose = knots(swing)
    weights = np.full(measured.shape[:2], 1.0 / measured[..., 0].size)
    with registers(way):
        found, _ = evaluate_batch(
            model(way, dt_s), parameters, _masses(parameters), time_s, pose, FRAMES_S, measured, weights
        )
    return found


def measured(swing: Swing, parameters: Array) -> Array:
    """Simulate one string (10,) to compare others with; its points 1…n (F, n, 2) [m] at `FRAMES_S`."""
    return positions(F64, swing, parameters[None], 2.5e-4, FRAMES_S)[0, :, 1:]


def _masses(parameters: Array) -> Array:
    return np.tile(MASSES, (len(parameters), 1))
