"""MuJoCo's 1-D flex: a discrete elastic rod of mass points, with springs or constraints for edges."""

from __future__ import annotations

from abc import ABC, abstractmethod

import mujoco
import numpy as np

from strandcast.bench.mujoco_chain import HAND_KG, Rollout, accelerations
from strandcast.bench.swing import DURATION_S, LENGTH_M, SEGMENTS, Swing, every, stretched_m
from strandcast.string.parameters import Array

_RADIUS_M = 0.005
# The twist of a planar rod never moves; a soft one keeps its fast mode from limiting the step.
_SHEAR_PA = 1e-3


def flex_xml(parameters: Array, dt_s: float, integrator: str, edge: str) -> str:
    """Return the rod as MJCF, hanging from its first point, the hand, free to turn in it; points of 1 kg."""
    spacing = LENGTH_M / SEGMENTS
    bending, damping = parameters[2], parameters[3]
    young = bending * spacing / (0.25 * np.pi * _RADIUS_M**4)
    points = " ".join(f"0 {-spacing * i} 0" for i in range(SEGMENTS + 1))
    elements = " ".join(f"{i} {i + 1}" for i in range(SEGMENTS))
    return f"""<mujoco>
        <option timestep="{dt_s}" gravity="0 -9.81 0" integrator="{integrator}" jacobian="sparse">
        <flag contact="disable" autoreset="disable"/></option>
        <worldbody><flexcomp name="s" type="direct" dim="1" radius="{_RADIUS_M}" mass="{SEGMENTS + 1}"
            point="{points}" element="{elements}"><contact selfcollide="none"/>{edge}
        <elasticity young="{young}" poisson="0" shear="{_SHEAR_PA}" damping="{damping / bending}"/>
        </flexcomp></worldbody></mujoco>"""


def _with_hand(xml: str) -> mujoco.MjModel:
    """Compile with the first point as heavy as the hinge chain's hand, and motors on it."""
    spec = mujoco.MjSpec.from_string(xml)
    for name, joint in zip("xyz", spec.body("s_0").joints, strict=True):
        joint.name, joint.armature = name, HAND_KG
        if name != "z":
            motor = spec.add_actuator(trntype=mujoco.mjtTrn.mjTRN_JOINT, target=name)
            motor.gear[0] = HAND_KG
    return spec.compile()


class _Flex(ABC):
    integrator: str

    def __init__(self, swing: Swing, parameters: Array, dt_s: float, threads: int) -> None:
        models = [_with_hand(flex_xml(row, dt_s, self.integrator, self.edge(row))) for row in parameters]
        pose, _ = swing.at(np.zeros(1))
        starts = np.zeros((len(models), models[0].nq))
        starts[:, : 3 * SEGMENTS + 3] = np.tile([pose[0, 0], pose[0, 1], 0.0], SEGMENTS + 1)
        starts[:, 4 : 3 * SEGMENTS + 3 : 3] -= self.sag(parameters)
        control = accelerations(swing, round(DURATION_S / dt_s), self.integrator != "RK4")[:, :2]
        self.rollout = Rollout(models, starts, control, threads)
        self.each = every(dt_s)

    @abstractmethod
    def edge(self, parameters: Array) -> str:
        """Return the edges of one string as MJCF."""

    def sag(self, parameters: Array) -> Array:
        """Return by how much points 1…n hang lower at the start than unstretched edges would let them [m]."""
        return np.zeros((len(parameters), SEGMENTS))

    def positions(self) -> Array:
        """Simulate; positions (B, F, n+1, 2) [m] at the common times."""
        q = self.rollout.places()[:, self.each - 1 :: self.each, : 3 * SEGMENTS + 3]
        moved = q.reshape(*q.shape[:2], SEGMENTS + 1, 3)[..., :2]
        hanging = np.linspace(0.0, -LENGTH_M, SEGMENTS + 1)
        return moved + np.stack([np.zeros_like(hanging), hanging], axis=-1)


class DiscreteFlex(_Flex):
    """The way MuJoCo's documentation recommends: edges that keep their length, the discrete integrator."""

    name = "mujoco_flex"
    integrator = "discrete"

    def edge(self, parameters: Array) -> str:
        """Return constraints of 4 ms, the stiffest that the coarsest step of 2 ms allows."""
        return '<edge equality="true" solref="0.004 1"/>'


class SpringFlex(_Flex):
    """Edges that are springs, as ours are, and RK4: cheaper where the springs are soft."""

    name = "mujoco_flex_rk4"
    integrator = "RK4"

    def edge(self, parameters: Array) -> str:
        """Return the string's own stretch spring and damper."""
        return f'<edge stiffness="{parameters[0]}" damping="{parameters[1]}"/>'

    def sag(self, parameters: Array) -> Array:
        """Return the static stretch."""
        return np.cumsum(stretched_m(parameters[:, 0]) - LENGTH_M / SEGMENTS, axis=1)
