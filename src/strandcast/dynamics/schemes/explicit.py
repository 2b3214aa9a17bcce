"""The explicit schemes: Euler, as the paper prints it, and semi-implicit (symplectic) Euler.

Euler needs steps of microseconds in a corner of Table 2, so it is kept as a reference.
"""

from typing import Any

from numba import njit

from strandcast.dynamics.elements import (
    C_PH,
    C_S,
    CLAMP_OFFSET,
    K_PH,
    K_S,
    REST_BEND,
    direction,
    drag,
    dry_friction,
    joint,
    segment,
    slender_drag,
    sticking_friction,
    turn,
)
from strandcast.dynamics.hand import COS, DRATE, DVX, DVY, RATE, SIN, VX, VY
from strandcast.dynamics.schemes.scheme import Scheme, StepSettings, StringArrays, StringMotion
from strandcast.dynamics.simd import INLINED, load, maximum, minimum, splat, store


@njit(**INLINED)
def _add(spec: Any, force: Any, i: int, x: Any, y: Any) -> None:
    store(spec, force, 2 * i, load(spec, force, 2 * i) + x)
    store(spec, force, 2 * i + 1, load(spec, force, 2 * i + 1) + y)


@njit(**INLINED)
def _step(
    euler: bool,
    stick: Any,
    spec: Any,
    string: StringArrays,
    motion: StringMotion,
    hand: Any,
    force: Any,
    settings: StepSettings,
) -> tuple[Any, Any]:
    """Advance velocities and segments by one step; `force` is 2n + 2 rows of work.

    `euler`: points move with the old velocities, else with the new ones; `stick`: that of `motion`.
    """
    n, c, mass, factor = string
    d, v, _, _ = motion
    step, share, l0, gravity, reading, per_width, has_friction, slender = settings
    zero = splat(spec, 0.0)
    store(spec, force, 0, zero)
    store(spec, force, 1, zero)
    for i in range(1, n + 1):
        vx, vy = load(spec, v, 2 * i), load(spec, v, 2 * i + 1)
        if slender is None:
            per_speed, _ = drag(c, spec, vx * vx + vy * vy)
            fx, fy = -per_speed * vx, -per_speed * vy
        else:
            tx, ty = direction(spec, d, n, i)
            fx, fy, _, _, _ = slender_drag(c, spec, tx, ty, vx, vy)
        store(spec, force, 2 * i, fx)
        store(spec, force, 2 * i + 1, fy - gravity * load(spec, mass, i - 1))
    k_s, c_s = load(spec, c, K_S), load(spec, c, C_S)
    # The hand's velocity now lies between those of the half steps around.
    vx, vy = hand[VX] + 0.5 * hand[DVX], hand[VY] + 0.5 * hand[DVY]
    ux, uy, rate = hand[COS], hand[SIN], hand[RATE] + 0.5 * hand[DRATE]
    qx, qy, pull, longest, shortest = zero, zero, zero, zero, splat(spec, 1e9)
    for j in range(n):
        px, py, before_x, before_y, before, before_pull = qx, qy, ux, uy, rate, pull
        wx, wy = -vx, -vy
        vx, vy = load(spec, v, 2 * j + 2), load(spec, v, 2 * j + 3)
        wx, wy = vx + wx, vy + wy
        ux, uy, length, inverse = segment(spec, load(spec, d, 2 * j), load(spec, d, 2 * j + 1))
        longest, shortest = maximum(length, longest), minimum(length, shortest)
        pull = k_s * (length - l0)
        axial = pull + c_s * (wx * ux + wy * uy)
        rate = (ux * wy - uy * wx) * inverse
        qx, qy = -uy * inverse, ux * inverse
        own, bend, change = load(spec, factor, j), turn(spec, before_x, before_y, ux, uy), rate - before
        if j == 0:
            bend -= load(spec, c, CLAMP_OFFSET)
            k, damping = own * load(spec, c, K_PH), own * load(spec, c, C_PH)
        else:
            bend -= load(spec, c, REST_BEND)
            weight = gravity * load(spec, mass, j - 1)
            mean = 0.5 * (before_pull + pull)
            k, damping, _ = joint(spec, c, reading, per_width, weight, own, bend, change, mean)
        if has_friction:
            damping += dry_friction(spec, c, own, change)
        moment = k * bend + damping * change
        if stick is not None:
            moment += sticking_friction(spec, c, own, j, bend, share, stick)[0]
        ax, ay = axial * ux + moment * qx, axial * uy + moment * qy
        _add(spec, force, j + 1, -ax, -ay)
        _add(spec, force, j, ax + moment * px, ay + moment * py)
        if j > 0:
            _add(spec, force, j - 1, -moment * px, -moment * py)
    _advance(spec, n, mass, hand, d, v, force, step, euler)
    return longest, shortest


@njit(**INLINED)
def _advance(
    spec: Any, n: int, mass: Any, hand: Any, d: Any, v: Any, force: Any, step: float, euler: bool
) -> None:
    """Change velocities by the forces; Euler moves the points with the old ones."""
    before_x, before_y = hand[VX] + hand[DVX], hand[VY] + hand[DVY]
    for i in range(1, n + 1):
        per_mass = step / load(spec, mass, i - 1)
        vx, vy = load(spec, v, 2 * i), load(spec, v, 2 * i + 1)
        new_x = vx + per_mass * load(spec, force, 2 * i)
        new_y = vy + per_mass * load(spec, force, 2 * i + 1)
        store(spec, v, 2 * i, new_x)
        store(spec, v, 2 * i + 1, new_y)
        if not euler:
            vx, vy = new_x, new_y
        store(spec, d, 2 * i - 2, load(spec, d, 2 * i - 2) + step * (vx - before_x))
        store(spec, d, 2 * i - 1, load(spec, d, 2 * i - 1) + step * (vy - before_y))
        before_x, before_y = vx, vy


@njit(**INLINED)
def step_euler(*given: Any) -> tuple[Any, Any]:
    """Advance by one step; see `strandcast.dynamics.schemes.scheme.advance`."""
    return _step(True, given[2].stick, *given)


@njit(**INLINED)
def step_semi_implicit(*given: Any) -> tuple[Any, Any]:
    """Advance by one step; see `strandcast.dynamics.schemes.scheme.advance`."""
    return _step(False, given[2].stick, *given)


EULER = Scheme("euler", step_euler)
SEMI_IMPLICIT = Scheme("semi_implicit", step_semi_implicit)
