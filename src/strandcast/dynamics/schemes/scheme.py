"""Integration schemes and how kernels call them: each scheme is compiled into its own kernel."""

import hashlib
import inspect
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from numba import njit, types
from numba.core.datamodel import register_default
from numba.core.datamodel.models import OpaqueModel
from numba.extending import NativeValue, overload, typeof_impl, unbox

from strandcast.dynamics.vectors import INLINED

ROWS = 12  # of work per point i = 0…n that a scheme may use


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
        2n + 2 rows: velocities of points 0…n and their last change; point 0 is the hand. A scheme whose
        velocities belong to the end of the step leaves `dv` at zero.
    stick
        2n rows: bend at the last step [rad] and share of its full moment of friction at joints 0…n-1, by
        turns; None if no friction sticks: kernels are compiled for either. In space see
        `strandcast.dynamics.spatial.joints.sticking_friction_in_space`.
    """

    d: Any
    v: Any
    dv: Any
    stick: Any = None


class StepSettings(NamedTuple):
    """Values common to all strings at one step.

    Attributes
    ----------
    step, share
        Step [s]; 1/2 at the first step and 1 at all others, for schemes whose velocities are half a step off.
    l0, gravity
        Rest spacing [m], gravity [m/s^2].
    reading, per_width
        The model's reading and 1 / half-width of its switch.
    has_friction
        Whether there is dry friction.
    slender
        True if drag differs along and across the string, else None: kernels are compiled for either.
    """

    step: float
    share: float
    l0: float
    gravity: float
    reading: int
    per_width: float
    has_friction: bool
    slender: Any


@njit(**INLINED)
def at_step(settings: StepSettings, k: int) -> StepSettings:
    """Return the settings of step k."""
    step, _, l0, gravity, reading, per_width, friction, slender = settings
    return StepSettings(step, 0.5 if k == 0 else 1.0, l0, gravity, reading, per_width, friction, slender)


@dataclass(frozen=True, eq=False)
class Scheme:
    """An integration scheme.

    Attributes
    ----------
    name
        As `StringModel.integrator` and ``estimate.integrator`` give it.
    step
        Numba function that advances all candidates of one vector by one step; arguments and result as for
        `advance`, without the first.
    repeats_diverged
        Whether strings that are too stiff for the step, and that diverge, are simulated again with smaller
        steps.
    """

    name: str
    step: Callable[..., Any]
    repeats_diverged: bool = False

    @cached_property
    def version(self) -> str:
        """Hash of the file that defines `step`: a kernel cached on disk is compiled again if it changes."""
        function = getattr(self.step, "py_func", self.step)
        file = inspect.getsourcefile(function)
        if inspect.getmodule(function) is None or not file or not Path(file).is_file():
            # numba's cached machine code imports the module of `step` by name: no other process can.
            return uuid.uuid4().hex[:16]
        return hashlib.sha256(Path(file).read_bytes()).hexdigest()[:16]


class SchemeType(types.Opaque):
    """Numba's type of a `Scheme`: kernels are compiled for each."""

    def __init__(self, name: str, version: str) -> None:
        self.key_of_step = (name, version)
        super().__init__(name=f"Scheme({name}, {version})")


_steps: dict[tuple[str, str], Callable[..., Any]] = {}  # by `SchemeType.key_of_step`


@register_default(SchemeType)
class _SchemeModel(OpaqueModel):
    pass


@typeof_impl.register(Scheme)
def _typeof_scheme(scheme: Scheme, context: Any) -> SchemeType:
    typ = SchemeType(scheme.name, scheme.version)
    _steps[typ.key_of_step] = scheme.step
    return typ


@unbox(SchemeType)
def _unbox_scheme(typ: SchemeType, obj: Any, context: Any) -> NativeValue:
    return NativeValue(context.context.get_dummy_value())


def advance(
    scheme: Any,
    spec: Any,
    string: StringArrays,
    motion: StringMotion,
    hand: Any,
    work: Any,
    settings: StepSettings,
) -> tuple[Any, Any]:
    """Advance velocities and segments by one step, with a scheme that is known at compile time.

    Parameters
    ----------
    scheme
        The `Scheme`.
    spec
        `VectorSpec` of the values. All arrays are (rows, width).
    string, motion, settings
        See there; `motion` is changed.
    hand
        The hand at this step: the first eight values of `strandcast.dynamics.hand.drive`.
    work
        `ROWS` (n + 1) rows that the scheme may use.

    Returns
    -------
    Lengths of the longest and the shortest segment before the step [m].
    """
    # numba replaces this body by the chosen scheme's (`_advance`); the interpreter never runs a step.
    raise TypeError("an integration step runs in a compiled kernel only")


@overload(advance, jit_options=INLINED)
def _advance(scheme, *given):  # type: ignore[no-untyped-def]
    chosen = _steps[scheme.key_of_step]

    def call(scheme, *given):  # type: ignore[no-untyped-def]
        return chosen(*given)

    return call
