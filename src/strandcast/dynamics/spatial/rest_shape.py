"""Rest shape of a string in space as the minimum of its energy, by Newton's method with the exact Hessian.

The unknowns of segment j are the bend at the joint before it, two components of a rotation vector in the
transported frame, and its length. In these, bending and stretching are sums of squares of one segment each,
whatever the curl; gravity and the second clamp see the segments' directions, which turn with all joints
before them.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from strandcast.dynamics.candidates import Candidates
from strandcast.dynamics.elements import K_MORE, K_PH, K_S, K_SH, STRAIN_READING, blend, ramp
from strandcast.dynamics.parameters import Array
from strandcast.dynamics.simd import CACHED
from strandcast.dynamics.spatial.clamps import POSE, orthonormal
from strandcast.dynamics.spatial.step import (
    DIRECTION,
    FAR_DIRECTION,
    L0,
    REST,
    SIDE,
    TORSION,
)
from strandcast.dynamics.string_state import StepSettings

# Chosen.
_ROUNDS, _WHOLE_ROUNDS = 60, 6  # of joints' stiffness and the far clamp's force, and those of whole changes
_ITERATIONS = 1000  # of Newton's method in each
# What holds the last point in its place, over the whole string's stiffness: at the end, at least; its growth.
_HELD, _SOFTEST, _STIFFER = 10.0, 1e-6, 10.0
_LARGEST_TURN_RAD = 0.5  # of one joint in one step
_SMALL = 1e-3  # angle below which functions of it are series
_LEAST_DAMPING, _STIFFEST = 1e-6, 1e12  # of Newton's method, over the stiffness of bending and weight
# Pivots below which a direction does not count as stiff, and damping above which the shape is a saddle.
# Between them: a string free to turn about the vertical, which stays where it is.
_SINGULAR, _UNSTABLE = 1e-10, 1e-4
_NUDGES, _NUDGE_RAD = 2, 1e-3
_AT_REST = 1e-9  # of the string's length: the step of a string that has come to rest


class RestProblem(NamedTuple):
    """What the energy of a string of n segments consists of; per nominal point mass, as all coefficients.

    Attributes
    ----------
    first
        (3, 3) direction of the first clamp and two normals.
    k, rest
        (n + 1,) stiffness of the joints [N m/rad/kg], (n, 2) their bends at rest [rad].
    spring, l0
        Stiffness [N/m/kg] and rest length [m] of segments.
    weight
        (n,) weight hung on each segment [N/kg].
    far
        (2, 3) place of the last point and the direction against which the last segment bends; not read
        without `stiff`.
    hold, stiff
        (3,) force that holds the last point in its place [N/kg] and (1,) a spring that does so, too; 0: free.
    """

    first: Array
    k: Array
    rest: Array
    spring: float
    l0: float
    weight: Array
    far: Array
    hold: Array
    stiff: Array


@njit(**CACHED)
def _put_cross(a: Array, b: Array, out: Array) -> None:
    for c in range(3):
        e, f = (c + 1) % 3, (c + 2) % 3
        out[c] = a[e] * b[f] - a[f] * b[e]


@njit(**CACHED)
def _dot(a: Array, b: Array) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@njit(**CACHED)
def _turn_by(frame: Array, x: float, y: float, after: Array) -> None:
    """Write the frame (3, 3) turned by a rotation vector of these components along its second and third."""
    angle = math.sqrt(x * x + y * y)
    size = math.sin(angle) / angle if angle > 0.0 else 1.0
    bent = 2.0 * (math.sin(0.5 * angle) / angle) ** 2 if angle > 0.0 else 0.5
    for c in range(3):
        along, left, up = frame[0, c], frame[1, c], frame[2, c]
        after[0, c] = math.cos(angle) * along + size * (y * left - x * up)
        after[1, c] = left - size * y * along + bent * y * (x * up - y * left)
        after[2, c] = up + size * x * along - bent * x * (x * up - y * left)


@njit(**CACHED)
def _bends_of(d: Array, first: Array, q: Array, length: Array) -> None:
    """Write bends (n, 2) and lengths (n,) of segments (3n,) behind a clamp of frame (3, 3)."""
    frame, after, across, u = first.copy(), np.empty((3, 3)), np.empty(3), np.empty(3)
    for j in range(len(length)):
        length[j] = math.sqrt(_dot(d[3 * j : 3 * j + 3], d[3 * j : 3 * j + 3]))
        for c in range(3):
            u[c] = d[3 * j + c] / length[j]
        _put_cross(frame[0], u, across)
        sine = math.sqrt(_dot(across, across))
        ratio = math.atan2(sine, _dot(frame[0], u)) / sine if sine > 0.0 else 1.0
        q[j, 0], q[j, 1] = ratio * _dot(across, frame[1]), ratio * _dot(across, frame[2])
        _turn_by(frame, q[j, 0], q[j, 1], after)
        frame[:] = after


@njit(**CACHED)
def _rest_energy(at: RestProblem, q: Array, length: Array, frames: Array) -> float:
    """Return the energy [J/kg] of bends (n, 2) and lengths (n,); write the segments' frames (n, 3, 3)."""
    total, end, before = 0.0, np.zeros(3), at.first
    for j in range(len(length)):
        _turn_by(before, q[j, 0], q[j, 1], frames[j])
        before = frames[j]
        total += 0.5 * at.k[j] * ((q[j, 0] - at.rest[j, 0]) ** 2 + (q[j, 1] - at.rest[j, 1]) ** 2)
        total += 0.5 * at.spring * (length[j] - at.l0) ** 2 + at.weight[j] * length[j] * before[0, 2]
        for c in range(3):
            end[c] += length[j] * before[0, c]
    if at.stiff[0] > 0.0:
        for c in range(3):
            miss = end[c] - at.far[0, c]
            total += (at.hold[c] + 0.5 * at.stiff[0] * miss) * miss
        across = np.empty(3)
        _put_cross(before[0], at.far[1], across)
        angle = math.atan2(math.sqrt(_dot(across, across)), _dot(before[0], at.far[1]))
        total += 0.5 * at.k[len(length)] * angle**2
    return total


