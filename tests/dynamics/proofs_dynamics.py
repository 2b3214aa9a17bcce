"""Proofs in motion: periods, modes, fall through air, energy, momentum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from arrays import simulate
from proof import DOWN, GRAVITY_M_S2, Options, along, cycle_s, largest, parameters, proof, steps, still
from scipy.linalg import eigh
from scipy.special import ellipk, jn_zeros

from strandcast.dynamics.masses import mass_layout, point_masses
from strandcast.dynamics.model import StringModel

TAUT = parameters(k_s=1e7)
MASSES = np.array([1.0, 1.0, 3.0, 1.0, 8.0])


def period_error(
    model: StringModel, p: np.ndarray, masses: np.ndarray, start: np.ndarray, expected_s: float
) -> float:
    """Relative error of the period with which a string released at `start` swings sideways."""
    times = steps(model, 3.2 * expected_s)
    hand = still(DOWN, times[-1] + 1.0)
    simulated, _ = simulate(model, p, masses, *hand, times, start)
    swing = np.einsum("fn,n,n->f", simulated[:, 1:, 0], masses, start[:, 0])
    return cycle_s(times, swing) / expected_s - 1.0


def sideways(shape: np.ndarray, places_m: np.ndarray, amplitude_m: float = 1e-3) -> np.ndarray:
    """Points hanging at `places_m` below the hand, moved sideways by the mode's shape: (n, 2) [m]."""
    return np.column_stack([shape * amplitude_m / np.abs(shape).max(), -places_m])


@proof("% of the period", lfcn=1e-3, lfcn_f32=0.05)
def pendulum(options: Options) -> float:
    """One point swings with the pendulum's period at any amplitude: 4 sqrt(l/g) K(sin(amplitude / 2))."""
    model = StringModel(0.3, 1, **options)
    errors = []
    for amplitude in (0.05, 1.5, 2.8):
        period = 4 * np.sqrt(0.3 / GRAVITY_M_S2) * ellipk(np.sin(amplitude / 2) ** 2)
        start = 0.3 * np.array([[np.sin(amplitude), -np.cos(amplitude)]])
        errors.append(period_error(model, TAUT, np.ones(1), start, period))
    return 100.0 * largest(np.array(errors))


@proof("% of the period", lfcn=5e-3, lfcn_f32=0.1)
def hanging_chain_modes(options: Options) -> float:
    """The first three modes of the hanging chain: zeros of Bessel's J0, corrected for the points.

    n equal points under equal spacings swing with w^2 = g/l0 times the zeros of the Laguerre polynomial L_n,
    which are j^2 / (4 k) (1 + (j^2 - 2) / (48 k^2)), k = n + 1/2, up to the fourth order in 1/k (Abramowitz
    and Stegun, 22.16.8).
    """
    n = 24
    model = StringModel(0.6, n, **options)
    place = np.arange(n, 0.0, -1.0)  # spacings from the tip's end to point i
    errors = []
    for j in jn_zeros(0, 3):
        k = n + 0.5
        zero = j**2 / (4 * k) * (1 + (j**2 - 2) / (48 * k**2))
        shape = np.array([np.polynomial.laguerre.lagval(zero, np.eye(n)[int(i) - 1]) for i in place])
        start = sideways(shape, model.places_m()[1:], 2e-4)
        period = 2 * np.pi / np.sqrt(zero * GRAVITY_M_S2 / model.spacing_m)
        errors.append(period_error(model, parameters(k_s=1e8), np.ones(n), start, period))
    return 100.0 * largest(np.array(errors))


@proof("% of the period", lfcn=0.01, lfcn_f32=0.1)
def weight_at_any_point(options: Options) -> float:
    """A weight at each point and one at the tip of a nearly massless string: the double pendulum's modes."""
    n, light, upper, tip = 5, 1e-4, 2.0, 1.0
    model = StringModel(0.25, n, **options)
    errors = []
    for place in range(1, n):
        layout = mass_layout(0.25, n, [place * model.spacing_m, 0.25])
        masses = point_masses(layout, np.array([upper, tip]), light)
        a, b = place * model.spacing_m, (n - place) * model.spacing_m
        pull = GRAVITY_M_S2 * np.array([(upper + tip) / a, tip / b])
        stiffness = np.array([[pull.sum(), -pull[1]], [-pull[1], pull[1]]])
        squares, shapes = eigh(stiffness, np.diag([upper, tip]))
        for square, shape in zip(squares, shapes.T, strict=True):
            bent = np.interp(model.places_m()[1:], [0.0, a, a + b], [0.0, *shape])
            start = sideways(bent, model.places_m()[1:], 1e-4)
            errors.append(period_error(model, TAUT, masses, start, 2 * np.pi / np.sqrt(square)))
    return 100.0 * largest(np.array(errors))


