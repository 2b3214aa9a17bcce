"""The unknowns of a string in space, held at one end or both, and the strings that they describe.

All ranges scale with the string's length, and nothing is specific to a data set.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from strandcast.config.estimate import IN_SPACE
from strandcast.core.strings import (
    PARAMETERS,
    SPATIAL_RANGES,
    UNKNOWNS,
    Cable,
    Ends,
    Range,
    StringBatch,
    Way,
)
from strandcast.dynamics.masses import mass_layout, point_masses
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import GRAVITY_M_S2, MASS_RANGE, Array
from strandcast.estimation.space import Space
from strandcast.estimation.unknowns import forces_of, options_of

# All chosen.
POINTS = 20
THROWN_POINTS = 14  # of a thrown string: about their spacing in the plane
STRAIN = 1e-3  # by the string's own weight: it does not visibly stretch
STRETCH_DAMPING = 0.1  # of the critical damping of one segment
AIR_LINEAR = 1e-6  # drag is quadratic

# The first of the others: the draws that a search starts from depend on the order.
FIRST = ("length_change", "clamp_left_rad", "clamp_up_rad", "far_left_rad", "far_up_rad")


@dataclass(frozen=True, eq=False)
class CableSpace(Space):
    """Box of a cable's unknowns, see `SPATIAL_RANGES`; its strings have bending h and sh the same.

    An unknown that is not in the box is 0: clamps of stiffness 0 are points.
    """

    spacing_m: float = 1.0  # rest length of a segment
    length_m: float = 1.0

    in_plane: ClassVar[bool] = False
    precision: ClassVar[Literal["f64", "f32"]] = "f32"

    @staticmethod
    def ways() -> dict[str, Way]:
        """Return how each unknown is fitted that can be fitted here, by its name in files, in order."""
        found = {name: row.in_space for name, row in UNKNOWNS.items() if row.in_space is not None}
        first = [name for name, how in found.items() if how.name in FIRST]
        first.sort(key=lambda name: FIRST.index(found[name].name))
        return {name: found[name] for name in (*first, *found)}

    @property
    def parameter_units(self) -> dict[str, str]:
        """Names and units of the unknowns but for weights."""
        units = {"damping_s": "s"} | {name: "rad" for name in self.names if name.endswith("_rad")}
        return {name: units.get(name, "1") for name in self.names[: len(self.names) - self.layout.count]}

    def mass_powers(self) -> Array:
        """(d,) powers of a string's mass with which its unknowns rise if it is to move as before."""
        powers = {"bending_length": 1.0 / 3.0, "air": 1.0}
        return np.array([powers.get(name, 0.0) for name in self.names])

    def strings(self, chi: Array) -> StringBatch:
        """Candidate cables of exponents (B, d)."""
        value = dict(zip(self.names, self.values(np.atleast_2d(chi)).T, strict=True))
        count, n, l0 = len(np.atleast_2d(chi)), self.layout.shares.shape[1], self.spacing_m
        none, ways = np.zeros(count), self.ways()
        weights = [value[f"weight_{k + 1}"] for k in range(self.layout.count)]
        free = np.column_stack([np.zeros((count, 0)), *weights])
        bending = GRAVITY_M_S2 * (value["bending_length"] * self.length_m) ** 3 / l0**2
        damping = value["damping_s"] * bending
        clamp = 2.0 * value.get("clamp_stiffness", none)
        stretch = (n + free.sum(axis=1)) * GRAVITY_M_S2 / (STRAIN * l0)
        columns = {
            "k_s": stretch,
            "c_s": STRETCH_DAMPING * 2.0 * np.sqrt(stretch),
            "k_h": bending,
            "c_h": damping,
            "k_sh": bending,
            "c_sh": damping,
            "C_c1": AIR_LINEAR,
            "C_c2": value["air"] / self.length_m,
            "k_ph": clamp * bending,
            "c_ph": clamp * damping,
        }
        cable = Cable(self.length_m, l0, bending)
        return StringBatch(
            np.column_stack([np.broadcast_to(columns[name], count) for name in PARAMETERS]),
            point_masses(self.layout, free),
            {name: value[how.name] / how.per(cable) for name, how in ways.items() if how.name in value},
            stiff_joints=self.layout.stiff_joints(),
            free_masses=free,
        )

    def chi_of(self, strings: StringBatch) -> Array:
        """Exponents (B, d) of given strings, clipped into the box; absent unknowns are at mid-range."""
        given = dict(zip(PARAMETERS, strings.parameters.T, strict=True))
        bending, l0 = given["k_h"], self.spacing_m
        cable = Cable(self.length_m, l0, bending)
        known = {
            "bending_length": np.cbrt(bending * l0**2 / GRAVITY_M_S2) / self.length_m,
            "damping_s": given["c_h"] / bending,
            "air": given["C_c2"] * self.length_m,
            "clamp_stiffness": 0.5 * given["k_ph"] / bending,
        }
        known |= {f"weight_{k + 1}": mass for k, mass in enumerate(strings.free_masses.T)}
        ways = {name: how for name, how in self.ways().items() if name in strings.values}
        known |= {how.name: strings[name] * how.per(cable) for name, how in ways.items()}
        middle = dict(zip(self.names, self.values(np.full(self.dimension, 0.5)), strict=True))
        middle |= {how.name: s[0] for name, how in self.ways().items() if (s := UNKNOWNS[name].starts)}
        columns = [np.broadcast_to(known.get(name, middle[name]), len(strings)) for name in self.names]
        return self.exponents(np.column_stack(columns))


def space_of_cable(
    length_m: float,
    two_ends: bool,
    *,
    pinned: bool = False,
    points: int = POINTS,
    step_s: float = IN_SPACE["dt_s"],
    weight_places_m: Sequence[float] = (),
    stiff_sections_m: Sequence[tuple[float, float]] = (),
    ranges: Mapping[str, Range] | None = None,
    **wanted: Any,
) -> tuple[StringModel, CableSpace]:
    """Return the model of a cable of this nominal length [m], and the box of its unknowns.

    Parameters
    ----------
    length_m
        Nominal free length [m].
    two_ends
        Whether both ends are driven.
    pinned
        Whether they are points, which hold the string in no direction.
    points, step_s
        Number n of points, and time step [s].
    weight_places_m, stiff_sections_m
        See `strandcast.dynamics.masses.mass_layout`.
    ranges
        Ranges to use instead, by name.
    wanted
        See `strandcast.estimation.unknowns.given_of`; by default what is fitted to captures.
    """
    model = StringModel(length_m, points, reading="strain", dt_s=step_s)
    layout = mass_layout(length_m, points, list(weight_places_m), list(stiff_sections_m))
    held: list[Ends] = ["any"] if pinned else ["any", "clamp", "two clamps" if two_ends else "one clamp"]
    unknowns = dict(SPATIAL_RANGES)
    if pinned:
        del unknowns["clamp_stiffness"]
    given = {"forces": forces_of("auto", in_plane=False, thrown=False)[0]} | wanted
    options, sd = options_of(CableSpace, given, layout, held)
    unknowns |= options
    unknowns |= {f"weight_{k + 1}": MASS_RANGE["wide"] for k in range(layout.count)}
    unknowns |= {name: range for name, range in (ranges or {}).items() if name in unknowns}
    return model, CableSpace(
        tuple(unknowns),
        np.array(list(unknowns.values())),
        layout,
        np.array([sd.get(name, np.inf) for name in unknowns]),
        model.spacing_m,
        length_m,
    )