@njit(**CACHED)
def _turn_rates(before: Array, x: float, y: float, rate: Array, change: Array) -> None:
    """Write how the turn of a joint changes with its bend (2, 3), and how that changes (2, 2, 3).

    The left Jacobian of the rotation vector q = (0, x, y), e + A q x e + B q x (q x e), and its derivative.
    """
    angle = math.sqrt(x * x + y * y)
    if angle < 0.05:
        s = angle * angle
        a, b = 0.5 - s / 24.0 + s * s / 720.0, 1.0 / 6.0 - s / 120.0 + s * s / 5040.0
        da, db = -1.0 / 12.0 + s / 180.0, -1.0 / 60.0 + s / 1260.0
    else:
        s = angle * angle
        sine, cosine = math.sin(angle), math.cos(angle)
        a, b = (1.0 - cosine) / s, (angle - sine) / (s * angle)
        da = (sine / angle - 2.0 * a) / s
        db = ((1.0 - cosine) / s - 3.0 * b) / s
    q, e, g = np.zeros(3), np.zeros(3), np.zeros(3)
    once, twice, own, mixed, inner, local = (
        np.empty(3),
        np.empty(3),
        np.empty(3),
        np.empty(3),
        np.empty(3),
        np.empty(3),
    )
    q[1], q[2] = x, y
    for f in range(2):
        e[:] = 0.0
        e[1 + f] = 1.0
        _put_cross(q, e, once)
        _put_cross(q, once, twice)
        for c in range(3):
            local[c] = e[c] + a * once[c] + b * twice[c]
        for c in range(3):
            rate[f, c] = local[0] * before[0, c] + local[1] * before[1, c] + local[2] * before[2, c]
        for h in range(2):
            g[:] = 0.0
            g[1 + h] = 1.0
            _put_cross(g, e, own)
            _put_cross(g, once, mixed)
            _put_cross(q, own, inner)
            for c in range(3):
                local[c] = q[1 + h] * (da * once[c] + db * twice[c]) + a * own[c] + b * (mixed[c] + inner[c])
            for c in range(3):
                change[f, h, c] = local[0] * before[0, c] + local[1] * before[1, c] + local[2] * before[2, c]


class Turns(NamedTuple):
    """How the string turns with its 3n unknowns, and what that does to the energy.

    Attributes
    ----------
    turn, swept
        (3n, 3) turn of all that lies behind, and velocity of the last point.
    arm
        (3n, 3) what a turn of a joint before changes in the gradient.
    moment, change
        (n, 3) of the forces behind each joint, (n, 2, 2, 3) change of its own two turns with its bends.
    tilt, softer
        (3,) and (1,) second derivative of the far bend's energy in the direction of `tilt`.
    """

    turn: Array
    swept: Array
    arm: Array
    moment: Array
    change: Array
    tilt: Array
    softer: Array


