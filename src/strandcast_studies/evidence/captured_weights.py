"""Weights of known mass, from captures that are fitted as the commands fit them.

    python -m strandcast_studies.evidence.captured_weights --seeds 200-219

prints a line per drawn string: in the plane and in space, one recording of 5 s or two of unlike motions,
markers beside the string; truth from 48 points, fits of 20.
"""

import argparse
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

import strandcast
from strandcast.config.estimate import EstimateSettings
from strandcast.dynamics.masses import mass_layout
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import GRAVITY_M_S2, Array
from strandcast.estimation.cable_series import series_between
from strandcast.estimation.cable_space import space_of_cable
from strandcast.estimation.estimate import estimate
from strandcast.estimation.fit import StringFit
from strandcast.estimation.measured import Throw, parts_of_throws
from strandcast.estimation.space import Space
from strandcast.estimation.throws import TrialParts
from strandcast.estimation.unknowns import forces_of, space_of
from strandcast.estimation.windows import parts_by_roll
from strandcast.records.alignment import EndPath
from strandcast.stages.estimate import CAPTURE_SEARCHES
from strandcast.stages.estimate_record import mass_known
from strandcast_studies.benchmarks.loop.run import numbers
from strandcast_studies.evidence.figure import Figure
from strandcast_studies.evidence.pac_cable import CABLES, DRIVEN, FREE, RELEASED_FRAME, known_of

# (T,) times; (T, 2 or 3) places of the hand and in which direction it holds; (T, m, 2 or 3) markers.
Recording = tuple[Array, Array, Array, Array]
POINTS, SECONDS = 20, 5.0
OFF_STRING_M, NOISE_M, HAND_NOISE_M, LOST = 1.5e-3, 5e-4, 2e-4, 0.03
SEEDS = (1, 2)


class Problem(NamedTuple):
    """What `estimate` takes first: trials by roll, the model, the unknowns and the settings."""

    parts: dict[str, TrialParts]
    model: StringModel
    space: Space
    settings: EstimateSettings


def problem_of(recordings: list[Recording], places: Array, length_m: float, *weights_m: float) -> Problem:
    """Return the fit of a captured string with weights; markers at places along it, 0 to 1."""
    settings = EstimateSettings()
    if recordings[0][1].shape[1] == 3:
        model, space = space_of_cable(length_m, False, points=POINTS, weight_places_m=weights_m)
        parts = parts_by_roll([series_of(*each, places) for each in recordings], POINTS)
        return Problem(parts, model, space, settings.in_space(thrown=False))
    settings = settings.of_captures()
    model, layout = StringModel(length_m, POINTS), mass_layout(length_m, POINTS, list(weights_m), [])
    throws = [_throw(*each, places) for each in recordings]
    parts = {"": parts_of_throws(throws, model.places_m(), settings)}
    return Problem(parts, model, space_of(settings, layout, thrown=False), settings)


def fitted(problem: Problem, seed: int) -> StringFit:
    """Fit a captured string as the commands do."""
    tried = forces_of("auto", in_plane=problem.space.in_plane, thrown=False)[1]
    how: dict[str, Any] = {"tried": tried, "references": True, "searches": CAPTURE_SEARCHES}
    return estimate(*problem, np.random.default_rng(seed), **how)


def series_of(
    time_s: Array, hand_m: Array, direction: Array, markers_m: Array, places: Array
) -> dict[str, Any]:
    """Return a capture in space by the roll that its hand may have."""
    return series_between(time_s, [EndPath(hand_m, direction)], markers_m, places)


def _throw(time_s: Array, hand_m: Array, direction: Array, markers_m: Array, places: Array) -> Throw:
    """Return a capture in the plane: only the points at the markers were seen."""
    points_m = np.full((len(time_s), POINTS + 1, 2), np.nan)
    points_m[:, 0], points_m[:, np.round(places * POINTS).astype(int)] = hand_m, markers_m
    angle = np.unwrap(np.arctan2(direction[:, 1], direction[:, 0]))
    pose = np.column_stack([hand_m, angle])
    return Throw(time_s, points_m, time_s, pose, np.ones(len(time_s), dtype=bool))


