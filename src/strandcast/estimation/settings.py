"""Settings of the fit, and the prior strings it starts from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from strandcast.estimation.evaluation import Array
from strandcast.estimation.space import CLAMP, COMMON, CURL, Space, make_space
from strandcast.string.masses import MassLayout
from strandcast.string.model import StringModel
from strandcast.string.parameters import MASS_RANGE, PARAMETERS, RANGES, ensemble

CURL_RANGE = (-15.0, 15.0)
CLAMP_RANGE = (-0.2, 0.2)


@dataclass(frozen=True)
class FitSettings:
    """How the string is fitted.

    Attributes
    ----------
    search
        ``cma`` (draws from the prior, Levenberg-Marquardt, CMA-ES) or ``paper`` (eq. 3).
    evaluations
        Candidates to simulate in all.
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
    ensemble
        Number of near-optimal strings to keep.
    centre, chi_0, beta
        Of the paper's search.
    held_out
        Share of the frames, the last ones, that the first part of a first fit does not see.
    """

    search: Literal["cma", "paper"] = "cma"
    evaluations: int = 2000
    trials: Literal["all", "latest"] = "all"
    older_trials_weight: float = 0.6
    evaluation: Literal["world", "hand"] = "world"
    w: float = 0.1
    ranges: str | dict[str, tuple[float, float]] = "wide"
    start_shape: Literal["observed", "hanging"] = "observed"
    rest_curl: bool = True
    clamp_offset: bool = False
    plain_mass: bool = False
    ensemble: int = 6
    centre: Literal["fixed", "running"] = "running"
    chi_0: float = 1.0
    beta: float = 0.999
    held_out: float = 0.25

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

    def space(self, layout: MassLayout) -> Space:
        """Box of all unknowns."""
        kind = self.ranges if isinstance(self.ranges, str) else "wide"
        mass_range = MASS_RANGE[kind]
        options = {}
        if self.plain_mass:
            options[COMMON] = mass_range
        if self.rest_curl:
            options[CURL] = CURL_RANGE
        if self.clamp_offset:
            options[CLAMP] = CLAMP_RANGE
        return make_space(self.bounds(), mass_range, layout, options)


def prior_exponents(
    space: Space, model: StringModel, count: int, rng: np.random.Generator, scatter: float = 0.08
) -> Array:
    """Exponents (count, d) of physically plausible strings, scattered a little; options at their middle."""
    masses, stiff = space.layout.count, space.layout.stiff
    draw = ensemble(count, model.length_m, model.points, masses - stiff, rng, stiff)
    chi = np.full((count, space.dimension), 0.5)
    values = space.values(chi)
    values[:, :10] = draw.parameters
    values[:, 10 : 10 + masses] = draw.weight_masses
    values[:, [k for k, name in enumerate(space.names) if name == COMMON]] = 1.0
    return np.asarray(np.clip(space.exponents(values) + scatter * rng.standard_normal(chi.shape), 0.0, 1.0))
