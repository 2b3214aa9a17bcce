"""Banded solve of a step: elimination from hand to tip, then back substitution.

Blocks of two by two couple points up to two apart; see `strandcast.dynamics.step`.
"""

from typing import Any

from numba import njit

from strandcast.dynamics.hand import DVX, DVY, VX, VY
from strandcast.dynamics.simd import INLINED, inverse, load, splat, store
from strandcast.dynamics.string_state import ROWS, StringMotion

# Rows of work per point i = 0…n, of `ROWS`. The elimination writes its results over what it has used.
XX, YY, XY, R, E, W, Q = 0, 1, 2, 3, 5, 9, 10  # own block, right side, block to i + 1, bend at i
UX, UY, PER_LENGTH, AXIAL, ACROSS, MOMENT, TURNING, PULL, BEND = range(9)  # before that, the elements
T, Z, H = XX, R, E


@njit(**INLINED)
def leave(
    spec: Any,
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
    store(spec, work, r + XX, xx)
    store(spec, work, r + YY, yy)
    store(spec, work, r + XY, xy)
    store(spec, work, r + R, rx)
    store(spec, work, r + R + 1, ry)
    store(spec, work, r + E, e0)
    store(spec, work, r + E + 1, e1)
    store(spec, work, r + E + 2, e2)
    store(spec, work, r + E + 3, e3)


@njit(**INLINED)
def eliminate(spec: Any, n: int, work: Any, hand_x: Any, hand_y: Any) -> tuple[Any, Any]:
    """Return the change of the tip's velocity; write the equations of all other points into `work`.

    dv_i = Z - H^T dv_(i+1) - T (q_(i+1) . dv_(i+2)). The hand's own change is known.
    """
    px, py = load(spec, work, Q), load(spec, work, Q + 1)
    r = ROWS
    xx, yy, xy = load(spec, work, r + XX), load(spec, work, r + YY), load(spec, work, r + XY)
    rx = load(spec, work, r + R) - (load(spec, work, E) * hand_x + load(spec, work, E + 1) * hand_y)
    ry = load(spec, work, r + R + 1) - (load(spec, work, E + 2) * hand_x + load(spec, work, E + 3) * hand_y)
    left = load(spec, work, r + W)
    known = left * (px * hand_x + py * hand_y)
    yx, yy_ = splat(spec, 0.0), splat(spec, 0.0)
    for i in range(1, n):
        r = ROWS * i
        qx, qy = load(spec, work, r + Q), load(spec, work, r + Q + 1)
        # 1 / determinant has a long latency: compute everything else meanwhile.
        per_area = inverse(spec, xx * yy - xy * xy)
        e0, e1 = load(spec, work, r + E) - qx * yx, load(spec, work, r + E + 1) - qx * yy_
        e2, e3 = load(spec, work, r + E + 2) - qy * yx, load(spec, work, r + E + 3) - qy * yy_
        h0, h1, h2, h3 = yy * e0 - xy * e1, xx * e1 - xy * e0, yy * e2 - xy * e3, xx * e3 - xy * e2
        weight = load(spec, work, r + ROWS + W)
        wx, wy = weight * qx, weight * qy
        zx, zy = yy * rx - xy * ry, xx * ry - xy * rx
        tx, ty = yy * wx - xy * wy, xx * wy - xy * wx
        r += ROWS
        bx, by = left * qx, left * qy
        hr0, hr1 = h0 * rx + h1 * ry, h2 * rx + h3 * ry
        left = weight - per_area * (wx * tx + wy * ty)
        xx = (load(spec, work, r + XX) + bx * qx) - per_area * (h0 * e0 + h1 * e1)
        yy = (load(spec, work, r + YY) + by * qy) - per_area * (h2 * e2 + h3 * e3)
        xy = (load(spec, work, r + XY) + bx * qy) - per_area * (h0 * e2 + h1 * e3)
        rx = (load(spec, work, r + R) - known * qx) - per_area * hr0
        ry = (load(spec, work, r + R + 1) - known * qy) - per_area * hr1
        known = per_area * (wx * zx + wy * zy)
        yx, yy_ = per_area * (e0 * tx + e1 * ty), per_area * (e2 * tx + e3 * ty)
        r -= ROWS
        store(spec, work, r + Z, per_area * zx)
        store(spec, work, r + Z + 1, per_area * zy)
        store(spec, work, r + H, per_area * h0)
        store(spec, work, r + H + 1, per_area * h1)
        store(spec, work, r + H + 2, per_area * h2)
        store(spec, work, r + H + 3, per_area * h3)
        store(spec, work, r + T, per_area * tx)
        store(spec, work, r + T + 1, per_area * ty)
    per_area = inverse(spec, xx * yy - xy * xy)
    return (yy * rx - xy * ry) * per_area, (xx * ry - xy * rx) * per_area


@njit(**INLINED)
def back(
    spec: Any, n: int, work: Any, hand: Any, step: float, ax: Any, ay: Any, motion: StringMotion
) -> None:
    """From the tip's change (ax, ay) back to the hand: kick the velocities, drift the segments."""
    d, v, dv, _ = motion
    fx, fy = splat(spec, 0.0), splat(spec, 0.0)
    vx, vy = load(spec, v, 2 * n) + ax, load(spec, v, 2 * n + 1) + ay
    store(spec, v, 2 * n, vx)
    store(spec, v, 2 * n + 1, vy)
    store(spec, dv, 2 * n, ax)
    store(spec, dv, 2 * n + 1, ay)
    for i in range(n - 1, 0, -1):
        r = ROWS * i
        bend = load(spec, work, r + ROWS + Q) * fx + load(spec, work, r + ROWS + Q + 1) * fy
        fx, fy = ax, ay
        ax = load(spec, work, r + Z) - (
            load(spec, work, r + H) * fx + load(spec, work, r + H + 2) * fy + load(spec, work, r + T) * bend
        )
        ay = load(spec, work, r + Z + 1) - (
            load(spec, work, r + H + 1) * fx
            + load(spec, work, r + H + 3) * fy
            + load(spec, work, r + T + 1) * bend
        )
        wx, wy = load(spec, v, 2 * i) + ax, load(spec, v, 2 * i + 1) + ay
        store(spec, v, 2 * i, wx)
        store(spec, v, 2 * i + 1, wy)
        store(spec, dv, 2 * i, ax)
        store(spec, dv, 2 * i + 1, ay)
        store(spec, d, 2 * i, load(spec, d, 2 * i) + step * (vx - wx))
        store(spec, d, 2 * i + 1, load(spec, d, 2 * i + 1) + step * (vy - wy))
        vx, vy = wx, wy
    store(spec, dv, 0, hand[DVX])
    store(spec, dv, 1, hand[DVY])
    store(spec, d, 0, load(spec, d, 0) + step * (vx - (hand[VX] + hand[DVX])))
    store(spec, d, 1, load(spec, d, 1) + step * (vy - (hand[VY] + hand[DVY])))