@proof("% of the period", lfcn=0.02, lfcn_f32=0.1)
def fast_periods(options: Options) -> float:
    """Stretch, clamp, bend and a taut string oscillate with the right periods at twenty steps per period.

    The default scheme averages stiffness over three time levels so that its leading error of the period, the
    24th part of (w h)^2 or 0.4 %, cancels.
    """
    period = 20 * 5e-4
    w2 = (2 * np.pi / period) ** 2
    l0 = 0.1
    one = StringModel(l0, 1, gravity_m_s2=0.0, **options)
    two = StringModel(2 * l0, 2, gravity_m_s2=0.0, **options)
    taut = StringModel(2 * l0, 2, **options)
    # Two points at right angles to the string, against the turn of the straight string, which is free.
    bent, bent_masses = np.array([3.0, -1.0]), np.array([2.0, 3.0])
    stiffness = w2 * l0**2 * (bent_masses @ bent**2) / (bent[1] - 2 * bent[0]) ** 2
    # A light point between the hand and a heavy one; its pulls over the lengths to which they stretch.
    heavy, light, k_s = 10.0, 0.02, 1e6
    pull = GRAVITY_M_S2 * np.array([heavy + light, heavy])
    pull = pull / (l0 + pull / k_s)
    squares, shapes = eigh(np.array([[pull.sum(), -pull[1]], [-pull[1], pull[1]]]), np.diag([light, heavy]))
    fast = np.argmax(squares)
    cases = (
        (one, parameters(k_s=w2), np.ones(1), np.array([[0.0, -l0 - 1e-4]]), 1, period),
        (
            one,
            parameters(k_s=1e6, k_ph=3 * w2 * l0**2),
            np.full(1, 3.0),
            along(DOWN[2:] + 1e-3, l0),
            0,
            period,
        ),
        (
            two,
            parameters(k_s=1e6, k_h=stiffness, k_sh=stiffness),
            bent_masses,
            sideways(bent, two.places_m()[1:], 1e-4),
            0,
            period,
        ),
        (
            taut,
            parameters(k_s=k_s),
            np.array([light, heavy]),
            sideways(shapes[:, fast], taut.places_m()[1:], 1e-4),
            0,
            2 * np.pi / np.sqrt(squares[fast]),
        ),
    )
    errors = []
    for model, p, masses, start, axis, expected in cases:
        times = steps(model, 3.2 * expected)
        hand = still(DOWN, 1.0)
        simulated, _ = simulate(model, p, masses, *hand, times, start, respace=model.gravity_m_s2 > 0)
        swing = simulated[:, 1, axis] + (l0 if axis else 0.0)
        errors.append(cycle_s(times, swing) / expected - 1.0)
    return 100.0 * largest(np.array(errors))


