"""The explicit schemes: the paper's Euler, and the semi-implicit that moves points with new velocities."""

from __future__ import annotations

from typing import Any

from numba import njit

from strandcast.string.elements import (
    C_PH,
    C_S,
    CLAMP_OFFSET,
    K_PH,
    K_S,
    REST_BEND,
    drag,
    joint,
    rubbing,
    segment,
    turn,
)
from strandcast.string.hand import COS, DRATE, DVX, DVY, RATE, SIN, VX, VY
from strandcast.string.lanes import INLINED, load, maximum, minimum, splat, store


@njit(**INLINED)
def _add(kind: Any, force: Any, i: int, x: Any, y: Any) -> None:
    store(kind, force, 2 * i, load(kind, force, 2 * i) + x)
    store(kind, force, 2 * i + 1, load(kind, force, 2 * i + 1) + y)


@njit(**INLINED)
def explicit_step(
    kind: Any,
    n: int,
    c: Any,
    mass: Any,
    factor: Any,
    hand: Any,
    d: Any,
    v: Any,
    force: Any,
    step: float,
    l0: float,
    gravity: float,
    reading: int,
    per_width: float,
    rubs: bool,
    euler: bool,
) -> tuple[Any, Any]:
    """Advance velocities and segments by one step.

    Arguments and result as for `strandcast.string.implicit.kick_and_drift`; `force` is 2n + 2 rows of work.
    """
    zero = splat(kind, 0.0)
    store(kind, force, 0, zero)
    store(kind, force, 1, zero)
    for i in range(1, n + 1):
        vx, vy = load(kind, v, 2 * i), load(kind, v, 2 * i + 1)
        per_speed, _ = drag(c, kind, vx, vy)
        store(kind, force, 2 * i, -per_speed * vx)
        store(kind, force, 2 * i + 1, -per_speed * vy - gravity * load(kind, mass, i - 1))
    k_s, c_s = load(kind, c, K_S), load(kind, c, C_S)
    # The hand's velocity now lies between those of the half steps around.
    vx, vy = hand[VX] + 0.5 * hand[DVX], hand[VY] + 0.5 * hand[DVY]
    ux, uy, rate = hand[COS], hand[SIN], hand[RATE] + 0.5 * hand[DRATE]
    qx, qy, pull, longest, shortest = zero, zero, zero, zero, splat(kind, 1e9)
    for j in range(n):
        px, py, before_x, before_y, before, before_pull = qx, qy, ux, uy, rate, pull
        wx, wy = -vx, -vy
        vx, vy = load(kind, v, 2 * j + 2), load(kind, v, 2 * j + 3)
        wx, wy = vx + wx, vy + wy
        ux, uy, length, inverse = segment(kind, load(kind, d, 2 * j), load(kind, d, 2 * j + 1))
        longest, shortest = maximum(length, longest), minimum(length, shortest)
        pull = k_s * (length - l0)
        axial = pull + c_s * (wx * ux + wy * uy)
        rate = (ux * wy - uy * wx) * inverse
        qx, qy = -uy * inverse, ux * inverse
        own, bend, change = load(kind, factor, j), turn(kind, before_x, before_y, ux, uy), rate - before
        if j == 0:
            bend -= load(kind, c, CLAMP_OFFSET)
            k, damping = own * load(kind, c, K_PH), own * load(kind, c, C_PH)
        else:
            bend -= load(kind, c, REST_BEND)
            weight = gravity * load(kind, mass, j - 1)
            mean = 0.5 * (before_pull + pull)
            k, damping, _ = joint(kind, c, reading, per_width, weight, own, bend, change, mean)
        if rubs:
            damping += rubbing(kind, c, own, change)
        moment = k * bend + damping * change
        ax, ay = axial * ux + moment * qx, axial * uy + moment * qy
        _add(kind, force, j + 1, -ax, -ay)
        _add(kind, force, j, ax + moment * px, ay + moment * py)
        if j > 0:
            _add(kind, force, j - 1, -moment * px, -moment * py)
    _advance(kind, n, mass, hand, d, v, force, step, euler)
    return longest, shortest


@njit(**INLINED)
def _advance(
    kind: Any, n: int, mass: Any, hand: Any, d: Any, v: Any, force: Any, step: float, euler: bool
) -> None:
    """Change velocities by the forces; Euler moves the points with the old ones."""
    before_x, before_y = hand[VX] + hand[DVX], hand[VY] + hand[DVY]
    for i in range(1, n + 1):
        per_mass = step / load(kind, mass, i - 1)
        vx, vy = load(kind, v, 2 * i), load(kind, v, 2 * i + 1)
        new_x = vx + per_mass * load(kind, force, 2 * i)
        new_y = vy + per_mass * load(kind, force, 2 * i + 1)
        store(kind, v, 2 * i, new_x)
        store(kind, v, 2 * i + 1, new_y)
        if not euler:
            vx, vy = new_x, new_y
        store(kind, d, 2 * i - 2, load(kind, d, 2 * i - 2) + step * (vx - before_x))
        store(kind, d, 2 * i - 1, load(kind, d, 2 * i - 1) + step * (vy - before_y))
        before_x, before_y = vx, vy
