"""The bending joint in space: its bend, rate and moment as vectors, and its stiffness blocks.

A joint connects the directions a and b before and after it. The string has no twist of its own: a frame is
transported along it from the clamp without spin about the string, and the rest curl is constant in it.
All vectors of a joint belong to the frame halfway between its two sides, so that none has a part along
a + b. In the plane they have one component, the plane's bend.
"""

import math
from typing import Any

from numba import njit

from strandcast.dynamics.elements import PER_STICK, STICKING, half_angle_ratio
from strandcast.dynamics.simd import (
    INLINED,
    inverse,
    inverse_root,
    load,
    maximum,
    minimum,
    select,
    splat,
    store,
)
from strandcast.dynamics.spatial.triples import (
    cross,
    diagonal_plus6,
    dot,
    minus,
    plus,
    plus_scaled,
    scaled,
)

_NEAREST_FOLD = 1e-6  # 1 + cosine of a bend that is as good as a fold


@njit(**INLINED)
def side_by_side(spec: Any, a: Any, b: Any) -> tuple[Any, Any, Any, Any, Any, Any]:
    """Return what a joint needs of the unit vectors before and after it.

    Returns
    -------
    a x b, a + b, 1 / (1 + cosine), the angle between them over its sine, 1 / sine, 1 / tangent of half of it.
    """
    binormal, cosine = cross(a, b), dot(a, b)
    per_sine = inverse_root(spec, maximum(dot(binormal, binormal), 1e-12))
    behind = cosine < 0.0
    size = select(behind, -cosine, cosine)
    # Tangent of half the angle, or of half its complement behind 90 degrees: its square and its ratio.
    per = inverse(spec, 1.0 + size)
    ratio = per * half_angle_ratio(spec, maximum(1.0 - size, 0.0) * per)
    folded = minimum((1.0 + size) * (per_sine * per_sine), 1.0 / _NEAREST_FOLD)
    return (
        binormal,
        plus(a, b),
        select(behind, folded, per),
        select(behind, math.pi * per_sine - ratio, ratio),
        per_sine,
        per_sine * maximum(1.0 + cosine, _NEAREST_FOLD),
    )


@njit(**INLINED)
def relative_rate(middle: Any, per: Any, rate: Any) -> tuple[Any, Any]:
    """Return a difference of turn rates without its part along `middle`, and the spin that makes up for it.

    Parameters
    ----------
    middle, per
        a + b and 1 / (1 + cosine).
    rate
        Turn rate of b minus that of a, each across its own direction [rad/s].
    """
    spin = per * dot(rate, middle)
    return plus_scaled(rate, -0.5 * spin, middle), spin


@njit(**INLINED)
def transported(b: Any, middle: Any, per: Any, rest: Any) -> tuple[Any, Any]:
    """Return a vector across a, halfway to b times the cosine of half the bend, and transported to b."""
    share = per * dot(rest, b)
    return plus_scaled(rest, -0.5 * share, middle), plus_scaled(rest, -share, middle)


@njit(**INLINED)
def bend_from_rest(binormal: Any, ratio: Any, per_sine: Any, halfway: Any) -> Any:
    """Return the bend vector from rest [rad]: the gradient of half its square is exact, see the notes.

    Parameters
    ----------
    binormal, ratio, per_sine
        See `side_by_side`.
    halfway
        The rest bend halfway, times the cosine of half the bend.

    Notes
    -----
    For the bend beta = theta n and the rest bend beta_0 in the transported frame, the energy
    K |beta - beta_0|^2 / 2 does work on the relative turn with the moment K (beta - (theta / sin theta) h +
    (theta / sin theta - 1) (h.n) n), where h is `halfway`: across n, a turn by dt changes n by
    dt / (2 sin(theta / 2)).
    """
    along = (ratio - 1.0) * (per_sine * per_sine) * dot(halfway, binormal)
    return plus_scaled(scaled(ratio + along, binormal), -ratio, halfway)


@njit(**INLINED)
def sticking_friction_in_space(
    spec: Any, c: Any, factor: Any, j: int, bend: Any, share: float, stick: Any
) -> tuple[Any, Any, Any]:
    """Moment of dry friction that sticks, see `strandcast.dynamics.elements`; advances its state.

    The share of the full moment is a vector z in the string's transported frame, as the bend b is:
    dz = (db - z |db|) / s, so that z is never longer than 1.

    Parameters
    ----------
    factor, j
        Multiplier of the moment; the joint.
    bend
        Two components of its bend in the string's frame [rad].
    share
        Below 1 at the first step, where friction is relaxed: z = 0.
    stick
        `StringMotion.stick`: two rows of the bend and two of z per joint.

    Returns
    -------
    The moment's two components, and the largest derivative that it may have by the bend in the coming step.
    """
    r, zero = 4 * j, splat(spec, 0.0)
    dx, dy = bend[0] - load(spec, stick, r), bend[1] - load(spec, stick, r + 1)
    x, y = load(spec, stick, r + 2), load(spec, stick, r + 3)
    if share < 1.0:
        dx = dy = x = y = zero
    length, per_length = size_of(spec, (dx, dy, zero))
    size = length * load(spec, c, PER_STICK)
    # exp(-size) to second order, by an approximant between 0 and 1.
    kept = inverse(spec, 1.0 + size + 0.5 * size * size)
    toward_x, toward_y = per_length * dx, per_length * dy
    x, y = toward_x + (x - toward_x) * kept, toward_y + (y - toward_y) * kept
    store(spec, stick, r, bend[0])
    store(spec, stick, r + 1, bend[1])
    store(spec, stick, r + 2, x)
    store(spec, stick, r + 3, y)
    full = factor * load(spec, c, STICKING)
    return full * x, full * y, full * load(spec, c, PER_STICK) * (1.0 + size_of(spec, (x, y, zero))[0])


@njit(**INLINED)
def mixed_block(k: Any, a: Any, b: Any, cosine: Any, normal: Any) -> Any:
    """Return the block between the velocities of a's segment (rows) and b's: a full matrix.

    -k (cosine I - b a^T) - normal, of k, the weight over both lengths, and `normal`, k times
    (a x b) (a x b)^T / (2 (1 + cosine)) or another multiple. Each segment's own block is, with its own
    direction u and length, weight / length^2 (I - u u^T) less its own multiple.
    """
    bx, by, bz = scaled(k, b)
    xx, yy, zz, xy, xz, yz = diagonal_plus6(k * cosine, normal)
    return (
        bx * a[0] - xx,
        bx * a[1] - xy,
        bx * a[2] - xz,
        by * a[0] - xy,
        by * a[1] - yy,
        by * a[2] - yz,
        bz * a[0] - xz,
        bz * a[1] - yz,
        bz * a[2] - zz,
    )


@njit(**INLINED)
def size_of(spec: Any, a: Any) -> tuple[Any, Any]:
    """Return the length of a vector and 1 / length; 0 and a large number for the zero vector."""
    squared = dot(a, a)
    per = inverse_root(spec, maximum(squared, 1e-24))
    return squared * per, per


@njit(**INLINED)
def across(direction: Any, rate: Any) -> Any:
    """Return the part of a turn rate across a unit vector."""
    return minus(rate, scaled(dot(rate, direction), direction))
