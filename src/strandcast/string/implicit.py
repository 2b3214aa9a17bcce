"""The linear system of the default scheme: symmetric, banded, solved by LDL^T.

One kick of the velocities over a step h solves (M + h/2 C + beta h^2 K) dv = h f(x_n, v_{n-1/2}): dampers by
Crank-Nicolson, stiffness averaged over three time levels. beta = 1/12 cancels the leading dispersion error
and is stable to h w < 2.45; an element stiffer than that takes 1/4, which has no bound.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from strandcast.string.forces import KERNEL, LENGTH, PULL, UX, UY
from strandcast.string.parameters import Array

BAND = 5
FINE, SAFE = 1.0 / 12.0, 0.25
_STIFF_DAMPING = 0.5
_STIFF = 1.4  # of the largest (h w)^2 / 4 that is left to beta = 1/12, which holds up to 1.5


@njit(**KERNEL)
def averaging(stiffness: float, h: float, lightest: float, largest: float) -> float:
    """Weight beta of an element of `stiffness` whose operator's largest eigenvalue is `largest`."""
    return SAFE if 0.25 * largest * stiffness * h * h > _STIFF * lightest else FINE


@njit(**KERNEL)
def damped_if_stiff(p: Array, h: float, lightest: float) -> Array:
    """Parameters (10,) with more stretch damping where the step cannot follow the stretch waves.

    Averaging alone leaves such waves undamped, and every turn of a segment feeds them: they tore a string of
    k_s = 8e7 at 1 ms. The damper acts on the stretch, which is micrometres there, and goes with the step.
    """
    changed = p.copy()
    if averaging(p[0], h, lightest, 4.0) == SAFE:
        changed[1] += _STIFF_DAMPING * h * p[0]
    return changed


@njit(**KERNEL)
def kick(
    v: Array,
    dv: Array,
    hand_dv: Array,
    h: float,
    p: Array,
    m: Array,
    lightest: float,
    l0: float,
    seg: Array,
    joint: Array,
    force: Array,
    a: Array,
    b: Array,
) -> None:
    """Advance the velocities of points 1…n by one step of length h.

    Parameters
    ----------
    v, dv
        (n+1, 2) velocities, advanced here; their change, written here.
    hand_dv
        (3,) change of the hand's velocity and turn rate over the same interval, for the averaged stiffness.
    h
        Step [s].
    p, m, lightest, l0
        Parameters, masses, the smallest mass, rest spacing [m].
    seg, joint, force
        As filled by `strandcast.string.forces.forces`.
    a, b
        (2n + 5, 6) and (2n + 5,) work arrays; the first five rows are padding.
    """
    n = len(m)
    _diagonal(v, h, p, m, a)
    for i in range(n):
        b[BAND + 2 * i] = h * force[i + 1, 0]
        b[BAND + 2 * i + 1] = h * force[i + 1, 1]
    _add_segments(h, p, lightest, hand_dv, seg, a, b)
    _add_bends(h, lightest, l0, hand_dv, seg, joint, a, b)
    solve(a, b)
    for i in range(n):
        dv[i + 1, 0] = b[BAND + 2 * i]
        dv[i + 1, 1] = b[BAND + 2 * i + 1]
        v[i + 1, 0] += dv[i + 1, 0]
        v[i + 1, 1] += dv[i + 1, 1]


@njit(**KERNEL)
def _diagonal(v: Array, h: float, p: Array, m: Array, a: Array) -> None:
    """Masses and the drag's exact Jacobian, in an otherwise empty matrix."""
    for i in range(len(m)):
        vx, vy = v[i + 1, 0], v[i + 1, 1]
        speed = math.sqrt(vx * vx + vy * vy)
        along = 0.5 * h * p[7] / max(speed, 1e-12)
        plain = m[i] + 0.5 * h * (p[6] + p[7] * speed)
        r = BAND + 2 * i
        for c in range(1, BAND + 1):
            a[r, c] = 0.0
            a[r + 1, c] = 0.0
        a[r, 0] = plain + along * vx * vx
        a[r + 1, 0] = plain + along * vy * vy
        a[r + 1, 1] = along * vx * vy


@njit(**KERNEL)
def _add_segments(
    h: float, p: Array, lightest: float, hand_dv: Array, seg: Array, a: Array, b: Array
) -> None:
    """Stretch spring and damper along each segment, the pull's own stiffness across it."""
    spring = averaging(p[0], h, lightest, 4.0) * h * h * p[0]
    for j in range(len(seg)):
        ux, uy = seg[j, UX], seg[j, UY]
        across = max(seg[j, PULL], 0.0) / seg[j, LENGTH]
        across *= averaging(across, h, lightest, 4.0) * h * h
        along = spring + 0.5 * h * p[1]
        xx = along * ux * ux + across * uy * uy
        yy = along * uy * uy + across * ux * ux
        xy = (along - across) * ux * uy
        r = BAND + 2 * j
        a[r, 0] += xx
        a[r + 1, 0] += yy
        a[r + 1, 1] += xy
        if j == 0:
            # The hand's change is known: it goes to the right side. Its dampers are exact in f already.
            slip = spring * (ux * hand_dv[0] + uy * hand_dv[1])
            side = across * (ux * hand_dv[1] - uy * hand_dv[0])
            b[r] += slip * ux - side * uy
            b[r + 1] += slip * uy + side * ux
        else:
            a[r - 2, 0] += xx
            a[r - 1, 0] += yy
            a[r - 1, 1] += xy
            a[r, 2] -= xx
            a[r, 1] -= xy
            a[r + 1, 3] -= xy
            a[r + 1, 2] -= yy


