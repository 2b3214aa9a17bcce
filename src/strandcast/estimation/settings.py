"""Settings of the fit, and the prior strings it starts from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from strandcast.estimation.evaluation import Array
from strandcast.estimation.space import (
    CLAMP,
    COMMON,
    CURL,
    FOUND_MASS,
    FOUND_PLACE,
    FRICTION,
    SHIFT,
    STIFF,
    Space,
    make_space,
)
from strandcast.string.masses import MassLayout
from strandcast.string.model import StringModel
from strandcast.string.parameters import MASS_RANGE, PARAMETERS, RANGES, ensemble

CURL_RANGE = (-15.0, 15.0)
CLAMP_RANGE = (-0.2, 0.2)
SHIFT_RANGE_SD = 4.0
STIFF_RANGE = (1.0, 1e3)
FRICTION_RANGE = (1e-4, 1e2)
FRICTION_BEND_RAD = (1e-3, 1e-1)  # plausible bends that dry friction alone can hold


@dataclass(frozen=True)
class FitSettings:
    """How the string is fitted.

    Attributes
    ----------
    search
        ``descent`` (Levenberg-Marquardt from many draws, evolution among their ends, Levenberg-Marquardt
        again), ``cma``, ``evolution`` (differential) or ``paper`` (eq. 3).
    evaluations
        Strings to simulate in all, those for derivatives and the forecast included; the profiles come on top.
    trials
        ``all`` trials so far, each older one with `older_trials_weight` times the weight; ``latest`` as in
        the paper.
    evaluation, w
        Reading of eq. (4), weight of eq. (6).
    ranges
        ``paper``, ``wide``, or bounds by parameter name over the wide ones.
    start_shape
        ``observed`` or ``hanging``.
    rest_curl, clamp_offset, plain_mass
        Whether to fit a constant rest curvature, a turn of the clamp, and the common mass of the plain points
        (the paper fits the last, although only ratios can be known).
    clamp_offset_sd_rad
        Prior standard deviation of the clamp's turn.
    camera_offset_sd_m
        Prior standard deviation of an offset between camera and robot that is fitted too; None: none is.
    stiff_bend
        Whether to fit how much stiffer than the string its stiff sections bend.
    bend_friction
        Whether to fit a dry friction of all joints, which ends a swing where damping only fades it.
    find_weights
        Number of weights of which not even the place is known.
    ensemble
        Number of near-optimal strings to keep.
    profiles
        Whether to compute the profile of every unknown.
    centre, chi_0, beta
        Of the paper's search.
    """

    search: Literal["descent", "cma", "evolution", "paper"] = "descent"
    evaluations: int = 4000
    trials: Literal["all", "latest"] = "all"
    older_trials_weight: float = 0.6
    evaluation: Literal["world", "hand"] = "world"
    w: float = 0.1
    ranges: str | dict[str, tuple[float, float]] = "wide"
    start_shape: Literal["observed", "hanging"] = "observed"
    rest_curl: bool = True
    clamp_offset: bool = False
    clamp_offset_sd_rad: float = 0.05
    camera_offset_sd_m: float | None = None
    stiff_bend: bool = False
    bend_friction: bool = False
    find_weights: int = 0
    plain_mass: bool = False
    ensemble: int = 6
    profiles: bool = False
    centre: Literal["fixed", "running"] = "running"
    chi_0: float = 1.0
    beta: float = 0.999

    @property
    def overstretched_allowed(self) -> bool:
        """A segment beyond 3 l0 is flagged under the paper's ranges, rejected under all others."""
        return self.ranges == "paper"

    def bounds(self) -> Array:
        """(10, 2) bounds of the parameters."""
        if isinstance(self.ranges, str):
            return RANGES[self.ranges]
        bounds = RANGES["wide"].copy()
        for name, pair in self.ranges.items():
            if name in PARAMETERS:
                bounds[PARAMETERS.index(name)] = pair
        return bounds

    def space(self, layout: MassLayout, length_m: float = 0.0) -> Space:
        """Box of all unknowns; the string's `length_m` says where weights are looked for."""
        kind = self.ranges if isinstance(self.ranges, str) else "wide"
        mass_range = MASS_RANGE[kind]
        options: dict[str, tuple[float, float]] = {}
        sd: dict[str, float] = {}
        if self.plain_mass:
            options[COMMON] = mass_range
        if self.rest_curl:
            options[CURL] = CURL_RANGE
        if self.clamp_offset:
            options[CLAMP], sd[CLAMP] = CLAMP_RANGE, self.clamp_offset_sd_rad
        if self.camera_offset_sd_m is not None:
            reach_m = SHIFT_RANGE_SD * self.camera_offset_sd_m
            options |= dict.fromkeys(SHIFT, (-reach_m, reach_m))
            sd |= dict.fromkeys(SHIFT, self.camera_offset_sd_m)
        if self.stiff_bend and layout.stiff:
            options[STIFF] = STIFF_RANGE
        if self.bend_friction:
            options[FRICTION] = FRICTION_RANGE
        for k in range(self.find_weights):
            options[FOUND_PLACE.format(k + 1)] = (0.0, length_m)
            options[FOUND_MASS.format(k + 1)] = mass_range
        points = layout.shares.shape[1]
        return make_space(self.bounds(), mass_range, layout, options, sd, length_m / points)


def prior_exponents(
    space: Space, model: StringModel, count: int, rng: np.random.Generator, scatter: float = 0.08
) -> Array:
    """Exponents (count, d) of physically plausible strings, scattered a little; options at their middle.

    Weights looked for may be anywhere, and as heavy as those whose place is known.
    """
    masses, stiff = space.layout.count, space.layout.stiff
    known, found = masses - stiff, space.weights_found
    draw = ensemble(count, model.length_m, model.points, known + found, rng, stiff)
    chi = np.full((count, space.dimension), 0.5)
    values = space.values(chi)
    values[:, :10] = draw.parameters
    values[:, 10 : 10 + masses] = np.delete(draw.weight_masses, range(known, known + found), axis=1)
    for k in range(found):
        values[:, space.names.index(FOUND_PLACE.format(k + 1))] = model.length_m * rng.random(count)
        values[:, space.names.index(FOUND_MASS.format(k + 1))] = draw.weight_masses[:, known + k]
    values[:, [k for k, name in enumerate(space.names) if name == COMMON]] = 1.0
    if FRICTION in space.names:
        low, high = FRICTION_BEND_RAD
        held_rad = low * (high / low) ** rng.random(count)
        values[:, space.names.index(FRICTION)] = held_rad * draw.parameters[:, PARAMETERS.index("k_h")]
    return np.asarray(np.clip(space.exponents(values) + scatter * rng.standard_normal(chi.shape), 0.0, 1.0))
