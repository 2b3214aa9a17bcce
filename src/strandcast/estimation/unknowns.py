"""The unknown numbers of the string, their ranges and priors, and plausible strings to start from."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from strandcast.config.estimate import EstimateSettings, Ranges
from strandcast.core.strings import (
    BEND_FRICTION,
    FORCES,
    OF_PRIOR,
    PARAMETERS,
    PLAIN_MASS,
    UNKNOWNS,
    Ends,
    ForceName,
    Range,
    Unknown,
    When,
)
from strandcast.dynamics.masses import MassLayout
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import MASS_RANGE, RANGES, ensemble
from strandcast.estimation.evaluation import Array
from strandcast.estimation.space import AT_BOUND, Space

# All chosen.
PRIOR_RANGE_SD = 4.0  # half-width of a range that only a prior gives, in its standard deviations
FRICTION_BEND_RAD = (1e-3, 1e-1)  # plausible bends that dry friction alone can hold
# A stiff cable is beyond the wide ranges, the more the closer its points are: its coefficients are stiffness
# per mass and spacing squared. More k_s or c_s changes nothing, and less than the lower bounds is nothing.
BENDING = ("k_h", "k_sh")  # of the string itself
STIFFNESSES = (*BENDING, "k_ph")
WIDENED = (*STIFFNESSES, "c_h", "c_sh", "c_ph")
WIDENED_BY = 30.0
CAPTURED_BY = 900.0  # of captures at once: cables that their weight hardly bends, as in space


def bounds_of(ranges: Ranges) -> Array:
    """Return the (10, 2) bounds of the parameters; those given by name replace the wide ones."""
    if isinstance(ranges, str):
        return RANGES[ranges]
    bounds = RANGES["wide"].copy()
    for name, pair in ranges.items():
        bounds[PARAMETERS.index(name)] = pair
    return bounds


def forces_of(
    wanted: str | Collection[str], *, in_plane: bool = True, thrown: bool = True
) -> tuple[set[str], list[ForceName]]:
    """Return which optional forces are fitted, and which are tried, as `estimate.forces` wants them.

    `thrown`: at a target, not captured.
    """
    if wanted != "auto":
        return set() if wanted == "paper" else set(wanted), []
    kind = ("throws" if thrown else "captures") + ("" if in_plane else "_in_space")
    when: dict[ForceName, When] = {name: getattr(force, kind) for name, force in FORCES.items()}
    tried = [name for name in when if when[name] == "tried"]
    return {name for name in when if when[name] == "fitted"}, tried


def space_of(
    settings: EstimateSettings, layout: MassLayout, *, thrown: bool = True, plain_mass: bool | None = None
) -> Space:
    """Return the box of all unknowns.

    Parameters
    ----------
    settings, layout
        The options to fit; where the free masses sit.
    thrown
        See `forces_of`.
    plain_mass
        Whether to fit the common mass of the plain points; None: only in the paper's search. Only ratios of
        masses can be known, so every other search fixes it at 1.
    """
    mass_range = MASS_RANGE[settings.ranges if isinstance(settings.ranges, str) else "wide"]
    if plain_mass is None:
        plain_mass = settings.search == "paper" and layout.count > 0
    options, sd = options_of(Space, given_of(settings, thrown=thrown), layout)
    if plain_mass:
        options = {PLAIN_MASS: mass_range} | options
    names = (*PARAMETERS, *(f"weight_{k + 1}" for k in range(layout.count)), *options)
    bounds = bounds_of(settings.ranges).copy()
    if not thrown and settings.ranges == "wide":
        bounds[np.isin(PARAMETERS, WIDENED), 1] *= CAPTURED_BY
    ranges = np.vstack([bounds, *[mass_range] * layout.count, *options.values()])
    prior_sd = np.array([sd.get(name, np.inf) for name in names])
    return Space(names, ranges, layout, prior_sd)


def options_of(
    box: type[Space], given: Mapping[str, Any], layout: MassLayout, held: Sequence[Ends] = ("any",)
) -> tuple[dict[str, Range], dict[str, float]]:
    """Return ranges and deviations of the priors of the unknowns that are fitted from the start.

    `given`: see `given_of`; what is not given is fitted. `held`: how the string is.
    """
    ranges: dict[str, Range] = {}
    sd: dict[str, float] = {}
    for name, how in box.ways().items():
        row = UNKNOWNS[name]
        if how.needs not in held or not _is_wanted(row, given) or not row.is_in(layout.stiff):
            continue
        if isinstance(prior := given.get(row.sd or ""), float):
            sd[how.name] = prior
        ranges[how.name] = how.range
        if how.range == OF_PRIOR:
            ranges[how.name] = (-PRIOR_RANGE_SD * sd[how.name], PRIOR_RANGE_SD * sd[how.name])
    return ranges, sd


def given_of(settings: EstimateSettings, *, in_plane: bool = True, thrown: bool = True) -> dict[str, Any]:
    """Return what says which unknowns are fitted from the start, and the deviations of their priors."""
    names = {row.sd for row in UNKNOWNS.values() if row.sd is not None}
    forces, _ = forces_of(settings.forces, in_plane=in_plane, thrown=thrown)
    return {name: getattr(settings, name) for name in names} | {"forces": forces}


def _is_wanted(row: Unknown, given: Mapping[str, Any]) -> bool:
    if row.forces:
        return not given["forces"].isdisjoint(row.forces)
    return row.sd is None or given.get(row.sd, "any") not in (None, 0.0)


def widened(space: Space, chi: Array) -> Space | None:
    """Return the box with wider ranges of `WIDENED` if a fit `chi` (d,) has a stiffness at its upper bound.

    Dampers alone are often there because a throw does not determine them.
    """
    if not (np.isin(space.names, STIFFNESSES) & (chi > 1.0 - AT_BOUND)).any():
        return None
    named = np.isin(space.names, WIDENED)
    return replace(space, bounds=space.bounds * np.where(named[:, None], [1.0, WIDENED_BY], 1.0))


def prior_exponents(
    space: Space, model: StringModel, count: int, rng: np.random.Generator, scatter: float = 0.08
) -> Array:
    """Return exponents (count, d) of plausible strings, with a little scatter; options at mid-range.

    In space all ranges are plausible; turns are near zero.
    """
    if not space.in_plane:
        from scipy.stats import qmc  # takes half a second: only for a search that needs it

        drawn = space.without_turns(qmc.LatinHypercube(space.dimension, rng=rng).random(count))
        return np.asarray(np.clip(drawn + scatter * rng.standard_normal(drawn.shape), 0.0, 1.0))
    stiff = space.layout.stiff
    draw = ensemble(count, model.length_m, model.points, space.layout.count - stiff, rng, stiff)
    # The first unknowns are the ten parameters and the free masses.
    plausible = dict(zip(space.names, np.hstack([draw.parameters, draw.weight_masses]).T, strict=False))
    plausible[PLAIN_MASS] = np.ones(count)
    if BEND_FRICTION in space.names:
        low, high = FRICTION_BEND_RAD
        held_rad = low * (high / low) ** rng.random(count)
        plausible[BEND_FRICTION] = held_rad * plausible["k_h"]
    values = space.values(np.full((count, space.dimension), 0.5))
    for k, name in enumerate(space.names):
        values[:, k] = plausible.get(name, values[:, k])
    chi = space.exponents(values) + scatter * rng.standard_normal(values.shape)
    return np.asarray(np.clip(chi, 0.0, 1.0))