@proof("% of the amplitude", lfcn=0.02, lfcn_f32=0.2)
def driven_springs(options: Options) -> float:
    """A hand that shakes along the string, or turns back and forth, drives a point as a harmonic oscillator.

    x'' = -w^2 (x - a (1 - cos(s t))) from rest: a (1 - b cos(s t) + (b - 1) cos(w t)), b = w^2 / (w^2 - s^2).
    """
    w, s, l0, a = 2 * np.pi / 0.01, 2 * np.pi / 0.027, 0.1, 1e-3
    model = StringModel(l0, 1, gravity_m_s2=0.0, **options)
    times = steps(model, 0.04)
    fine = np.linspace(0.0, 0.05, 2001)
    still_hand, shaken = np.zeros_like(fine), a * (1 - np.cos(s * fine))
    along_string = np.column_stack([still_hand, -shaken, still_hand + DOWN[2]])
    about_clamp = np.column_stack([still_hand, still_hand, DOWN[2] + shaken])
    hanging = np.array([[0.0, -l0]])
    p = parameters(k_s=w**2)
    stretched, _ = simulate(model, p, np.ones(1), fine, along_string, times, hanging, respace=False)
    p = parameters(k_s=1e6, k_ph=2 * w**2 * l0**2)
    turned, _ = simulate(model, p, np.full(1, 2.0), fine, about_clamp, times, hanging, respace=False)
    b = w**2 / (w**2 - s**2)
    expected = a * (1 - b * np.cos(s * times) + (b - 1) * np.cos(w * times))
    size = np.abs(expected).max()
    return 100.0 * largest(-stretched[:, 1, 1] - l0 - expected, turned[:, 1, 0] / l0 - expected) / size


@proof("mm", lfcn=2e-3, lfcn_f32=0.1)
def fall_through_air(options: Options) -> float:
    """Points without springs, falling with the hand, follow m dv/dt = m g - C1 v - C2 v^2."""
    model = StringModel(0.2, 5, **options)
    mass, linear, square = 2.0, 0.7, 1.3
    root = np.sqrt(linear**2 + 4 * square * mass * GRAVITY_M_S2)
    speed, rate, q = (root - linear) / (2 * square), root / mass, (root - linear) / (root + linear)

    def fallen(t):
        return speed * t + speed * (1 + q) / (q * rate) * np.log((1 + q * np.exp(-rate * t)) / (1 + q))

    times = np.arange(0.0, 2.0001, 2e-3)
    hand = np.column_stack([np.zeros_like(times), -fallen(times), np.full_like(times, -np.pi / 2)])
    start = along(np.full(5, -np.pi / 2), model.spacing_m)
    air = parameters(k_s=1e-6, C_c1=linear, C_c2=square)
    simulated, _ = simulate(model, air, np.full(5, mass), times, hand, times[::10], start, respace=False)
    assert fallen(2.0) - fallen(1.99) > 0.99 * 0.01 * speed  # it has reached the terminal speed
    expected = start[:, 1] - fallen(times[::10])[:, None]
    return 1e3 * largest(simulated[:, 1:, 1] - expected, simulated[:, 1:, 0])


@proof("mm", lfcn=1e-6, lfcn_f32=0.02)
def towed_through_air(options: Options) -> float:
    """A string towed at constant speed keeps each segment along the drag and weight behind it."""
    model = StringModel(0.2, 5, **options)
    speed, linear, square, k_s = 3.0, 0.4, 0.9, 3e4
    drag = (linear + square * speed) * speed
    behind = np.arange(5, 0, -1)
    below = np.cumsum(MASSES[::-1])[::-1] * GRAVITY_M_S2
    angles = np.arctan2(-below, -drag * behind)
    rest = along(angles, model.spacing_m + np.hypot(drag * behind, below) / k_s)
    times = np.array([0.0, 1.0])
    hand = np.column_stack([speed * times, [0.0, 0.0], [0.0, 0.0]])
    p = parameters(k_s=k_s, c_s=50.0, c_h=0.05, c_sh=0.05, C_c1=linear, C_c2=square)
    velocity = np.full((5, 2), [speed, 0.0])
    simulated, _ = simulate(model, p, MASSES, times, hand, times[1:], rest, velocity, respace=False)
    return 1e3 * largest(simulated[0, 1:] - [speed, 0.0] - rest)


@dataclass(frozen=True)
class Motion:
    """A simulated motion, output at each step: what an observer sees at the steps between first and last."""

    x: np.ndarray  # (F, n+1, 2) positions
    v: np.ndarray  # (F, n+1, 2) velocities, central differences
    middle: np.ndarray  # (F+1, n+1, 2) velocities half a step before and after

    @classmethod
    def of(cls, simulated: np.ndarray, dt_s: float) -> Motion:
        middle = np.diff(simulated, axis=0) / dt_s
        return cls(simulated[1:-1], 0.5 * (middle[1:] + middle[:-1]), middle)

    def segments(self):
        """Lengths, rates of length, directions, angles and turn rates of the segments."""
        d, w = np.diff(self.x, axis=1), np.diff(self.v, axis=1)
        length = np.linalg.norm(d, axis=2)
        u = d / length[..., None]
        turn = (u[..., 0] * w[..., 1] - u[..., 1] * w[..., 0]) / length
        return length, (u * w).sum(2), u, np.unwrap(np.arctan2(d[..., 1], d[..., 0]), axis=1), turn


