"""The weight at a cable's end, found from motion: cables with and without it, fitted together.

Motion shows ratios only; the known mass of the cable makes kilograms of them. Stiffness, damping and the
weight's lever are common to all cables, rest curl and clamp belong to each. The lever is how far the weight's
centre lies beyond the end marker: what that does to the swing must not pass for mass.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from strandcast.evidence.cable import UNKNOWNS, Series, play
from strandcast.evidence.figure import Figure
from strandcast.evidence.pac_cable import (
    CABLES,
    DRIVEN,
    FREE,
    PAIRS,
    REST_FRAMES,
    read,
    weight_kg,
)
from strandcast.evidence.solve import Solution, Unknown, solve
from strandcast.string.parameters import Array

TRUE_KG = 0.200
GRAVITY_M_S2 = 9.81
TARGET_PERCENT = 10.0
CONFIDENCE = 0.95
Excess = Callable[[float, Array], tuple[float, Array]]

_STRIDE_KG = 0.01
_STRIDES = 25

COMMON = ("log_stiffness", "log_damping", "log_friction")
OWN = ("curl_rad_m", "clamp_rad")


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint fit: its series, and its unknowns, of which the mass of the weight is the last.

    Attributes
    ----------
    series, weighted
        The motions, and which of them carry the weight.
    common, cables
        Names of the unknowns that all share, and the cables that have `OWN` ones each.
    """

    series: list[Series]
    weighted: list[bool]
    common: tuple[str, ...]
    cables: list[str]

    def unknowns(self) -> list[Unknown]:
        """All unknowns in order."""
        names = [*self.common, *(name for _ in self.cables for name in OWN), "weight_kg"]
        return [UNKNOWNS[name] for name in names]

    def residuals(self, candidates: Array) -> Array:
        """Differences (B, R) of all marker coordinates of all series [m]."""
        shared = {name: candidates[:, k] for k, name in enumerate(self.common)}
        parts = []
        for series, weighted in zip(self.series, self.weighted, strict=True):
            first = len(self.common) + len(OWN) * self.cables.index(series.cable)
            own = {name: candidates[:, first + k] for k, name in enumerate(OWN)}
            weight = candidates[:, -1] if weighted else 0.0
            simulated = play(series, shared | own | {"weight_kg": weight})
            parts.append((series.markers_m - simulated).reshape(len(candidates), -1))
        return np.concatenate(parts, axis=1)

    def solve(self) -> Solution:
        """Fit everything."""
        return solve(self.residuals, self.unknowns())

    def at(self, mass_kg: float, start: Array) -> Solution:
        """Fit the rest at a given mass of the weight."""

        def residuals(candidates: Array) -> Array:
            return self.residuals(np.column_stack([candidates, np.full(len(candidates), mass_kg)]))

        return solve(residuals, self.unknowns()[:-1], start)

    def effective_count(self, residuals: Array) -> float:
        """Return how many residuals (R,) are independent: one per correlation time of a coordinate."""
        ends = np.cumsum([series.markers_m.size for series in self.series])[:-1]
        count = 0.0
        for series, part in zip(self.series, np.split(residuals, ends), strict=True):
            for channel in part.reshape(len(series.time_s), -1).T:
                count += len(channel) / correlation_frames(channel)
        return count


def correlation_frames(channel: Array) -> float:
    """Correlation time of a signal (F,) in frames: 1 + 2 sum of rho, until rho first turns negative."""
    total, power = 1.0, float(channel @ channel)
    for lag in range(1, len(channel)):
        rho = float(channel[lag:] @ channel[:-lag]) / power
        if rho <= 0.0:
            break
        total += 2.0 * rho
    return total


def joint(
    folder: Path, cables: Iterable[str], kinds: Iterable[str], *, lever: bool, first_s: float = np.inf
) -> Joint:
    """Joint fit of the first seconds of series of some cables, with the weight's lever free or none."""
    chosen = list(cables)
    series = [read(folder, kind, cable).until(first_s) for kind in kinds for cable in chosen]
    weighted = [weight_kg(folder, s.cable) > 0.0 for s in series]
    return Joint(series, weighted, COMMON + (("lever_m",) if lever else ()), chosen)


