"""The unknowns of a string in space, held at one end or both, and the strings that they describe.

All ranges scale with the string's length, and nothing is specific to a data set.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from strandcast.core.strings import PARAMETERS, UNKNOWNS, Cable, InSpace, StringBatch
from strandcast.dynamics.masses import mass_layout, point_masses
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import GRAVITY_M_S2, MASS_RANGE, Array
from strandcast.estimation.space import Space

# All chosen.
POINTS, STEP_S = 20, 2e-3
THROWN_POINTS = 14  # of a thrown string: about their spacing in the plane
STRAIN = 1e-3  # by the string's own weight: it does not visibly stretch
STRETCH_DAMPING = 0.1  # of the critical damping of one segment
AIR_LINEAR = 1e-6  # drag is quadratic

# What stands for the parameters: length over which the cable's weight bends it, over its length; bending
# damping over stiffness [s]; quadratic drag over mass, times the length; stiffness of the clamps over that of
# half a segment. All others are rows of `UNKNOWNS`.
PARAMETER_RANGES = {
    "bending_length": (0.01, 3.0),
    "damping_s": (1e-3, 1.0),
    "air": (1e-3, 3.0),
    "clamp_stiffness": (0.02, 50.0),
}
# The first of the others: the draws that a search starts from depend on the order.
FIRST = ("length_change", "clamp_left_rad", "clamp_up_rad", "far_left_rad", "far_up_rad")
STICKS = ("friction_turn_rad", "stick_turn_rad")


@dataclass(frozen=True, eq=False)
class CableSpace(Space):
    """Box of a cable's unknowns, by the names above; its strings have bending h and sh the same.

    An unknown that is not in the box is 0: clamps of stiffness 0 are points.
    """

    spacing_m: float = 1.0  # rest length of a segment
    length_m: float = 1.0

    @property
    def parameter_units(self) -> dict[str, str]:
        """Names and units of the unknowns but for weights."""
        units = {"damping_s": "s"} | {name: "rad" for name in self.names if name.endswith("_rad")}
        return {name: units.get(name, "1") for name in self.names[: len(self.names) - self.layout.count]}

    def without_friction(self) -> CableSpace:
        """Return the same box without the unknowns of friction that sticks."""
        kept = ~np.isin(self.names, STICKS)
        names = tuple(np.array(self.names)[kept].tolist())
        return replace(self, names=names, bounds=self.bounds[kept], prior_sd=self.prior_sd[kept])

    def with_least_friction(self, plain: CableSpace, chi: Array) -> Array:
        """Return exponents (d,) of a cable of the box `plain`, with as little friction as this box allows."""
        least = dict(zip(self.names, self.bounds[:, 0], strict=True))
        known = least | dict(zip(plain.names, plain.values(chi), strict=True))
        return self.exponents(np.array([known[name] for name in self.names]))

    def strings(self, chi: Array) -> StringBatch:
        """Candidate cables of exponents (B, d)."""
        value = dict(zip(self.names, self.values(np.atleast_2d(chi)).T, strict=True))
        count, n, l0 = len(np.atleast_2d(chi)), self.layout.shares.shape[1], self.spacing_m
        none = np.zeros(count)
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
            {name: how.value(value[how.name], cable) for name, how in ways() if how.name in value},
            free_masses=free,
        )


def ways() -> list[tuple[str, InSpace]]:
    """Return the unknowns that can be fitted in space, each with how, in the order of the fit."""
    found = [(name, row.in_space) for name, row in UNKNOWNS.items() if row.in_space is not None]
    return sorted(found, key=lambda each: FIRST.index(each[1].name) if each[1].name in FIRST else len(FIRST))


def space_of_throw(
    length_m: float, points: int, step_s: float = STEP_S, weight_places_m: Sequence[float] = ()
) -> tuple[StringModel, CableSpace]:
    """Return the model of a string that an arm throws, and the box of its unknowns; see `space_of_cable`."""
    return space_of_cable(
        length_m,
        False,
        points=points,
        step_s=step_s,
        weight_places_m=weight_places_m,
        drag_along=True,
        taper=False,
    )


def space_of_cable(
    length_m: float,
    two_ends: bool,
    *,
    pinned: bool = False,
    points: int = POINTS,
    step_s: float = STEP_S,
    weight_places_m: Sequence[float] = (),
    **wanted: bool,
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
    weight_places_m
        Places of weights of unknown mass, from the first end [m].
    wanted
        Whether optional unknowns are fitted, by the settings of the estimate that switch them on or, without
        any, by their names; those not named as their rows say.
    """
    model = StringModel(length_m, points, reading="strain", dt_s=step_s)
    layout = mass_layout(length_m, points, list(weight_places_m))
    held = {"any"} if pinned else {"any", "clamp", "two clamps" if two_ends else "one clamp"}
    unknowns = dict(PARAMETER_RANGES)
    if pinned:
        del unknowns["clamp_stiffness"]
    for name, how in ways():
        asked = [wanted[key] for key in UNKNOWNS[name].switches or (name,) if key in wanted]
        if how.needs in held and (any(asked) if asked else how.when == "always"):
            unknowns[how.name] = how.range
    unknowns |= {f"weight_{k + 1}": MASS_RANGE["wide"] for k in range(layout.count)}
    return model, CableSpace(
        tuple(unknowns),
        np.array(list(unknowns.values())),
        layout,
        np.full(len(unknowns), np.inf),
        model.spacing_m,
        length_m,
    )
