"""The default scheme: leapfrog with Crank-Nicolson dampers and averaged stiffness, one banded solve per step.

One kick of the velocities over a step h solves (M + h/2 C + h^2 B) dv = h f(x_n, v_{n-1/2}), where C holds
the dampers and B = beta K the stiffness averaged over three time levels. beta = 1/12 cancels the leading
dispersion error; an element too stiff for that gets what stability asks for, up to 1/4 (`averaged`).

The matrix is symmetric and couples points up to two apart: a segment its ends, a bend three in a row. A step
is three loops over the points, each with little to wait for: assemble from hand to tip; eliminate from hand
to tip (L D L^T in blocks of two by two; the block between points i and i + 2, a bend's, has rank one, so that
its share of the elimination only changes a weight and a vector); and back, kicking and drifting on the way.
"""

from __future__ import annotations

from typing import Any

from numba import njit

from strandcast.string.elements import (
    C_PH,
    C_S,
    CLAMP_OFFSET,
    FLOOR,
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
from strandcast.string.lanes import INLINED, inverse, load, maximum, minimum, splat, store

STABLE = 0.9  # of the largest step that averaging allows
# Rows of work per point i = 0…n. The elimination writes its results over what it has used.
XX, YY, XY, R, E, W, Q = 0, 1, 2, 3, 5, 9, 10  # own block, right side, block to i + 1, bend at i
UX, UY, PER_LENGTH, AXIAL, ACROSS, MOMENT, TURNING, PULL, BEND = range(9)  # what is there before
T, Z, H = XX, R, E
ROWS = 12
_STIFF_DAMPING = 0.03  # more costs accuracy (0.5: seven times the error of a plausible cord at 1 ms)
_FINE = 1.0 / 12.0


@njit(**INLINED)
def stretch_damping(k_s: float, h: float, lightest: float) -> float:
    """Stretch damping to add [N s/m/kg] where the step cannot follow the stretch waves.

    Averaging alone leaves such waves undamped, and every turn of a segment feeds them. The damper acts on the
    stretch, which is micrometres there, and goes with the step; a string that is torn all the same is taken
    again with smaller steps (`strandcast.string.simulate`).
    """
    return _STIFF_DAMPING * h * max(k_s - STABLE * lightest / (4.0 * (0.25 - _FINE) * h * h), 0.0)


@njit(**INLINED)
def averaged(stiffness: Any, h2: float, floor: Any) -> Any:
    """h^2 beta k: beta is 1/12, or as much as keeps h^2 (1/4 - beta) k below `floor`."""
    return maximum(stiffness * (h2 / 12.0), stiffness * (h2 / 4.0) - floor)


@njit(**INLINED)
def _point(
    kind: Any, c: Any, h: float, gravity: float, mass: Any, vx: Any, vy: Any
) -> tuple[Any, Any, Any, Any, Any]:
    """Block of one point's own inertia and drag (xx, yy, xy), and its impulse by drag and weight."""
    per_speed, slope = drag(c, kind, vx, vy)
    along = (0.5 * h) * slope
    plain = mass + (0.5 * h) * per_speed
    ax, ay = along * vx, along * vy
    down = per_speed * vy + gravity * mass
    return plain + ax * vx, plain + ay * vy, ax * vy, -h * (per_speed * vx), -h * down


@njit(**INLINED)
def _segment_block(along: Any, across: Any, ux: Any, uy: Any) -> tuple[Any, Any, Any]:
    """Block of a segment: `along` its direction u, `across` at right angles to it."""
    more = along - across
    mx, my = more * ux, more * uy
    return across + mx * ux, across + my * uy, mx * uy


@njit(**INLINED)
def kick_and_drift(
    kind: Any,
    n: int,
    c: Any,
    mass: Any,
    factor: Any,
    hand: Any,
    d: Any,
    v: Any,
    dv: Any,
    work: Any,
    step: float,
    share: float,
    l0: float,
    gravity: float,
    reading: int,
    per_width: float,
    rubs: bool,
) -> tuple[Any, Any]:
    """Advance velocities by `share` of a step and segments by a whole one.

    Parameters
    ----------
    kind, n
        Kind of the values, number of free points. All arrays below are (rows, width).
    c, mass, factor
        Coefficients, masses of points 1…n, multipliers of bending at joints 0…n-1.
    hand
        The hand at this step: the first eight columns of `strandcast.string.hand.driving`, as values.
    d
        2n rows: the segments, x and y by turns. Segments, not points: differences of points would cost f32
        the digits that a stiff spring needs.
    v, dv
        2n + 2 rows: velocities of points 0…n and their last change; point 0 is the hand.
    work
        `ROWS` (n + 1) rows.
    step, share
        Step [s], 1/2 for the first kick and 1 for all others.
    l0, gravity, reading, per_width, rubs
        Rest spacing [m], gravity [m/s^2], reading and 1 / width of the switch, whether there is friction.

    Returns
    -------
    Lengths of the longest and the shortest segment before the step [m].
    """
    h = share * step
    extent = _segments(kind, n, c, hand, d, v, work, h, l0)
    _bends(kind, n, c, hand, work)
    _joints(kind, n, c, mass, factor, hand, work, h, l0, gravity, reading, per_width, rubs)
    _assemble(kind, n, c, mass, v, work, h, gravity)
    tip_x, tip_y = _eliminate(kind, n, work, hand[DVX], hand[DVY])
    _back(kind, n, work, hand, step, tip_x, tip_y, d, v, dv)
    return extent


@njit(**INLINED)
def _segments(
    kind: Any, n: int, c: Any, hand: Any, d: Any, v: Any, work: Any, h: float, l0: float
) -> tuple[Any, Any]:
    """Write what every segment does into its rows of `work`; lengths of the longest and the shortest."""
    k_s, c_s, floor = load(kind, c, K_S), load(kind, c, C_S), 0.25 * load(kind, c, FLOOR)
    vx, vy = hand[VX], hand[VY]
    longest, shortest = splat(kind, 0.0), splat(kind, 1e9)
    for j in range(n):
        wx, wy = -vx, -vy
        vx, vy = load(kind, v, 2 * j + 2), load(kind, v, 2 * j + 3)
        wx, wy = vx + wx, vy + wy
        ux, uy, length, per_length = segment(kind, load(kind, d, 2 * j), load(kind, d, 2 * j + 1))
        longest, shortest = maximum(length, longest), minimum(length, shortest)
        pull = k_s * (length - l0)
        r = ROWS * j
        store(kind, work, r + UX, ux)
        store(kind, work, r + UY, uy)
        store(kind, work, r + PER_LENGTH, per_length)
        store(kind, work, r + AXIAL, h * (pull + c_s * (wx * ux + wy * uy)))
        store(kind, work, r + ACROSS, averaged(maximum(pull, 0.0) * per_length, h * h, floor))
        store(kind, work, r + TURNING, (ux * wy - uy * wx) * per_length)
        store(kind, work, r + PULL, pull)
    return longest, shortest


@njit(**INLINED)
def _bends(kind: Any, n: int, c: Any, hand: Any, work: Any) -> None:
    """Write the bend from rest of every joint into its row of `work`; joint 0 is the clamp."""
    rest = load(kind, c, REST_BEND)
    ux, uy = load(kind, work, UX), load(kind, work, UY)
    store(kind, work, BEND, turn(kind, hand[COS], hand[SIN], ux, uy) - load(kind, c, CLAMP_OFFSET))
    for j in range(1, n):
        before_x, before_y = ux, uy
        ux, uy = load(kind, work, ROWS * j + UX), load(kind, work, ROWS * j + UY)
        store(kind, work, ROWS * j + BEND, turn(kind, before_x, before_y, ux, uy) - rest)


@njit(**INLINED)
def _joints(
    kind: Any,
    n: int,
    c: Any,
    mass: Any,
    factor: Any,
    hand: Any,
    work: Any,
    h: float,
    l0: float,
    gravity: float,
    reading: int,
    per_width: float,
    rubs: bool,
) -> None:
    """Write impulse and weight of every joint's moment into its rows of `work`."""
    h2, half = h * h, 0.5 * h
    floor = (l0 * l0 / 16.0) * load(kind, c, FLOOR)
    own = load(kind, factor, 0)
    k, damping = own * load(kind, c, K_PH), own * load(kind, c, C_PH)
    rate, pull = load(kind, work, TURNING), load(kind, work, PULL)
    if rubs:
        damping += rubbing(kind, c, own, rate - hand[RATE])
    weight = averaged(k, h2, 4.0 * floor) + half * damping
    moment = h * (k * load(kind, work, BEND) + damping * (rate - hand[RATE])) - weight * hand[DRATE]
    store(kind, work, MOMENT, moment)
    store(kind, work, W, weight)
    for j in range(1, n):
        r = ROWS * j
        before, before_pull = rate, pull
        rate, pull = load(kind, work, r + TURNING), load(kind, work, r + PULL)
        bend, change = load(kind, work, r + BEND), rate - before
        point, mean = load(kind, mass, j - 1) * gravity, 0.5 * (before_pull + pull)
        own = load(kind, factor, j)
        k, damping, slope = joint(kind, c, reading, per_width, point, own, bend, change, mean)
        if rubs:
            more = rubbing(kind, c, own, change)
            damping, slope = damping + more, slope + more
        store(kind, work, r + MOMENT, h * (k * bend + damping * change))
        # A switch may add energy faster than a step can follow; the matrix stays positive.
        store(kind, work, r + W, averaged(k, h2, floor) + maximum(half * slope, -0.5 * floor))


@njit(**INLINED)
def _assemble(kind: Any, n: int, c: Any, mass: Any, v: Any, work: Any, h: float, gravity: float) -> None:
    """Blocks and right sides of all points, over the elements in `work`; without each bend's last end."""
    zero = splat(kind, 0.0)
    floor_segment = 0.25 * load(kind, c, FLOOR)
    along = averaged(load(kind, c, K_S), h * h, floor_segment) + (0.5 * h) * load(kind, c, C_S)
    # Point i = j - 1 waits for its last joint, j for its segment; the hand's own block is never read.
    px, py, ixx, iyy, ixy, irx, iry = zero, zero, zero, zero, zero, zero, zero
    e0, e1, e2, e3 = zero, zero, zero, zero
    xx, yy, xy, rx, ry = zero, zero, zero, zero, zero
    for j in range(n):
        r = ROWS * j
        ux, uy, per_length = (
            load(kind, work, r + UX),
            load(kind, work, r + UY),
            load(kind, work, r + PER_LENGTH),
        )
        axial, across = load(kind, work, r + AXIAL), load(kind, work, r + ACROSS)
        moment, weight = load(kind, work, r + MOMENT), load(kind, work, r + W)
        qx, qy = -uy * per_length, ux * per_length
        more = along - across
        mx, my = more * ux, more * uy
        sxx, syy, sxy = across + mx * ux, across + my * uy, mx * uy
        ax, ay = axial * ux, axial * uy
        # Gradient of the bend: p on point i, g on j, q on j + 1.
        gx, gy = -px - qx, -py - qy
        bpx, bpy, bgx, bgy = weight * px, weight * py, weight * gx, weight * gy
        if j > 0:
            r -= ROWS
            store(kind, work, r + XX, ixx + bpx * px)
            store(kind, work, r + YY, iyy + bpy * py)
            store(kind, work, r + XY, ixy + bpx * py)
            store(kind, work, r + R, irx - moment * px)
            store(kind, work, r + R + 1, iry - moment * py)
            store(kind, work, r + E, e0 + bgx * px)
            store(kind, work, r + E + 1, e1 + bgx * py)
            store(kind, work, r + E + 2, e2 + bgy * px)
            store(kind, work, r + E + 3, e3 + bgy * py)
            r += ROWS
        store(kind, work, r + Q, qx)
        store(kind, work, r + Q + 1, qy)
        ixx, iyy, ixy = xx + sxx + bgx * gx, yy + syy + bgy * gy, xy + sxy + bgx * gy
        irx, iry = rx + ax - moment * gx, ry + ay - moment * gy
        e0, e1, e2, e3 = qx * bgx - sxx, qx * bgy - sxy, qy * bgx - sxy, qy * bgy - syy
        xx, yy, xy, rx, ry = _point(
            kind, c, h, gravity, load(kind, mass, j), load(kind, v, 2 * j + 2), load(kind, v, 2 * j + 3)
        )
        if j == 0:
            # The clamp's bend has no joint behind it to be eliminated with: all of it is here.
            bx, by = weight * qx, weight * qy
            xx, yy, xy = xx + bx * qx, yy + by * qy, xy + bx * qy
        xx, yy, xy = xx + sxx, yy + syy, xy + sxy
        rx -= ax + moment * qx
        ry -= ay + moment * qy
        px, py = qx, qy
    _leave(kind, work, n - 1, ixx, iyy, ixy, irx, iry, e0, e1, e2, e3)
    _leave(kind, work, n, xx, yy, xy, rx, ry, e0, e1, e2, e3)
    store(kind, work, ROWS * n + W, zero)
    store(kind, work, ROWS * n + Q, zero)
    store(kind, work, ROWS * n + Q + 1, zero)


@njit(**INLINED)
def _leave(
    kind: Any,
    work: Any,
    i: int,
    xx: Any,
    yy: Any,
    xy: Any,
    rx: Any,
    ry: Any,
    e0: Any,
    e1: Any,
    e2: Any,
    e3: Any,
) -> None:
    """Store block, right side and coupling of point i."""
    r = ROWS * i
    store(kind, work, r + XX, xx)
    store(kind, work, r + YY, yy)
    store(kind, work, r + XY, xy)
    store(kind, work, r + R, rx)
    store(kind, work, r + R + 1, ry)
    store(kind, work, r + E, e0)
    store(kind, work, r + E + 1, e1)
    store(kind, work, r + E + 2, e2)
    store(kind, work, r + E + 3, e3)


@njit(**INLINED)
def _eliminate(kind: Any, n: int, work: Any, hand_x: Any, hand_y: Any) -> tuple[Any, Any]:
    """Change of the tip's velocity; of every other point i, into `work`, how it follows from those behind.

    dv_i = Z - H^T dv_(i+1) - T (q_(i+1) . dv_(i+2)). The hand's own change is known.
    """
    px, py = load(kind, work, Q), load(kind, work, Q + 1)
    r = ROWS
    xx, yy, xy = load(kind, work, r + XX), load(kind, work, r + YY), load(kind, work, r + XY)
    rx = load(kind, work, r + R) - (load(kind, work, E) * hand_x + load(kind, work, E + 1) * hand_y)
    ry = load(kind, work, r + R + 1) - (load(kind, work, E + 2) * hand_x + load(kind, work, E + 3) * hand_y)
    left = load(kind, work, r + W)
    known = left * (px * hand_x + py * hand_y)
    yx, yy_ = splat(kind, 0.0), splat(kind, 0.0)
    for i in range(1, n):
        r = ROWS * i
        qx, qy = load(kind, work, r + Q), load(kind, work, r + Q + 1)
        # 1 / determinant is long in coming: all that does not need it is done without.
        per_area = inverse(kind, xx * yy - xy * xy)
        e0, e1 = load(kind, work, r + E) - qx * yx, load(kind, work, r + E + 1) - qx * yy_
        e2, e3 = load(kind, work, r + E + 2) - qy * yx, load(kind, work, r + E + 3) - qy * yy_
        h0, h1, h2, h3 = yy * e0 - xy * e1, xx * e1 - xy * e0, yy * e2 - xy * e3, xx * e3 - xy * e2
        weight = load(kind, work, r + ROWS + W)
        wx, wy = weight * qx, weight * qy
        zx, zy = yy * rx - xy * ry, xx * ry - xy * rx
        tx, ty = yy * wx - xy * wy, xx * wy - xy * wx
        r += ROWS
        bx, by = left * qx, left * qy
        hr0, hr1 = h0 * rx + h1 * ry, h2 * rx + h3 * ry
        left = weight - per_area * (wx * tx + wy * ty)
        xx = (load(kind, work, r + XX) + bx * qx) - per_area * (h0 * e0 + h1 * e1)
        yy = (load(kind, work, r + YY) + by * qy) - per_area * (h2 * e2 + h3 * e3)
        xy = (load(kind, work, r + XY) + bx * qy) - per_area * (h0 * e2 + h1 * e3)
        rx = (load(kind, work, r + R) - known * qx) - per_area * hr0
        ry = (load(kind, work, r + R + 1) - known * qy) - per_area * hr1
        known = per_area * (wx * zx + wy * zy)
        yx, yy_ = per_area * (e0 * tx + e1 * ty), per_area * (e2 * tx + e3 * ty)
        r -= ROWS
        store(kind, work, r + Z, per_area * zx)
        store(kind, work, r + Z + 1, per_area * zy)
        store(kind, work, r + H, per_area * h0)
        store(kind, work, r + H + 1, per_area * h1)
        store(kind, work, r + H + 2, per_area * h2)
        store(kind, work, r + H + 3, per_area * h3)
        store(kind, work, r + T, per_area * tx)
        store(kind, work, r + T + 1, per_area * ty)
    per_area = inverse(kind, xx * yy - xy * xy)
    return (yy * rx - xy * ry) * per_area, (xx * ry - xy * rx) * per_area


@njit(**INLINED)
def _back(
    kind: Any, n: int, work: Any, hand: Any, step: float, ax: Any, ay: Any, d: Any, v: Any, dv: Any
) -> None:
    """From the tip's change (ax, ay) back to the hand: kick the velocities, drift the segments."""
    fx, fy = splat(kind, 0.0), splat(kind, 0.0)
    vx, vy = load(kind, v, 2 * n) + ax, load(kind, v, 2 * n + 1) + ay
    store(kind, v, 2 * n, vx)
    store(kind, v, 2 * n + 1, vy)
    store(kind, dv, 2 * n, ax)
    store(kind, dv, 2 * n + 1, ay)
    for i in range(n - 1, 0, -1):
        r = ROWS * i
        bend = load(kind, work, r + ROWS + Q) * fx + load(kind, work, r + ROWS + Q + 1) * fy
        fx, fy = ax, ay
        ax = load(kind, work, r + Z) - (
            load(kind, work, r + H) * fx + load(kind, work, r + H + 2) * fy + load(kind, work, r + T) * bend
        )
        ay = load(kind, work, r + Z + 1) - (
            load(kind, work, r + H + 1) * fx
            + load(kind, work, r + H + 3) * fy
            + load(kind, work, r + T + 1) * bend
        )
        wx, wy = load(kind, v, 2 * i) + ax, load(kind, v, 2 * i + 1) + ay
        store(kind, v, 2 * i, wx)
        store(kind, v, 2 * i + 1, wy)
        store(kind, dv, 2 * i, ax)
        store(kind, dv, 2 * i + 1, ay)
        store(kind, d, 2 * i, load(kind, d, 2 * i) + step * (vx - wx))
        store(kind, d, 2 * i + 1, load(kind, d, 2 * i + 1) + step * (vy - wy))
        vx, vy = wx, wy
    store(kind, dv, 0, hand[DVX])
    store(kind, dv, 1, hand[DVY])
    store(kind, d, 0, load(kind, d, 0) + step * (vx - (hand[VX] + hand[DVX])))
    store(kind, d, 1, load(kind, d, 1) + step * (vy - (hand[VY] + hand[DVY])))
