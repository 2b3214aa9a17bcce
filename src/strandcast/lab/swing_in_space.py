"""A throw in space: the string is a chain of rigid links with ball joints that resist bending and twist."""

from dataclasses import asdict
from typing import Any, NamedTuple

import mujoco
import numpy as np
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from strandcast.arm.load import SpatialArm
from strandcast.arm.spatial import clamp_axes
from strandcast.core.trajectory import JointTrajectory
from strandcast.errors import FAILED_TRIALS, StrandcastError
from strandcast.lab.rig import (
    LabRig,
    StringLink,
    add_capsule,
    add_weight,
    bending_length_m,
    compiled_rig,
    driven_arm,
    links_of,
)
from strandcast.lab.servo import JointDrives, ServoSetPoints
from strandcast.lab.strings import DAMPING_TIME_S, PhysicalString
from strandcast.lab.swing import LabSwing, ServoLoop, arm_at_start, force_at_rest, swing_on
from strandcast.lab.variation import ThrowVariation

SPATIAL_LINK_M = 0.02  # chosen: coarser than in the plane, because thin links twist fast
UPWARDS = np.array([0.0, 0.0, 1.0])
UNBALANCED = 1e-6  # of the loads, of a string at rest; chosen
RELAXED_S, RELAXING_PER_S = 2.0, 16.0  # of strings whose rest is not found at once; chosen


class VariationInSpace(NamedTuple):
    """A throw's deviations; those of the clamp and of the sway have a second direction, across the first."""

    along: ThrowVariation
    across: ThrowVariation

    def facts(self) -> dict[str, Any]:
        """Return the deviations by name."""
        second = ("grasp_lateral_m", "grasp_angle_rad", "sway_rad", "sway_rad_s")
        return asdict(self.along) | {
            f"second_direction_{name}": getattr(self.across, name) for name in second
        }


def simulate_swing_in_space(
    arm: SpatialArm,
    servo: str,
    string: PhysicalString,
    curl_turn_rad: float,
    variation: VariationInSpace,
    command: JointTrajectory,
) -> LabSwing:
    """Simulate a throw in space.

    Parameters
    ----------
    servo, command
        See `strandcast.lab.swing.simulate_swing`.
    string
        The string, without pipes; the variation changes how it is held.
    curl_turn_rad
        Direction in which it is curled, about itself.

    Raises
    ------
    StrandcastError
        SC-E003 the string diverges even at the smallest step, or is nowhere at rest.
    """
    along, across = variation
    hanging = string.shifted(along.grasp_length_m)

    def make_rig(drive: JointDrives, step_s: float) -> LabRig:
        spec = driven_arm(arm, drive, UPWARDS, step_s)
        links = links_of(hanging, SPATIAL_LINK_M)
        _hang(spec.body(arm.clamp.link), arm, links, hanging, curl_turn_rad, variation)
        return compiled_rig(spec, arm, links, np.eye(3))

    def begin(rig: LabRig, loop: ServoLoop, points: ServoSetPoints) -> tuple[np.ndarray, np.ndarray]:
        place, speed = _at_rest_in_space(rig, loop, points), np.zeros(rig.model.nv)
        data = mujoco.MjData(rig.model)
        data.qpos[:] = place
        mujoco.mj_kinematics(rig.model, data)
        # Turns in the world, about two horizontal axes, as the first link's own frame has them.
        frame = data.body("string_0").xmat.reshape(3, 3)
        first = rig.string_dofs[:3]
        turn = np.zeros(rig.model.nv)
        turn[first] = frame.T @ [along.sway_rad, across.sway_rad, 0.0]
        speed[first] = frame.T @ [along.sway_rad_s, across.sway_rad_s, 0.0]
        mujoco.mj_integratePos(rig.model, place, turn, 1.0)
        return place, speed

    return swing_on(arm, servo, along, command, make_rig, begin)


