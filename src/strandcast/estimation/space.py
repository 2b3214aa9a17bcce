"""The unknowns of the fit and their exponents: ten parameters, free masses, and named options."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strandcast.estimation.evaluation import Array
from strandcast.string.masses import MassLayout, point_masses
from strandcast.string.parameters import PARAMETERS, to_exponent

CURL, CLAMP, COMMON = "rest_curl_rad_m", "clamp_offset_rad", "plain_mass"


@dataclass(frozen=True, eq=False)
class Strings:
    """A batch of B candidate strings.

    Attributes
    ----------
    parameters, masses, free_masses
        (B, 10), (B, n) and (B, w).
    rest_curl_rad_m, clamp_offset_rad
        (B,).
    """

    parameters: Array
    masses: Array
    free_masses: Array
    rest_curl_rad_m: Array
    clamp_offset_rad: Array

    def __len__(self) -> int:
        return len(self.parameters)

    def pick(self, rows: Array | list[int] | int) -> Strings:
        """Return the candidates `rows` of this batch."""
        kept = np.atleast_1d(rows).astype(int)
        return Strings(
            self.parameters[kept],
            self.masses[kept],
            self.free_masses[kept],
            self.rest_curl_rad_m[kept],
            self.clamp_offset_rad[kept],
        )


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
    """

    names: tuple[str, ...]
    bounds: Array
    layout: MassLayout

    @property
    def dimension(self) -> int:
        """Number of unknowns d."""
        return len(self.names)

    def is_linear(self) -> Array:
        """(d,) True for unknowns that may be negative: chi is their linear place, not an exponent."""
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
        count = self.layout.count
        free = values[:, 10 : 10 + count]
        plain = self._option(values, COMMON, 1.0)
        return Strings(
            values[:, :10],
            point_masses(self.layout, free, plain),
            free,
            self._option(values, CURL, 0.0),
            self._option(values, CLAMP, 0.0),
        )

    def chi_of(self, strings: Strings) -> Array:
        """Exponents (B, d) of given strings, clipped into the box."""
        columns = [strings.parameters, strings.free_masses]
        for name in self.names[10 + self.layout.count :]:
            column = {CURL: strings.rest_curl_rad_m, CLAMP: strings.clamp_offset_rad}.get(name)
            columns.append((np.ones(len(strings)) if column is None else column)[:, None])
        return self.exponents(np.hstack(columns))

    def _option(self, values: Array, name: str, default: float) -> Array:
        if name in self.names:
            return np.asarray(values[:, self.names.index(name)])
        return np.full(len(values), default)


def make_space(
    ranges: Array,
    mass_range: tuple[float, float],
    layout: MassLayout,
    options: dict[str, tuple[float, float]],
) -> Space:
    """Box of the ten parameters, the layout's free masses and the `options` (name to bounds)."""
    masses = [mass_range] * layout.count
    names = (*PARAMETERS, *(f"weight_{k + 1}" for k in range(layout.count)), *options)
    return Space(names, np.vstack([ranges, *masses, *options.values()]), layout)