def found_mass(fit: StringFit, plain_kg: float) -> dict[str, Any]:
    """Return the mass of a fit's weight, its interval [kg], and whether it is known."""
    row = fit.space.names.index("weight_1")
    known = mass_known(fit.space, fit.uncertainty, row, agree=fit.searches_agree)
    ends = [end if end is None else end * plain_kg for end in known["interval"]]
    found_kg = float(fit.space.values(fit.chi)[row]) * plain_kg
    return {"found_kg": found_kg, "interval_kg": ends, "known": known["known"], "E_mm": 1e3 * fit.E_m}


@dataclass(frozen=True, eq=False)
class Capture:
    """A drawn string with markers.

    Attributes
    ----------
    true
        Its numbers by name, with the names of the recorded motions.
    known
        What `strandcast.simulate` takes.
    places, off_m
        Places of the markers along it, 0 to 1, and how far they are beside it (m, 2 or 3) [m].
    """

    true: dict[str, Any]
    known: dict[str, Any]
    places: Array
    off_m: Array

    @property
    def plain_kg(self) -> float:
        """Mass of a plain point of the fit [kg]."""
        return float(self.true["mass_kg_m"] * self.true["length_m"] / POINTS)

    def recorded(self, time_s: Array, hand_m: Array, random: np.random.Generator) -> Recording:
        """Return a recording of a motion of the hand, which holds the string downwards."""
        down = np.broadcast_to(-np.eye(hand_m.shape[1])[-1], hand_m.shape)
        path = strandcast.simulate(time_s, hand_m, direction=down, points=48, **self.known)
        seen = CubicSpline(np.linspace(0.0, 1.0, 49), path, axis=1)(self.places) + self.off_m
        seen += random.normal(0.0, NOISE_M, seen.shape)
        seen[random.random(seen.shape[:2]) < LOST] = np.nan
        return time_s, hand_m + random.normal(0.0, HAND_NOISE_M, hand_m.shape), down, seen

    def problem(self, recordings: list[Recording]) -> Problem:
        """Return the fit of its recordings."""
        weights_m = [place_m for place_m, _ in self.known["weights"]]
        return problem_of(recordings, self.places, self.true["length_m"], *weights_m)


def drawn(seed: int, axes: int, *, bare: bool = False) -> tuple[Capture, list[Recording]]:
    """Return a drawn string, with its weight or bare, and its recordings."""
    random = np.random.default_rng([seed, axes == 3])
    length_m = float(random.uniform(0.25, 1.6))
    mass_kg_m, bend, share = (float(np.exp(random.uniform(*np.log(ends)))) for ends in RANGES)
    weight_kg = share * mass_kg_m * length_m
    weight_m = length_m * (1.0 if random.random() < 0.65 else float(random.uniform(0.4, 0.9)))
    places = np.array([0.5, 1.0])
    if random.random() < 0.6:
        places = np.unique(np.r_[np.round(random.uniform(0.15, 0.95, 5) * POINTS) / POINTS, 1.0])
    kinds = random.permutation(["shake", "pull", "slow"])[: 1 + (random.random() < 0.6)]
    time_s = np.arange(0.0, SECONDS, 1.0 / float(random.choice([60, 100, 120, 200])))
    known: dict[str, Any] = {
        "length_m": length_m,
        "weights": [] if bare else [(weight_m, weight_kg)],
        "mass_kg_m": mass_kg_m,
        "bending_n_m2": mass_kg_m * GRAVITY_M_S2 * (length_m * bend) ** 3,
        "damping_s": float(np.exp(random.uniform(*np.log((0.004, 0.04))))),
        "diameter_m": float(np.exp(random.uniform(*np.log((0.002, 0.012))))),
        "rest_curl_rad_m": float(0.4 * random.normal() / length_m),
    }
    if axes == 3:
        known["curl_towards"] = np.array([1.0, 0.0, 0.0])
    true = {"length_m": length_m, "weight_m": weight_m, "weight_kg": weight_kg, "mass_kg_m": mass_kg_m}
    true |= {"motions": kinds.tolist(), "markers": len(places)}
    capture = Capture(true, known, places, random.normal(0.0, OFF_STRING_M, (len(places), axes)))
    hands = (_hand(kind, time_s, length_m, axes, random) for kind in kinds)
    return capture, [capture.recorded(time_s, hand_m, random) for hand_m in hands]


