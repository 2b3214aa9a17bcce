"""The unknowns of the fit and their exponents: ten parameters, free masses, and named options."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Self

import numpy as np

from strandcast.core.strings import (
    BEND_FRICTION,
    FRICTION_STICK,
    PLAIN_MASS,
    UNITS,
    UNKNOWNS,
    ForceName,
    StringBatch,
    Unknown,
    Way,
)
from strandcast.dynamics.masses import MassLayout, point_masses
from strandcast.dynamics.parameters import to_exponent
from strandcast.estimation.evaluation import Array

AT_BOUND = 0.01  # distance to a bound, as a share of the range (chosen)
DEVIATION_COSTS_M = 2e-5
"""Penalty of one standard deviation from a prior, on the scale of E [m]. Chosen: as if a throw were some 50
independent measurements of a millimetre each; many more are taken, but their errors are correlated."""


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
        (d,) standard deviation about zero of the unknowns that have a prior, infinite for all others.
    """

    names: tuple[str, ...]
    bounds: Array
    layout: MassLayout
    prior_sd: Array

    in_plane: ClassVar[bool] = True  # whether the unknowns of a plain string are the ten parameters
    # Of searches. In space single precision is micrometres away, at two thirds of the time.
    precision: ClassVar[Literal["f64", "f32"]] = "f64"

    @property
    def dimension(self) -> int:
        """Number of unknowns d."""
        return len(self.names)

    @property
    def parameter_units(self) -> dict[str, str]:
        """Names and units of the unknowns that describe a plain string; weights and options follow them."""
        return UNITS

    @staticmethod
    def ways() -> dict[str, Way]:
        """Return how each unknown is fitted that can be fitted here, by its name in files, in order."""
        rows = [(row, row.range) for row in UNKNOWNS.values()]
        return {row.name: Way(row.name, range_) for row, range_ in rows if range_ is not None}

    def unknowns_of(self, force: ForceName) -> list[Unknown]:
        """Return the unknowns of an optional force that can be fitted here."""
        rows = [UNKNOWNS[name] for name in self.ways()]
        return [row for row in rows if force in row.forces and row.is_in(self.layout.stiff)]

    def with_force(self, force: ForceName) -> Self:
        """Return the box with the unknowns of one more optional force."""
        hows = [self.ways()[row.name] for row in self.unknowns_of(force)]
        hows = [how for how in hows if how.name not in self.names]
        if not hows:
            return self
        at = len(self.names) - (0 if self.in_plane else self.layout.count)  # weights are the last in space
        return replace(
            self,
            names=(*self.names[:at], *(how.name for how in hows), *self.names[at:]),
            bounds=np.insert(self.bounds, [at], [how.range for how in hows], axis=0),
            prior_sd=np.insert(self.prior_sd, [at], [np.inf for _ in hows]),
        )

    def without_turns(self, chi: Array) -> Array:
        """Return exponents (B, d) with all unknowns that may be negative at zero."""
        linear = self.is_linear()
        return np.where(linear, self.exponents(np.where(linear, 0.0, 1.0)), chi)

    def without_friction(self) -> Self:
        """Return the same box without the unknowns of dry friction."""
        ways = self.ways()
        kept = ~np.isin(self.names, [ways[name].name for name in (BEND_FRICTION, FRICTION_STICK)])
        names = tuple(np.array(self.names)[kept].tolist())
        return replace(self, names=names, bounds=self.bounds[kept], prior_sd=self.prior_sd[kept])

    def with_least_friction(self, plain: Space, chi: Array) -> Array:
        """Return exponents (d,) of a string of the box `plain`, with the least friction of this box."""
        least = dict(zip(self.names, self.bounds[:, 0], strict=True))
        known = least | dict(zip(plain.names, plain.values(chi), strict=True))
        return self.exponents(np.array([known[name] for name in self.names]))

    def is_linear(self) -> Array:
        """(d,) True for unknowns that may be zero or negative: chi is linear in them, not an exponent."""
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

    def strings(self, chi: Array) -> StringBatch:
        """Candidate strings of exponents (B, d)."""
        values = self.values(np.atleast_2d(chi))
        free = values[:, 10 : 10 + self.layout.count]
        options = {name: values[:, k] for k, name in enumerate(self.names) if k >= 10 + self.layout.count}
        masses = point_masses(self.layout, free, options.get(PLAIN_MASS, 1.0))
        stiff = self.layout.stiff_joints()
        return StringBatch(values[:, :10], masses, options, stiff_joints=stiff, free_masses=free)

    def chi_of(self, strings: StringBatch) -> Array:
        """Exponents (B, d) of given strings, clipped into the box."""
        bare = self.layout.shares.sum(axis=0) == 0.0
        relative = strings.masses / self.layout.plain
        plain = relative[:, bare].min(axis=1) if bare.any() else np.ones(len(strings))
        known = strings.options() | {PLAIN_MASS: plain}
        middle = dict(zip(self.names, self.values(np.full(self.dimension, 0.5)), strict=True))
        middle |= {name: row.starts[0] for name, row in UNKNOWNS.items() if row.starts}
        columns = [strings.parameters, strings.free_masses]
        for k in range(10 + self.layout.count, self.dimension):
            name = self.names[k]
            columns.append(known.get(name, np.full(len(strings), middle[name]))[:, None])
        return self.exponents(np.hstack(columns))

    def mass_powers(self) -> Array:
        """(d,) powers of a string's mass with which its unknowns rise if it is to move as before."""
        per_mass = {name for name, row in UNKNOWNS.items() if row.unit.endswith("/kg")} | set(UNITS)
        return np.array([float(name in per_mass) for name in self.names])

    def as_heavy(self, masses: Array, chi: Array, row: int) -> Array:
        """Return exponents (T, d) of strings that move about like `chi` (d,), with other masses of a weight.

        `masses` (T,) are exponents of the unknown `row`.
        """
        values = np.tile(self.values(chi), (len(masses), 1))
        values[:, row] = self.values(np.where(np.arange(len(chi)) == row, masses[:, None], chi))[:, row]
        half = 0.5 * self.layout.shares.shape[1]
        heavier = (values[:, row] + half) / (self.values(chi)[row] + half)
        return self.exponents(values * heavier[:, None] ** self.mass_powers())

    def deviations(self, chi: Array) -> Array:
        """Deviations (..., d) from the priors, in standard deviations; 0 for unknowns without one."""
        return np.asarray(self.values(chi) / self.prior_sd)

    def penalty(self, chi: Array) -> Array:
        """Cost of deviations from the priors: (...,) [m], to be added to E."""
        return np.asarray(DEVIATION_COSTS_M * (self.deviations(chi) ** 2).sum(axis=-1))
