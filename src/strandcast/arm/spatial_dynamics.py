"""Torques and inertia of joints with axes in any direction: fast, for searches."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import mujoco
import numpy as np
from numba import njit

from strandcast.arm.dynamics import Dynamics
from strandcast.arm.spatial import Vector, turn_about, turned
from strandcast.arm.urdf import dofs_of, owners, posed

WORK = 5  # vectors of each joint that `write_torques` needs: axis, anchor, force, moment, the link's centre


class Links(NamedTuple):
    """The J moving links, each with all that is fixed to it: held joints, payload.

    All joints are at zero, and all is in the frame of the URDF's root link.

    Attributes
    ----------
    anchors_m, directions
        (J, 3) a place on each joint's axis [m], and its unit vector, in the sense of a positive angle.
    mass_kg, centre_m, inertia_kg_m2
        (J,), (J, 3), (J, 3, 3) about the centre.
    """

    anchors_m: np.ndarray
    directions: np.ndarray
    mass_kg: np.ndarray
    centre_m: np.ndarray
    inertia_kg_m2: np.ndarray


@dataclass(frozen=True, eq=False)
class SpatialDynamics(Dynamics):
    """The moving links and their joints.

    Attributes
    ----------
    viscous, armature, dry
        (J,) of the joints: viscous friction [N m s/rad], motor inertia [kg m²], dry friction [N m].
    gravity_m_s2
        (3,).
    """

    links: Links
    viscous: np.ndarray
    armature: np.ndarray
    dry: np.ndarray
    gravity_m_s2: np.ndarray
    stride: ClassVar[int] = 4  # chosen, as the next
    between: ClassVar[float] = 1.01

    def torques(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Return torques (T, J) [N m], see `Dynamics.torques`."""
        needed = newton_euler(q, qd, qdd, self.links, self.gravity_m_s2)
        needed += self.viscous * qd + self.armature * qdd
        return np.asarray(needed + np.copysign(self.dry, needed))

    def momentum(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Return the momentum (T,) [kg m/s], see `Dynamics.momentum`."""
        still = np.zeros_like(q)
        # As in a plane.
        parts = [(newton_euler(q, still, still, self.links, unit) * qd).sum(axis=1) for unit in np.eye(3)]
        return np.asarray(np.linalg.norm(parts, axis=0))

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return (J, J) [kg m²] of the links at angles (J,), without motors."""
        return np.asarray(mass_matrix(np.ascontiguousarray(q, float), self.links))


def spatial_dynamics(model: mujoco.MjModel, held: dict[str, float], joints: Sequence[str]) -> SpatialDynamics:
    """Return the moving links, lumped, with other joints at angles `held`."""
    data = posed(model, held)
    owner = owners(model, tuple(joints))
    mass, centre, inertia = [], [], []
    for j in range(len(joints)):
        bodies = np.flatnonzero(owner == j)
        own = model.body_mass[bodies]
        turns = data.ximat[bodies].reshape(-1, 3, 3)
        mass.append(own.sum())
        centre.append(own @ data.xipos[bodies] / own.sum())
        away = data.xipos[bodies] - centre[-1]
        tensors = np.einsum("bik,bk,bjk->bij", turns, model.body_inertia[bodies], turns)
        square = (away**2).sum(axis=1)[:, None, None] * np.eye(3) - away[:, :, None] * away[:, None, :]
        inertia.append((tensors + own[:, None, None] * square).sum(axis=0))
    dofs = dofs_of(model, joints)
    every = [data.joint(name) for name in joints]
    return SpatialDynamics(
        Links(
            np.array([joint.xanchor for joint in every]),
            np.array([joint.xaxis for joint in every]),
            np.array(mass),
            np.array(centre),
            np.array(inertia),
        ),
        model.dof_damping[dofs],
        model.dof_armature[dofs],
        model.dof_frictionloss[dofs],
        np.array(model.opt.gravity),
    )


@njit(cache=True)
def cross_part(a: Vector, b: Vector, r: int) -> float:
    """Return component r of a vector product."""
    i, k = (r + 1) % 3, (r + 2) % 3
    component: float = a[i] * b[k] - a[k] * b[i]
    return component


@njit(cache=True)
def newton_euler(
    q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, links: Links, gravity: np.ndarray
) -> np.ndarray:
    """Return torques (T, J) by recursive Newton-Euler (Luh, Walker and Paul, 1980), in the root's frame.

    The outward pass gives the links' turn rates and the accelerations of their joints, gravity included; the
    inward pass the force and the moment that each link needs from the one before.
    """
    torque, work = np.empty(q.shape), np.empty((WORK, q.shape[1], 3))
    for t in range(len(q)):
        write_torques(q[t], qd[t], qdd[t], links, gravity, work, torque[t])
    return torque


@njit(cache=True)
def write_torques(
    q: np.ndarray,
    qd: np.ndarray,
    qdd: np.ndarray,
    links: Links,
    gravity: np.ndarray,
    work: np.ndarray,
    torque: np.ndarray,
) -> None:
    """Write the torques (J,) of one instant; `work` is any memory (WORK, J, 3)."""
    axis, anchor, force, moment = work[0], work[1], work[2], work[3]
    _outward(q, qd, qdd, links, gravity, work)
    for j in range(len(q) - 1, -1, -1):
        if j + 1 < len(q):
            for r in range(3):
                force[j, r] += force[j + 1, r]
            _add_moment(anchor[j + 1], anchor[j], force[j + 1], moment[j])
            for r in range(3):
                moment[j, r] += moment[j + 1, r]
        torque[j] = axis[j, 0] * moment[j, 0] + axis[j, 1] * moment[j, 1] + axis[j, 2] * moment[j, 2]


@njit(cache=True)
def _outward(
    q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, links: Links, gravity: np.ndarray, work: np.ndarray
) -> None:
    """Write axis, anchor, the force and moment about the anchor that each link needs, and its centre."""
    axis, anchor, force, moment, place = work[0], work[1], work[2], work[3], work[4]
    turn, move = np.eye(3), np.zeros(3)
    rate, change, pull = np.zeros(3), np.zeros(3), np.empty(3)
    for r in range(3):
        pull[r] = -gravity[r]
    for j in range(len(q)):
        _write_place(turn, move, links.anchors_m[j], anchor[j])
        if j:
            _accelerate(pull, rate, change, anchor[j - 1], anchor[j])
        for r in range(3):
            axis[j, r] = turned(turn, links.directions[j], r)
        for r in range(3):
            change[r] += qdd[j] * axis[j, r] + qd[j] * cross_part(rate, axis[j], r)
        for r in range(3):
            rate[r] += qd[j] * axis[j, r]
        turn_about(links.anchors_m[j], links.directions[j], q[j], turn, move)
        _write_place(turn, move, links.centre_m[j], place[j])
        for r in range(3):
            force[j, r] = pull[r]
        _accelerate(force[j], rate, change, anchor[j], place[j])
        for r in range(3):
            force[j, r] *= links.mass_kg[j]
        _needed_moment(turn, links.inertia_kg_m2[j], rate, change, moment[j])
        _add_moment(place[j], anchor[j], force[j], moment[j])


@njit(cache=True)
def _write_place(turn: np.ndarray, move: np.ndarray, given: np.ndarray, place: np.ndarray) -> None:
    """Write where a place (3,) of a link is."""
    for r in range(3):
        place[r] = turned(turn, given, r) + move[r]


@njit(cache=True)
def _add_moment(place: np.ndarray, about: np.ndarray, force: np.ndarray, moment: np.ndarray) -> None:
    """Add the moment (3,) about a place of a force at another one."""
    arm = place[0] - about[0], place[1] - about[1], place[2] - about[2]
    for r in range(3):
        moment[r] += cross_part(arm, force, r)


@njit(cache=True)
def _accelerate(
    pull: np.ndarray, rate: np.ndarray, change: np.ndarray, old: np.ndarray, new: np.ndarray
) -> None:
    """Take an acceleration (3,) from an old place of a body with a turn rate and its change to a new one."""
    away = new[0] - old[0], new[1] - old[1], new[2] - old[2]
    inside = rate[0] * away[0] + rate[1] * away[1] + rate[2] * away[2]
    square = rate[0] ** 2 + rate[1] ** 2 + rate[2] ** 2
    for r in range(3):
        pull[r] += cross_part(change, away, r) + rate[r] * inside - square * away[r]


@njit(cache=True)
def _needed_moment(
    turn: np.ndarray, inertia: np.ndarray, rate: np.ndarray, change: np.ndarray, moment: np.ndarray
) -> None:
    """Write the moment (3,) about its centre of a body; its inertia (3, 3) is that at zero angles."""
    own, spun = _turned_back(turn, rate), _turned_back(turn, change)
    bent = turned(inertia, own, 0), turned(inertia, own, 1), turned(inertia, own, 2)
    whole = (
        turned(inertia, spun, 0) + cross_part(own, bent, 0),
        turned(inertia, spun, 1) + cross_part(own, bent, 1),
        turned(inertia, spun, 2) + cross_part(own, bent, 2),
    )
    for r in range(3):
        moment[r] = turned(turn, whole, r)


@njit(cache=True)
def _turned_back(turn: np.ndarray, vector: np.ndarray) -> tuple[float, float, float]:
    """Return a vector (3,) in the frame at zero angles."""
    return (
        turn[0, 0] * vector[0] + turn[1, 0] * vector[1] + turn[2, 0] * vector[2],
        turn[0, 1] * vector[0] + turn[1, 1] * vector[1] + turn[2, 1] * vector[2],
        turn[0, 2] * vector[0] + turn[1, 2] * vector[1] + turn[2, 2] * vector[2],
    )


@njit(cache=True, nogil=True)
def mass_matrix(q: np.ndarray, links: Links) -> np.ndarray:
    """Return (J, J): the momenta of all that each joint carries, about every joint before it.

    That is the composite-rigid-body method (Walker and Orin, 1982), about the root's origin.
    """
    joints = len(q)
    anchor, axis = np.empty((joints, 3)), np.empty((joints, 3))
    carried, first, second = links.mass_kg.copy(), np.empty((joints, 3)), np.empty((joints, 3, 3))
    turn, move = np.eye(3), np.zeros(3)
    for j in range(joints):
        _write_place(turn, move, links.anchors_m[j], anchor[j])
        for r in range(3):
            axis[j, r] = turned(turn, links.directions[j], r)
        turn_about(links.anchors_m[j], links.directions[j], q[j], turn, move)
        _write_place(turn, move, links.centre_m[j], first[j])
        _write_second_moment(turn, links.inertia_kg_m2[j], links.mass_kg[j], first[j], second[j])
        for r in range(3):
            first[j, r] *= links.mass_kg[j]
    answer = np.empty((joints, joints))
    about, linear, angular = np.empty(3), np.empty(3), np.empty(3)
    for j in range(joints - 1, -1, -1):
        for r in range(3):
            about[r] = cross_part(axis[j], anchor[j], r)
        for r in range(3):
            linear[r] = cross_part(axis[j], first[j], r) - carried[j] * about[r]
            angular[r] = turned(second[j], axis[j], r) - cross_part(first[j], about, r)
        for i in range(j + 1):
            answer[i, j] = answer[j, i] = _about_axis(axis[i], anchor[i], linear, angular)
        if j > 0:
            carried[j - 1] += carried[j]
            _add_moments(first[j], second[j], first[j - 1], second[j - 1])
    return answer


@njit(cache=True)
def _add_moments(first: np.ndarray, second: np.ndarray, to_first: np.ndarray, to_second: np.ndarray) -> None:
    """Add the first moment (3,) and the second one (3, 3) of a body to those of another.

    By number: numba takes 5 s to compile the sums of whole arrays.
    """
    for r in range(3):
        to_first[r] += first[r]
        for c in range(3):
            to_second[r, c] += second[r, c]


@njit(cache=True)
def _write_second_moment(
    turn: np.ndarray, inertia: np.ndarray, mass: float, place: np.ndarray, second: np.ndarray
) -> None:
    """Write the inertia (3, 3) about the root's origin of a body there; its own is given at zero angles."""
    spun = np.empty(3)
    square = mass * (place[0] ** 2 + place[1] ** 2 + place[2] ** 2)
    for r in range(3):
        for c in range(3):
            spun[c] = turn[r, 0] * inertia[0, c] + turn[r, 1] * inertia[1, c] + turn[r, 2] * inertia[2, c]
        for c in range(3):
            second[r, c] = turned(turn, spun, c) - mass * place[r] * place[c]
        second[r, r] += square


@njit(cache=True)
def _about_axis(axis: np.ndarray, anchor: np.ndarray, linear: np.ndarray, angular: np.ndarray) -> float:
    """Return the angular momentum about an axis through an anchor, from both momenta at the origin."""
    total = 0.0
    for r in range(3):
        total += axis[r] * (angular[r] - cross_part(anchor, linear, r))
    return total
