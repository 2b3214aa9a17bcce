"""A chain of hinges in MuJoCo: point masses on rigid rods, with torsion springs for bending."""

import mujoco
import numpy as np
from mujoco import rollout

from strandcast.dynamics.parameters import Array
from strandcast_studies.benchmarks.simulation.swing import DURATION_S, LENGTH_M, SEGMENTS, HandSwing, every

# The string cannot move a hand this heavy: it follows its motors and needs no constraint.
HAND_KG = 1e9
_POINT = 'mass="1" diaginertia="1e-12 1e-12 1e-12"'  # MuJoCo allows no moving body without inertia


# A divergence shows in the result; MuJoCo's own warnings would fill the terminal and a file.
mujoco.set_mju_user_warning(lambda message: None)


def chain_xml(parameters: Array, dt_s: float, integrator: str) -> str:
    """Return the chain as MJCF: x to the right, y up, points of 1 kg, `parameters` (10,) per kilogram."""
    spacing = LENGTH_M / SEGMENTS
    _, _, bending, damping, _, _, _, _, clamp, clamp_damping = parameters.tolist()
    chain = ""
    for j in reversed(range(SEGMENTS)):
        stiffness, damper = (bending, damping) if j else (clamp, clamp_damping)
        chain = (
            f'<body pos="{spacing if j else 0.0} 0 0">'
            f'<joint type="hinge" axis="0 0 1" stiffness="{stiffness}" damping="{damper}"/>'
            f'<inertial pos="{spacing} 0 0" {_POINT}/>{chain}</body>'
        )
    axes = (("x", "slide", "1 0 0"), ("y", "slide", "0 1 0"), ("turn", "hinge", "0 0 1"))
    joints = "".join(
        f'<joint name="{name}" type="{kind}" axis="{axis}" armature="{HAND_KG}"/>'
        for name, kind, axis in axes
    )
    motors = "".join(f'<motor joint="{name}" gear="{HAND_KG}"/>' for name, _, _ in axes)
    return f"""<mujoco><compiler angle="radian" inertiafromgeom="false"/>
        <option timestep="{dt_s}" gravity="0 -9.81 0" integrator="{integrator}">
        <flag contact="disable" autoreset="disable"/></option>
        <worldbody><body>{joints}<inertial pos="0 0 0" {_POINT}/>{chain}</body></worldbody>
        <actuator>{motors}</actuator></mujoco>"""


def accelerations(swing: HandSwing, steps: int, first_order: bool = False) -> Array:
    """Return accelerations (steps, 3) of the hand, constant over each step, that follow the swing.

    With RK4 the velocity is exact after each step and the position to micrometres. An integrator that moves
    points with the new velocity would lag by half a step: `first_order` makes its positions exact instead.
    """
    pose, rate = swing.at(np.linspace(0.0, DURATION_S, steps + 1))
    per_step = steps / DURATION_S
    if first_order:
        rate = np.concatenate([np.zeros((1, 3)), np.diff(pose, axis=0) * per_step])
    return np.diff(rate, axis=0) * per_step


class Rollout:
    """Models of several strings under the same controls, simulated by MuJoCo's own threads."""

    def __init__(self, models: list[mujoco.MjModel], starts: Array, control: Array, threads: int) -> None:
        first = models[0]
        self.models = models
        self.data = [mujoco.MjData(first) for _ in range(threads)]
        self.control = control[None]
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        self.start = np.empty((len(models), mujoco.mj_stateSize(first, kind)))
        for start, state in zip(starts, self.start, strict=True):
            self.data[0].qpos[:] = start
            mujoco.mj_getState(first, self.data[0], state, kind)

    def places(self) -> Array:
        """Simulate; return the generalised positions after each step (B, steps, nq)."""
        state, _ = rollout.rollout(self.models, self.data, self.start, self.control, persistent_pool=True)
        return np.asarray(state[:, :, 1 : 1 + self.models[0].nq])


class HingeChain:
    """The peer: RK4, the most accurate of MuJoCo's integrators for a chain without contacts."""

    def __init__(self, swing: HandSwing, parameters: Array, dt_s: float, threads: int) -> None:
        steps = round(DURATION_S / dt_s)
        pose, _ = swing.at(np.zeros(1))
        models = [mujoco.MjModel.from_xml_string(chain_xml(row, dt_s, "RK4")) for row in parameters]
        starts = np.tile(np.r_[pose[0], np.zeros(SEGMENTS)], (len(models), 1))
        self.rollout = Rollout(models, starts, accelerations(swing, steps), threads)
        self.each = every(dt_s)

    def positions(self) -> Array:
        """Simulate; return positions (B, F, n+1, 2) [m] at the common times."""
        q = self.rollout.places()[:, self.each - 1 :: self.each]
        angle = np.cumsum(q[:, :, 2:], axis=2)[:, :, 1:]
        along = np.stack([np.cos(angle), np.sin(angle)], axis=-1) * (LENGTH_M / SEGMENTS)
        return np.cumsum(np.concatenate([q[:, :, None, :2], along], axis=2), axis=2)