def _hang(
    body: mujoco.MjsBody,
    arm: SpatialArm,
    links: list[StringLink],
    string: PhysicalString,
    curl_turn_rad: float,
    variation: VariationInSpace,
) -> None:
    """Add the string's links to the hand's body, each a child of the one before, along their own x axes."""
    along, across = variation
    axes = clamp_axes(arm.clamp)
    place = np.array(arm.clamp.offset_m) + [along.grasp_lateral_m, across.grasp_lateral_m] @ axes[1:]
    held = Rotation.from_matrix(axes.T) * Rotation.from_rotvec(
        [0.0, along.grasp_angle_rad, across.grasp_angle_rad]
    )
    curled = np.array([0.0, np.cos(curl_turn_rad), np.sin(curl_turn_rad)])
    for k, link in enumerate(links):
        reach = bending_length_m(links, k)
        stiffness = string.bending_stiffness_n_m2 / reach
        turn = Rotation.from_rotvec(string.curl_rad_m * reach * curled)
        quat = (held * turn if k == 0 else turn).as_quat(scalar_first=True)
        body = body.add_body(name=f"string_{k}", pos=place, quat=quat)
        body.add_site(name=f"node_{k}")
        body.add_joint(
            name=f"bend_{k}",
            type=mujoco.mjtJoint.mjJNT_BALL,
            stiffness=[stiffness, 0, 0],
            damping=[stiffness * DAMPING_TIME_S, 0, 0],
        )
        add_capsule(body, link, string)
        _make_sluggish(body, link, string)
        place = np.array([link.length_m, 0.0, 0.0])
        if link.weight_kg > 0:
            add_weight(body.add_body(pos=place), link, [0.0, 0.0, 0.0])
    body.add_site(name=f"node_{len(links)}", pos=place)


def _make_sluggish(body: mujoco.MjsBody, link: StringLink, string: PhysicalString) -> None:
    """Give a link about itself the inertia that it has across.

    A thin link would twist thousands of times a second: no affordable step resolves that, nothing excites it.
    """
    mass = string.linear_density_kg_m * link.length_m
    body.explicitinertial, body.mass = True, mass
    body.ipos, body.inertia = [0.5 * link.length_m, 0.0, 0.0], [mass * link.length_m**2 / 12.0] * 3


def _at_rest_in_space(rig: LabRig, loop: ServoLoop, points: ServoSetPoints) -> np.ndarray:
    """Return the coordinates at which loops, weights and the bent string are in equilibrium."""
    model = rig.model
    data, start, free = arm_at_start(rig, points)
    # The string hangs straight down from its first joint.
    frame = data.body("string_0").xmat.reshape(3, 3)
    down = Rotation.align_vectors([frame.T @ -UPWARDS], [[1.0, 0.0, 0.0]])[0]
    first = int(model.joint("bend_0").qposadr[0])
    start[first : first + 4] = down.as_quat(scalar_first=True)

    def moved(turns: np.ndarray) -> np.ndarray:
        place, every = start.copy(), np.zeros(model.nv)
        every[free] = turns
        mujoco.mj_integratePos(model, place, every, 1.0)
        return place

    def unbalanced(turns: np.ndarray) -> np.ndarray:
        data.qpos[:] = moved(turns)
        return np.asarray(force_at_rest(rig, loop, points, data)[free] / scale)

    scale = np.ones(len(free))
    scale = np.maximum(np.abs(unbalanced(np.full(len(free), 0.3))), 1e-9)
    answer = root(unbalanced, np.zeros(len(free)), tol=1e-12)
    if np.abs(answer.fun).max() > UNBALANCED:
        start = _relaxed(rig, loop, points, start)
        answer = root(unbalanced, np.zeros(len(free)), tol=1e-12)
    if np.abs(answer.fun).max() > UNBALANCED:
        raise StrandcastError(
            "SC-E003",
            "the virtual string is nowhere at rest",
            field="lab.string",
            fix="start the motion in another posture, or give the string less curl",
            exit_code=FAILED_TRIALS,
        )
    return moved(answer.x)


def _relaxed(rig: LabRig, loop: ServoLoop, points: ServoSetPoints, start: np.ndarray) -> np.ndarray:
    """Return the coordinates after a while of damped motion from `start`."""
    model, dofs = rig.model, rig.arm_dofs
    data = mujoco.MjData(model)
    data.qpos[:] = start
    for _ in range(round(RELAXED_S / model.opt.timestep)):
        data.qfrc_applied[dofs] = loop.torque(points, 0, data.qpos[dofs], data.qvel[dofs])
        mujoco.mj_step(model, data)
        data.qvel[:] *= 1.0 - RELAXING_PER_S * model.opt.timestep
    return np.array(data.qpos)
