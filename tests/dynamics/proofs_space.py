"""Proofs in space: against the plane, independent equations and integrators, and analysis."""

from dataclasses import replace
from functools import cache
from itertools import pairwise, product

import numpy as np
import reference_space
from arrays import simulate, start_shape
from proof import GRAVITY_M_S2, Options, along, largest, parameters, proof, steps
from proofs_dynamics import MASSES, hand_path
from reference_space import ClampState, SpatialEquations
from scipy.integrate import quad, solve_bvp
from scipy.spatial.transform import Rotation

from strandcast.dynamics.model import StringModel

STRING = parameters(
    k_s=2e4, c_s=5.0, k_h=0.5, c_h=0.1, k_sh=0.2, c_sh=0.02, C_c1=0.1, C_c2=0.3, k_ph=2.0, c_ph=0.02
)
TIME_S = np.arange(0.0, 0.4001, 5e-4)
OUT_S = np.linspace(0.0, 0.4, 21)
ORIGIN_M = np.array([0.3, -0.2, 0.1])
CURL_RAD_M = np.array([2.0, -3.0])
FACTOR = (1.5, 1.0, 2.5, 1.0, 0.5)
SWITCH = {"rate": 0.5, "strain": 20.0}
STICKING = {"bend_friction": 0.15, "friction_stick_rad_m": 2.0}
TILTED = np.array([[0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])


def poses_in_plane(pose: np.ndarray, origin_m: np.ndarray, right: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return the poses (T, 9) in space of poses (T, 3) in the plane of the unit vectors `right` and `up`."""
    plane = np.stack([right, up])
    turned = np.column_stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])])
    return np.hstack([origin_m + pose[:, :2] @ plane, turned @ plane, turned[:, ::-1] * [-1.0, 1.0] @ plane])


@proof("mm", lfcn=1e-6, lfcn_f32=0.05)
def plane_in_space(options: Options) -> float:
    """A string that moves in a vertical plane of any direction moves as the plane's does."""
    start = along(np.array([-1.2, -1.5, -1.1, -1.4, -1.8]), 0.04)
    pose = hand_path(TIME_S)
    apart = []
    for reading in SWITCH:
        model = StringModel(0.2, 5, reading=reading, **options)
        for more in ({"drag_along": 0.2}, {"bend_friction": 0.01}, STICKING):
            bent = {"rest_curl_rad_m": 3.0, "clamp_offset_rad": 0.3, "bend_factor": FACTOR, **more}
            flat, _ = simulate(model, STRING, MASSES, TIME_S, pose, OUT_S, start, **bent)
            poses = poses_in_plane(pose, ORIGIN_M, *TILTED)
            tilted, _ = simulate(
                model, STRING, MASSES, TIME_S, poses, OUT_S, start @ TILTED + ORIGIN_M, **bent
            )
            apart.append(tilted - (flat @ TILTED + ORIGIN_M))
    return 1e3 * largest(*apart)


@proof("mm", lfcn=1e-6, lfcn_f32=0.02)
def rests_as_in_the_plane(options: Options) -> float:
    """A clamped, curled string hangs in space as in the plane, from clamps pointing down, sideways and up."""
    model = StringModel(0.2, 5, **options)
    bent = {"rest_curl_rad_m": -1.5, "clamp_offset_rad": 0.2, "bend_factor": FACTOR}
    apart = []
    for angle in (-1.5, 0.4, 1.2):
        pose = np.array([0.0, 0.0, angle])
        flat = start_shape(model, STRING, MASSES, pose, **bent)
        spatial = poses_in_plane(pose[None], ORIGIN_M, *TILTED)[0]
        apart.append(start_shape(model, STRING, MASSES, spatial, **bent) - (flat @ TILTED + ORIGIN_M))
    return 1e3 * largest(*apart)


def swung(t: float, phase: float, away: float) -> ClampState:
    """A clamp that moves and turns about all axes, at first pointing down and along `away` times x."""
    s = 5.0
    place = 0.05 * np.array([np.sin(s * t + phase), np.sin(0.7 * s * t), np.sin(0.9 * s * t + phase)])
    velocity = (
        0.05
        * s
        * np.array([np.cos(s * t + phase), 0.7 * np.cos(0.7 * s * t), 0.9 * np.cos(0.9 * s * t + phase)])
    )
    size, axis = 0.8 * np.sin(s * t), np.array([2.0 * away, 2.0, -2.0]) / 3.0
    direction = np.array([away, 0.3, -1.0])
    frame = np.stack([direction, reference_space.cross(direction, np.array([0.0, 1.0, 0.0])), np.zeros(3)])
    frame[:2] /= np.linalg.norm(frame[:2], axis=1)[:, None]
    frame[2] = reference_space.cross(frame[0], frame[1])
    return ClampState(
        place, velocity, Rotation.from_rotvec(size * axis).apply(frame), 0.8 * s * np.cos(s * t) * axis
    )


def first_clamp(t: float) -> ClampState:
    return swung(t, 0.0, 0.5)


def second_clamp(t: float) -> ClampState:
    at = swung(t, 1.0, -0.7)
    return at._replace(place=at.place + np.array([0.14, 0.03, 0.02]))


def pose_of(state: ClampState) -> np.ndarray:
    return np.r_[state.place, state.frame[0], state.frame[1]]


def start_of(two_ends: bool) -> np.ndarray:
    """Points 1…n out of any plane; between two clamps the last is the second clamp's."""
    turn = np.linspace(0.0, 1.2, 5)
    u = np.column_stack([0.6 * np.cos(turn), 0.6 * np.sin(turn), np.linspace(-1.0, 0.3, 5)])
    points = first_clamp(0.0).place + np.cumsum(0.04 * u / np.linalg.norm(u, axis=1)[:, None], axis=0)
    if two_ends:
        points += (second_clamp(0.0).place - points[-1]) * np.arange(1, 6)[:, None] / 5
    return points


# Reading, two ends, drag along the string, friction that sticks.
CASES = (
    ("rate", False, 0.0, False),
    ("strain", False, 0.2, False),
    ("rate", True, 0.0, False),
    ("strain", False, 0.0, True),
    ("strain", True, 0.0, True),
    ("rate", True, 0.2, True),
)
DAMPING_OF_JOINTS = [3, 5, 9]  # columns of `parameters`


def string_of(damped: float) -> np.ndarray:
    """Return the parameters (10,) of `STRING` with `damped` times the damping in its joints."""
    string = STRING.copy()
    string[DAMPING_OF_JOINTS] *= damped
    return string


@cache
def truth(reading: str, two_ends: bool, drag_along: float, sticks: bool, damped: float = 1.0) -> np.ndarray:
    """Free points by DOP853; a function of constants only, so that it can be cached."""
    equations = SpatialEquations(
        string_of(damped), MASSES, 0.04, reading, SWITCH[reading], CURL_RAD_M, np.array(FACTOR), drag_along
    )
    if sticks:
        full, stick = STICKING.values()
        equations = replace(equations, friction=full, stick_rad=stick * equations.rest_m)
    free = start_of(two_ends)[: 4 if two_ends else 5]
    return reference_space.integrate(
        equations, first_clamp, free, OUT_S, far=second_clamp if two_ends else None
    )


def distance_m(
    options: Options, reading: str, two_ends: bool, drag_along: float, sticks: bool, damped: float = 1.0
) -> float:
    """Root mean square distance of the simulated free points from DOP853's."""
    model = StringModel(0.2, 5, reading=reading, switch_width=SWITCH[reading], **options)
    pose = np.array([pose_of(first_clamp(t)) for t in TIME_S])
    if two_ends:
        pose = np.hstack([pose, [pose_of(second_clamp(t)) for t in TIME_S]])
    fixed = {"rest_curl_rad_m": CURL_RAD_M[None], "drag_along": drag_along, "respace": False}
    fixed |= STICKING if sticks else {}
    simulated, _ = simulate(
        model, string_of(damped), MASSES, TIME_S, pose, OUT_S, start_of(two_ends), bend_factor=FACTOR, **fixed
    )
    expected = truth(reading, two_ends, drag_along, sticks, damped)
    return float(np.sqrt(((simulated[:, 1 : 1 + expected.shape[1]] - expected) ** 2).sum(-1).mean()))


@proof("mm", lfcn=3e-3, lfcn_f32=1e-2)
def dop853_in_space(options: Options) -> float:
    """Independent equations under an independent integrator of order eight, one end driven and both."""
    assert np.ptp(truth(*CASES[0])[:, -1, 1]) > 0.05  # the tip leaves the plane
    return 1e3 * largest(np.array([distance_m(options, *case) for case in CASES]))


@proof("mm", lfcn=0.05)
def strong_damping_in_space(options: Options) -> float:
    """DOP853 again, at four times the step: damping that a step's inertia does not hold is bounded."""
    return 1e3 * distance_m({**options, "dt_s": 4 * options["dt_s"]}, "strain", True, 0.0, False, 10.0)


@proof("orders", lfcn=0.25)
def order_in_space(options: Options) -> float:
    """Shortfall of the order of convergence from two."""
    orders = []
    for case in CASES[1:]:
        coarse, fine = (distance_m({**options, "dt_s": 2 * options["dt_s"] / k}, *case) for k in (1, 4))
        orders.append(np.log2(coarse / fine) / 2.0)
    return float(np.max(2.0 - np.array(orders)))


@proof("mm", lfcn=1e-6, lfcn_f32=0.05)
def turned_space(options: Options) -> float:
    """Without gravity, turning and moving the frame turns and moves the motion, a clamp's roll included."""
    model = StringModel(0.2, 5, gravity_m_s2=0.0, **options)
    fixed = {"rest_curl_rad_m": CURL_RAD_M[None], "clamp_offset_rad": np.array([[0.2, -0.1]])}
    fixed["respace"] = False
    turn, origin = Rotation.from_rotvec([0.7, -1.9, 0.4]), np.array([0.4, -0.3, 0.2])
    apart = []
    for clamps, more in product(((first_clamp,), (first_clamp, second_clamp)), ({}, STICKING)):
        states = [[clamp(t) for t in TIME_S] for clamp in clamps]
        pose = np.hstack([[pose_of(at) for at in each] for each in states])
        turned = np.hstack(
            [
                np.hstack([turn.apply(each[:, c : c + 3]) + (origin if c == 0 else 0.0) for c in (0, 3, 6)])
                for each in np.split(pose, len(clamps), axis=1)
            ]
        )
        two_ends = len(clamps) == 2
        start = start_of(two_ends)
        fixed |= {"far_offset_rad": np.array([[0.1, 0.3]])} if two_ends else {}
        plain, _ = simulate(model, STRING, MASSES, TIME_S, pose, OUT_S, start, **fixed, **more)
        other, _ = simulate(
            model, STRING, MASSES, TIME_S, turned, OUT_S, turn.apply(start) + origin, **fixed, **more
        )
        apart.append(other - (turn.apply(plain.reshape(-1, 3)) + origin).reshape(plain.shape))
    return 1e3 * largest(*apart)


@proof("% of the precession", lfcn=0.02, lfcn_f32=0.02)
def spherical_pendulum(options: Options) -> float:
    """One point swings between two heights, and its plane turns by the spherical pendulum's angle per swing.

    From the integrals of energy and of the momentum about the vertical: with z the height over l,
    l^2 z'^2 = 2 (e - g l z) (1 - z^2) - p^2 between its two roots (Landau and Lifshitz, Mechanics, 14).
    """
    length, low, speed = 0.3, 0.6, 0.9
    model = StringModel(length, 1, **options)
    out = np.cos(low)
    start = length * np.array([[np.sin(low), 0.0, -out]])
    momentum, e = np.sin(low) * speed / length, 0.5 * (speed / length) ** 2 - GRAVITY_M_S2 / length * out
    gravity = GRAVITY_M_S2 / length
    roots = np.sort(np.roots([2 * gravity, -2 * e, -2 * gravity, 2 * e - momentum**2]).real)[:2]
    middle, half = roots.mean(), 0.5 * np.ptp(roots)
    far_root = e / gravity - roots.sum()

    def swept(angle):
        z = middle + half * np.sin(angle)
        return momentum / (1 - z * z) / np.sqrt(2 * gravity * (far_root - z))

    per_swing = quad(swept, -0.5 * np.pi, 0.5 * np.pi, epsabs=1e-12)[0]
    times = steps(model, 1.5)
    down = np.r_[np.zeros(3), 0.0, 0.0, -1.0, 1.0, 0.0, 0.0]
    velocity = np.array([[0.0, speed, 0.0]])
    simulated, _ = simulate(
        model,
        parameters(k_s=1e7),
        np.ones(1),
        np.array([0.0, 2.0]),
        np.array([down, down]),
        times,
        start,
        velocity,
    )
    height, angle = simulated[:, 1, 2], np.unwrap(np.arctan2(simulated[:, 1, 1], simulated[:, 1, 0]))
    # Between passes of the middle height: at a turning point itself, heights differ by less than rounding.
    passes = np.flatnonzero(np.diff(np.sign(height - length * middle)) != 0)
    if len(passes) < 3:
        return float("nan")
    at = []
    for first, last in pairwise(passes):
        k = first + int(np.argmax(np.abs(height[first:last] - length * middle)))
        near = slice(k - (last - first) // 10, k + (last - first) // 10 + 1)
        since = times[near] - times[k]
        peaks = np.roots(np.polyder(np.polyfit(since, height[near], 4)))
        peak = peaks[np.argmin(np.abs(peaks))].real
        at.append(np.polyval(np.polyfit(since, angle[near], 5), peak))
    found = (at[-1] - at[0]) / (len(at) - 1)
    return 100.0 * abs((found - 0.5 * np.pi) / (per_swing - 0.5 * np.pi) - 1.0)


@proof("mm", lfcn=1e-3, lfcn_f32=0.05)
def curl_at_rest(options: Options) -> float:
    """Without gravity a curled string rests on the circle's polygon, in the plane of its curl."""
    n, spacing = 12, 0.025
    model = StringModel(n * spacing, n, gravity_m_s2=0.0, **options)
    p = parameters(k_s=1e5, k_h=0.5, k_sh=0.5, k_ph=1.0)
    pose = pose_of(first_clamp(0.0))
    frame = first_clamp(0.0).frame
    points = start_shape(
        model, p, np.ones(n), pose, rest_curl_rad_m=CURL_RAD_M[None], clamp_offset_rad=np.zeros((1, 2))
    )
    inward = (CURL_RAD_M @ frame[1:]) / np.hypot(*CURL_RAD_M)
    angle = np.hypot(*CURL_RAD_M) * spacing * np.arange(n)
    u = np.cos(angle)[:, None] * frame[0] + np.sin(angle)[:, None] * inward
    expected = pose[:3] + spacing * np.cumsum(u, axis=0)
    return 1e3 * largest(points[1:] - expected)


@proof("mm", lfcn=0.2, lfcn_f32=0.2)
def helix_at_rest(options: Options) -> float:
    """Without gravity a curl that turns along the string rests on a helix, extrapolated over two meshes.

    Of curvature k and torsion t: radius k / (k^2 + t^2), pitch 2 pi t / (k^2 + t^2), by the rotation of the
    Frenet frame about its Darboux vector.
    """
    length, torsion, curvature = 0.3, 20.0, float(np.hypot(*(4.0 * CURL_RAD_M)))
    state = first_clamp(0.0)
    left, up = CURL_RAD_M / np.hypot(*CURL_RAD_M)
    normal = left * state.frame[1] + up * state.frame[2]
    rate = np.hypot(curvature, torsion)
    axis = (torsion * state.frame[0] + curvature * np.cross(state.frame[0], normal)) / rate
    s = np.linspace(0.0, length, 41)[:, None]
    forward = torsion / rate * axis
    across = state.frame[0] - forward
    expected = state.place + s * forward + np.sin(rate * s) / rate * across
    expected = expected + (1.0 - np.cos(rate * s)) / rate * np.cross(axis, across)
    assert np.ptp(rate * s) > 2 * np.pi  # more than one winding
    found = []
    for n in (20, 40):
        model = StringModel(length, n, gravity_m_s2=0.0, **options)
        # Half a segment's bend lies before the first segment's middle.
        p = parameters(k_s=1e6, k_h=5.0, k_sh=5.0, k_ph=10.0)
        fixed = {"rest_curl_rad_m": 4.0 * CURL_RAD_M[None], "rest_torsion_rad_m": torsion}
        half = 0.5 * model.spacing_m * 4.0 * CURL_RAD_M
        points = start_shape(
            model,
            p,
            np.ones(n),
            pose_of(state),
            expected[40 // n :: 40 // n],
            clamp_offset_rad=half[None],
            settle=True,
            **fixed,
        )
        found.append(points[:: n // 20])
    return 1e3 * largest((4.0 * found[1] - found[0]) / 3.0 - expected[::2])


@cache
def rod_between_clamps(length_m: float, stiffness: float, weight: float) -> np.ndarray:
    """Places (101, 3) [m] of a heavy, inextensible rod between two clamps, without twist: boundary values.

    r' = t, B t' = m x t, m' = f x t with the force f along the rod, f' = (0, 0, weight);
    m has no part along t.
    """
    ends = rod_ends()

    def slope(s, y):
        t, m, f = y[3:6].T, y[6:9].T, y[9:12].T
        down = np.zeros_like(f)
        down[:, 2] = weight
        return np.vstack([t.T, (np.cross(m, t) / stiffness).T, np.cross(f, t).T, down.T])

    def boundary(a, b):
        at = np.concatenate([a[:6] - ends[0], b[:3] - ends[1][:3]])
        # The last tangent has two unknown components: those across the clamp's direction vanish.
        across = np.linalg.svd(ends[1][None, 3:])[2][1:]
        return np.concatenate([at, across @ b[3:6], [a[6:9] @ a[3:6]]])

    s = np.linspace(0.0, length_m, 101)
    guess = np.zeros((12, len(s)))
    share = s / length_m
    guess[:3] = ends[0][:3, None] + share * (ends[1][:3] - ends[0][:3])[:, None]
    guess[2] -= 0.1 * np.sin(np.pi * share)
    direction = np.gradient(guess[:3], s, axis=1)
    guess[3:6] = direction / np.linalg.norm(direction, axis=0)
    solved = solve_bvp(slope, boundary, s, guess, tol=1e-8, max_nodes=20000)
    assert solved.success, solved.message
    return solved.sol(s)[:3].T


def rod_ends() -> tuple[np.ndarray, np.ndarray]:
    """Place and tangent of the rod at its two clamps."""
    first = np.array([1.0, 0.5, -0.3])
    last = np.array([0.8, -0.7, 0.6])
    return (
        np.r_[0.0, 0.0, 0.0, first / np.linalg.norm(first)],
        np.r_[0.25, 0.05, 0.05, last / np.linalg.norm(last)],
    )


@proof("mm", lfcn=2e-3, lfcn_f32=2e-2)
def elastica_between_clamps(options: Options) -> float:
    """Between two clamps out of any plane the string rests like a rod, extrapolated over 20 and 40 points."""
    length, stiffness, density = 0.3, 4e-3, 0.05
    expected = rod_between_clamps(length, stiffness, density * GRAVITY_M_S2)
    ends = rod_ends()
    normals = [np.cross(end[3:], [0.0, 0.0, 1.0]) for end in ends]
    pose = np.r_[ends[0], normals[0], ends[1][:3], -ends[1][3:], normals[1]]
    found = []
    for n in (20, 40):
        model = StringModel(length, n, **options)
        k = stiffness / model.spacing_m
        p = parameters(k_s=1e6 * n, k_h=k, k_sh=k, k_ph=2 * k)
        points = start_shape(model, p, np.full(n, density * model.spacing_m), pose)
        found.append(points[:: n // 20])
    return 1e3 * largest((4.0 * found[1] - found[0]) / 3.0 - expected[::5])
