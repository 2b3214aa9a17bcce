"""Vectors, symmetric and full matrices of three dimensions for numba kernels: tuples of numbers or lanes.

A symmetric matrix is (xx, yy, zz, xy, xz, yz), a full one its rows, one after the other.
"""

from typing import Any

from numba import njit

from strandcast.dynamics.simd import INLINED, inverse, load, splat, store


@njit(**INLINED)
def load3(spec: Any, array: Any, row: int) -> Any:
    """Return the vector in three rows from `row` on."""
    return load(spec, array, row), load(spec, array, row + 1), load(spec, array, row + 2)


@njit(**INLINED)
def store3(spec: Any, array: Any, row: int, a: Any) -> None:
    """Write a vector to three rows from `row` on."""
    store(spec, array, row, a[0])
    store(spec, array, row + 1, a[1])
    store(spec, array, row + 2, a[2])


@njit(**INLINED)
def zero3(spec: Any) -> Any:
    """Return the zero vector."""
    zero = splat(spec, 0.0)
    return zero, zero, zero


@njit(**INLINED)
def plus(a: Any, b: Any) -> Any:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@njit(**INLINED)
def minus(a: Any, b: Any) -> Any:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(**INLINED)
def scaled(k: Any, a: Any) -> Any:
    """Return k a."""
    return k * a[0], k * a[1], k * a[2]


@njit(**INLINED)
def plus_scaled(a: Any, k: Any, b: Any) -> Any:
    """Return a + k b."""
    return a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2]


@njit(**INLINED)
def dot(a: Any, b: Any) -> Any:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(**INLINED)
def cross(a: Any, b: Any) -> Any:
    """Return the vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(**INLINED)
def combined(frame: Any, a: Any) -> Any:
    """Return a_0 e_0 + a_1 e_1 + a_2 e_2 of a frame of three vectors e."""
    return plus_scaled(plus_scaled(scaled(a[0], frame[0]), a[1], frame[1]), a[2], frame[2])


@njit(**INLINED)
def outer6(k: Any, a: Any) -> Any:
    """Return the symmetric k a a^T."""
    x, y, z = scaled(k, a)
    return x * a[0], y * a[1], z * a[2], x * a[1], x * a[2], y * a[2]


@njit(**INLINED)
def plus6(a: Any, b: Any) -> Any:
    """Return the sum of symmetric matrices."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]


@njit(**INLINED)
def minus6(a: Any, b: Any) -> Any:
    """Return the difference of symmetric matrices."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3], a[4] - b[4], a[5] - b[5]


@njit(**INLINED)
def scaled6(k: Any, a: Any) -> Any:
    """Return k a of a symmetric matrix."""
    return k * a[0], k * a[1], k * a[2], k * a[3], k * a[4], k * a[5]


@njit(**INLINED)
def plus_scaled6(a: Any, k: Any, b: Any) -> Any:
    """Return a + k b of symmetric matrices."""
    return (
        a[0] + k * b[0],
        a[1] + k * b[1],
        a[2] + k * b[2],
        a[3] + k * b[3],
        a[4] + k * b[4],
        a[5] + k * b[5],
    )


@njit(**INLINED)
def diagonal_plus6(k: Any, a: Any) -> Any:
    """Return k I + a of a symmetric matrix a."""
    return k + a[0], k + a[1], k + a[2], a[3], a[4], a[5]


@njit(**INLINED)
def twice_symmetric_part(a: Any) -> Any:
    """Return a + a^T of a full matrix."""
    return a[0] + a[0], a[4] + a[4], a[8] + a[8], a[1] + a[3], a[2] + a[6], a[5] + a[7]


@njit(**INLINED)
def plus9(a: Any, b: Any) -> Any:
    """Return the sum of full matrices."""
    return (*plus(a[0:3], b[0:3]), *plus(a[3:6], b[3:6]), *plus(a[6:9], b[6:9]))


@njit(**INLINED)
def minus_full_of(a: Any, b: Any) -> Any:
    """Return b - a of a symmetric a and a full b."""
    return (
        b[0] - a[0],
        b[1] - a[3],
        b[2] - a[4],
        b[3] - a[3],
        b[4] - a[1],
        b[5] - a[5],
        b[6] - a[4],
        b[7] - a[5],
        b[8] - a[2],
    )


@njit(**INLINED)
def times9(a: Any, x: Any) -> Any:
    """Return a x of a full matrix and a vector."""
    return dot(a[0:3], x), dot(a[3:6], x), dot(a[6:9], x)


@njit(**INLINED)
def transposed_times9(a: Any, x: Any) -> Any:
    """Return a^T x of a full matrix and a vector."""
    return plus_scaled(plus_scaled(scaled(x[0], a[0:3]), x[1], a[3:6]), x[2], a[6:9])


@njit(**INLINED)
def transposed_product6(a: Any, b: Any) -> Any:
    """Return a^T b of full matrices where it is symmetric."""
    return (
        a[0] * b[0] + a[3] * b[3] + a[6] * b[6],
        a[1] * b[1] + a[4] * b[4] + a[7] * b[7],
        a[2] * b[2] + a[5] * b[5] + a[8] * b[8],
        a[0] * b[1] + a[3] * b[4] + a[6] * b[7],
        a[0] * b[2] + a[3] * b[5] + a[6] * b[8],
        a[1] * b[2] + a[4] * b[5] + a[7] * b[8],
    )


@njit(**INLINED)
def factored6(spec: Any, a: Any) -> Any:
    """Return D^-1 and the unit lower triangle's xy, xz and yz of a symmetric matrix L D L^T."""
    xx, yy, zz, xy, xz, yz = a
    # D is xx, y / xx and rest / (xx y): none of the three divisions waits for another.
    y, z, mixed = xx * yy - xy * xy, xx * zz - xz * xz, xx * yz - xy * xz
    rest = y * z - mixed * mixed
    per_x, per_y, per_rest = inverse(spec, xx), inverse(spec, y), inverse(spec, rest)
    return per_x, per_y * xx, per_rest * (xx * y), per_x * xy, per_x * xz, per_y * mixed