def interval_kg(problem: Joint, best: Solution) -> tuple[float | None, float | None]:
    """Profile interval of the weight [kg]: masses that explain the data as well, all else fitted anew.

    As well: to within the chi-square of one degree at `CONFIDENCE`, by the variance of the residuals and as
    many of them as are independent. None for an end that was not found within 0.25 kg.
    """
    share = problem.effective_count(best.residuals) / len(best.residuals)
    allowed = float(chi2.ppf(CONFIDENCE, 1)) * best.sum_of_squares / len(best.residuals) / share

    def excess(mass_kg: float, start: Array) -> tuple[float, Array]:
        found = problem.at(mass_kg, start)
        return max(found.sum_of_squares - best.sum_of_squares, 0.0), found.values

    low, high = (_end(excess, float(best.values[-1]), best.values[:-1], side, allowed) for side in (-1, 1))
    return low, high


def _end(
    excess: Excess,
    best_kg: float,
    start: Array,
    side: int,
    allowed: float,
) -> float | None:
    """Walk from the best mass to one side until the excess passes what is allowed; where it did [kg]."""
    before = 0.0
    for k in range(1, _STRIDES + 1):
        mass_kg = best_kg + side * k * _STRIDE_KG
        if mass_kg < 0.0:
            return 0.0
        now, start = excess(mass_kg, start)
        if now >= allowed:
            a, b, c = (float(np.sqrt(value)) for value in (before, now, allowed))
            return mass_kg - side * _STRIDE_KG * (b - c) / (b - a)
        before = now
    return None


def measure(folder: Path) -> list[Figure]:
    """Figures of the weight: from all cables, parts of their motions, each pair, and by the force sensor.

    At the end of a swing dry friction holds a cable where it happens to stop; the fits to the first seconds
    tell how much of the answer hangs on that.
    """
    free = (FREE,)
    swings = {
        "all_cables.to_the_end": joint(folder, CABLES, free, lever=True),
        "all_cables.first_3_s": joint(folder, CABLES, free, lever=True, first_s=3.0),
        "all_cables.first_2_s": joint(folder, CABLES, free, lever=True, first_s=2.0),
        "all_cables.to_the_end.without_lever": joint(folder, CABLES, free, lever=False),
        "all_cables.driven_too": joint(folder, CABLES, (FREE, DRIVEN), lever=True),
        "long_pair.first_3_s": joint(folder, PAIRS[0], free, lever=True, first_s=3.0),
        "short_pair.first_3_s": joint(folder, PAIRS[1], free, lever=True, first_s=3.0),
    }
    figures = [_figure(f"pac_cable.weight.{name}", problem) for name, problem in swings.items()]
    return [*figures, _by_force(folder)]


def _by_force(folder: Path) -> Figure:
    """Figure of the weight by the wrist's force at rest, which needs no model."""
    found = [rest_force_n(folder, heavy) - rest_force_n(folder, light) for heavy, light in PAIRS]
    mass_kg = float(np.mean(found)) / GRAVITY_M_S2
    return Figure(
        "pac_cable.weight.force_sensor",
        100.0 * (mass_kg / TRUE_KG - 1.0),
        "% of the weight",
        note="wrist force at rest, with and without the weight: a check of the stated mass, not a result",
        detail={"found_kg": mass_kg, "pairs_kg": [force / GRAVITY_M_S2 for force in found]},
    )


def rest_force_n(folder: Path, cable: str) -> float:
    """Return the weight that hangs on the wrist at the end of a driven series [N]."""
    state = np.genfromtxt(folder / DRIVEN / f"{cable}.csv", delimiter=",", names=True)
    return -float(state["Fz"][-REST_FRAMES:].mean())


def _figure(name: str, problem: Joint) -> Figure:
    best = problem.solve()
    mass_kg = float(best.values[-1])
    shared = dict(zip(problem.common, best.values, strict=False))
    return Figure(
        name,
        100.0 * (mass_kg / TRUE_KG - 1.0),
        "% of the weight",
        TARGET_PERCENT,
        detail={
            "found_kg": mass_kg,
            "interval_kg": interval_kg(problem, best),
            "confidence": CONFIDENCE,
            "rms_mm": 1e3 * float(np.sqrt(2.0 * best.sum_of_squares / len(best.residuals))),
            "independent_residuals": problem.effective_count(best.residuals),
            "stiffness_N_m2": float(np.exp(shared["log_stiffness"])),
            **({"lever_m": float(shared["lever_m"])} if "lever_m" in shared else {}),
            "friction_N_m": float(np.exp(shared["log_friction"])),
        },
    )
