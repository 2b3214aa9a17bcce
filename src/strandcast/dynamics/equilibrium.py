"""Shape of the string at the start: hanging at rest from the hand, or as measured."""

import math

import numpy as np
from numba import njit

from strandcast.dynamics.elements import (
    BEND_AT_REST,
    CLAMP_TURN,
    GRAVITY,
    HALF_WIDTH,
    RATE_READING,
    SIGN_READING,
    SPACING,
    blend,
    ramp,
)
from strandcast.dynamics.parameters import Array
from strandcast.dynamics.simd import CACHED

# Chosen.
_MAX_ITERATIONS = 60
_LARGEST_TURN_RAD = 0.5  # of one Newton step
_COILED_RAD, _SETTLED_RAD = 1e-9, 1e-12  # steps of shapes that are sought on, and of those that are found
_MAX_DESCENT = 400


@njit(**CACHED)
def segment_lengths(angle: Array, p: Array, m: Array, l0: float, gravity: float, length: Array) -> None:
    """Lengths of segments at rest: l0 and the static stretch under the weight below, into `length` (n,)."""
    weight = 0.0
    for j in range(len(m) - 1, -1, -1):
        weight += m[j] * gravity
        length[j] = max(l0 - weight * math.sin(angle[j]) / p[0], 0.1 * l0)


@njit(**CACHED)
def _stiffness_at_rest(
    angle: Array, p: Array, m: Array, factor: Array, fixed: Array, reading: int, k: Array
) -> None:
    """Bending stiffness of joints 1…n-1 at rest, by the reading's own switch."""
    weight = 0.0
    for i in range(len(m) - 1, 0, -1):
        bend = angle[i] - angle[i - 1] - fixed[BEND_AT_REST]
        weight += m[i] * fixed[GRAVITY]
        pull = -0.5 * weight * (math.sin(angle[i]) + math.sin(angle[i - 1]))
        switch = -pull / (m[i - 1] * fixed[GRAVITY])
        if reading == RATE_READING:
            switch = 0.0
        elif reading == SIGN_READING:
            switch = bend
        k[i] = factor[i] * (p[4] + (p[2] - p[4]) * blend(ramp(switch, 1.0 / fixed[HALF_WIDTH])))


@njit(**CACHED)
def hanging(hand: Array, p: Array, m: Array, factor: Array, fixed: Array, reading: int, x: Array) -> None:
    """Points of the string at rest under gravity, clamped in the hand.

    Newton's method on the segments' angles; the Hessian is tridiagonal, and made positive by omitting the
    gravity of segments that point upwards. Where that does not end, as in coils with many of these, the
    energy is made to fall with the exact Hessian. Points are NaN if no rest shape was found.

    Parameters
    ----------
    hand
        (3,) x, y [m] and angle [rad] of the hand.
    p, m, factor
        (10,) parameters, (n,) relative masses, (n,) multipliers of bending at joints 0…n-1.
    fixed
        (FIXED,) columns as listed in `strandcast.dynamics.elements`.
    reading
        See `strandcast.dynamics.elements.joint`.
    x
        (n+1, 2) filled here.
    """
    n = len(m)
    clamp = hand[2] + fixed[CLAMP_TURN]
    # Down, on the turn nearest to the clamp's angle.
    down = clamp - math.atan2(math.sin(clamp + 0.5 * math.pi), math.cos(clamp + 0.5 * math.pi))
    angle = np.full(n, down)
    length = np.empty(n)
    k = np.zeros(n)
    upper = np.empty(n)
    step = np.empty(n)
    for _ in range(_MAX_ITERATIONS):
        segment_lengths(angle, p, m, fixed[SPACING], fixed[GRAVITY], length)
        _stiffness_at_rest(angle, p, m, factor, fixed, reading, k)
        k[0] = factor[0] * p[8]
        _newton_step(angle, clamp, length, m, k, fixed, upper, step)
        largest = 0.0
        for j in range(n):
            largest = max(largest, abs(step[j]))
        shorter = 1.0 if largest <= _LARGEST_TURN_RAD else _LARGEST_TURN_RAD / largest
        for j in range(n):
            angle[j] += shorter * step[j]
        if largest < 1e-13:
            break
    if largest > _COILED_RAD:
        _descend(angle, clamp, p, m, factor, fixed, reading, k)
    segment_lengths(angle, p, m, fixed[SPACING], fixed[GRAVITY], length)
    lay_out(hand, angle, length, x)


@njit(**CACHED)
def _energy(angle: Array, clamp: float, p: Array, m: Array, k: Array, fixed: Array) -> float:
    """Return the energy [J/kg] of joints of stiffness k (n,) and of segments stretched by their load."""
    total, weight = 0.0, 0.0
    for j in range(len(m) - 1, -1, -1):
        weight += m[j] * fixed[GRAVITY]
        down = weight * math.sin(angle[j])
        bend = angle[j] - (clamp if j == 0 else angle[j - 1] + fixed[BEND_AT_REST])
        total += down * (fixed[SPACING] - 0.5 * down / p[0]) + 0.5 * k[j] * bend * bend
    return total


