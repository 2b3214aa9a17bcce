"""Arm and string as one MuJoCo model: the string is a chain of rigid links with bending springs."""

from dataclasses import dataclass, field, replace
from itertools import pairwise

import mujoco
import numpy as np

from strandcast.arm.load import Arm, PlanarArm
from strandcast.arm.urdf import dofs_of, read_spec
from strandcast.lab.servo import JointDrives
from strandcast.lab.strings import DAMPING_TIME_S, PhysicalString

LINK_M = 0.015  # chosen
CLAY_KG_M3 = 1800.0
PIPE_DIAMETER_M = 0.006
AIR_KG_M3 = 1.2
AIR_PA_S = 1.8e-5
LOCKED_KG_M2 = 1e6  # rotor inertia of a joint that is held
OFF = mujoco.mjtDisableBit


@dataclass(frozen=True)
class StringLink:
    """A straight link of the string: its ends along it [m], its pipe, the weight at its far end [kg]."""

    from_m: float
    to_m: float
    pipe: bool
    pipe_kg: float
    weight_kg: float

    @property
    def length_m(self) -> float:
        """Its length [m]."""
        return self.to_m - self.from_m


def links_of(string: PhysicalString, link_m: float = LINK_M) -> list[StringLink]:
    """Divide a string into links of about `link_m` that end at weights and at the ends of pipes."""
    marks = [0.0, string.length_m, *(place for place, _ in string.weights)]
    marks += [place for start, end, _ in string.pipes for place in (start, end)]
    marks = sorted({round(mark, 9) for mark in marks})
    places = [0.0]
    for start, end in pairwise(marks):
        places += np.linspace(start, end, max(1, round((end - start) / link_m)) + 1)[1:].tolist()
    links = []
    for start, end in pairwise(places):
        pipe = next((p for p in string.pipes if p[0] - 1e-9 <= start and end <= p[1] + 1e-9), None)
        weight = sum(mass for place, mass in string.weights if abs(place - end) < 1e-9)
        share = 0.0 if pipe is None else pipe[2] * (end - start) / (pipe[1] - pipe[0])
        links.append(StringLink(start, end, pipe is not None, share, weight))
    return links


@dataclass(frozen=True)
class SlipInClamp:
    """A clamp that lets go for a while: from when since the motion's start, for how long [s], how far [m]."""

    from_s: float
    duration_s: float
    length_m: float

    def speed_m_s(self, time_s: float) -> float:
        """Return the speed at which the string leaves the clamp: a half sine."""
        phase = (time_s - self.from_s) / self.duration_s
        if not 0.0 <= phase <= 1.0:
            return 0.0
        return float(0.5 * np.pi * self.length_m / self.duration_s * np.sin(np.pi * phase))


@dataclass(frozen=True, eq=False)
class LabRig:
    """The compiled model, and the indices of its parts.

    Attributes
    ----------
    arm_dofs
        (J,) coordinates of the moving joints; all are hinges, so speeds have the same indices.
    held
        Angle [rad] of each held joint, by coordinate.
    string_dofs
        (H,) coordinates of the string's hinges, from the clamp on; in space the
        speeds of its ball joints, three each.
    nodes
        (N,) sites at the ends of the links, from the clamp on.
    places_m
        (N,) their positions along the string [m].
    plane
        (2, 3) unit vectors of the plane of the throw; in space (3, 3), the axes themselves.
    slide
        Coordinate along which the string leaves the clamp, and how it does; None if it is held.
    """

    model: mujoco.MjModel
    arm_dofs: np.ndarray
    held: dict[int, float]
    string_dofs: np.ndarray
    nodes: np.ndarray
    places_m: np.ndarray
    plane: np.ndarray = field(repr=False)
    slide: tuple[int, SlipInClamp] | None = None

    def nodes_m(self, data: mujoco.MjData) -> np.ndarray:
        """Return the nodes' positions (N, 2) in the plane, or (N, 3) in space [m]."""
        return np.asarray(data.site_xpos[self.nodes] @ self.plane.T)


def build_rig(
    arm: PlanarArm,
    drive: JointDrives,
    string: PhysicalString,
    held: tuple[np.ndarray, np.ndarray],
    dt_s: float,
    slip: SlipInClamp | None = None,
) -> LabRig:
    """Return the model of an arm that holds a string.

    Parameters
    ----------
    string
        The string, with its free length at the start of this throw.
    held
        Where it leaves the hand, and its axes there, as `strandcast.arm.load.clamp_frame` has them.
    dt_s
        Step of the integration [s].
    slip
        If given, the string can slide out of the clamp, and one more node is at the clamp.
    """
    spec = driven_arm(arm, drive, arm.plane[1], dt_s)
    links = links_of(string)
    hand = spec.body(arm.clamp.link)
    _hang(hand, links, string, held)
    if slip is None:
        return compiled_rig(spec, arm, links, arm.plane)
    hand.add_site(name="clamp", pos=held[0])
    # Along the first link, which turns about the clamp. The rotor's inertia keeps the given speed.
    spec.body("string_0").add_joint(
        name="slide", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0], armature=LOCKED_KG_M2
    )
    rig = compiled_rig(spec, arm, links, arm.plane)
    return replace(
        rig,
        nodes=np.array([rig.model.site("clamp").id, *rig.nodes]),
        places_m=np.array([-slip.length_m, *rig.places_m]),
        slide=(int(rig.model.joint("slide").dofadr[0]), slip),
    )


