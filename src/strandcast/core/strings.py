"""Strings: the parameters' names and units, the rows of all other unknowns, and batches of strings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

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

# What a fit in space has for them, with ranges: length over which the string's weight bends it, over its
# length; bending damping over stiffness [s]; quadratic drag over mass, times the length; stiffness of the
# clamps over that of half a segment. Chosen.
SPATIAL_RANGES = {
    "bending_length": (0.01, 3.0),
    "damping_s": (1e-3, 1.0),
    "air": (1e-3, 3.0),
    "clamp_stiffness": (0.02, 50.0),
}

# Names of the numbers beside parameters and masses, as files and the unknowns of the fit use them.
REST_CURL, CLAMP_OFFSET, PLAIN_MASS = "rest_curl_rad_m", "clamp_offset_rad", "plain_mass"
FAR_OFFSET, LENGTH_CHANGE, REST_TORSION = "far_offset_rad", "length_change", "rest_torsion_rad_m"
SIDES = ("left", "up")  # of a turn in space: along the normal of the clamp's pose, along direction x normal
CAMERA_OFFSET = ("camera_offset_x_m", "camera_offset_y_m")
STIFF_BEND, BEND_FRICTION, DRAG_ALONG = "stiff_bend_factor", "bend_friction", "drag_along"
FRICTION_STICK = "friction_stick_rad_m"
TAPER, MARKER_SHIFT = "taper", "marker_shift"

Range = tuple[float, float]
OF_PRIOR: Range = (-np.inf, np.inf)
When = Literal["fitted", "tried", "never"]
Ends = Literal["any", "clamp", "one clamp", "two clamps"]  # how a string in space has to be held


class Cable(NamedTuple):
    """What unknowns in space scale with: length, spacing [m], bending stiffness (B,) [N m/rad/kg]."""

    length_m: float
    spacing_m: float
    bending: np.ndarray


class Force(NamedTuple):
    """An optional part of the model: what a fit makes of it unless `estimate.forces` names the parts.

    One that is tried is kept where it predicts better what was not fitted. Throws are at a target.
    """

    words: str
    throws: When
    captures: When
    throws_in_space: When
    captures_in_space: When


ForceName = Literal[
    "rest_curl", "drag_along", "friction_stick", "stiff_bend", "bend_friction", "marker_shift", "taper"
]
FORCES: dict[ForceName, Force] = {
    "rest_curl": Force("rest curl", "fitted", "fitted", "fitted", "fitted"),
    "drag_along": Force("less drag along the string", "tried", "tried", "fitted", "tried"),
    # A thrown cord shows no friction, and its pipes hardly bend: not worth the time between two throws.
    "friction_stick": Force("friction that sticks", "never", "tried", "never", "tried"),
    "stiff_bend": Force("stiff sections that bend", "never", "tried", "never", "tried"),
    "bend_friction": Force("friction that does not stick", "never", "never", "never", "never"),
    "marker_shift": Force("shift of the markers", "never", "never", "never", "tried"),
    "taper": Force("stiffness that changes along the string", "never", "never", "never", "fitted"),
}


class Way(NamedTuple):
    """How an unknown is fitted in the plane or in space: name, range, and what is fitted over its value."""

    name: str
    range: Range
    needs: Ends = "any"
    per: Callable[[Cable], float | np.ndarray] = lambda _: 1.0


@dataclass(frozen=True)
class Unknown:
    """A number of a string beside its parameters and masses: one row of `UNKNOWNS`."""

    name: str  # in files
    words: str = ""  # on pages
    unit: str = "1"
    range: Range | None = None  # of fits in the plane, OF_PRIOR: that of its prior; None: not fitted there
    in_space: Way | None = None
    forces: tuple[str, ...] = ()  # it is part of; none: it is always fitted, or where `sd` is given
    sd: str | None = None  # the setting with the standard deviation of its prior about zero, or "any" value
    stiff_sections: bool = False  # whether only strings with stiff sections have it
    starts: tuple[float, ...] = ()  # of a search for it from strings without it; none: mid-range
    bounds_are_physical: bool = False  # no string is beyond them
    axes: int = 0  # of strings that it is written of even where it is absent
    absent: float = 0.0  # the value that is as good as none
    thrown: bool = True  # whether a throw depends on it; otherwise it concerns the measurement
    # Works values (B,) into parameters, masses or bending; None: kernels, or what compares points, read it.
    apply: Callable[[StringBatch, np.ndarray], StringBatch] | None = None

    def is_in(self, stiff_sections: int) -> bool:
        """Whether a string with so many stiff sections has it."""
        return stiff_sections > 0 or not self.stiff_sections


def side(name: str, which: str) -> str:
    """Return the name of a turn to one side in space: its unit comes last."""
    stem, _, unit = name.partition("_rad")
    return f"{stem}_{which}_rad{unit}"


def _turns(name: str, fitted: str, unit: str, axes: int, *how: Any, **settings: Any) -> list[Unknown]:
    """Return the rows of a turn in space to both sides."""
    return [
        Unknown(side(name, k), "", unit, None, Way(f"{fitted}_{k}_rad", *how), axes=axes, **settings)
        for k in SIDES
    ]


def _length_m(cable: Cable) -> float:
    return cable.length_m


def _held_by_friction(cable: Cable) -> np.ndarray:
    return np.asarray(cable.length_m / (cable.bending * cable.spacing_m))


def _stiff_sections(strings: StringBatch, values: np.ndarray) -> StringBatch:
    factor = np.where(strings.stiff_joints, values[:, None], 1.0)
    return replace(strings, bend_factor=strings.bend_factor * factor)


def _tapered(strings: StringBatch, values: np.ndarray) -> StringBatch:
    along = np.linspace(-0.5, 0.5, strings.masses.shape[1])
    return replace(strings, bend_factor=strings.bend_factor * np.exp(values[:, None] * along))


_CLAMP: dict[str, Any] = {"sd": "clamp_offset_sd_rad"}
_CAMERA: dict[str, Any] = {"sd": "camera_offset_sd_m"}

# In the order of files. Ranges are chosen; in space they scale with the string's length.
_ROWS = [
    # Bend at rest; between two clamps it is hardly observable.
    Unknown(REST_CURL, "rest curl", "rad/m", (-15.0, 15.0), forces=("rest_curl",), axes=2),
    *_turns(*(REST_CURL, "curl", "rad/m", 3, (-3.0, 3.0), "one clamp", _length_m), forces=("rest_curl",)),
    # Turns of the clamp against the arm's file, and of a second clamp at the string's end.
    Unknown(*(CLAMP_OFFSET, "clamp angle", "rad", (-0.2, 0.2)), axes=2, **_CLAMP),
    *_turns(*(CLAMP_OFFSET, "clamp", "rad", 3, (-0.8, 0.8), "clamp"), **_CLAMP),
    *_turns(*(FAR_OFFSET, "far", "rad", 0, (-0.8, 0.8), "two clamps"), **_CLAMP),
    # Relative change of the rest length.
    Unknown(LENGTH_CHANGE, in_space=Way(LENGTH_CHANGE, (-0.08, 0.04)), axes=3),
    # Turn of the rest curl about the string, per length, from left to up: at rest the string is a helix.
    Unknown(REST_TORSION, unit="rad/m"),
    # Offset of the camera's positions from the robot's.
    *(Unknown(name, "", "m", OF_PRIOR, None, thrown=False, **_CAMERA) for name in CAMERA_OFFSET),
    Unknown(
        *(STIFF_BEND, "stiffness of the stiff sections", "1", (1.0, 1e3)),
        Way(STIFF_BEND, (1.0, 1e3)),
        forces=("stiff_bend",),
        stiff_sections=True,
        absent=1.0,
        apply=_stiff_sections,
    ),
    # Dry friction of a joint; in space, the turn over the length that it holds against bending.
    Unknown(
        *(BEND_FRICTION, "bend friction", "N m/kg", (1e-4, 1e2)),
        Way("friction_turn_rad", (0.01, 3.0), per=_held_by_friction),
        forces=("bend_friction", "friction_stick"),
    ),
    # Bend per length over which dry friction builds up, so that it holds a string at rest where it stopped;
    # absent: friction acts like a damper at small rates. Real cables, 20 mm thick: 0.02 to 0.25.
    Unknown(
        *(FRICTION_STICK, "bend over which friction builds up", "rad/m", (0.01, 1.0)),
        Way("stick_turn_rad", (0.005, 0.5), per=_length_m),
        forces=("friction_stick",),
    ),
    # From skin friction alone to as much as across, like where it is absent; fast strings show it.
    Unknown(
        *(DRAG_ALONG, "drag along the string over that across it", "1", (0.02, 1.0)),
        Way(DRAG_ALONG, (0.05, 1.0)),
        forces=("drag_along",),
        starts=(1.0, 0.3),
        bounds_are_physical=True,
    ),
    # Logarithm of the ratio of bending at the last joint to that at the hand; it changes exponentially.
    Unknown(TAPER, in_space=Way(TAPER, (-3.0, 3.0), needs="one clamp"), forces=("taper",), apply=_tapered),
    # By which all markers between mass points are farther along the string than declared, over its length.
    Unknown(
        *(MARKER_SHIFT, "shift of the markers", "1", (-0.1, 0.1)),
        Way(MARKER_SHIFT, (-0.1, 0.1)),
        forces=("marker_shift",),
        thrown=False,
    ),
]
UNKNOWNS = {row.name: row for row in _ROWS}


@dataclass(frozen=True, eq=False)
class StringBatch:
    """A batch of B strings; where they are ranked, the best comes first.

    `strings[name]` is an unknown, (B,).
    """

    parameters: np.ndarray  # (B, 10) in the order of `PARAMETERS`
    masses: np.ndarray  # (B, n) relative masses of points 1…n
    # Name to (B,) values of the unknowns that are not absent, see `UNKNOWNS`; others are ignored.
    values: Mapping[str, np.ndarray] = field(default_factory=dict)
    # (B, n) multiplier of bending at joints 0…n-1, without that of `values`; 1 if not given.
    bend_factor: np.ndarray = field(default_factory=lambda: np.ones((0, 0)))
    # (n,) True for the joints of the stiff sections; none if not given.
    stiff_joints: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    # (B, w) the free masses of the layout from which `masses` were made; (B, 0) if not given.
    free_masses: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    # Of the throw that each string is in; none if not given.
    disturbances: Disturbances = field(default_factory=lambda: Disturbances.none(0))

    def __post_init__(self) -> None:
        absent = {
            "values": {name: self.values[name] for name in UNKNOWNS if name in self.values},
            "bend_factor": np.ones_like(self.masses, dtype=float),
            "stiff_joints": np.zeros(self.masses.shape[1], dtype=bool),
            "free_masses": np.zeros((len(self), 0)),
            "disturbances": Disturbances.none(len(self)),
        }
        for name, value in absent.items():
            if name == "values" or not len(getattr(self, name)):
                object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.parameters)

    def __getitem__(self, name: str) -> np.ndarray:
        if name in self.values:
            return self.values[name]
        return np.full(len(self), UNKNOWNS[name].absent)

    @property
    def in_space(self) -> bool:
        """Whether they have unknowns that only strings in space have."""
        return any(UNKNOWNS[name].axes == 3 for name in self.values)

    def sides(self, name: str) -> np.ndarray:
        """Return a turn to the left and up: (B, 2); one in the plane is to the left."""
        if name in self.values:
            return np.column_stack([self[name], np.zeros(len(self))])
        return np.column_stack([self[side(name, which)] for which in SIDES])

    def take(self, rows: Sequence[int] | np.ndarray | int) -> StringBatch:
        """Return the strings `rows` of this batch."""
        at = np.atleast_1d(rows).astype(int)
        return StringBatch(
            self.parameters[at],
            self.masses[at],
            {name: values[at] for name, values in self.values.items()},
            self.bend_factor[at],
            self.stiff_joints,
            self.free_masses[at],
            self.disturbances.take(at),
        )

    def first(self, count: int) -> StringBatch:
        """Return the first `count` strings, or all if there are fewer."""
        return self.take(range(min(count, len(self))))

    def with_values(self, **values: np.ndarray) -> StringBatch:
        """Return the same strings with some unknowns replaced, each (B,), or a turn to both sides (B, 2)."""
        given: dict[str, np.ndarray] = {}
        for name, column in values.items():
            if column.ndim == 1:
                given[UNKNOWNS[name].name] = column
            else:
                given |= {side(name, which): column[:, k] for k, which in enumerate(SIDES)}
        kept = {name: column for name, column in self.values.items() if name not in values}
        return replace(self, values=kept | given)

    def with_disturbances(self, **columns: np.ndarray) -> StringBatch:
        """Return the same strings with some of the disturbances replaced."""
        return replace(self, disturbances=replace(self.disturbances, **columns))

    def applied(self) -> StringBatch:
        """Return the same strings with what `Unknown.apply` does worked into their arrays."""
        strings = self
        for name, row in UNKNOWNS.items():
            if row.apply is not None and name in self.values:
                strings = row.apply(strings, self.values[name])
        kept = {name: values for name, values in self.values.items() if UNKNOWNS[name].apply is None}
        return replace(strings, values=kept)

    def thrown(self) -> StringBatch:
        """Return the same strings without what only concerns the measurement or the fit."""
        kept = {name: values for name, values in self.values.items() if UNKNOWNS[name].thrown}
        return replace(self, values=kept, free_masses=np.zeros((len(self), 0)))

    def options(self) -> dict[str, np.ndarray]:
        """Return the unknowns that files have of these strings, in order: name to (B,)."""
        axes = 3 if self.in_space else 2
        return {
            name: self[name]
            for name, row in UNKNOWNS.items()
            if row.axes == axes or (self[name] != row.absent).any()
        }
