"""The unknown numbers of the string, their ranges and priors, and plausible strings to start from."""

from dataclasses import replace

import numpy as np

from strandcast.config.estimate import EstimateSettings, Ranges
from strandcast.core.strings import (
    BEND_FRICTION,
    CAMERA_OFFSET,
    CLAMP_OFFSET,
    DRAG_ALONG,
    FRICTION_STICK,
    PARAMETERS,
    PLAIN_MASS,
    REST_CURL,
    STIFF_BEND,
)
from strandcast.dynamics.masses import MassLayout
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import MASS_RANGE, RANGES, ensemble
from strandcast.estimation.evaluation import Array
from strandcast.estimation.space import AT_BOUND, Space

# All chosen.
CURL_RANGE_RAD_M = (-15.0, 15.0)
CLAMP_RANGE_RAD = (-0.2, 0.2)
CAMERA_OFFSET_RANGE_SD = 4.0  # half-width, in standard deviations of the prior
STIFF_RANGE = (1.0, 1e3)
FRICTION_RANGE = (1e-4, 1e2)  # N m/kg
DRAG_ALONG_RANGE = (0.02, 1.0)  # from skin friction alone to as much as across
STICK_RANGE_RAD_M = (0.01, 1.0)  # real cables, 20 mm thick: 0.02 to 0.25 (`make real`)
FRICTION_BEND_RAD = (1e-3, 1e-1)  # plausible bends that dry friction alone can hold
# A stiff cable is beyond the wide ranges, the more the closer its points are: its coefficients are stiffness
# per mass and spacing squared. More k_s or c_s changes nothing, and less than the lower bounds is nothing.
BENDING = ("k_h", "k_sh")  # of the string itself
STIFFNESSES = (*BENDING, "k_ph")
WIDENED = (*STIFFNESSES, "c_h", "c_sh", "c_ph")
WIDENED_BY = 30.0


def bounds_of(ranges: Ranges) -> Array:
    """Return the (10, 2) bounds of the parameters; those given by name replace the wide ones."""
    if isinstance(ranges, str):
        return RANGES[ranges]
    bounds = RANGES["wide"].copy()
    for name, pair in ranges.items():
        bounds[PARAMETERS.index(name)] = pair
    return bounds


def space_of(settings: EstimateSettings, layout: MassLayout, *, plain_mass: bool | None = None) -> Space:
    """Return the box of all unknowns.

    Parameters
    ----------
    settings, layout
        The options to fit; where the free masses sit.
    plain_mass
        Whether to fit the common mass of the plain points; None: only in the paper's search. Only ratios of
        masses can be known, so every other search fixes it at 1.
    """
    mass_range = MASS_RANGE[settings.ranges if isinstance(settings.ranges, str) else "wide"]
    options: dict[str, tuple[float, float]] = {}
    sd: dict[str, float] = {}
    if plain_mass is None:
        plain_mass = settings.search == "paper" and layout.count > 0
    if plain_mass:
        options[PLAIN_MASS] = mass_range
    if settings.rest_curl:
        options[REST_CURL] = CURL_RANGE_RAD_M
    if settings.clamp_offset:
        options[CLAMP_OFFSET], sd[CLAMP_OFFSET] = CLAMP_RANGE_RAD, settings.clamp_offset_sd_rad
    if settings.camera_offset_sd_m is not None:
        reach_m = CAMERA_OFFSET_RANGE_SD * settings.camera_offset_sd_m
        options |= dict.fromkeys(CAMERA_OFFSET, (-reach_m, reach_m))
        sd |= dict.fromkeys(CAMERA_OFFSET, settings.camera_offset_sd_m)
    if settings.stiff_bend and layout.stiff:
        options[STIFF_BEND] = STIFF_RANGE
    by_name = {
        BEND_FRICTION: (settings.bend_friction or settings.friction_stick, FRICTION_RANGE),
        FRICTION_STICK: (settings.friction_stick, STICK_RANGE_RAD_M),
        DRAG_ALONG: (settings.drag_along is True, DRAG_ALONG_RANGE),
    }
    options |= {name: bounds for name, (wanted, bounds) in by_name.items() if wanted}
    names = (*PARAMETERS, *(f"weight_{k + 1}" for k in range(layout.count)), *options)
    bounds = np.vstack([bounds_of(settings.ranges), *[mass_range] * layout.count, *options.values()])
    prior_sd = np.array([sd.get(name, np.inf) for name in names])
    return Space(names, bounds, layout, prior_sd)


def with_drag_along(space: Space) -> Space:
    """Return the box with the drag along the string as one more unknown."""
    names, bounds = (*space.names, DRAG_ALONG), np.vstack([space.bounds, DRAG_ALONG_RANGE])
    return replace(space, names=names, bounds=bounds, prior_sd=np.append(space.prior_sd, np.inf))


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
    """Return exponents (count, d) of plausible strings, with a little scatter; options at mid-range."""
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
