"""The unknowns of the fit and their exponents: ten parameters, free masses, and named options."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from strandcast.estimation.evaluation import Array
from strandcast.string.masses import MassLayout, point_masses
from strandcast.string.parameters import PARAMETERS, to_exponent

CURL, CLAMP, COMMON = "rest_curl_rad_m", "clamp_offset_rad", "plain_mass"
SHIFT = ("camera_offset_x_m", "camera_offset_y_m")
STIFF, FRICTION = "stiff_bend_factor", "bend_friction"
FOUND_PLACE, FOUND_MASS = "found_{}_place_m", "found_{}_mass"

DEVIATION_COSTS_M = 2e-5
"""What one standard deviation from a prior costs, on the scale of E: as if a throw were some 50 independent
measurements of a millimetre each. Many more are taken, but their errors go together."""


@dataclass(frozen=True, eq=False)
class Strings:
    """A batch of B candidate strings.

    Attributes
    ----------
    parameters, masses, free_masses
        (B, 10), (B, n) and (B, w).
    rest_curl_rad_m, clamp_offset_rad
        (B,).
    shift_m
        (B, 2) how far the camera sees everything from where the robot says it is; zero if not given.
    bend_factor
        (B, n) multiplier of bending at joints 0…n-1, or None for ones.
    found
        (B, k, 2) place [m from the hand] and relative mass of the weights at unknown places; they are part
        of `masses`.
    bend_friction
        (B,) dry friction of a joint [N m/kg]; zero if not given.
    """

    parameters: Array
    masses: Array
    free_masses: Array
    rest_curl_rad_m: Array
    clamp_offset_rad: Array
    shift_m: Array = field(default_factory=lambda: np.zeros((0, 2)))
    bend_factor: Array | None = None
    found: Array = field(default_factory=lambda: np.zeros((0, 0, 2)))
    bend_friction: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        shapes: dict[str, tuple[int, ...]] = {"shift_m": (2,), "found": (0, 2), "bend_friction": ()}
        for name, shape in shapes.items():
            if not len(getattr(self, name)):
                object.__setattr__(self, name, np.zeros((len(self), *shape)))

    def __len__(self) -> int:
        return len(self.parameters)

    def pick(self, rows: Array | list[int] | int) -> Strings:
        """Return the candidates `rows` of this batch."""
        kept = np.atleast_1d(rows).astype(int)
        columns: dict[str, Any] = {}
        for column in fields(self):
            rows_of = getattr(self, column.name)
            columns[column.name] = None if rows_of is None else rows_of[kept]
        return Strings(**columns)


@dataclass(frozen=True, eq=False)
class Space:
    """Box of unknowns; a point in it is a vector chi of exponents within [0, 1].

    Attributes
    ----------
    names
        d names: the ten parameters, ``weight_1``… for the free masses, then the options in use.
    bounds
        (d, 2) lower and upper values.
    layout
        Where the free masses sit.
    prior_sd
        (d,) standard deviation about zero of the unknowns that are known a little, infinite for all others.
    spacing_m
        Rest length of a segment, where weights are looked for; else 0.
    """

    names: tuple[str, ...]
    bounds: Array
    layout: MassLayout
    prior_sd: Array
    spacing_m: float = 0.0

    @property
    def dimension(self) -> int:
        """Number of unknowns d."""
        return len(self.names)

    @property
    def weights_found(self) -> int:
        """Number of weights at unknown places."""
        return sum(name.startswith("found_") for name in self.names) // 2

    def is_linear(self) -> Array:
        """(d,) True for unknowns that may be zero or negative: chi is their linear place, not an exponent."""
        return np.asarray(self.bounds[:, 0] <= 0)

    def values(self, chi: Array) -> Array:
        """Values of exponents, eq. (2), or linear for those that may be negative: (..., d)."""
        low, high = self.bounds.T
        linear = self.is_linear()
        ratio = np.where(linear, 1.0, high / np.where(linear, 1.0, low))
        return np.asarray(np.where(linear, low + (high - low) * chi, low * ratio**chi))

    def exponents(self, values: Array) -> Array:
        """Exponents of values, clipped to [0, 1]: the inverse of `values`."""
        low, high = self.bounds.T
        linear = self.is_linear()
        safe = np.where(linear, 1.0, values)
        bounds = np.where(linear[:, None], [1.0, 2.0], self.bounds)
        chi = np.where(linear, (values - low) / (high - low), to_exponent(safe, bounds))
        return np.asarray(np.clip(chi, 0.0, 1.0))

    def strings(self, chi: Array) -> Strings:
        """Candidate strings of exponents (B, d)."""
        values = self.values(np.atleast_2d(chi))
        free = values[:, 10 : 10 + self.layout.count]
        masses = point_masses(self.layout, free, self._option(values, COMMON, 1.0))
        options = {name: values[:, k] for k, name in enumerate(self.names) if k >= 10 + self.layout.count}
        made = with_options(values[:, :10], masses, free, options, self.layout)
        return replace(made, masses=masses + carried(made.found, self.spacing_m, masses.shape[1]))

    def chi_of(self, strings: Strings) -> Array:
        """Exponents (B, d) of given strings, clipped into the box."""
        bare = self.layout.shares.sum(axis=0) == 0.0
        plain = strings.masses[:, bare].min(axis=1) if bare.any() else np.ones(len(strings))
        known = options_of(strings) | {COMMON: plain}
        middle = self.values(np.full(self.dimension, 0.5))
        columns = [strings.parameters, strings.free_masses]
        for k in range(10 + self.layout.count, self.dimension):
            columns.append(known.get(self.names[k], np.full(len(strings), middle[k]))[:, None])
        return self.exponents(np.hstack(columns))

    def deviations(self, chi: Array) -> Array:
        """Deviations (..., d) from the priors, in standard deviations; 0 for unknowns without one."""
        return np.asarray(self.values(chi) / self.prior_sd)

    def penalty(self, chi: Array) -> Array:
        """Cost of deviations from the priors: (...,) [m], to be added to E."""
        return np.asarray(DEVIATION_COSTS_M * (self.deviations(chi) ** 2).sum(axis=-1))

    def _option(self, values: Array, name: str, default: float) -> Array:
        if name in self.names:
            return np.asarray(values[:, self.names.index(name)])
        return np.full(len(values), default)


def options_of(strings: Strings) -> dict[str, Array]:
    """Name to values (B,) of the numbers beside parameters and masses: curl, clamp, and what else is used."""
    options = {CURL: strings.rest_curl_rad_m, CLAMP: strings.clamp_offset_rad}
    if strings.shift_m.any():
        options |= dict(zip(SHIFT, strings.shift_m.T, strict=True))
    if strings.bend_factor is not None:
        options[STIFF] = strings.bend_factor.max(axis=1)
    if strings.bend_friction.any():
        options[FRICTION] = strings.bend_friction
    for k in range(strings.found.shape[1]):
        options[FOUND_PLACE.format(k + 1)], options[FOUND_MASS.format(k + 1)] = strings.found[:, k].T
    return options


def with_options(
    parameters: Array, masses: Array, free_masses: Array, options: Mapping[str, Array], layout: MassLayout
) -> Strings:
    """Strings from their arrays and what `options_of` gave; what is not there is not in use."""
    none = np.zeros(len(parameters))
    factor = options.get(STIFF)
    found = [
        np.column_stack([options[FOUND_PLACE.format(k + 1)], options[FOUND_MASS.format(k + 1)]])
        for k in range(sum(name.startswith("found_") for name in options) // 2)
    ]
    return Strings(
        parameters,
        masses,
        free_masses,
        options.get(CURL, none),
        options.get(CLAMP, none),
        np.column_stack([options.get(name, none) for name in SHIFT]),
        None if factor is None else np.where(stiff_joints(layout), factor[:, None], 1.0),
        np.stack(found, axis=1) if found else np.zeros((len(parameters), 0, 2)),
        options.get(FRICTION, none),
    )


def stiff_joints(layout: MassLayout) -> np.ndarray:
    """(n,) True for joints 0…n-1 at points of stiff sections: joint i is at point i."""
    touched = layout.shares[layout.count - layout.stiff :].sum(axis=0) > 0
    return np.concatenate([[False], touched[:-1]])


def carried(found: Array, spacing_m: float, n: int) -> Array:
    """Relative masses (B, n) that weights (B, k, 2) of place [m] and mass put on points 1…n.

    A weight between two points is split linearly over them.
    """
    if not found.size:
        return np.zeros((len(found), n))
    place = np.clip(found[..., 0] / spacing_m, 1.0, n)
    share = np.maximum(1.0 - np.abs(place[..., None] - np.arange(1, n + 1)), 0.0)
    return np.asarray(np.einsum("bk,bkn->bn", found[..., 1], share))


def make_space(
    ranges: Array,
    mass_range: tuple[float, float],
    layout: MassLayout,
    options: dict[str, tuple[float, float]],
    prior_sd: dict[str, float] | None = None,
    spacing_m: float = 0.0,
) -> Space:
    """Box of the ten parameters, the layout's free masses and the `options` (name to bounds)."""
    masses = [mass_range] * layout.count
    names = (*PARAMETERS, *(f"weight_{k + 1}" for k in range(layout.count)), *options)
    known = prior_sd or {}
    sd = np.array([known.get(name, np.inf) for name in names])
    return Space(names, np.vstack([ranges, *masses, *options.values()]), layout, sd, spacing_m)
