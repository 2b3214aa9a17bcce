"""The strings that the thrown one may be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np

# What differs from throw to throw (one standard deviation): how the string is grasped.
GRASP_ANGLE_RAD = float(np.radians(3.0))
GRASP_LENGTH_M = 0.002


def _none() -> np.ndarray:
    return np.zeros(0)


@dataclass(frozen=True, eq=False)
class Strings:
    """K strings, the best first.

    Attributes
    ----------
    parameters, masses
        (K, 10) and (K, n).
    curl_rad_m, clamp_offset_rad, longer_m
        (K,) bend at rest [rad/m], turn of the clamp [rad], length that hangs out beyond the nominal one [m];
        zero if not given.
    bend_friction
        (K,) dry friction of a joint [N m/kg]; zero if not given.
    bend_factor
        (K, n) multiplier of bending at joints 0…n-1; one if not given.
    """

    parameters: np.ndarray
    masses: np.ndarray
    curl_rad_m: np.ndarray = field(default_factory=_none)
    clamp_offset_rad: np.ndarray = field(default_factory=_none)
    longer_m: np.ndarray = field(default_factory=_none)
    bend_friction: np.ndarray = field(default_factory=_none)
    bend_factor: np.ndarray = field(default_factory=_none)

    def __post_init__(self) -> None:
        for name in ("curl_rad_m", "clamp_offset_rad", "longer_m", "bend_friction"):
            if not len(getattr(self, name)):
                object.__setattr__(self, name, np.zeros(len(self)))
        if not len(self.bend_factor):
            object.__setattr__(self, "bend_factor", np.ones_like(self.masses, dtype=float))

    def __len__(self) -> int:
        return len(self.parameters)

    def take(self, members: Sequence[int]) -> Strings:
        """Return some of the strings."""
        at = np.asarray(members, int)
        return Strings(*(getattr(self, column.name)[at] for column in fields(self)))

    def first(self, count: int) -> Strings:
        """Return the best `count` strings, or all if there are fewer."""
        return self.take(range(min(count, len(self))))


def regrasped(strings: Strings, rng: np.random.Generator) -> Strings:
    """Return the strings grasped a little differently, each in its own way."""
    return replace(
        strings,
        clamp_offset_rad=strings.clamp_offset_rad + rng.normal(0.0, GRASP_ANGLE_RAD, len(strings)),
        longer_m=strings.longer_m + rng.normal(0.0, GRASP_LENGTH_M, len(strings)),
    )


def joined(one: Strings, other: Strings) -> Strings:
    """Return the strings of both."""
    columns = ((getattr(one, column.name), getattr(other, column.name)) for column in fields(Strings))
    return Strings(*(np.concatenate(pair) for pair in columns))