@njit(**CACHED)
def _gradient(at: RestProblem, q: Array, length: Array, frames: Array, turns: Turns, gradient: Array) -> None:
    """Write the gradient (3n,) of `_rest_energy` by bends and lengths, and what its Hessian consists of.

    Of forces f on the ends of the segments d behind joint k, a turn by w of an earlier joint and by v of
    joint k changes the energy by w S v - (w.v) tr S with S = sum of d f^T.
    """
    n = len(length)
    product, reach, force = np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    if at.stiff[0] > 0.0:
        for c in range(3):
            force[c] = at.hold[c] - at.stiff[0] * at.far[0, c]
            for j in range(n):
                force[c] += at.stiff[0] * length[j] * frames[j, 0, c]
        turns.softer[0] = _far_bend(at.k[n], frames[n - 1, 0], at.far[1], product, turns.tilt)
    for j in range(n - 1, -1, -1):
        u, r = frames[j, 0], 3 * j
        force[2] += at.weight[j]
        for c in range(3):
            reach[c] += length[j] * u[c]
            turns.swept[r + 2, c] = u[c]
            for e in range(3):
                product[c, e] += length[j] * u[c] * force[e]
        _put_cross(u, force, turns.arm[r + 2])
        gradient[r + 2] = at.spring * (length[j] - at.l0) + _dot(force, u)
        force[2] -= at.weight[j]
        for c in range(3):
            e, f = (c + 1) % 3, (c + 2) % 3
            turns.moment[j, c] = product[e, f] - product[f, e]
        _turn_rates(
            at.first if j == 0 else frames[j - 1], q[j, 0], q[j, 1], turns.turn[r : r + 2], turns.change[j]
        )
        for f in range(2):
            own = turns.turn[r + f]
            gradient[r + f] = at.k[j] * (q[j, f] - at.rest[j, f]) + _dot(turns.moment[j], own)
            _put_cross(own, reach, turns.swept[r + f])
            for c in range(3):
                trace = product[0, 0] + product[1, 1] + product[2, 2]
                turns.arm[r + f, c] = _dot(product[c], own) - trace * own[c]


@njit(**CACHED)
def _put_hessian(at: RestProblem, turns: Turns, hessian: Array) -> None:
    """Write the lower half of the Hessian (3n, 3n) of `_rest_energy`."""
    turn, swept = turns.turn, turns.swept
    for row in range(len(turn)):
        k, f = row // 3, row % 3
        tilted = turns.softer[0] * _dot(turn[row], turns.tilt)
        for column in range(row + 1):
            i, h = column // 3, column % 3
            value = tilted * _dot(turn[column], turns.tilt)
            value += at.stiff[0] * _dot(swept[row], swept[column])
            if h < 2:
                value += _dot(turn[column], turns.arm[row])
                if i == k and f < 2:
                    value += _dot(turns.moment[k], turns.change[k, h, f])
            hessian[row, column] = value
        hessian[row, row] += at.spring if f == 2 else at.k[k]


@njit(**CACHED)
def _far_bend(k: float, u: Array, against: Array, product: Array, tilt: Array) -> float:
    """Add the bend at the second clamp to the sum of d f^T; return and write what its square is softer by.

    Its energy is a function of the cosine between the last segment and the clamp.
    """
    _put_cross(u, against, tilt)
    sine, cosine = math.sqrt(_dot(tilt, tilt)), _dot(u, against)
    ratio, softer = 1.0, 1.0 / 3.0
    if sine > _SMALL:
        ratio = math.atan2(sine, cosine) / sine
        softer = (1.0 - cosine * ratio) / (sine * sine)
    for c in range(3):
        for e in range(3):
            product[c, e] -= k * ratio * u[c] * against[e]
    return k * softer


@njit(**CACHED)
def _solve(hessian: Array, scale: Array, shift: float, gradient: Array, factor: Array, step: Array) -> bool:
    """Write the step (N,) of (hessian + shift scale) step = -gradient; False if that is not positive."""
    size = len(gradient)
    for i in range(size):
        rhs = -gradient[i]
        for j in range(i + 1):
            total = hessian[i, j]
            for e in range(j):
                total -= factor[i, e] * factor[j, e]
            if j < i:
                factor[i, j] = total / factor[j, j]
                rhs -= factor[i, j] * step[j]
            else:
                total += shift * scale[i]
                if not total > _SINGULAR * scale[i]:
                    return False
                factor[i, i] = math.sqrt(total)
                step[i] = rhs / factor[i, i]
    for i in range(size - 1, -1, -1):
        step[i] /= factor[i, i]
        for j in range(i):
            step[j] -= factor[i, j] * step[i]
    return True