def compiled_rig(spec: mujoco.MjSpec, arm: Arm, links: list[StringLink], plane: np.ndarray) -> LabRig:
    """Return the rig of an arm with a string: the joints `bend_k`, none within a pipe, and nodes `node_k`."""
    model = spec.compile()
    ids = {model.joint(k).name: k for k in range(model.njnt)}
    bends = [ids[name] for k in range(len(links)) if (name := f"bend_{k}") in ids]
    return LabRig(
        model=model,
        arm_dofs=dofs_of(model, arm.joints),
        held={int(model.joint(name).dofadr[0]): angle for name, angle in arm.held.items()},
        string_dofs=np.flatnonzero(np.isin(model.dof_jntid, bends)),
        nodes=np.array([model.site(f"node_{k}").id for k in range(len(links) + 1)]),
        places_m=np.array([0.0, *(link.to_m for link in links)]),
        plane=plane,
    )


def driven_arm(arm: Arm, drive: JointDrives, upwards: np.ndarray, dt_s: float) -> mujoco.MjSpec:
    """Return the arm's links and motors in air, to hang a string on; `upwards` (3,) is against gravity."""
    spec = read_spec(arm.urdf_path)
    spec.option.timestep = dt_s
    # First-order integrators have errors of millimetres at the tip at any affordable step.
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.density, spec.option.viscosity = AIR_KG_M3, AIR_PA_S
    # Nothing touches, and all rotations in a plane are about its normal: no constraint is needed.
    spec.option.disableflags = int(OFF.mjDSBL_CONSTRAINT | OFF.mjDSBL_CONTACT | OFF.mjDSBL_AUTORESET)
    spec.option.gravity = -9.81 * upwards
    for name, inertia, friction in zip(arm.joints, drive.armature, drive.friction, strict=True):
        joint = spec.joint(name)
        joint.armature, joint.damping = inertia, [friction, 0.0, 0.0]
    for name in arm.held:
        spec.joint(name).armature = LOCKED_KG_M2
    return spec


def bending_length_m(links: list[StringLink], k: int) -> float:
    """Return how much of the string bends at the joint before link `k`: half of both links beside it [m].

    The clamp holds the direction, so half a link bends before the first joint.
    """
    if k == 0:
        return 0.5 * links[0].length_m
    return 0.5 * (links[k].length_m + links[k - 1].to_m - links[k - 1].from_m)


def _hang(
    body: mujoco.MjsBody, links: list[StringLink], string: PhysicalString, held: tuple[np.ndarray, np.ndarray]
) -> None:
    """Add the string's links to the hand's body, each a child of the one before."""
    place, frame = held
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, frame.T.ravel())
    for k, link in enumerate(links):
        body = body.add_body(name=f"string_{k}", pos=place, quat=quat)
        body.add_site(name=f"node_{k}")
        if k == 0 or not (link.pipe and links[k - 1].pipe):
            reach = bending_length_m(links, k)
            stiffness = string.bending_stiffness_n_m2 / reach
            body.add_joint(
                name=f"bend_{k}",
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=[0, 0, 1],
                stiffness=[stiffness, 0, 0],
                damping=[stiffness * DAMPING_TIME_S, 0, 0],
                springref=string.curl_rad_m * reach,
            )
        add_capsule(body, link, string)
        if link.weight_kg > 0:
            add_weight(body, link, [link.length_m, 0.0, 0.0])
        place, quat = np.array([link.length_m, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0])
    body.add_site(name=f"node_{len(links)}", pos=place)


def add_capsule(body: mujoco.MjsBody, link: StringLink, string: PhysicalString) -> None:
    """Add a link's string and pipe to its body, along its x axis."""
    diameter = PIPE_DIAMETER_M if link.pipe else string.diameter_m
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[0, 0, 0, link.length_m, 0, 0],
        size=[diameter / 2, 0, 0],
        mass=string.linear_density_kg_m * link.length_m + link.pipe_kg,
        fluid_ellipsoid=1,
    )


def add_weight(body: mujoco.MjsBody, link: StringLink, place_m: list[float]) -> None:
    """Add a link's ball of clay to a body, at a place (3,) in its frame [m]."""
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        pos=place_m,
        size=[weight_radius_m(link.weight_kg), 0, 0],
        mass=link.weight_kg,
        fluid_ellipsoid=1,
    )


def weight_radius_m(mass_kg: float) -> float:
    """Return the radius of a ball of clay [m]."""
    return float((3.0 * mass_kg / (4.0 * np.pi * CLAY_KG_M3)) ** (1.0 / 3.0))
