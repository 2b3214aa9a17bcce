"""MuJoCo's 1-D flex: a discrete elastic rod of mass points with springs or constraints as edges."""

from abc import ABC, abstractmethod

import mujoco
import numpy as np

from strandcast.dynamics.parameters import Array
from strandcast_studies.benchmarks.simulation.mujoco_chain import HAND_KG, Rollout, accelerations
from strandcast_studies.benchmarks.simulation.swing import (
    DURATION_S,
    LENGTH_M,
    SEGMENTS,
    HandSwing,
    every,
    stretched_m,
)

_RADIUS_M = 0.005  # as in `pyelastica`; the stiffness is given apart from it
# A planar rod never twists; a soft twist keeps its fast mode from limiting the step.
_SHEAR_PA = 1e-3


def flex_xml(parameters: Array, dt_s: float, integrator: str, edge: str) -> str:
    """Return the rod as MJCF, hanging from the hand, its first point, without a clamp; points of 1 kg."""
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
    """Compile with a first point as heavy as the hinge chain's hand, driven by motors."""
    spec = mujoco.MjSpec.from_string(xml)
    for name, joint in zip("xyz", spec.body("s_0").joints, strict=True):
        joint.name, joint.armature = name, HAND_KG
        if name != "z":
            motor = spec.add_actuator(trntype=mujoco.mjtTrn.mjTRN_JOINT, target=name)
            motor.gear[0] = HAND_KG
    return spec.compile()


class _Flex(ABC):
    integrator: str

    def __init__(self, swing: HandSwing, parameters: Array, dt_s: float, threads: int) -> None:
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
        """Return how much lower points 1…n hang at the start than with unstretched edges [m]."""
        return np.zeros((len(parameters), SEGMENTS))

    def positions(self) -> Array:
        """Simulate; return positions (B, F, n+1, 2) [m] at the common times."""
        q = self.rollout.places()[:, self.each - 1 :: self.each, : 3 * SEGMENTS + 3]
        moved = q.reshape(*q.shape[:2], SEGMENTS + 1, 3)[..., :2]
        hanging = np.linspace(0.0, -LENGTH_M, SEGMENTS + 1)
        return moved + np.stack([np.zeros_like(hanging), hanging], axis=-1)


class DiscreteFlex(_Flex):
    """As MuJoCo's documentation recommends: inextensible edges and the discrete integrator."""

    integrator = "discrete"

    def edge(self, parameters: Array) -> str:
        """Return constraints of 4 ms, the stiffest that the coarsest step of 2 ms allows."""
        return '<edge equality="true" solref="0.004 1"/>'


class SpringFlex(_Flex):
    """Edges that are springs, like ours, and RK4: cheaper where the springs are soft."""

    integrator = "RK4"

    def edge(self, parameters: Array) -> str:
        """Return the string's own stretch spring and damper."""
        return f'<edge stiffness="{parameters[0]}" damping="{parameters[1]}"/>'

    def sag(self, parameters: Array) -> Array:
        """Return the static stretch."""
        return np.cumsum(stretched_m(parameters[:, 0]) - LENGTH_M / SEGMENTS, axis=1)