def hand_path(t: np.ndarray) -> np.ndarray:
    """A throw-like path of the hand: (T, 3)."""
    return np.column_stack([0.1 * np.sin(6 * t) ** 2, 0.05 * np.sin(4 * t) ** 2, -1.2 + np.sin(5 * t) ** 2])


def wrapped(angle: np.ndarray) -> np.ndarray:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def energy(motion: Motion, masses, spacing, k_s, k, k_ph, clamp):
    """Kinetic energy, and all energy of gravity, stretch, bends and clamp with it: (F,) each."""
    length, _, _, angle, _ = motion.segments()
    kinetic = 0.5 * (motion.v[:, 1:] ** 2).sum(-1) @ masses
    stored = GRAVITY_M_S2 * motion.x[:, 1:, 1] @ masses + 0.5 * k_s * ((length - spacing) ** 2).sum(1)
    stored += 0.5 * k * (np.diff(angle, axis=1) ** 2).sum(1) + 0.5 * k_ph * wrapped(angle[:, 0] - clamp) ** 2
    return kinetic, kinetic + stored


@proof("% of the largest kinetic energy", lfcn=0.8, lfcn_f32=0.8)
def energy_stays_without_dampers(options: Options) -> float:
    """k_h = k_sh, no damper, a hand at rest: kinetic energy, gravity, stretch and bends keep their sum."""
    model = StringModel(0.2, 5, **{**options, "dt_s": min(options["dt_s"], 2.5e-4)})
    p = parameters(k_s=2e5, k_h=0.3, k_sh=0.3, k_ph=0.5)
    folded = along(np.array([0.2, -0.1, 2.2, 0.6, -1.2]), model.spacing_m)
    times = steps(model, 1.0)
    simulated, _ = simulate(model, p, MASSES, *still(DOWN, 2.0), times, folded, respace=False)
    motion = Motion.of(simulated, model.dt_s)
    kinetic, total = energy(motion, MASSES, model.spacing_m, p[0], 0.3, 0.5, DOWN[2])
    assert not kinetic.max() < 5.0  # it does swing
    return 100.0 * float(np.ptp(total) / kinetic.max())


@proof("% of the largest kinetic energy", lfcn=0.02, lfcn_f32=0.1)
def energy_balance(options: Options) -> float:
    """With all dampers and a driven hand, energy grows by the hand's work less what dampers and air take.

    The hand pulls at point 0 against the first segment and the first joint's reaction, and turns against the
    clamp.
    """
    model = StringModel(0.2, 5, **options)
    k_s, c_s, k, c, linear, square, k_ph, c_ph = 2e4, 8.0, 0.3, 0.02, 0.3, 0.5, 1.5, 0.03
    p = np.array([k_s, c_s, k, c, k, c, linear, square, k_ph, c_ph])
    fine = np.arange(0.0, 0.6001, 5e-4)
    times = steps(model, 0.6)
    start = along(np.array([-1.2, -1.3, -1.4, -1.5, -1.6]), model.spacing_m)
    simulated, _ = simulate(model, p, MASSES, fine, hand_path(fine), times, start, respace=False)
    motion = Motion.of(simulated, model.dt_s)
    inner = times[1:-1]
    clamp = hand_path(inner)[:, 2]
    hand_v = np.column_stack([0.6 * np.sin(12 * inner), 0.2 * np.sin(8 * inner)])
    hand_turn = 5.0 * np.sin(10 * inner)
    kinetic, total = energy(motion, MASSES, model.spacing_m, k_s, k, k_ph, clamp)
    length, growth, u, angle, turn = motion.segments()
    bend_rate, speed = np.diff(turn, axis=1), np.linalg.norm(motion.v[:, 1:], axis=2)
    at_clamp = k_ph * (angle[:, 0] - clamp) + c_ph * (turn[:, 0] - hand_turn)
    at_joint = k * (angle[:, 1] - angle[:, 0]) + c * bend_rate[:, 0]
    normal = np.stack([-u[:, 0, 1], u[:, 0, 0]], axis=1)
    pull = (k_s * (length[:, 0] - model.spacing_m) + c_s * growth[:, 0])[:, None] * u[:, 0]
    on_hand = pull + ((at_clamp - at_joint) / length[:, 0])[:, None] * normal
    work = -(on_hand * hand_v).sum(1) - at_clamp * hand_turn
    dissipated = c_s * (growth**2).sum(1) + c * (bend_rate**2).sum(1) + c_ph * (turn[:, 0] - hand_turn) ** 2
    dissipated += (linear * speed**2 + square * speed**3).sum(1)
    power = work - dissipated
    done = np.r_[0.0, np.cumsum(0.5 * (power[1:] + power[:-1]) * model.dt_s)]
    assert not kinetic.max() < 2.0  # the hand does throw it
    return 100.0 * float(np.abs(total - total[0] - done).max() / kinetic.max())


