"""The unknowns of a string in space, held at one end or both, and the strings that they describe.

All ranges scale with the string's length, and nothing is specific to a data set.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from strandcast.core.strings import PARAMETERS, StringBatch
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

# Unknowns: length over which the cable's weight bends it, over its length; bending damping over stiffness
# [s]; quadratic drag over mass, times the length; stiffness of the clamps over that of half a segment;
# relative change of the length; turns of the clamps [rad]; rest curl, as the turn over the length [rad].
CLAMP = {"clamp_left_rad": (-0.8, 0.8), "clamp_up_rad": (-0.8, 0.8)}
COMMON = {
    "bending_length": (0.01, 3.0),
    "damping_s": (1e-3, 1.0),
    "air": (1e-3, 3.0),
    "clamp_stiffness": (0.02, 50.0),
    "length_change": (-0.08, 0.04),
} | CLAMP
TWO_ENDS = {"far_left_rad": (-0.8, 0.8), "far_up_rad": (-0.8, 0.8)}
ONE_END = {"curl_left_rad": (-3.0, 3.0), "curl_up_rad": (-3.0, 3.0)}  # both ends held: hardly observable
# Friction that sticks, as turns over the length [rad]: what it holds against bending, and where it builds up.
STICKS = {"friction_turn_rad": (0.01, 3.0), "stick_turn_rad": (0.005, 0.5)}
# Held at one end: logarithm of the stiffness at the tip over that at this end.
TAPER_RANGE = (-3.0, 3.0)
MARKER_SHIFT_RANGE = (-0.1, 0.1)  # of markers along the string, over its length
DRAG_ALONG_RANGE = (0.05, 1.0)  # drag along the string over that across it: fast strings show it
OF_CLAMPS = ("clamp_", "far_", "curl_")  # unknowns of ends that hold the string in a direction
UNITS = {"damping_s": "s"} | {
    name: "rad" for name in (*COMMON, *TWO_ENDS, *ONE_END, *STICKS) if name.endswith("_rad")
}


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
        return {name: UNITS.get(name, "1") for name in self.names[: len(self.names) - self.layout.count]}

    def without_friction(self) -> CableSpace:
        """Return the same box without the unknowns of friction that sticks."""
        kept = [name not in STICKS for name in self.names]
        names = tuple(name for name in self.names if name not in STICKS)
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
        pairs = {
            name: np.column_stack([value.get(f"{name}_{side}_rad", none) for side in ("left", "up")])
            for name in ("clamp", "far", "curl")
        }
        return StringBatch(
            np.column_stack([np.broadcast_to(columns[name], count) for name in PARAMETERS]),
            point_masses(self.layout, free),
            rest_curl_rad_m=pairs["curl"] / self.length_m,
            clamp_offset_rad=pairs["clamp"],
            far_offset_rad=pairs["far"],
            taper=value.get("taper", none),
            marker_shift=value.get("marker_shift", none),
            free_masses=free,
            length_change=value["length_change"],
            drag_along=value.get("drag_along", none),
            bend_friction=bending * value.get("friction_turn_rad", none) * l0 / self.length_m,
            friction_stick_rad_m=value.get("stick_turn_rad", none) / self.length_m,
        )


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
    drag_along: bool = False,
    friction_stick: bool = False,
    taper: bool | None = None,
    marker_shift: bool = False,
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
    drag_along
        Whether drag along it is an unknown of its own: for thrown strings; otherwise it is that across it.
    friction_stick
        Whether dry friction that sticks is fitted, with the bend over which it builds up.
    taper
        Whether bending stiffness may grow or fall along it; None: where one end holds it in a direction.
    marker_shift
        Whether all markers may be farther along it than declared, or less far.
    """
    model = StringModel(length_m, points, reading="strain", dt_s=step_s)
    layout = mass_layout(length_m, points, list(weight_places_m))
    unknowns = COMMON | (TWO_ENDS if two_ends else ONE_END)
    if pinned:
        unknowns = {name: each for name, each in unknowns.items() if not name.startswith(OF_CLAMPS)}
    unknowns |= {"drag_along": DRAG_ALONG_RANGE} if drag_along else {}
    unknowns |= STICKS if friction_stick else {}
    unknowns |= {"taper": TAPER_RANGE} if taper or (taper is None and not two_ends and not pinned) else {}
    unknowns |= {"marker_shift": MARKER_SHIFT_RANGE} if marker_shift else {}
    unknowns |= {f"weight_{k + 1}": MASS_RANGE["wide"] for k in range(layout.count)}
    return model, CableSpace(
        tuple(unknowns),
        np.array(list(unknowns.values())),
        layout,
        np.full(len(unknowns), np.inf),
        model.spacing_m,
        length_m,
    )
