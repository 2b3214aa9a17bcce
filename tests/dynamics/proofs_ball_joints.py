"""MuJoCo as a witness in space: a chain of ball joints that a hand moves and turns out of every plane."""

from functools import cache

import mujoco
import numpy as np
from arrays import simulate
from proof import Options, parameters, proof
from proofs_dynamics import MASSES
from scipy.spatial.transform import Rotation

from strandcast.dynamics.model import StringModel

SPACING_M, BENDING, CLAMP = 0.04, 0.5, 2.0
DAMPING, CLAMP_DAMPING = 0.02, 0.05
CLAMP_OFFSET_RAD = np.array([0.2, -0.1])
BENT_RAD = (0.0, 0.15, 0.1)  # of every joint at the start, about x, y and z of the link before it
UNTIL_S, FRAMES, STEP_S = 0.4, 41, 1e-5
HEAVY = 1e9  # mass and moments of inertia of the hand, which the chain must not slow down
# A link's moment of inertia about itself, where a string has none: a thousandth of the lightest link's
# across, and half of it, to extrapolate to none.
AXIAL_INERTIA = (2e-6, 1e-6)

# The hand: a harmonic motion along each axis, and a steady turn about one that is none of them.
SIZE_M, RATE_RAD_S, PHASE = (
    np.array([0.08, 0.06, 0.08]),
    np.array([8.0, 12.0, 10.0]),
    np.array([0.0, 1.6, 1.0]),
)
TURN_RAD_S = np.array([1.0, 2.0, -2.0])
# Its direction, a normal and their vector product at the start, in rows.
FRAME = np.array([[0.6, 0.0, -0.8], [0.0, 1.0, 0.0], [0.8, 0.0, 0.6]])


def clamp_pose(t: np.ndarray) -> np.ndarray:
    """Poses (T, 9) of the hand."""
    place = SIZE_M * np.sin(np.outer(t, RATE_RAD_S) + PHASE)
    turned = Rotation.from_rotvec(np.outer(t, TURN_RAD_S))
    return np.hstack([place, turned.apply(FRAME[0]), turned.apply(FRAME[1])])


def numbers(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in values)


def quaternion(turn: Rotation) -> np.ndarray:
    return turn.as_quat(scalar_first=True)


def chain_model(axial_inertia: float, damped: bool) -> mujoco.MjModel:
    """Rigid links with point masses at their ends, in a heavy hand on three springs without gravity."""
    inside = ""
    left, up = CLAMP_OFFSET_RAD
    for i in reversed(range(5)):
        spring, damper = (CLAMP, CLAMP_DAMPING) if i == 0 else (BENDING, DAMPING)
        at = "0 0 0" if i == 0 else f"{SPACING_M} 0 0"
        rest = Rotation.from_rotvec([0.0, -up, left]) if i == 0 else Rotation.identity()
        inside = (
            f'<body pos="{at}" quat="{numbers(quaternion(rest))}">'
            f'<joint type="ball" stiffness="{spring}" damping="{damper if damped else 0.0}"/>'
            f'<inertial pos="{SPACING_M} 0 0" mass="{MASSES[i]}" diaginertia="{axial_inertia} 1e-10 1e-10"/>'
            f'<site name="{i + 1}" pos="{SPACING_M} 0 0"/>{inside}</body>'
        )
    slides = "".join(
        f'<joint type="slide" axis="{numbers(axis)}" stiffness="{HEAVY * rate**2}"/>'
        for axis, rate in zip(np.eye(3), RATE_RAD_S, strict=True)
    )
    light = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    hand = f'<inertial pos="0 0 0" mass="{HEAVY}" diaginertia="{numbers(np.full(3, HEAVY))}"/>'
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler balanceinertia="true"/><option timestep="{STEP_S}" integrator="RK4" '
        f'gravity="0 0 -9.81"/><worldbody><body gravcomp="1">{slides}{light}'
        f'<body gravcomp="1" quat="{numbers(quaternion(Rotation.from_matrix(FRAME.T)))}"><joint type="ball"/>'
        f'{hand}<site name="0"/>{inside}</body></body></worldbody></mujoco>'
    )