@proof("% of the area", lfcn=0.05, lfcn_f32=0.5)
def friction_loop(options: Options) -> float:
    """The moment of friction that sticks runs through a loop of the area 4 M (a - s tanh(a / s)).

    a: amplitude of the bend, s: bend over which the full moment M builds up. The hand turns back and forth;
    the pendulum below it shows the clamp's moment.
    """
    length, clamp, linear, full, stick, turn_s = 0.1, 0.5, 6.0, 0.2, 0.05, 2.0
    model = StringModel(length, 1, **options)
    times = steps(model, 3 * turn_s)
    fine = np.linspace(0.0, 3 * turn_s, 6001)

    def turned(t):
        return DOWN[2] + 0.5 * np.sin(2 * np.pi * t / turn_s)

    hand = np.column_stack([np.zeros((6001, 2)), turned(fine)])
    p = parameters(k_s=1e6, k_ph=clamp, C_c1=linear)
    fixed = {"bend_friction": full, "friction_stick_rad_m": stick / length}
    simulated, _ = simulate(model, p, np.ones(1), fine, hand, times, **fixed)
    angle = np.unwrap(np.arctan2(simulated[:, 1, 1], simulated[:, 1, 0]))[times > 2 * turn_s - 1e-9]
    half = np.diff(angle) / model.dt_s
    inertia, air = length**2 * np.diff(half) / model.dt_s, linear * length**2 * 0.5 * (half[1:] + half[:-1])
    moment = -(inertia + air + GRAVITY_M_S2 * length * np.cos(angle[1:-1]))
    bend = (angle - turned(times[times > 2 * turn_s - 1e-9]))[1:-1]
    area = 0.5 * float((moment + np.roll(moment, 1)) @ (bend - np.roll(bend, 1)))
    reach = 0.5 * np.ptp(bend)
    assert reach > 3 * stick
    assert np.sum(np.diff(np.sign(np.diff(bend))) != 0) <= 2  # no small loops in the large one
    return 100.0 * abs(area / (4 * full * (reach - stick * np.tanh(reach / stick))) - 1.0)


