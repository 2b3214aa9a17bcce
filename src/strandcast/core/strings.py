"""Strings: the parameters' names and units, and batches of strings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from strandcast.core.disturbances import Disturbances

# Names of the paper's Table 1.
UNITS = {
    "k_s": "N/m/kg",
    "c_s": "N s/m/kg",
    "k_h": "N m/rad/kg",
    "c_h": "N m s/rad/kg",
    "k_sh": "N m/rad/kg",
    "c_sh": "N m s/rad/kg",
    "C_c1": "N s/m/kg",
    "C_c2": "N s2/m2/kg",
    "k_ph": "N m/rad/kg",
    "c_ph": "N m s/rad/kg",
}
PARAMETERS = tuple(UNITS)  # in the order of every array of parameters

# Names of the numbers beside parameters and masses, as files and the unknowns of the fit use them.
REST_CURL, CLAMP_OFFSET, PLAIN_MASS = "rest_curl_rad_m", "clamp_offset_rad", "plain_mass"
FAR_OFFSET, LENGTH_CHANGE, REST_TORSION = "far_offset_rad", "length_change", "rest_torsion_rad_m"
SIDES = ("left", "up")  # of a turn in space
CAMERA_OFFSET = ("camera_offset_x_m", "camera_offset_y_m")
STIFF_BEND, BEND_FRICTION, DRAG_ALONG = "stiff_bend_factor", "bend_friction", "drag_along"
FRICTION_STICK = "friction_stick_rad_m"
TAPER, MARKER_SHIFT = "taper", "marker_shift"


@dataclass(frozen=True, eq=False)
class StringBatch:
    """A batch of B strings; where they are ranked, the best comes first.

    Attributes
    ----------
    parameters
        (B, 10) in the order of `PARAMETERS`.
    masses
        (B, n) relative masses of points 1…n.
    rest_curl_rad_m, clamp_offset_rad
        (B,) bend at rest [rad/m], turn of the clamp against the arm's file [rad]; zero if not given. In
        space (B, 2): to the left, along the normal of the clamp's pose, and up, along direction x normal.
    bend_factor
        (B, n) multiplier of bending at joints 0…n-1; None: all joints bend alike.
    bend_friction
        (B,) dry friction of a joint [N m/kg]; zero if not given.
    friction_stick_rad_m
        (B,) bend per length over which dry friction builds up, so that it holds a string at rest where it
        stopped [rad/m]; zero, the default: friction acts like a damper at small rates.
    drag_along
        (B,) drag along the string over that across it; zero, the default: the same in all directions.
    free_masses
        (B, w) the free masses of the layout from which `masses` were made; (B, 0) if not given.
    camera_offset_m
        (B, 2) offset of the camera's positions from the robot's; zero if not given.
    disturbances
        Of the throw that each string is in; none if not given.
    far_offset_rad
        (B, 2) turn of the second clamp to its left and up [rad], of strings in space; zero if not given.
    length_change
        (B,) of the rest length, relative, of strings in space; zero if not given.
    rest_torsion_rad_m
        (B,) turn of the rest curl about the string, per length, from left to up [rad/m], of strings in
        space: at rest the string is a helix; zero, the default: an arc.
    taper
        (B,) logarithm of the ratio of bending at the last joint to that at the hand, which changes
        exponentially between them; zero if not given.
    marker_shift
        (B,) by which all markers are farther along the string than declared, over its length, where they lie
        between mass points; zero if not given.
    """

    parameters: np.ndarray
    masses: np.ndarray
    rest_curl_rad_m: np.ndarray = field(default_factory=lambda: np.zeros(0))
    clamp_offset_rad: np.ndarray = field(default_factory=lambda: np.zeros(0))
    bend_factor: np.ndarray | None = None
    bend_friction: np.ndarray = field(default_factory=lambda: np.zeros(0))
    drag_along: np.ndarray = field(default_factory=lambda: np.zeros(0))
    friction_stick_rad_m: np.ndarray = field(default_factory=lambda: np.zeros(0))
    free_masses: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    camera_offset_m: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    disturbances: Disturbances = field(default_factory=lambda: Disturbances.none(0))
    far_offset_rad: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    length_change: np.ndarray = field(default_factory=lambda: np.zeros(0))
    rest_torsion_rad_m: np.ndarray = field(default_factory=lambda: np.zeros(0))
    taper: np.ndarray = field(default_factory=lambda: np.zeros(0))
    marker_shift: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        for column in fields(self):
            value = getattr(self, column.name)
            if isinstance(value, np.ndarray) and not len(value):
                object.__setattr__(self, column.name, np.zeros((len(self), *value.shape[1:])))
        if not len(self.disturbances):
            object.__setattr__(self, "disturbances", Disturbances.none(len(self)))

    def __len__(self) -> int:
        return len(self.parameters)

    def take(self, rows: Sequence[int] | np.ndarray | int) -> StringBatch:
        """Return the strings `rows` of this batch."""
        at = np.atleast_1d(rows).astype(int)
        columns: dict[str, Any] = {}
        for column in fields(self):
            value = getattr(self, column.name)
            if isinstance(value, Disturbances):
                columns[column.name] = value.take(at)
            else:
                columns[column.name] = None if value is None else value[at]
        return StringBatch(**columns)

    def first(self, count: int) -> StringBatch:
        """Return the first `count` strings, or all if there are fewer."""
        return self.take(range(min(count, len(self))))

    def with_disturbances(self, **columns: np.ndarray) -> StringBatch:
        """Return the same strings with some of the disturbances replaced."""
        return replace(self, disturbances=replace(self.disturbances, **columns))

    def bend_factors(self) -> np.ndarray:
        """Return the multiplier of bending at every joint, of `bend_factor` and `taper`: (B, n)."""
        factor = np.ones_like(self.masses, dtype=float) if self.bend_factor is None else self.bend_factor
        if not self.taper.any():
            return factor
        along = np.linspace(-0.5, 0.5, factor.shape[1])
        return np.asarray(factor * np.exp(self.taper[:, None] * along))

    def thrown_clamp_offset_rad(self) -> np.ndarray:
        """Return the clamp's offset and its disturbance together: (B,)."""
        return np.asarray(self.clamp_offset_rad + self.disturbances.clamp_turn_rad)

    def options(self) -> dict[str, np.ndarray]:
        """Return the numbers in use beside parameters and masses by name, each (B,)."""
        options: dict[str, np.ndarray] = {}
        for name, values in ((REST_CURL, self.rest_curl_rad_m), (CLAMP_OFFSET, self.clamp_offset_rad)):
            options |= _by_side(name, values)
        if self.rest_curl_rad_m.ndim > 1:
            options |= _by_side(FAR_OFFSET, self.far_offset_rad) if self.far_offset_rad.any() else {}
            options[LENGTH_CHANGE] = self.length_change
            options |= {REST_TORSION: self.rest_torsion_rad_m} if self.rest_torsion_rad_m.any() else {}
        if self.camera_offset_m.any():
            options |= dict(zip(CAMERA_OFFSET, self.camera_offset_m.T, strict=True))
        if self.bend_factor is not None:
            options[STIFF_BEND] = self.bend_factor.max(axis=1)
        if self.bend_friction.any():
            options[BEND_FRICTION] = self.bend_friction
        if self.friction_stick_rad_m.any():
            options[FRICTION_STICK] = self.friction_stick_rad_m
        if self.drag_along.any():
            options[DRAG_ALONG] = self.drag_along
        options |= {TAPER: self.taper} if self.taper.any() else {}
        options |= {MARKER_SHIFT: self.marker_shift} if self.marker_shift.any() else {}
        return options

    @classmethod
    def from_options(
        cls,
        parameters: np.ndarray,
        masses: np.ndarray,
        free_masses: np.ndarray,
        options: Mapping[str, np.ndarray],
        stiff_joints: np.ndarray,
    ) -> StringBatch:
        """Return strings from their arrays and their `options`; an option that is absent is not in use.

        Parameters
        ----------
        parameters, masses, free_masses
            See `StringBatch`.
        options
            Name to (B,) values.
        stiff_joints
            (n,) True for the joints that the stiff sections' factor multiplies.
        """
        none = np.zeros(len(parameters))
        factor = options.get(STIFF_BEND)
        return cls(
            parameters,
            masses,
            _of_sides(REST_CURL, options, none),
            _of_sides(CLAMP_OFFSET, options, none),
            bend_factor=None if factor is None else np.where(stiff_joints, factor[:, None], 1.0),
            bend_friction=options.get(BEND_FRICTION, none),
            drag_along=options.get(DRAG_ALONG, none),
            friction_stick_rad_m=options.get(FRICTION_STICK, none),
            free_masses=free_masses,
            camera_offset_m=np.column_stack([options.get(name, none) for name in CAMERA_OFFSET]),
            far_offset_rad=np.column_stack([options.get(_side(FAR_OFFSET, side), none) for side in SIDES]),
            length_change=options.get(LENGTH_CHANGE, none),
            rest_torsion_rad_m=options.get(REST_TORSION, none),
            taper=options.get(TAPER, none),
            marker_shift=options.get(MARKER_SHIFT, none),
        )


def _side(name: str, side: str) -> str:
    """Return the name of a turn to one side in space: its unit comes last."""
    stem, _, unit = name.partition("_rad")
    return f"{stem}_{side}_rad{unit}"


def _by_side(name: str, values: np.ndarray) -> dict[str, np.ndarray]:
    """Return turns (B,) in the plane by name, or turns (B, 2) in space by side."""
    if values.ndim == 1:
        return {name: values}
    return {_side(name, side): values[:, k] for k, side in enumerate(SIDES)}


def _of_sides(name: str, options: Mapping[str, np.ndarray], none: np.ndarray) -> np.ndarray:
    """Return turns (B,) in the plane, or (B, 2) in space."""
    if _side(name, SIDES[0]) not in options:
        return options.get(name, none)
    return np.column_stack([options[_side(name, side)] for side in SIDES])
