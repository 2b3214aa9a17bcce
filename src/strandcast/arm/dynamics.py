"""Torques of the moving joints, and the fast ones of a planar chain, for searches."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from numba import njit

from strandcast.arm.urdf import dofs_of, owners, posed

# Columns of `PlanarDynamics.links`.
SIGN, MASS, INERTIA, CENTRE_X, CENTRE_Y, NEXT_X, NEXT_Y, VISCOUS, ARMATURE, DRY = range(10)


class Dynamics(ABC):
    """Torques of an arm's J moving joints.

    Attributes
    ----------
    stride, between
        In a search, torques are checked every so many samples, and taken to be this much higher in between.
    """

    stride: ClassVar[int] = 1
    between: ClassVar[float] = 1.0

    @abstractmethod
    def torques(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Return torques (T, J) [N m] for angles, speeds, accelerations (T, J).

        Dry friction, of uncertain direction, is taken to oppose the motion.
        """

    @abstractmethod
    def momentum(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Return the momentum (T,) of the moving links [kg m/s] for angles and speeds (T, J)."""


@dataclass(frozen=True, eq=False)
class PlanarDynamics(Dynamics):
    """The J moving links in the plane of the throw, each with all that is fixed to it: held joints, payload.

    Attributes
    ----------
    links
        (J, 10) of each link: sign of its joint (+1 where a positive angle is counter-clockwise); mass [kg];
        inertia about its centre and the plane's normal [kg m²]; x, y from its joint to its centre, and to the
        next joint, at zero angles [m]; its joint's viscous friction [N m s/rad], motor inertia [kg m²] and
        dry friction [N m].
    gravity_m_s2
        (2,).
    """

    links: np.ndarray
    gravity_m_s2: np.ndarray

    def torques(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Return torques (T, J) [N m], see `Dynamics.torques`; zeros without links."""
        if not len(self.links):
            return np.zeros_like(q)
        return np.asarray(chain_torques(q, qd, qdd, self.links, self.gravity_m_s2))

    def momentum(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Return the momentum (T,) [kg m/s], see `Dynamics.momentum`."""
        smooth, still = self.links.copy(), np.zeros_like(q)
        smooth[:, DRY] = 0.0
        # What holds links at rest against a unit of gravity is how their first moment changes with angles.
        parts = [(chain_torques(q, still, still, smooth, unit) * qd).sum(axis=1) for unit in np.eye(2)]
        return np.asarray(np.hypot(*parts))


# For an arm without torque limits.
NO_DYNAMICS = PlanarDynamics(np.zeros((0, DRY + 1)), np.zeros(2))


def planar_dynamics(
    model: mujoco.MjModel, held: dict[str, float], joints: Sequence[str], plane: np.ndarray
) -> PlanarDynamics:
    """Return the moving links, lumped, in the plane with axes (2, 3), with other joints at angles `held`."""
    data = posed(model, held)
    normal = np.cross(plane[0], plane[1])
    anchors = np.array([data.joint(name).xanchor for name in joints]) @ plane.T
    owner = owners(model, tuple(joints))
    lumps = [_lump(model, data, np.flatnonzero(owner == j), plane) for j in range(len(joints))]
    dofs = dofs_of(model, joints)
    links = np.column_stack(
        [
            [np.sign(data.joint(name).xaxis @ normal) for name in joints],
            [mass for mass, _, _ in lumps],
            [inertia for _, _, inertia in lumps],
            np.array([centre for _, centre, _ in lumps]) - anchors,
            np.diff(anchors, axis=0, append=anchors[-1:]),
            model.dof_damping[dofs],
            model.dof_armature[dofs],
            model.dof_frictionloss[dofs],
        ]
    )
    return PlanarDynamics(np.ascontiguousarray(links), plane @ model.opt.gravity)


def _lump(
    model: mujoco.MjModel, data: mujoco.MjData, bodies: np.ndarray, plane: np.ndarray
) -> tuple[float, np.ndarray, float]:
    """Return mass, centre (2,) in the plane, and inertia about it and the plane's normal, of some bodies."""
    mass = model.body_mass[bodies]
    places = data.xipos[bodies] @ plane.T
    centre = mass @ places / mass.sum()
    turned = np.einsum("bik,i->bk", data.ximat[bodies].reshape(-1, 3, 3), np.cross(plane[0], plane[1]))
    own = (turned**2 * model.body_inertia[bodies]).sum(axis=1)
    return float(mass.sum()), centre, float((own + mass * ((places - centre) ** 2).sum(axis=1)).sum())


@njit(cache=True)
def chain_torques(
    q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, links: np.ndarray, gravity: np.ndarray
) -> np.ndarray:
    """Return torques (T, J) [N m] for angles, speeds, accelerations (T, J), by recursive Newton-Euler.

    The outward pass gives the links' turn rates and the accelerations of the joints, gravity included; the
    inward pass the force and the moment that each link needs from the one before (Luh, Walker and Paul,
    1980). Dry friction, of uncertain direction, is taken to oppose the motion.
    """
    count, joints = q.shape
    torque = np.empty((count, joints))
    force, step, moment = np.empty((joints, 2)), np.empty((joints, 2)), np.empty(joints)
    for t in range(count):
        turn, rate, bend = 0.0, 0.0, 0.0
        ax, ay = -gravity[0], -gravity[1]
        for j in range(joints):
            sign, mass, inertia = links[j, SIGN], links[j, MASS], links[j, INERTIA]
            cx, cy = links[j, CENTRE_X], links[j, CENTRE_Y]
            dx, dy = links[j, NEXT_X], links[j, NEXT_Y]
            turn += sign * q[t, j]
            rate += sign * qd[t, j]
            bend += sign * qdd[t, j]
            cos, sin = math.cos(turn), math.sin(turn)
            x, y = cos * cx - sin * cy, sin * cx + cos * cy
            force[j, 0] = mass * (ax - bend * y - rate * rate * x)
            force[j, 1] = mass * (ay + bend * x - rate * rate * y)
            moment[j] = inertia * bend + x * force[j, 1] - y * force[j, 0]
            x, y = cos * dx - sin * dy, sin * dx + cos * dy
            step[j, 0], step[j, 1] = x, y
            ax, ay = ax - bend * y - rate * rate * x, ay + bend * x - rate * rate * y
        fx, fy, turning = 0.0, 0.0, 0.0
        for j in range(joints - 1, -1, -1):
            turning += moment[j] + step[j, 0] * fy - step[j, 1] * fx
            fx, fy = fx + force[j, 0], fy + force[j, 1]
            viscous, armature = links[j, VISCOUS], links[j, ARMATURE]
            needed = links[j, SIGN] * turning + viscous * qd[t, j] + armature * qdd[t, j]
            torque[t, j] = needed + math.copysign(links[j, DRY], needed)
    return torque