@njit(**INLINED)
def forward3(factors: Any, x: Any) -> Any:
    """Return L^-1 x of a vector."""
    y = x[1] - factors[3] * x[0]
    return x[0], y, x[2] - factors[4] * x[0] - factors[5] * y


@njit(**INLINED)
def forward9(factors: Any, a: Any) -> Any:
    """Return L^-1 a of a full matrix."""
    x0, y0, z0 = forward3(factors, a[0::3])
    x1, y1, z1 = forward3(factors, a[1::3])
    x2, y2, z2 = forward3(factors, a[2::3])
    return x0, x1, x2, y0, y1, y2, z0, z1, z2


@njit(**INLINED)
def divided3(factors: Any, x: Any) -> Any:
    """Return D^-1 x of a vector."""
    return factors[0] * x[0], factors[1] * x[1], factors[2] * x[2]


@njit(**INLINED)
def divided9(factors: Any, a: Any) -> Any:
    """Return D^-1 a of a full matrix."""
    return (*scaled(factors[0], a[0:3]), *scaled(factors[1], a[3:6]), *scaled(factors[2], a[6:9]))


@njit(**INLINED)
def backward3(lower: Any, x: Any) -> Any:
    """Return L^-T x of a vector and the last three of `factored6`."""
    y = x[1] - lower[2] * x[2]
    return x[0] - lower[0] * y - lower[1] * x[2], y, x[2]


@njit(**INLINED)
def minus_transposed_times9(c: Any, a: Any, x: Any) -> Any:
    """Return c - a^T x of vectors and a full matrix."""
    return plus_scaled(plus_scaled(plus_scaled(c, -x[0], a[0:3]), -x[1], a[3:6]), -x[2], a[6:9])


@njit(**INLINED)
def minus_product6(c: Any, a: Any, b: Any) -> Any:
    """Return c - a^T b of a symmetric c and full matrices where the product is symmetric."""
    return (
        c[0] - a[0] * b[0] - a[3] * b[3] - a[6] * b[6],
        c[1] - a[1] * b[1] - a[4] * b[4] - a[7] * b[7],
        c[2] - a[2] * b[2] - a[5] * b[5] - a[8] * b[8],
        c[3] - a[0] * b[1] - a[3] * b[4] - a[6] * b[7],
        c[4] - a[0] * b[2] - a[3] * b[5] - a[6] * b[8],
        c[5] - a[1] * b[2] - a[4] * b[5] - a[7] * b[8],
    )


@njit(**INLINED)
def plus_product(c: Any, a: Any, b: Any) -> Any:
    """Return c + a^T b of full matrices."""
    return (
        *plus_scaled(plus_scaled(plus_scaled(c[0:3], a[0], b[0:3]), a[3], b[3:6]), a[6], b[6:9]),
        *plus_scaled(plus_scaled(plus_scaled(c[3:6], a[1], b[0:3]), a[4], b[3:6]), a[7], b[6:9]),
        *plus_scaled(plus_scaled(plus_scaled(c[6:9], a[2], b[0:3]), a[5], b[3:6]), a[8], b[6:9]),
    )