@cache
def ball_chain(axial_inertia: float, damped: bool) -> tuple[np.ndarray, np.ndarray]:
    """Points 0…n of MuJoCo's chain (F, n+1, 3) [m], and their velocities at the start (n+1, 3) [m/s]."""
    model = chain_model(axial_inertia, damped)
    data = mujoco.MjData(model)
    data.qpos[:3], data.qvel[:3] = SIZE_M * np.sin(PHASE), SIZE_M * RATE_RAD_S * np.cos(PHASE)
    data.qvel[3:6] = FRAME @ TURN_RAD_S
    for first in range(11, model.nq, 4):  # after three slides, the hand's turn and the clamp
        data.qpos[first : first + 4] = quaternion(Rotation.from_rotvec(BENT_RAD))
    mujoco.mj_forward(model, data)
    velocity = np.empty((6, 3))
    for point in range(6):
        jacobian = np.empty((3, model.nv))
        mujoco.mj_jacSite(model, data, jacobian, None, point)
        velocity[point] = jacobian @ data.qvel
    every = round(UNTIL_S / (FRAMES - 1) / STEP_S)
    simulated = np.empty((FRAMES, 6, 3))
    for frame in range(FRAMES):
        mujoco.mj_kinematics(model, data)
        simulated[frame] = data.site_xpos
        mujoco.mj_step(model, data, every)
    return simulated, velocity


def expected(damped: bool) -> np.ndarray:
    """The chain of links without inertia about themselves, extrapolated."""
    more, less = (ball_chain(inertia, damped)[0] for inertia in AXIAL_INERTIA)
    return 2.0 * less - more


def swung_string(options: Options, k_s: float, damped: bool) -> np.ndarray:
    """Points (F, n+1, 3) [m] of the string that starts as the chain does."""
    damping, at_clamp = (DAMPING, CLAMP_DAMPING) if damped else (0.0, 0.0)
    p = parameters(
        k_s=k_s,
        c_s=1e-6 * k_s,
        k_h=BENDING,
        c_h=damping,
        k_sh=BENDING,
        c_sh=damping,
        k_ph=CLAMP,
        c_ph=at_clamp,
    )
    chain, velocity = ball_chain(AXIAL_INERTIA[1], damped)
    times = np.linspace(0.0, UNTIL_S, 401)
    simulated, _ = simulate(
        StringModel(5 * SPACING_M, 5, **options),
        p,
        MASSES,
        times,
        clamp_pose(times),
        times[::10],
        chain[0, 1:],
        velocity[1:],
        clamp_offset_rad=CLAMP_OFFSET_RAD[None],
    )
    return simulated


def distance_mm(simulated: np.ndarray, damped: bool) -> float:
    """Root mean square distance from MuJoCo's chain."""
    chain = expected(damped)
    assert np.abs(chain[:, 0] - simulated[:, 0]).max() < 1e-7  # nothing slows the hand down
    tip = chain[:, -1] - chain[:, -1].mean(axis=0)
    assert np.linalg.svd(tip)[1][-1] > 0.01 * np.sqrt(FRAMES)  # a centimetre off every plane
    return 1e3 * float(np.sqrt(((simulated - chain) ** 2).sum(-1).mean()))


@proof("mm", lfcn=0.02, lfcn_f32=0.1)
def mujoco_balls(options: Options) -> float:
    """A string too stiff to stretch moves in space as MuJoCo's chain of ball joints does, with dampers."""
    return distance_mm(swung_string(options, 1e8, damped=True), damped=True)


@proof("mm", lfcn=1e-3)
def mujoco_balls_limit(options: Options) -> float:
    """Without dampers, string and chain have one limit: no stretch, and no inertia of a link about itself.

    With dampers they differ by what the chain twists under their torques about it, which is micrometres.
    """
    fine = {**options, "dt_s": options["dt_s"] / 4.0}
    soft, stiff = (swung_string(fine, k_s, damped=False) for k_s in (1e8, 1e9))
    return distance_mm((10.0 * stiff - soft) / 9.0, damped=False)