@proof("% of the energy lost", lfcn=0.05, lfcn_f32=0.1)
def energy_lost_to_friction(options: Options) -> float:
    """Friction that sticks takes what its moments take, and never gives back more than its bends store."""
    model = StringModel(0.2, 5, **options)
    k_s, c_s, k, k_ph, full, stick = 2e4, 8.0, 0.3, 0.5, 0.1, 0.05
    p = parameters(k_s=k_s, c_s=c_s, k_h=k, k_sh=k, k_ph=k_ph)
    times = steps(model, 1.5)
    start = along(np.array([-0.5, -0.4, -0.6, -0.3, -0.5]), model.spacing_m)
    fixed = {"bend_friction": full, "friction_stick_rad_m": stick / model.spacing_m}
    simulated, _ = simulate(model, p, MASSES, *still(DOWN, 2.0), times, start, respace=False, **fixed)
    motion = Motion.of(simulated, model.dt_s)
    kinetic, total = energy(motion, MASSES, model.spacing_m, k_s, k, k_ph, DOWN[2])
    _, growth, _, angle, _ = motion.segments()
    change = np.diff(np.diff(angle, axis=1, prepend=DOWN[2]), axis=0)
    share = np.zeros((len(change) + 1, 5))
    first = along_bends(simulated[:2])
    share[0] = -np.sign(first) * np.expm1(-np.abs(first) / stick)
    for i, turn in enumerate(change):
        toward = np.sign(turn)
        share[i + 1] = toward + (share[i] - toward) * np.exp(-np.abs(turn) / stick)
    stretching = 0.5 * c_s * ((growth[1:] ** 2).sum(1) + (growth[:-1] ** 2).sum(1)) * model.dt_s
    rubbing = full * (0.5 * (share[1:] + share[:-1]) * change).sum(1)
    lost = np.r_[0.0, np.cumsum(stretching + rubbing)]
    stored = total + 0.5 * full * stick * (share**2).sum(1)
    assert np.diff(stored).max() < 1e-4 * kinetic.max()  # energy never grows
    assert rubbing.sum() > 1.0  # J/kg
    return 100.0 * float(np.abs(total - total[0] + lost).max() / lost[-1])


def along_bends(points: np.ndarray) -> np.ndarray:
    """Changes (n,) of the bends from the first to the second of two shapes (2, n+1, 2) [rad]."""
    d = np.diff(points, axis=1)
    return np.diff(np.diff(np.arctan2(d[..., 1], d[..., 0]), axis=1, prepend=DOWN[2]), axis=0)[0]


@proof("% of the largest momentum", lfcn=0.005, lfcn_f32=0.1)
def momentum(options: Options) -> float:
    """All momentum comes through the first segment and from gravity: inner forces have none."""
    model, factors = StringModel(0.2, 5, **options), np.array([0.0, 0.0, 1.0, 2.0, 1.0])
    p = parameters(k_s=2e4, c_s=5.0, k_h=0.5, c_h=0.02, k_sh=0.2, c_sh=0.01)
    times = steps(model, 0.5)
    start = along(np.array([0.2, -0.4, 0.3, -0.9, -0.5]), model.spacing_m)
    path = (*still(DOWN, 1.0), times, start)
    simulated, _ = simulate(model, p, MASSES, *path, respace=False, bend_factor=factors)
    motion = Motion.of(simulated, model.dt_s)
    held = motion.middle[:, 1:].transpose(0, 2, 1) @ MASSES
    length, growth, u, _, _ = motion.segments()
    force = -(p[0] * (length[:, 0] - model.spacing_m) + p[1] * growth[:, 0])[:, None] * u[:, 0]
    force[:, 1] -= MASSES.sum() * GRAVITY_M_S2
    given = np.cumsum(force, axis=0) * model.dt_s
    return 100.0 * float(np.abs(held[1:] - held[0] - given).max() / np.abs(held).max())


@proof("% of the largest angular momentum", lfcn=5e-4, lfcn_f32=0.1)
def angular_momentum(options: Options) -> float:
    """Around a hand that does not clamp, only gravity turns the string: springs and dampers do not."""
    model = StringModel(0.2, 5, reading="sign", **options)
    p = parameters(k_s=2e4, c_s=5.0, k_h=0.5, c_h=0.02, k_sh=0.2, c_sh=0.01)
    times = steps(model, 0.5)
    start = along(np.array([0.2, -0.4, 0.3, -0.9, -0.5]), model.spacing_m)
    path = (*still(DOWN, 1.0), times, start)
    simulated, _ = simulate(model, p, MASSES, *path, respace=False, rest_curl_rad_m=1.0)
    motion = Motion.of(simulated, model.dt_s)
    x, v = 0.5 * (simulated[1:, 1:] + simulated[:-1, 1:]), motion.middle[:, 1:]
    held = (x[..., 0] * v[..., 1] - x[..., 1] * v[..., 0]) @ MASSES
    given = np.cumsum(-GRAVITY_M_S2 * motion.x[:, 1:, 0] @ MASSES) * model.dt_s
    return 100.0 * float(np.abs(held[1:] - held[0] - given).max() / np.abs(held).max())