@njit(**KERNEL)
def _add_bends(
    h: float, lightest: float, l0: float, hand_dv: Array, seg: Array, joint: Array, a: Array, b: Array
) -> None:
    """Bending spring and damper of every joint: rank one along the gradient of its angle."""
    qx = -seg[0, UY] / seg[0, LENGTH]
    qy = seg[0, UX] / seg[0, LENGTH]
    spring = averaging(joint[0, 0] / (l0 * l0), h, lightest, 4.0) * h * h * joint[0, 0]
    weight = spring + 0.5 * h * joint[0, 1]
    r = BAND
    a[r, 0] += weight * qx * qx
    a[r + 1, 0] += weight * qy * qy
    a[r + 1, 1] += weight * qx * qy
    known = spring * (qx * hand_dv[0] + qy * hand_dv[1] + hand_dv[2])
    b[r] += known * qx
    b[r + 1] += known * qy
    for i in range(1, len(seg)):
        px, py = qx, qy
        qx = -seg[i, UY] / seg[i, LENGTH]
        qy = seg[i, UX] / seg[i, LENGTH]
        # Gradient of the bend: p on point i - 1, -(p + q) on i, q on i + 1.
        mx, my = -px - qx, -py - qy
        spring = averaging(joint[i, 0] / (l0 * l0), h, lightest, 16.0) * h * h * joint[i, 0]
        weight = spring + 0.5 * h * joint[i, 1]
        r = BAND + 2 * (i - 1)
        wmx, wmy, wqx, wqy = weight * mx, weight * my, weight * qx, weight * qy
        a[r, 0] += wmx * mx
        a[r + 1, 0] += wmy * my
        a[r + 1, 1] += wmx * my
        a[r + 2, 2] += wqx * mx
        a[r + 2, 1] += wqx * my
        a[r + 3, 3] += wqy * mx
        a[r + 3, 2] += wqy * my
        a[r + 2, 0] += wqx * qx
        a[r + 3, 0] += wqy * qy
        a[r + 3, 1] += wqx * qy
        if i == 1:
            known = -spring * (px * hand_dv[0] + py * hand_dv[1])
            b[r] += known * mx
            b[r + 1] += known * my
            b[r + 2] += known * qx
            b[r + 3] += known * qy
        else:
            wpx, wpy = weight * px, weight * py
            a[r - 2, 0] += wpx * px
            a[r - 1, 0] += wpy * py
            a[r - 1, 1] += wpx * py
            a[r, 2] += wpx * mx
            a[r, 1] += wpy * mx
            a[r + 1, 3] += wpx * my
            a[r + 1, 2] += wpy * my
            a[r + 2, 4] += wpx * qx
            a[r + 2, 3] += wpy * qx
            a[r + 3, 5] += wpx * qy
            a[r + 3, 4] += wpy * qy


@njit(**KERNEL)
def solve(a: Array, b: Array) -> None:
    """Solve the symmetric positive definite banded system in place; the solution is left in `b`.

    Parameters
    ----------
    a
        (r, 6) lower band: a[i, k] = A[i, i - k]. The first five rows are padding, `padded` makes them.
    b
        (r,) right side, then the solution.
    """
    w1 = w2 = w3 = w4 = w5 = 0.0
    for r in range(BAND, len(b)):
        # w_k = L[r, r-k] D[r-k]; column by column, each uses the ones further out.
        w5 = a[r, 5]
        w4 = a[r, 4] - w5 * a[r - 4, 1]
        w3 = a[r, 3] - w5 * a[r - 3, 2] - w4 * a[r - 3, 1]
        w2 = a[r, 2] - w5 * a[r - 2, 3] - w4 * a[r - 2, 2] - w3 * a[r - 2, 1]
        w1 = a[r, 1] - w5 * a[r - 1, 4] - w4 * a[r - 1, 3] - w3 * a[r - 1, 2] - w2 * a[r - 1, 1]
        l5, l4, l3 = w5 * a[r - 5, 0], w4 * a[r - 4, 0], w3 * a[r - 3, 0]
        l2, l1 = w2 * a[r - 2, 0], w1 * a[r - 1, 0]
        pivot = a[r, 0] - w5 * l5 - w4 * l4 - w3 * l3 - w2 * l2 - w1 * l1
        a[r, 0] = 1.0 / pivot
        a[r, 1], a[r, 2], a[r, 3], a[r, 4], a[r, 5] = l1, l2, l3, l4, l5
        b[r] -= l5 * b[r - 5] + l4 * b[r - 4] + l3 * b[r - 3] + l2 * b[r - 2] + l1 * b[r - 1]
    for r in range(BAND, len(b)):
        b[r] *= a[r, 0]
    for r in range(len(b) - 1, BAND, -1):
        value = b[r]
        for k in range(1, BAND + 1):
            b[r - k] -= a[r, k] * value


@njit(**KERNEL)
def padded(n: int) -> tuple[Array, Array]:
    """Work arrays `a` (2n + 5, 6) and `b` (2n + 5,) for n points."""
    a = np.zeros((2 * n + BAND, BAND + 1))
    a[:BAND, 0] = 1.0
    return a, np.zeros(2 * n + BAND)
