"""Joints held to their command by springs and dampers, which yield to the torques that the arm needs.

A loop without feed-forward of the arm's dynamics lets gravity and inertia move its joints off the command,
by other amounts in every motion; the second-order response of `arm.servo` cannot predict it. Many controllers
carry gravity alone, such as a Franka's joint impedance.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import scipy
from numba import njit

from strandcast.arm.servo import Servo, command_at, respond
from strandcast.arm.spatial_dynamics import WORK, Links, SpatialDynamics, mass_matrix, write_torques
from strandcast.threads import over_ranges

# Longest step of the simulation; chosen: on joints that yield by 0.7 rad the error is a third of a
# milliradian (rms).
STEP_S = 4e-3
SETTLING = 50  # iterations until gravity and springs balance; chosen
# The search's starts: natural frequencies of all loops [rad/s], whether their dampers take the command's
# speed or act against all motion, and carried shares of gravity; damping ratio, motor inertia over the
# link's, and delay [s]. Chosen.
FREQUENCIES_RAD_S, SHARES, CARRIED = (8.0, 16.0, 32.0, 64.0), (0.0, 1.0), (0.05, 0.95)
START_DAMPING_RATIO, START_ARMATURE, START_DELAY_S = 0.9, 0.3, 4e-3
# Standard deviations about that start, of logarithms, shares and delays [s], of the carried share of gravity,
# and of a measured angle [rad], with neighbouring samples sharing their error. Chosen.
SPREAD, CARRIED_SPREAD = np.array([1.5, 1.0, 1.0, 0.5, 0.02]), 0.5
ANGLE_RAD, SHARED_SAMPLES = 5e-4, 10
CHANGE = 1e-3  # of finite differences, in these standard deviations
CONVERGED = 1e-3  # relative changes of cost and unknowns; chosen
FOUND_RAD = 1e-3  # rms of every joint, above which a search from another frequency is tried; chosen


@dataclass(frozen=True, eq=False)
class YieldingJoints:
    """Loops with torque = stiffness (c - q) + damping (share c' - q'), where c is the delayed command.

    Attributes
    ----------
    dynamics
        The arm's.
    loops
        (5, J) stiffness [N m/rad], damping [N m s/rad], motor inertia [kg m²], share, delay [s].
    carried
        Share of gravity that the controller feeds forward.
    """

    dynamics: SpatialDynamics
    loops: np.ndarray
    carried: float = 0.0


# How joints follow a command.
JointResponse = Servo | YieldingJoints


def follow(joints: JointResponse, time_s: np.ndarray, q_command: np.ndarray) -> np.ndarray:
    """Return the angles of joints that follow a command from rest; see `arm.servo.respond`."""
    if isinstance(joints, Servo):
        return respond(joints, time_s, q_command)
    commands = np.asarray(q_command, float).reshape(-1, *np.shape(q_command)[-2:])
    given = joints.dynamics, joints.loops[None], np.array([joints.carried])
    return _simulated(*given, time_s, commands).reshape(np.shape(q_command))


def identify_yielding(
    time_s: np.ndarray, q_command: np.ndarray, q: np.ndarray, dynamics: SpatialDynamics
) -> tuple[YieldingJoints, np.ndarray]:
    """Fit the loops to logged motions.

    Parameters
    ----------
    time_s
        (T,) evenly spaced [s].
    q_command, q
        (B, T, J) commanded and measured angles [rad].

    Returns
    -------
    The joints, and (J,) the rms of their residual without a constant offset [rad].
    """
    inertia = np.diag(dynamics.mass_matrix(q_command[0, 0]))
    count = q.shape[0] * q.shape[1]
    scale_rad = ANGLE_RAD * np.sqrt(SHARED_SAMPLES)

    def off(points: np.ndarray) -> np.ndarray:
        """Return residuals (P, B, T, J) of unknowns (P, 5 J + 1)."""
        loops, carried = _loops(points)
        given = np.repeat(loops, len(q), axis=0), np.repeat(carried, len(q))
        found = _simulated(dynamics, *given, time_s, np.tile(q_command, (len(points), 1, 1)))
        away = found.reshape(len(points), *q.shape) - q
        return np.asarray(away - away.mean(axis=2, keepdims=True))

    def residuals(point: np.ndarray, start: np.ndarray) -> np.ndarray:
        return np.append(off(point[None]).ravel() / scale_rad, (point - start) / spread)

    def slopes(point: np.ndarray, _: np.ndarray) -> np.ndarray:
        changes = np.diag(CHANGE * spread)
        away = off(np.vstack([point + changes, point[None]])).reshape(len(point) + 1, -1)
        moved = (away[:-1] - away[-1]) / np.diag(changes)[:, None]
        return np.vstack([moved.T / scale_rad, np.diag(1.0 / spread)])

    spread = np.append(np.repeat(SPREAD, len(inertia)), CARRIED_SPREAD)
    low = np.append(np.repeat([-np.inf, -np.inf, -np.inf, 0.0, 0.0], len(inertia)), 0.0)
    high = np.append(np.repeat([np.inf, np.inf, np.inf, 1.5, 0.2], len(inertia)), 1.0)
    how: dict[str, Any] = {"bounds": (low, high), "x_scale": spread, "ftol": CONVERGED, "xtol": CONVERGED}
    found: list[tuple[np.ndarray, np.ndarray]] = []
    for start in _starts(inertia, off):
        begin = np.clip(start, low + 1e-6, high - 1e-6)
        fit = scipy.optimize.least_squares(residuals, begin, slopes, args=(start,), **how)
        left_rad = np.sqrt(np.mean(off(fit.x[None])[0].reshape(count, -1) ** 2, axis=0))
        found.append((fit.x, left_rad))
        if left_rad.max() < FOUND_RAD:
            break
    point, left_rad = min(found, key=lambda one: float((one[1] ** 2).sum()))
    loops, carried = _loops(point[None])
    return YieldingJoints(dynamics, loops[0], float(carried[0])), left_rad


def _starts(inertia: np.ndarray, off: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Return the best start of each frequency, the best first: (S, 5 J + 1)."""
    ways = [list(product([w], SHARES, CARRIED)) for w in FREQUENCIES_RAD_S]
    starts = np.array([[_start(inertia, *way) for way in same] for same in ways])
    errors = (off(starts.reshape(-1, starts.shape[-1])) ** 2).sum(axis=(1, 2, 3)).reshape(starts.shape[:2])
    best = starts[np.arange(len(starts)), np.argmin(errors, axis=1)]
    return np.asarray(best[np.argsort(errors.min(axis=1))])


