"""Comparisons with references that share no code with the simulator: SciPy's DOP853, and MuJoCo."""

from functools import cache

import mujoco
import numpy as np
import reference
from arrays import simulate
from proof import Options, along, largest, parameters, proof
from proofs_dynamics import MASSES, hand_path

from strandcast.dynamics.model import READINGS, StringModel

GROWING_STIFF = parameters(
    k_s=2e4, c_s=5.0, k_h=0.5, c_h=0.02, k_sh=0.2, c_sh=0.01, C_c1=0.1, C_c2=0.3, k_ph=2.0, c_ph=0.02
)
STRAIGHTENING_STIFF = parameters(
    k_s=2e4, c_s=5.0, k_h=0.2, c_h=0.02, k_sh=0.5, c_sh=0.1, C_c1=0.1, C_c2=0.3, k_ph=2.0, c_ph=0.02
)
TIME_S = np.arange(0.0, 0.4001, 5e-4)
OUT_S = np.linspace(0.0, 0.4, 41)
SPACING_M, CURL_RAD_M, CLAMP_RAD = 0.04, 2.0, 0.15
FACTOR = (1.5, 1.0, 2.5, 1.0, 0.5)
START = hand_path(np.zeros(1))[0, :2] + along(np.array([-1.2, -1.5, -1.3, -1.4, -1.7]), SPACING_M)
VELOCITY = np.linspace([0.0, 0.0], [0.4, -0.2], 5)
# Half-widths of the switch: a taut string pulls at a point with many times its weight.
SWITCH = {"rate": 0.5, "sign": 0.02, "strain": 20.0}
# The switch feeds energy in and turns within a step: there the order shows only at much finer steps.
LATE_ORDER = ("rate", "sh")
# Reading, stiffer coefficients, drag along over across (0: the same in all directions), bend per length over
# which friction builds up (0: no friction).
CASES = (
    *((reading, stiff, 0.0, 0.0) for reading in READINGS for stiff in ("h", "sh")),
    ("strain", "h", 0.2, 0.0),
    ("strain", "h", 0.0, 2.0),
)
FRICTION = 0.15


def moving_hand(t):
    speed = np.array([0.6 * np.sin(12 * t), 0.2 * np.sin(8 * t), 5.0 * np.sin(10 * t)])
    return hand_path(np.array([t]))[0], speed


@cache
def truth(reading: str, stiff: str, drag_along: float, stick_rad_m: float) -> np.ndarray:
    """Points 1…n by DOP853; a function of constants only, so that it can be cached."""
    p = GROWING_STIFF if stiff == "h" else STRAIGHTENING_STIFF
    equations = reference.Equations(
        p,
        MASSES,
        SPACING_M,
        reading,
        SWITCH[reading],
        CURL_RAD_M,
        CLAMP_RAD,
        np.array(FACTOR),
        drag_along=drag_along,
        friction=FRICTION if stick_rad_m else 0.0,
        stick_rad=stick_rad_m * SPACING_M,
    )
    return reference.integrate(equations, moving_hand, START, OUT_S, VELOCITY)


def distance_m(options: Options, reading: str, stiff: str, drag_along: float, stick_rad_m: float) -> float:
    """Root mean square distance of the simulated points from DOP853's."""
    p = GROWING_STIFF if stiff == "h" else STRAIGHTENING_STIFF
    fixed = {"reading": reading, "switch_width": None if reading == "rate" else SWITCH[reading]}
    model = StringModel(0.2, 5, **fixed, **options)
    simulated, _ = simulate(
        model,
        p,
        MASSES,
        TIME_S,
        hand_path(TIME_S),
        OUT_S,
        START,
        VELOCITY,
        respace=False,
        rest_curl_rad_m=CURL_RAD_M,
        bend_factor=FACTOR,
        clamp_offset_rad=CLAMP_RAD,
        drag_along=drag_along,
        bend_friction=FRICTION if stick_rad_m else 0.0,
        friction_stick_rad_m=stick_rad_m,
    )
    expected = truth(reading, stiff, drag_along, stick_rad_m)
    return float(np.sqrt(((simulated[:, 1:] - expected) ** 2).sum(-1).mean()))


