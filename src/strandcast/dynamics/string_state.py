"""State of the strings of one vector, and what a step is given besides; in the plane and in space."""

from typing import Any, NamedTuple

from numba import njit

from strandcast.dynamics.vectors import INLINED

ROWS = 12  # of work per point i = 0…n


class StringArrays(NamedTuple):
    """The strings of one vector.

    Attributes
    ----------
    n
        Number of free points.
    c
        Coefficients: rows as listed in `strandcast.dynamics.elements`.
    mass, factor
        Masses of points 1…n, multipliers of bending at joints 0…n-1.
    """

    n: int
    c: Any
    mass: Any
    factor: Any


class StringMotion(NamedTuple):
    """State of the strings of one vector.

    Attributes
    ----------
    d
        2n rows: the segments, x and y by turns. Segments, not points: differences of points would cost f32
        the digits that a stiff spring needs.
    v, dv
        2n + 2 rows: velocities of points 0…n and their last change; point 0 is the hand.
    stick
        2n rows: bend at the last step [rad] and share of its full moment of friction at joints 0…n-1, by
        turns; None if no friction sticks: kernels are compiled for either. In space see
        `strandcast.dynamics.spatial.joints.sticking_friction_in_space`.
    """

    d: Any
    v: Any
    dv: Any
    stick: Any = None


class ReadyStrings(NamedTuple):
    """Coefficients and starts of B candidates, in double precision and the layout of the vectors.

    Attributes
    ----------
    c
        (COEFFICIENTS or SPATIAL_COEFFICIENTS, B) rows as listed in `strandcast.dynamics.elements` and, in
        space, in `strandcast.dynamics.spatial.step`.
    mass, factor
        (n, B) masses of points 1…n and multipliers of bending at joints 0…n-1.
    d, v
        (2n or 3n, B) segments [m] and (2n + 2 or 3n + 3, B) velocities [m/s] at the start, see
        `StringMotion`.
    shift
        (2 or 3, B) added to the points before they are compared [m].
    """

    c: Any
    mass: Any
    factor: Any
    d: Any
    v: Any
    shift: Any


class StepSettings(NamedTuple):
    """Values common to all strings at one step.

    Attributes
    ----------
    step, share
        Step [s]; 1/2 at the first step and 1 at all others: velocities are half a step behind.
    l0, gravity
        Rest spacing [m], in space that of the model; gravity downwards [m/s^2].
    reading, per_width
        The model's reading and 1 / half-width of its switch.
    has_friction
        Whether there is dry friction.
    slender
        True if drag differs along and across the string, else None: the plane's kernels are compiled for
        either; False in space.
    two_ends, helical
        In space: whether the last point is driven, too; whether the rest bend turns along the string.
    """

    step: float
    share: float
    l0: float
    gravity: float
    reading: int
    per_width: float
    has_friction: bool
    slender: Any
    two_ends: bool = False
    helical: bool = False


@njit(**INLINED)
def at_step(settings: StepSettings, k: int) -> StepSettings:
    """Return the settings of step k."""
    step, _, l0, gravity, reading, per_width, friction, slender, two_ends, helical = settings
    return StepSettings(
        step, 0.5 if k == 0 else 1.0, l0, gravity, reading, per_width, friction, slender, two_ends, helical
    )
