"""The ten string parameters: names, units, ranges, exponents, and start strings.

The names and the ranges called ``paper`` are Tables 1 and 2 of the paper. Coefficients are per unit of
nominal point mass; only their ratios to the masses can be known. Three units of Table 2 are misprinted there
and corrected here.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Lower and upper bounds (10, 2). The paper's bounds of k_s, clamp and masses limited the fits
# most: a cord is nearly inextensible, the hand holds it like a clamp, and 10 g of clay weigh as much as 50 of
# its points.
RANGES: dict[str, Array] = {
    "paper": np.column_stack(
        [
            [1e3, 1.0, 1e-3, 1e-3, 1e-4, 1e-4, 1e-6, 1e-6, 1e-3, 1e-3],
            [1e6, 10.0, 10.0, 10.0, 1.0, 1.0, 10.0, 10.0, 1e-2, 1e-2],
        ]
    ),
    "wide": np.column_stack(
        [
            [1e3, 1.0, 1e-4, 1e-4, 1e-4, 1e-4, 1e-6, 1e-6, 1e-3, 1e-4],
            [1e8, 1e3, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0],
        ]
    ),
}

MASS_RANGE: dict[str, tuple[float, float]] = {"paper": (1.0, 20.0), "wide": (0.1, 800.0)}
"""Relative masses. The paper prints no range; its Table 4 shows values from 1 to 20."""


class StringDraw(NamedTuple):
    """Strings to start from.

    Attributes
    ----------
    parameters
        (k, 10) in the order of `PARAMETERS`.
    weight_masses
        (k, w) relative mass of each weight, in plain points.
    """

    parameters: Array
    weight_masses: Array


def from_exponent(chi: Array, ranges: Array) -> Array:
    """Values of exponents: eq. (2), P = P_min (P_max / P_min)^chi.

    Parameters
    ----------
    chi
        (..., d) exponents, 0 at the lower bound and 1 at the upper.
    ranges
        (d, 2) lower and upper bounds, positive.
    """
    return np.asarray(ranges[:, 0] * (ranges[:, 1] / ranges[:, 0]) ** chi)


def to_exponent(values: Array, ranges: Array) -> Array:
    """Exponents of values: the inverse of eq. (2), below 0 or above 1 outside the ranges."""
    return np.asarray(np.log(values / ranges[:, 0]) / np.log(ranges[:, 1] / ranges[:, 0]))


def minima(weights: int = 0) -> StringDraw:
    """One string of the minimum of every range of Table 2, with which the paper plans its first motion."""
    lightest = MASS_RANGE["paper"][0]
    return StringDraw(RANGES["paper"][None, :, 0].copy(), np.full((1, weights), lightest))


def random_strings(k: int, weights: int, rng: np.random.Generator, ranges: str = "paper") -> StringDraw:
    """`k` strings drawn log-uniformly from `ranges` ("paper" or "wide")."""
    masses = np.array([MASS_RANGE[ranges]] * weights).reshape(weights, 2)
    return StringDraw(
        from_exponent(rng.random((k, 10)), RANGES[ranges]), from_exponent(rng.random((k, weights)), masses)
    )


# The prior of a cord that was never thrown; chosen to hold sewing thread, cotton and nylon cord, rubber
# tube and rope: mass per length, density of the material with its air, and the length over which its own
# weight bends it, (B / (mass per length * g))^(1/3) for a bending stiffness B.
DENSITY_KG_M = (2e-3, 20e-3)
MATERIAL_KG_M3 = (100.0, 1300.0)
BENDING_LENGTH_M = (0.012, 0.065)
WEIGHT_KG, PIPE_KG_M = (3e-3, 20e-3), (8e-3, 40e-3)
# Drag per length and diameter, half of air's density times the coefficient of a cylinder across the flow,
# 1.0 to 1.2 at these Reynolds numbers (Hoerner, Fluid-Dynamic Drag, 1965, fig. 3-12).
DRAG_KG_M3 = 0.66
GRAVITY_M_S2 = 9.81


def ensemble(
    k: int,
    length_m: float,
    n: int,
    weights: int,
    rng: np.random.Generator,
    stiff: int = 0,
    thickness_m: float | None = None,
    density_kg_m: tuple[float, float] = DENSITY_KG_M,
) -> StringDraw:
    """`k` physically plausible strings: the prior of a cord that was never thrown.

    Parameters
    ----------
    k
        Number of strings.
    length_m, n
        Free length [m] and number of free points.
    weights, stiff
        Number of weights, and of points of stiff sections; their free masses follow those of the weights.
    thickness_m
        Diameter, for drag; without it, that of a cord of the mass and a plausible material.
    density_kg_m
        Least and greatest mass per length.

    Notes
    -----
    Held as in a clamp. All coefficients per kilogram of one plain point.
    """
    spacing_m = length_m / n
    per_length_kg_m = log_uniform_array(rng, *density_kg_m, k)
    diameter_m = np.sqrt(4.0 * per_length_kg_m / (np.pi * log_uniform_array(rng, *MATERIAL_KG_M3, k)))
    if thickness_m is not None:
        diameter_m[:] = thickness_m
    bending = GRAVITY_M_S2 * log_uniform_array(rng, *BENDING_LENGTH_M, k) ** 3 / spacing_m**2
    damping = bending * log_uniform_array(rng, 2e-3, 2e-2, k)
    stretch = log_uniform_array(rng, 5e6, 1e8, k)
    parameters = np.column_stack(
        [
            stretch,
            log_uniform_array(rng, 5.0, 50.0, k),
            bending,
            damping,
            bending * rng.uniform(0.5, 1.0, k),
            damping * rng.uniform(0.5, 1.0, k),
            log_uniform_array(rng, 1e-3, 5e-2, k),
            DRAG_KG_M3 * diameter_m / per_length_kg_m,
            2.0 * bending,
            2.0 * damping,
        ]
    )
    low, high = RANGES["wide"].T
    clay_kg = log_uniform_array(rng, *WEIGHT_KG, (k, weights))
    pipe_kg = np.repeat(log_uniform_array(rng, *PIPE_KG_M, (k, 1)) * spacing_m, stiff, axis=1)
    masses = np.hstack([clay_kg, pipe_kg]) / (per_length_kg_m * spacing_m)[:, None]
    return StringDraw(np.clip(parameters, low, high), np.clip(masses, *MASS_RANGE["wide"]))


def log_uniform_array(
    rng: np.random.Generator, low: float, high: float, size: int | tuple[int, int]
) -> Array:
    """Return numbers from `low` to `high` that are uniform in their logarithm."""
    return np.asarray(low * (high / low) ** rng.random(size))
