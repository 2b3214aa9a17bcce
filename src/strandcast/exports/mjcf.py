"""A fitted string on its arm as a MuJoCo model: point masses on links that bend at hinges.

Masses, bending, drag, clamp, rest curl and dry friction carry over. Bending coefficients that differ between
growing and straightening bends have no counterpart: each hinge takes their mean. Drag that differs along and
across the string becomes their mean, too. Links are rigid unless the string stretches noticeably under its
own weight.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from strandcast.arm.load import PlanarArm, clamp_frame
from strandcast.arm.urdf import read_spec
from strandcast.core.strings import PARAMETERS, StringBatch

# All chosen.
STRING_KG = 0.01
STEP_S = 2e-4  # at most
STABLE_STEP = 0.5  # with springs along the links: share of the longest stable step
STRETCHES = 1e-3  # hanging at rest, relative to its length: from here on links have a spring along them
BEAD_RADIUS_M = 0.003  # of the spheres that the air acts on
POINT_RADIUS_M = 1e-4  # of the spheres that give the mass points their inertia, which MuJoCo needs
POINT_KG_M2 = 1e-14
LINK_RADIUS_M = 0.02
SERVO_N_M_RAD, SERVO_KG_M2 = 5e3, 0.1
SWUNG_RAD = 0.8
HAND_KG = 1e9  # for a string in units of its plain points' mass: it cannot move such a hand
AIR_KG_M3 = 1.2
GRAVITY_M_S2 = 9.81


@dataclass(frozen=True, eq=False)
class StringInMuJoCo:
    """The numbers of one fitted string as MuJoCo takes them, for a given total mass.

    Attributes
    ----------
    spacing_m
        Length of a link.
    mass_kg
        (n,) of the points at the links' far ends.
    stiffness_n_m_rad, damping_n_m_s_rad, friction_n_m
        (n,) of the hinges at the links' near ends, the clamp's first.
    rest_rad
        (n,) angles of the hinges without load; the first is the clamp's offset.
    stretch_n_m, stretch_n_s_m
        Spring and damper along each link, or None for rigid links.
    viscosity_pa_s, drag
        Of the air, and the drag coefficient of a sphere of BEAD_RADIUS_M at every point.
    """

    spacing_m: float
    mass_kg: np.ndarray
    stiffness_n_m_rad: np.ndarray
    damping_n_m_s_rad: np.ndarray
    friction_n_m: np.ndarray
    rest_rad: np.ndarray
    stretch_n_m: float | None
    stretch_n_s_m: float
    viscosity_pa_s: float
    drag: float

    @property
    def step_s(self) -> float:
        """Time step [s]: STEP_S, or a whole fraction of it that keeps springs along the links stable.

        MuJoCo integrates springs explicitly: stable up to 2 / omega, and no mode of the chain is faster than
        omega = 2 sqrt(stiffness / least mass).
        """
        if self.stretch_n_m is None:
            return STEP_S
        longest_s = STABLE_STEP * np.sqrt(self.mass_kg.min() / self.stretch_n_m)
        return STEP_S / max(1, int(np.ceil(STEP_S / longest_s)))


def in_mujoco(string: StringBatch, length_m: float, total_kg: float = STRING_KG) -> StringInMuJoCo:
    """Return a fitted string (a batch of one) in MuJoCo's terms.

    Parameters
    ----------
    length_m
        Free length [m].
    total_kg
        Mass of the string with all it carries, which its motion does not show.
    """
    given = dict(zip(PARAMETERS, string.parameters[0].tolist(), strict=True))
    string = string.applied()
    masses, factor = string.masses[0], string.bend_factor[0]
    unit_kg = total_kg / masses.sum()
    spacing_m = length_m / len(masses)

    def hinges(clamp: str, growing: str, straightening: str) -> np.ndarray:
        inner = np.full(len(masses) - 1, 0.5 * (given[growing] + given[straightening]))
        return np.asarray(unit_kg * factor * np.r_[given[clamp], inner])

    rest = np.full(len(masses), string["rest_curl_rad_m"][0] * spacing_m)
    rest[0] = string["clamp_offset_rad"][0]
    friction = np.full(len(masses), string["bend_friction"][0])
    friction[0] = 0.0
    along = float(string["drag_along"][0]) or 1.0
    air = 0.5 * (1.0 + along)
    hanging_m = GRAVITY_M_S2 * np.cumsum(masses[::-1]).sum() / given["k_s"]
    return StringInMuJoCo(
        spacing_m=spacing_m,
        mass_kg=unit_kg * masses,
        stiffness_n_m_rad=hinges("k_ph", "k_h", "k_sh"),
        damping_n_m_s_rad=hinges("c_ph", "c_h", "c_sh"),
        friction_n_m=unit_kg * factor * friction,
        rest_rad=rest,
        stretch_n_m=unit_kg * given["k_s"] if hanging_m > STRETCHES * length_m else None,
        stretch_n_s_m=unit_kg * given["c_s"],
        # MuJoCo's drag on a sphere: 6 pi viscosity r v + density drag pi r^2 v^2.
        viscosity_pa_s=air * unit_kg * given["C_c1"] / (6.0 * np.pi * BEAD_RADIUS_M),
        drag=air * unit_kg * given["C_c2"] / (AIR_KG_M3 * np.pi * BEAD_RADIUS_M**2),
    )


def arm_with_string(
    arm: PlanarArm, string: StringInMuJoCo, posture_rad: np.ndarray, bends_rad: np.ndarray
) -> str:
    """Return MJCF of the arm with the string in its clamp.

    The keyframes ``start`` (hanging) and ``swing`` (turned by 0.8 rad at the clamp) have the arm in the given
    posture, which position servos hold; these are no model of the real ones.

    Parameters
    ----------
    posture_rad
        (J,) the arm's moving joints.
    bends_rad
        (n,) the string's hinges where it hangs at rest in that posture.
    """
    spec = read_spec(arm.urdf_path)
    spec.modelname = f"{arm.name} with a fitted string"
    spec.compiler.discardvisual = False
    spec.compiler.boundinertia = POINT_KG_M2
    _set_physics(spec, string, -GRAVITY_M_S2 * arm.plane[1], string.step_s)
    _hold(spec, arm)
    _show(spec, arm)
    place, axes = clamp_frame(arm)
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, axes.T.ravel())
    hand = spec.body(arm.clamp.link).add_body(name="hand", pos=place, quat=quat)
    hang(hand, string)
    model = spec.compile()
    qpos = np.zeros(model.nq)
    angles = arm.held | dict(zip(arm.joints, posture_rad, strict=True))
    for name, angle in angles.items():
        qpos[model.joint(name).qposadr[0]] = angle
    ctrl = np.array([angles[model.actuator(k).name] for k in range(model.nu)])
    bends = np.array([model.joint(f"bend_{k}").qposadr[0] for k in range(len(bends_rad))])
    for name, swung in (("start", 0.0), ("swing", SWUNG_RAD)):
        qpos[bends] = bends_rad
        qpos[bends[0]] += swung
        spec.add_key(name=name, qpos=qpos.copy(), ctrl=ctrl)
    spec.compile()
    return str(spec.to_xml())


def string_on_hand(string: StringInMuJoCo, step_s: float) -> mujoco.MjModel:
    """Return the string alone, x to the right and y up, on a hand of three coordinates: x, y, angle."""
    spec = mujoco.MjSpec()
    _set_physics(spec, string, np.array([0.0, -GRAVITY_M_S2, 0.0]), step_s)
    hand = spec.worldbody.add_body(name="hand")
    hand.explicitinertial, hand.mass, hand.inertia = True, 1.0, [1e-12, 1e-12, 1e-12]
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    for kind, axis in ((slide, [1, 0, 0]), (slide, [0, 1, 0]), (hinge, [0, 0, 1])):
        hand.add_joint(type=kind, axis=axis, armature=HAND_KG)
    hang(hand, string)
    return spec.compile()


def hang(hand: mujoco.MjsBody, string: StringInMuJoCo) -> None:
    """Add the string's links, each a child of the one before; the hand's x axis points along the string."""
    body, length = hand, string.spacing_m
    least = [0.4 * POINT_RADIUS_M**2] * 3
    for k, mass in enumerate(string.mass_kg):
        body = body.add_body(name=f"string_{k + 1}", pos=[length if k else 0.0, 0.0, 0.0])
        body.explicitinertial, body.mass, body.inertia = True, mass, [mass * i for i in least]
        body.ipos = [length, 0.0, 0.0]
        body.add_joint(
            name=f"bend_{k}",
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=[0, 0, 1],
            stiffness=[string.stiffness_n_m_rad[k], 0, 0],
            damping=[string.damping_n_m_s_rad[k], 0, 0],
            frictionloss=string.friction_n_m[k],
            springref=string.rest_rad[k],
        )
        if string.stretch_n_m is not None:
            body.add_joint(
                name=f"stretch_{k}",
                type=mujoco.mjtJoint.mjJNT_SLIDE,
                axis=[1, 0, 0],
                stiffness=[string.stretch_n_m, 0, 0],
                damping=[string.stretch_n_s_m, 0, 0],
            )
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            pos=[length, 0, 0],
            size=[BEAD_RADIUS_M, 0, 0],
            fluid_ellipsoid=1,
            fluid_coefs=[string.drag, 0, 0, 0, 0],
            **_SHOWN,
        )
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[0, 0, 0, length, 0, 0],
            size=[0.5 * BEAD_RADIUS_M, 0, 0],
            **_SHOWN,
        )
    body.add_site(name="tip", pos=[length, 0, 0])


_SHOWN = {"mass": 0.0, "contype": 0, "conaffinity": 0}


def _set_physics(
    spec: mujoco.MjSpec, string: StringInMuJoCo, gravity_m_s2: np.ndarray, step_s: float
) -> None:
    spec.compiler.degree = False
    spec.option.timestep, spec.option.gravity = step_s, gravity_m_s2
    # Stable with the stiffest dampers; its errors of first order are small at this step.
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.density, spec.option.viscosity = AIR_KG_M3, string.viscosity_pa_s


def _hold(spec: mujoco.MjSpec, arm: PlanarArm) -> None:
    """Add a stiff, critically damped position servo at every joint of the throw, and at the held ones."""
    damping = 2.0 * np.sqrt(SERVO_N_M_RAD * SERVO_KG_M2)
    for name in (*arm.joints, *arm.held):
        spec.joint(name).armature = SERVO_KG_M2
        servo = spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=name)
        servo.set_to_position(kp=SERVO_N_M_RAD, kv=damping)
    for body in spec.bodies[1:]:
        body.gravcomp = 1.0


def _show(spec: mujoco.MjSpec, arm: PlanarArm) -> None:
    """Draw the arm as capsules from link to link: meshes do not travel with the file."""
    model = arm.model()
    for k in range(1, model.nbody):
        parent, reach = model.body_parentid[k], model.body_pos[k]
        if parent and np.linalg.norm(reach) > LINK_RADIUS_M:
            spec.body(model.body(parent).name).add_geom(
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=[0, 0, 0, *reach],
                size=[LINK_RADIUS_M, 0, 0],
                **_SHOWN,
            )