# Mass per length [kg/m]; length over which the string's weight bends it, over its own; the weight's mass,
# over the string's.
RANGES = ((0.003, 0.06), (0.06, 0.45), (0.15, 6.0))


def _hand(kind: str, time_s: Array, length_m: float, axes: int, random: np.random.Generator) -> Array:
    """Return places (T, axes) of a hand that rests at first [m], up and down a third as far as sideways."""
    speed_m_s, turn = np.sqrt(GRAVITY_M_S2 * length_m), np.sqrt(GRAVITY_M_S2 / length_m)
    eased = np.clip((time_s - 0.6) / 0.3, 0.0, 1.0)
    eased = eased**2 * (3.0 - 2.0 * eased)
    place_m = np.zeros((len(time_s), axes))
    for k in range(axes):
        size = 0.35 if k == axes - 1 else 1.0
        if kind == "pull":
            share = np.clip((time_s - 0.7) * turn / (0.7 * np.pi), 0.0, 1.0)
            far = size * random.choice([-1.0, 1.0]) * random.uniform(0.2, 0.45) * length_m
            place_m[:, k] = far * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        elif kind == "slow":
            rate = turn * random.uniform(0.3, 0.6)
            far = size * random.uniform(0.15, 0.3) * length_m
            place_m[:, k] = far * eased * np.sin(rate * time_s + random.uniform(0.0, 6.0))
        else:
            for rate in turn * random.uniform(0.7, 2.6, 3):
                far = size * random.uniform(0.15, 0.25) * speed_m_s / rate
                place_m[:, k] += far * eased * np.sin(rate * time_s + random.uniform(0.0, 6.0))
    return place_m


def measure(folder: Path) -> list[Figure]:
    """Return figures of ``pac_cable``: the mass at each cable's end by its free swing and driven motion."""
    return [_cable(folder, cable, seed) for cable in CABLES for seed in SEEDS]


def _cable(folder: Path, cable: str, seed: int) -> Figure:
    known = known_of(folder, cable)
    recordings = [recorded(folder, kind, cable) for kind in (FREE, DRIVEN)]
    fit = fitted(problem_of(recordings, np.array([0.5, 1.0]), known["L"], known["L"]), seed)
    found = found_mass(fit, known["m_len"] / POINTS)
    note = "with its fitting; fitted as a capture in space to both recordings"
    off = 100.0 * (found["found_kg"] / known["m_end"] - 1.0)
    return Figure(
        f"pac_cable.weight.{cable}.seed_{seed}", off, "%", None, note, found | {"true_kg": known["m_end"]}
    )


def recorded(folder: Path, kind: str, cable: str) -> Recording:
    """Return one recording of ``pac_cable`` in space: its plane is x and z."""
    file = folder / kind / f"{cable}.markers_rebuilt.csv"
    table = np.genfromtxt(file, delimiter=",", names=True)[RELEASED_FRAME if kind == FREE else 0 :]
    none = np.zeros(len(table))
    hand_m, middle_m, end_m = (
        np.column_stack([table[f"x_{name}"], none, table[f"z_{name}"]]) for name in ("base", "mid", "end")
    )
    angle = -0.5 * np.pi - table["phi"]
    direction = np.column_stack([np.cos(angle), none, np.sin(angle)])
    return np.asarray(table["t"]), hand_m, direction, np.stack([middle_m, end_m], axis=1)


def main(arguments: list[str] | None = None) -> None:
    """Print what was found of each drawn weight, in the plane and in space."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=numbers, required=True, help="e.g. 200-219")
    for seed in parser.parse_args(arguments).seeds:
        for axes in (2, 3):
            capture, recordings = drawn(seed, axes)
            found = found_mass(fitted(capture.problem(recordings), seed), capture.plain_kg)
            print(json.dumps({"seed": seed, "axes": axes} | capture.true | found), flush=True)


if __name__ == "__main__":
    main()