@njit(**CACHED)
def _minimise(at: RestProblem, q: Array, length: Array) -> bool:
    """Move bends (n, 2) and lengths (n,) to a minimum of the energy; False if none was found.

    Steps are shortened, and damped where the energy is not convex, until it falls.
    """
    n = len(length)
    size, small = 3 * n, _AT_REST * n * at.l0
    turns = Turns(
        np.zeros((size, 3)),
        np.zeros((size, 3)),
        np.zeros((size, 3)),
        np.empty((n, 3)),
        np.empty((n, 2, 2, 3)),
        np.zeros(3),
        np.zeros(1),
    )
    gradient, step, scale = np.empty(size), np.empty(size), np.empty(size)
    hessian, factor = np.empty((size, size)), np.empty((size, size))
    frames, new_q, new_length = np.empty((n, 3, 3)), np.empty((n, 2)), np.empty(n)
    for i in range(size):
        scale[i] = at.spring if i % 3 == 2 else at.k[i // 3] + abs(at.weight[0]) * n * at.l0
    energy, damping, nudges = _rest_energy(at, q, length, frames), 0.0, 0
    for _ in range(_ITERATIONS):
        _gradient(at, q, length, frames, turns, gradient)
        _put_hessian(at, turns, hessian)
        # Below this, differences of energies are rounding.
        noise = 1e-14 * n * (abs(energy) + at.spring * (1e-3 * at.l0) ** 2)
        while True:
            if damping > _STIFFEST:
                return False
            if _solve(hessian, scale, damping, gradient, factor, step):
                moved, share = _try_step(at, q, length, step, new_q, new_length)
                new_energy = _rest_energy(at, new_q, new_length, frames)
                if new_energy <= energy + 1e-4 * share * np.dot(gradient, step) + noise:
                    break
            damping = max(4.0 * damping, _LEAST_DAMPING)
        q[:], length[:], energy = new_q, new_length, new_energy
        if moved < small and damping > _UNSTABLE and nudges < _NUDGES:
            # On a saddle, as a string that stands upright: off it, to either side.
            nudges += 1
            for j in range(n):
                q[j, 0], q[j, 1] = q[j, 0] + _NUDGE_RAD, q[j, 1] + 0.5 * _NUDGE_RAD
            energy = _rest_energy(at, q, length, frames)
        elif moved < small:
            return True
        damping = 0.1 * damping if damping > _LEAST_DAMPING else 0.0
    return False


@njit(**CACHED)
def _try_step(
    at: RestProblem, q: Array, length: Array, step: Array, new_q: Array, new_length: Array
) -> tuple[float, float]:
    """Write bends and lengths after a step (3n,); return how far it moves points [m], and the share taken."""
    n, largest, moved = len(length), 0.0, 0.0
    for j in range(n):
        for i in range(3 * j, 3 * j + 2):
            largest = max(largest, abs(step[i]))
            moved = max(moved, abs(step[i]) * at.l0 * (n - j))
        moved = max(moved, abs(step[3 * j + 2]))
    share = min(1.0, _LARGEST_TURN_RAD / largest) if largest > 0.0 else 1.0
    for j in range(n):
        for f in range(2):
            new_q[j, f] = q[j, f] + share * step[3 * j + f]
        new_length[j] = length[j] + share * step[3 * j + 2]
    return moved, share


@njit(**CACHED)
def _in_world(frame: Array, c: Array, row: int, out: Array) -> None:
    """Write a vector that three rows of coefficients give in the frame (3, 3) of a clamp's pose."""
    for axis in range(3):
        out[axis] = c[row] * frame[0, axis] + c[row + 1] * frame[1, axis] + c[row + 2] * frame[2, axis]


@njit(**CACHED)
def _problem(c: Array, mass: Array, pose: Array, gravity: float) -> RestProblem:
    """Return what the energy of one string consists of, but for the stiffness of its joints."""
    n, two_ends = len(mass), len(pose) > POSE
    clamp, first, bent = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    orthonormal(pose[:POSE], clamp)
    _in_world(clamp, c, DIRECTION, first[0])
    _in_world(clamp, c, SIDE, first[1])
    _put_cross(first[0], first[1], first[2])
    _in_world(clamp, c, REST, bent)
    rest, weight = np.zeros((n, 2)), np.zeros(n)
    x, y = _dot(bent, first[1]), _dot(bent, first[2])
    for j in range(1, n):
        x, y = c[TORSION] * x - c[TORSION + 1] * y, c[TORSION + 1] * x + c[TORSION] * y
        rest[j, 0], rest[j, 1] = x, y
    hung = 0.0
    for j in range(n - 1, -1, -1):
        hung += 0.0 if two_ends and j == n - 1 else gravity * mass[j]
        weight[j] = hung
    far, stiff = np.zeros((2, 3)), np.zeros(1)
    if two_ends:
        orthonormal(pose[POSE:], clamp)
        _in_world(clamp, c, FAR_DIRECTION, far[1])
        for axis in range(3):
            far[0, axis], far[1, axis] = pose[POSE + axis] - pose[axis], -far[1, axis]
        # As soft as the string sags: far from rest, a stiff spring would be a narrow, curved valley.
        reach = n * c[L0]
        sag = (weight[0] + 10.0 * max(c[K_SH], c[K_SH] + c[K_MORE]) * c[L0] / reach**2) / reach
        stiff[0] = min(max(sag, _SOFTEST * c[K_S] / n), _HELD * c[K_S] / n)
    return RestProblem(first, np.zeros(n + 1), rest, c[K_S], c[L0], weight, far, np.zeros(3), stiff)


@njit(**CACHED)
def _put_joints(
    c: Array, mass: Array, factor: Array, length: Array, settings: StepSettings, share: float, k: Array
) -> None:
    """Move the stiffness (n + 1,) of joints by `share` to what it is at rest under the segments' pull."""
    n = len(mass)
    k[0] = k[n] = factor[0] * c[K_PH]
    for j in range(1, n):
        switch = 0.0
        if settings.reading == STRAIN_READING:
            pull = 0.5 * c[K_S] * (length[j - 1] + length[j] - 2.0 * c[L0])
            switch = -pull / max(mass[j - 1] * settings.gravity, 1e-12)
        now = factor[j] * (c[K_SH] + c[K_MORE] * blend(ramp(switch, settings.per_width)))
        k[j] += share * (now - k[j])


@njit(**CACHED)
def _come_to_rest(
    c: Array, mass: Array, factor: Array, pose: Array, settings: StepSettings, d: Array
) -> bool:
    """Move the segments (3n,) of one string to rest; False if no rest shape was found.

    In turns: a minimum of the energy, then the stiffness and the far clamp's force that go with it.
    """
    n, at = len(mass), _problem(c, mass, pose, settings.gravity)
    q, length, reached = np.empty((n, 2)), np.empty(n), np.empty(3)
    two_ends = at.stiff[0] > 0.0
    for turn in range(_ROUNDS):
        _bends_of(d, at.first, q, length)
        # Stiffness that follows the pull can go back and forth: by ever smaller steps.
        _put_joints(c, mass, factor, length, settings, 1.0 / (1 + turn // _WHOLE_ROUNDS), at.k)
        if not _minimise(at, q, length):
            return False
        moved = _lay_out(at.first, q, length, d, reached)
        for axis in range(3):
            at.hold[axis] += at.stiff[0] * (reached[axis] - at.far[0, axis])
        at.stiff[0] = min(_STIFFER * at.stiff[0], two_ends * _HELD * at.spring / n)
        if moved < _AT_REST * n * c[L0]:
            return True
    return False


@njit(nogil=True, **CACHED)
def rest_shapes(
    first: int,
    last: int,
    candidates: Candidates,
    c: Array,
    poses: Array,
    settings: StepSettings,
    d: Array,
    lost: Array,
) -> None:
    """Move strings `first` to before `last` to rest, where their energy falls to from the given shapes.

    Parameters
    ----------
    candidates
        The candidates, whose masses and factors are read.
    c
        (SPATIAL_COEFFICIENTS, B) rows as listed in `strandcast.dynamics.spatial.step`.
    poses
        (1 or B, 9 or 18) of the clamps.
    settings
        Gravity, and the choice of h or sh.
    d
        (3n, B) segments [m]; replaced, by NaN where no rest shape was found.
    lost
        (B,) set to True there.
    """
    for b in range(first, last):
        own, shape = c[:, b].copy(), d[:, b].copy()
        pose = poses[b if len(poses) > 1 else 0]
        found = _come_to_rest(own, candidates.masses[b], candidates.factor[b], pose, settings, shape)
        lost[b] = not found
        d[:, b] = shape if found else np.full(len(shape), np.nan)


@njit(**CACHED)
def _lay_out(first: Array, q: Array, length: Array, d: Array, reached: Array) -> float:
    """Write segments (3n,) and the last point (3,) of bends and lengths; return how far points moved [m]."""
    frame, after, change, moved = first.copy(), np.empty((3, 3)), np.zeros(3), 0.0
    reached[:] = 0.0
    for j in range(len(length)):
        _turn_by(frame, q[j, 0], q[j, 1], after)
        frame[:] = after
        for c in range(3):
            new = length[j] * frame[0, c]
            change[c] += new - d[3 * j + c]
            reached[c] += new
            d[3 * j + c] = new
            moved = max(moved, abs(change[c]))
    return moved