@njit(**CACHED)
def _damped_step(
    angle: Array, clamp: float, p: Array, m: Array, k: Array, fixed: Array, damping: float, step: Array
) -> bool:
    """Write Newton's step of the energy with the exact Hessian; False if that is not positive definite."""
    n = len(m)
    upper = np.empty(n)
    below = 0.0
    for j in range(n):
        below += m[j] * fixed[GRAVITY]
    scale = below * fixed[SPACING] * n
    for j in range(n):
        sine, cosine = math.sin(angle[j]), math.cos(angle[j])
        length = fixed[SPACING] - below * sine / p[0]
        bend = angle[j] - (clamp if j == 0 else angle[j - 1] + fixed[BEND_AT_REST])
        next_k = k[j + 1] if j < n - 1 else 0.0
        onward = next_k * (angle[j + 1] - angle[j] - fixed[BEND_AT_REST]) if j < n - 1 else 0.0
        residual = onward - k[j] * bend - below * length * cosine
        stiff = k[j] + next_k
        diagonal = stiff - below * length * sine - (below * cosine) ** 2 / p[0] + damping * (stiff + scale)
        if j > 0:
            residual += k[j] * step[j - 1]
            diagonal -= k[j] * upper[j - 1]
        if not diagonal > 0.0:
            return False
        upper[j], step[j] = next_k / diagonal, residual / diagonal
        below -= m[j] * fixed[GRAVITY]
    for j in range(n - 2, -1, -1):
        step[j] += upper[j] * step[j + 1]
    return True


@njit(**CACHED)
def _descend(
    angle: Array, clamp: float, p: Array, m: Array, factor: Array, fixed: Array, reading: int, k: Array
) -> None:
    """Move the angles (n,) to a minimum of the energy; NaN if none was found."""
    n, damping = len(m), 1e-3
    step, tried = np.empty(n), np.empty(n)
    for _ in range(_MAX_DESCENT):
        _stiffness_at_rest(angle, p, m, factor, fixed, reading, k)
        energy, largest = _energy(angle, clamp, p, m, k, fixed), math.inf
        while damping < 1e12:
            if _damped_step(angle, clamp, p, m, k, fixed, damping, step):
                largest = np.abs(step).max()
                shorter = min(1.0, _LARGEST_TURN_RAD / max(largest, 1e-300))
                # Here and below by number: numba takes 3 s to compile the assignment of a whole array.
                for j in range(n):
                    tried[j] = angle[j] + shorter * step[j]
                if _energy(tried, clamp, p, m, k, fixed) <= energy + 1e-14 * n * abs(energy):
                    break
            damping = max(4.0 * damping, 1e-6)
        if damping >= 1e12:
            break
        for j in range(n):
            angle[j] = tried[j]
        if largest < _SETTLED_RAD and damping == 0.0:
            return
        damping = 0.1 * damping if damping > 1e-6 else 0.0
    angle[:] = math.nan


@njit(**CACHED)
def _newton_step(
    angle: Array, clamp: float, length: Array, m: Array, k: Array, fixed: Array, upper: Array, step: Array
) -> None:
    """Solve the tridiagonal system for the change of the angles, into `step`."""
    n = len(m)
    below = 0.0
    for j in range(n):
        below += m[j]
    for j in range(n):
        weight = below * fixed[GRAVITY] * length[j]
        below -= m[j]
        into = k[j] * (angle[j] - (clamp if j == 0 else angle[j - 1] + fixed[BEND_AT_REST]))
        onward = k[j + 1] * (angle[j + 1] - angle[j] - fixed[BEND_AT_REST]) if j < n - 1 else 0.0
        next_k = k[j + 1] if j < n - 1 else 0.0
        residual = -(weight * math.cos(angle[j]) + into - onward)
        diagonal = max(-weight * math.sin(angle[j]), 1e-6 * weight) + k[j] + next_k
        if j > 0:
            residual += k[j] * step[j - 1]
            diagonal -= k[j] * upper[j - 1]
        upper[j] = next_k / diagonal
        step[j] = residual / diagonal
    for j in range(n - 2, -1, -1):
        step[j] += upper[j] * step[j + 1]


@njit(**CACHED)
def respaced(hand: Array, measured: Array, p: Array, m: Array, l0: float, gravity: float, x: Array) -> None:
    """Points with the directions of `measured` and the lengths of a string at rest.

    Measured spacings scatter; a stiff string started with them would oscillate.

    Parameters
    ----------
    hand
        (3,) x, y [m] and angle [rad] of the hand.
    measured
        (n, 2) positions of points 1…n [m].
    p, m, l0, gravity
        Parameters, masses, rest spacing [m], gravity [m/s^2].
    x
        (n+1, 2) filled here.
    """
    n = len(m)
    angle = np.empty(n)
    length = np.empty(n)
    before_x, before_y = hand[0], hand[1]
    for j in range(n):
        angle[j] = math.atan2(measured[j, 1] - before_y, measured[j, 0] - before_x)
        before_x, before_y = measured[j, 0], measured[j, 1]
    segment_lengths(angle, p, m, l0, gravity, length)
    lay_out(hand, angle, length, x)


@njit(**CACHED)
def lay_out(hand: Array, angle: Array, length: Array, x: Array) -> None:
    """Points from the hand along segments of given angles and lengths, into `x` (n+1, 2)."""
    x[0, 0], x[0, 1] = hand[0], hand[1]
    for j in range(len(angle)):
        x[j + 1, 0] = x[j, 0] + length[j] * math.cos(angle[j])
        x[j + 1, 1] = x[j, 1] + length[j] * math.sin(angle[j])
