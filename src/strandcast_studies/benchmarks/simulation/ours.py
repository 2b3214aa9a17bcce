"""The string of this package as the benchmark calls it, with a choice of precision and vector width."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal

import numpy as np

from strandcast.core.strings import StringBatch
from strandcast.dynamics.batch import HandPath, MeasuredPoints
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import Array
from strandcast.dynamics.simulate import evaluate_batch, simulate_batch
from strandcast_studies.benchmarks.simulation.swing import (
    COMMON_S,
    DURATION_S,
    LENGTH_M,
    MASSES,
    SEGMENTS,
    HandSwing,
    knots,
)

REGISTER_BITS = "STRANDCAST_REGISTER_BITS"
FRAMES_S = np.arange(round(DURATION_S * 240.0) + 1) / 240.0


@dataclass(frozen=True)
class Mode:
    """How the strings are simulated.

    The main result uses the reading ``sign`` of h and sh: its equations are continuous in time, and the error
    falls with the step. With ``rate``, strings with k_sh > k_h gain energy from bending, and no step is small
    enough for all.
    """

    bits: int = 64  # of a number: 64 or 32
    scalar: bool = False  # one candidate after the other with the same source, instead of side by side
    reading: Literal["rate", "sign"] = "sign"


F64, F32, SCALAR = Mode(64), Mode(32), Mode(64, scalar=True)
RATE_F64, RATE_F32 = (Mode(bits, reading="rate") for bits in (64, 32))


def model(mode: Mode, dt_s: float) -> StringModel:
    """Return the model of the common string with a time step."""
    precision: Literal["f64", "f32"] = "f64" if mode.bits == 64 else "f32"
    return StringModel(LENGTH_M, SEGMENTS, dt_s=dt_s, precision=precision, reading=mode.reading)


@contextmanager
def registers(mode: Mode) -> Iterator[None]:
    """Use one candidate per register within the context, if the mode is scalar."""
    before = os.environ.get(REGISTER_BITS)
    if mode.scalar:
        os.environ[REGISTER_BITS] = "0"
    try:
        yield
    finally:
        os.environ.pop(REGISTER_BITS, None)
        if before is not None:
            os.environ[REGISTER_BITS] = before


def positions(
    mode: Mode, swing: HandSwing, parameters: Array, dt_s: float, out_time_s: Array = COMMON_S
) -> Array:
    """Simulate the strings (B, 10); return positions (B, F, n+1, 2) [m] at the common times."""
    hand = HandPath(*knots(swing))
    with registers(mode):
        simulated, _ = simulate_batch(model(mode, dt_s), _strings(parameters), hand, out_time_s)
    return simulated


def errors(mode: Mode, swing: HandSwing, parameters: Array, dt_s: float, measured: Array) -> Array:
    """Evaluate E (B,) [m] of the strings (B, 10) against points (F, n, 2) measured at `FRAMES_S`."""
    hand = HandPath(*knots(swing))
    weights = np.full(measured.shape[:2], 1.0 / measured[..., 0].size)
    points = MeasuredPoints(FRAMES_S, measured, weights)
    with registers(mode):
        found, _ = evaluate_batch(model(mode, dt_s), _strings(parameters), hand, points)
    return found


def measured(swing: HandSwing, parameters: Array) -> Array:
    """Simulate one string (10,) as the measurement; return its points 1…n (F, n, 2) [m] at `FRAMES_S`."""
    return positions(F64, swing, parameters[None], 2.5e-4, FRAMES_S)[0, :, 1:]


def _strings(parameters: Array) -> StringBatch:
    return StringBatch(parameters, np.tile(MASSES, (len(parameters), 1)))