@proof("mm", lfcn=5e-3, lfcn_f32=1e-2)
def dop853(options: Options) -> float:
    """Independent equations under an independent integrator of order eight, in every reading."""
    assert np.ptp(truth(*CASES[0])[:, -1, 0]) > 0.1  # the tip does travel
    return 1e3 * largest(np.array([distance_m(options, *case) for case in CASES]))


@proof("orders", lfcn=0.1)
def order(options: Options) -> float:
    """Shortfall of the order of convergence from two."""
    orders = []
    for case in CASES:
        if case[:2] == LATE_ORDER:
            continue
        coarse, fine = (distance_m({**options, "dt_s": 2 * options["dt_s"] / k}, *case) for k in (1, 4))
        orders.append(np.log2(coarse / fine) / 2.0)
    return float(np.max(2.0 - np.array(orders)))


WHEEL_M, WHEEL_RAD_S = 0.15, 8.0
BENDING, DAMPING, CLAMP, CLAMP_DAMPING = 0.5, 0.02, 2.0, 0.05


@cache
def mujoco_chain(until_s: float, frames: int) -> np.ndarray:
    """Points 0…n of MuJoCo's chain of hinges on the rim of a wheel that nothing slows down: (F, n+1, 2) [m].

    Rigid links with point masses at their ends; the hinges' springs and dampers are the string's.
    """
    inside = ""
    for i in reversed(range(5)):
        spring, damper = (CLAMP, CLAMP_DAMPING) if i == 0 else (BENDING, DAMPING)
        at = f"{WHEEL_M if i == 0 else SPACING_M} 0 0"
        inside = (
            f'<body pos="{at}"><joint axis="0 -1 0" stiffness="{spring}" damping="{damper}"/>'
            f'<inertial pos="{SPACING_M} 0 0" mass="{MASSES[i]}" diaginertia="1e-10 1e-10 1e-10"/>'
            f'<site name="{i + 1}" pos="{SPACING_M} 0 0"/>{inside}</body>'
        )
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="1e-4" integrator="RK4" gravity="0 0 -9.81"/><worldbody>'
        f'<body><joint axis="0 -1 0"/><inertial pos="0 0 0" mass="1" diaginertia="1e9 1e9 1e9"/>'
        f'<site name="0" pos="{WHEEL_M} 0 0"/>{inside}</body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0] = -np.pi / 2, WHEEL_RAD_S
    every = round(until_s / (frames - 1) / 1e-4)
    simulated = np.empty((frames, 6, 2))
    for frame in range(frames):
        mujoco.mj_kinematics(model, data)
        simulated[frame] = data.site_xpos[:, [0, 2]]
        mujoco.mj_step(model, data, every)
    return simulated


@proof("mm", lfcn=0.03, lfcn_f32=0.2)
def mujoco_hinges(options: Options) -> float:
    """A string too stiff to stretch, on the rim of a wheel, moves as MuJoCo's chain of hinges does."""
    model = StringModel(0.2, 5, **options)
    p = parameters(
        k_s=1e8,
        c_s=100.0,
        k_h=BENDING,
        c_h=DAMPING,
        k_sh=BENDING,
        c_sh=DAMPING,
        k_ph=CLAMP,
        c_ph=CLAMP_DAMPING,
    )
    expected = mujoco_chain(0.5, 51)
    times = np.linspace(0.0, 0.5, 501)
    turned = WHEEL_RAD_S * times - np.pi / 2
    pose = np.column_stack([WHEEL_M * np.cos(turned), WHEEL_M * np.sin(turned), turned])
    velocity = WHEEL_RAD_S * expected[0, 1:, ::-1] * [-1.0, 1.0]
    assert np.abs(expected[:, 0] - pose[::10, :2]).max() < 1e-6  # nothing slows the wheel down
    simulated, _ = simulate(model, p, MASSES, times, pose, times[::10], expected[0, 1:], velocity)
    return 1e3 * float(np.sqrt(((simulated - expected) ** 2).sum(-1).mean()))
