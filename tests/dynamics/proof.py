"""A proof of the string: a function that returns the simulator's error, with a tolerance for it.

A proof takes the options of the model under test (step, precision) and returns one error, in the
unit it is registered with; it holds if the error is no larger than the tolerance of that variant. NaN does
not hold.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from strandcast.dynamics.model import StringModel

Options = dict[str, Any]

VARIANTS: dict[str, Options] = {
    "lfcn": {"dt_s": 5e-4},
}
if any(field.name == "precision" for field in fields(StringModel)):
    VARIANTS["lfcn f32"] = {"dt_s": 5e-4, "precision": "f32"}

DOWN = np.array([0.0, 0.0, -np.pi / 2])
GRAVITY_M_S2 = 9.81


@dataclass(frozen=True)
class Proof:
    """One proof: its function of the options, the unit of its error, and the tolerance of each variant."""

    name: str
    error: Callable[[Options], float]
    unit: str
    tolerance: dict[str, float]

    def holds(self, variant: str, error: float) -> bool:
        return error <= self.tolerance[variant]


PROOFS: dict[str, Proof] = {}


def proof(
    unit: str, **tolerance: float
) -> Callable[[Callable[[Options], float]], Callable[[Options], float]]:
    """Register a function as a proof. It is not run for a variant without a tolerance."""

    def register(function: Callable[[Options], float]) -> Callable[[Options], float]:
        known = {name.replace("_f32", " f32"): limit for name, limit in tolerance.items()}
        known = {name: limit for name, limit in known.items() if name in VARIANTS}
        PROOFS[function.__name__] = Proof(function.__name__, function, unit, known)
        return function

    return register


def parameters(**values: float) -> np.ndarray:
    """The ten parameters; those not given are zero."""
    names = ("k_s", "c_s", "k_h", "c_h", "k_sh", "c_sh", "C_c1", "C_c2", "k_ph", "c_ph")
    unknown = set(values) - set(names)
    assert not unknown, unknown
    return np.array([values.get(name, 0.0) for name in names])


def still(pose: np.ndarray, until_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Times and poses of a hand that does not move."""
    return np.array([0.0, until_s]), np.array([pose, pose])


def steps(model: StringModel, until_s: float) -> np.ndarray:
    """The simulator's own times up to `until_s`: outputs there are not interpolated."""
    return model.dt_s * np.arange(round(until_s / model.dt_s) + 1)


def along(angles_rad: np.ndarray, lengths_m: np.ndarray | float) -> np.ndarray:
    """Points 1…n of segments of given angles and lengths from a hand at the origin: (n, 2) [m]."""
    turned = np.column_stack([np.cos(angles_rad), np.sin(angles_rad)])
    return np.cumsum(turned * np.reshape(lengths_m, (-1, 1)), axis=0)


def largest(*errors: np.ndarray) -> float:
    """Largest absolute error; NaN if any is NaN, so that a diverged string fails the proof."""
    return float(np.max([np.abs(error).max() for error in errors]))


def cycle_s(times_s: np.ndarray, swing: np.ndarray) -> float:
    """Period [s] from the first to the last zero crossing, each found on the cubic through four samples."""
    if not np.isfinite(swing).all():
        return float("nan")
    before = np.flatnonzero(np.sign(swing[1:]) != np.sign(swing[:-1]))
    before = before[(before > 0) & (before < len(swing) - 2)]
    step = times_s[1] - times_s[0]
    crossings = []
    for k in before:
        fit = np.polyfit([-1.0, 0.0, 1.0, 2.0], swing[k - 1 : k + 3], 3)
        root = swing[k] / (swing[k] - swing[k + 1])
        for _ in range(4):
            root -= np.polyval(fit, root) / np.polyval(np.polyder(fit), root)
        crossings.append(times_s[k] + step * root)
    if len(crossings) < 2:
        return float("nan")
    return float(2.0 * (crossings[-1] - crossings[0]) / (len(crossings) - 1))
