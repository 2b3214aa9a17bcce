"""The weight at a cable's end, estimated from motion: a joint fit of cables with and without it.

Motion gives mass ratios only; the known mass of the cable turns them into kilograms. Stiffness, damping and
the weight's lever are shared by all cables; each has its own rest curl and clamp. The lever is the distance
of the weight's centre beyond the end marker: its effect on the swing must not be taken for mass.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from strandcast.dynamics.parameters import Array
from strandcast_studies.evidence.cable import UNKNOWNS, Series, play
from strandcast_studies.evidence.figure import Figure
from strandcast_studies.evidence.pac_cable import (
    CABLES,
    DRIVEN,
    FREE,
    PAIRS,
    REST_FRAMES,
    read,
    weight_kg,
)
from strandcast_studies.evidence.solve import FreeParameter, Solution, solve

TRUE_KG = 0.200
GRAVITY_M_S2 = 9.81
TARGET_PERCENT = 10.0
CONFIDENCE = 0.95

_STRIDE_KG = 0.01
_STRIDES = 25

COMMON = ("log_stiffness", "log_damping", "log_friction", "log_stick")
OWN = ("curl_rad_m", "clamp_rad")


@dataclass(frozen=True, eq=False)
class JointFit:
    """A joint fit of several series; its last unknown is the mass of the weight."""

    series: list[Series]
    weighted: list[bool]  # whether a series has the weight
    common: tuple[str, ...]  # names of the shared unknowns
    cables: list[str]  # each with its `OWN` unknowns

    def unknowns(self) -> list[FreeParameter]:
        """Return all unknowns in order."""
        names = [*self.common, *(name for _ in self.cables for name in OWN), "weight_kg"]
        return [UNKNOWNS[name] for name in names]

    def residuals(self, candidates: Array) -> Array:
        """Return the differences (B, R) of all marker coordinates of all series [m]."""
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
        """Fit all unknowns."""
        return solve(self.residuals, self.unknowns())

    def at(self, mass_kg: float, start: Array) -> Solution:
        """Fit the other unknowns at a given mass of the weight."""

        def residuals(candidates: Array) -> Array:
            return self.residuals(np.column_stack([candidates, np.full(len(candidates), mass_kg)]))

        return solve(residuals, self.unknowns()[:-1], start)

    def effective_count(self, residuals: Array) -> float:
        """Return the effective number of independent residuals (R,): one per correlation time."""
        ends = np.cumsum([series.markers_m.size for series in self.series])[:-1]
        count = 0.0
        for series, part in zip(self.series, np.split(residuals, ends), strict=True):
            for channel in part.reshape(len(series.time_s), -1).T:
                count += len(channel) / correlation_frames(channel)
        return count


def correlation_frames(channel: Array) -> float:
    """Return the correlation time of a signal (F,) in frames: 1 + 2 sum of rho, up to the first negative."""
    total, power = 1.0, float(channel @ channel)
    for lag in range(1, len(channel)):
        rho = float(channel[lag:] @ channel[:-lag]) / power
        if rho <= 0.0:
            break
        total += 2.0 * rho
    return total


def joint_fit(
    folder: Path, cables: Iterable[str], kinds: Iterable[str], left_out: str = "", first_s: float = np.inf
) -> JointFit:
    """Return the joint fit of the first seconds of some series, or one without a shared unknown."""
    chosen = list(cables)
    series = [read(folder, kind, cable).until(first_s) for kind in kinds for cable in chosen]
    weighted = [weight_kg(folder, s.cable) > 0.0 for s in series]
    common = tuple(name for name in (*COMMON, "lever_m") if name != left_out)
    return JointFit(series, weighted, common, chosen)


def interval_kg(problem: JointFit, best: Solution) -> tuple[float | None, float | None]:
    """Return the profile interval of the weight [kg]: masses that explain the data equally well, refitted.

    The threshold is the chi-square of one degree of freedom at `CONFIDENCE`, with the residuals' variance and
    their effective number. None for an end not found within 0.25 kg.
    """
    share = problem.effective_count(best.residuals) / len(best.residuals)
    allowed = float(chi2.ppf(CONFIDENCE, 1)) * best.sum_of_squares / len(best.residuals) / share
    return _end(problem, best, -1, allowed), _end(problem, best, 1, allowed)


def _end(problem: JointFit, best: Solution, side: int, allowed: float) -> float | None:
    """Return the mass on one side of the best where the sum of squares has grown by `allowed` [kg]."""
    before, start = 0.0, best.values[:-1]
    for k in range(1, _STRIDES + 1):
        mass_kg = float(best.values[-1]) + side * k * _STRIDE_KG
        if mass_kg < 0.0:
            return 0.0
        found = problem.at(mass_kg, start)
        now, start = max(found.sum_of_squares - best.sum_of_squares, 0.0), found.values
        if now >= allowed:
            a, b, c = (float(np.sqrt(value)) for value in (before, now, allowed))
            return mass_kg - side * _STRIDE_KG * (b - c) / (b - a)
        before = now
    return None


def measure(folder: Path) -> list[Figure]:
    """Return figures of the weight: all cables, parts of their motions, each pair, and the force sensor.

    The recipe is ``all_cables.to_the_end``: the hand rests in all of its series. It was fixed before a weight
    was fitted with friction that sticks; the other figures show how much the result depends on it.
    """
    free = (FREE,)
    swings = {
        "all_cables.to_the_end": joint_fit(folder, CABLES, free),
        "all_cables.first_3_s": joint_fit(folder, CABLES, free, first_s=3.0),
        "all_cables.first_2_s": joint_fit(folder, CABLES, free, first_s=2.0),
        "all_cables.to_the_end.without_lever": joint_fit(folder, CABLES, free, "lever_m"),
        "all_cables.to_the_end.without_stick": joint_fit(folder, CABLES, free, "log_stick"),
        "all_cables.driven_too": joint_fit(folder, CABLES, (FREE, DRIVEN)),
        "long_pair.first_3_s": joint_fit(folder, PAIRS[0], free, first_s=3.0),
        "short_pair.first_3_s": joint_fit(folder, PAIRS[1], free, first_s=3.0),
    }
    figures = [_figure(f"pac_cable.weight.{name}", problem) for name, problem in swings.items()]
    return [*figures, _by_force(folder)]


def _by_force(folder: Path) -> Figure:
    """Return the figure of the weight from the wrist's force at rest, which needs no model."""
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
    """Return the load on the wrist at the end of a driven series [N]."""
    state = np.genfromtxt(folder / DRIVEN / f"{cable}.csv", delimiter=",", names=True)
    return -float(state["Fz"][-REST_FRAMES:].mean())


def _figure(name: str, problem: JointFit) -> Figure:
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
            **({"stick_rad_m": float(np.exp(shared["log_stick"]))} if "log_stick" in shared else {}),
        },
    )