def _start(inertia: np.ndarray, frequency_rad_s: float, share: float, carried: float) -> np.ndarray:
    """Return unknowns (5 J + 1,): logarithms of stiffness, damping, motor inertia; share; delay; carried."""
    whole = (1.0 + START_ARMATURE) * inertia
    stiffness = whole * frequency_rad_s**2
    damping = 2.0 * START_DAMPING_RATIO * whole * frequency_rad_s
    rest = np.repeat([share, START_DELAY_S], len(inertia))
    logarithms = np.log(np.concatenate([stiffness, damping, START_ARMATURE * inertia]))
    return np.concatenate([logarithms, rest, [carried]])


def _loops(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return loops (P, 5, J) and carried shares of gravity (P,) of unknowns (P, 5 J + 1)."""
    rows = points[:, :-1].reshape(len(points), 5, -1)
    return np.concatenate([np.exp(rows[:, :3]), rows[:, 3:]], axis=1), points[:, -1]


def _simulated(
    dynamics: SpatialDynamics,
    loops: np.ndarray,
    carried: np.ndarray,
    time_s: np.ndarray,
    commands: np.ndarray,
) -> np.ndarray:
    """Return angles (P, T, J) for loops (P or 1, 5, J), carried shares (P or 1,) and commands (P, T, J)."""
    every_s = (time_s[-1] - time_s[0]) / (len(time_s) - 1)
    stride = max(1, int(STEP_S / every_s))
    commands = np.ascontiguousarray(commands)  # another layout would compile another kernel
    answer = np.empty(commands.shape)
    moved = dynamics.links, dynamics.gravity_m_s2
    own = np.array([dynamics.viscous, dynamics.armature])
    over_ranges(
        len(commands),
        lambda first, last: _simulate(
            first, last, commands, every_s, stride, loops, carried, *moved, own, answer
        ),
    )
    return answer


@njit(cache=True)
def _settles(q: np.ndarray, command: np.ndarray, needed: np.ndarray, stiffness: np.ndarray) -> bool:
    """Let springs (J,) carry the torques that are needed at angles; return whether these stay the same."""
    stays = True
    for j in range(len(q)):
        before, q[j] = q[j], command[j] - needed[j] / stiffness[j]
        stays &= q[j] == before
    return stays


@njit(cache=True)
def _write(values: np.ndarray, to: np.ndarray) -> None:
    """Write values (J,) by number: numba takes 3 s to compile the assignment of a whole array."""
    for j in range(len(values)):
        to[j] = values[j]


@njit(cache=True, nogil=True)
def _simulate(
    first: int,
    last: int,
    commands: np.ndarray,
    every_s: float,
    stride: int,
    loops: np.ndarray,
    carried: np.ndarray,
    links: Links,
    whole_gravity: np.ndarray,
    own: np.ndarray,
    answer: np.ndarray,
) -> None:
    """Fill the angles `answer` (P, T, J) of the motions `first` to `last`, by the trapezoidal rule.

    Mass matrix and the links' own torques are evaluated at the step's extrapolated middle: the scheme is of
    second order without iterations.
    """
    _, count, joints = commands.shape
    h = stride * every_s
    none, push, needed = np.zeros(joints), np.empty(joints), np.empty(joints)
    middle_q, middle_v, work = np.empty(joints), np.empty(joints), np.empty((WORK, joints, 3))
    for p in range(first, last):
        stiffness, damping, motor, share, delay_s = loops[min(p, len(loops) - 1)]
        gravity = (1.0 - carried[min(p, len(carried) - 1)]) * whole_gravity
        q, v, change = commands[p, 0].copy(), np.zeros(joints), np.zeros(joints)
        for _ in range(SETTLING):
            write_torques(q, none, none, links, gravity, work, needed)
            if _settles(q, commands[p, 0], needed, stiffness):
                break
        _write(q, answer[p, 0])
        for k in range(0, count - 1, stride):
            for j in range(joints):
                middle_q[j], middle_v[j] = q[j] + 0.5 * h * v[j], v[j] + 0.5 * change[j]
            whole = mass_matrix(middle_q, links)
            for j in range(joints):
                brake = damping[j] + own[0, j]
                whole[j, j] += motor[j] + own[1, j] + 0.5 * h * brake + 0.25 * h * h * stiffness[j]
            write_torques(middle_q, middle_v, none, links, gravity, work, needed)
            for j in range(joints):
                before = command_at(commands, p, j, k - delay_s[j] / every_s)
                after = command_at(commands, p, j, k + stride - delay_s[j] / every_s)
                off = 0.5 * (before + after) - q[j] - 0.5 * h * v[j]
                rate = share[j] * (after - before) / h - v[j]
                push[j] = stiffness[j] * off + damping[j] * rate - own[0, j] * v[j] - needed[j]
            change = h * np.linalg.solve(whole, push)
            for j in range(joints):
                for t in range(1, min(stride, count - 1 - k) + 1):
                    s = t / stride
                    answer[p, k + t, j] = q[j] + s * h * (v[j] + 0.5 * s * change[j])
                q[j] += h * (v[j] + 0.5 * change[j])
                v[j] += change[j]
