"""Which link turns with which joint, and whether the URDF says what it weighs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco
import numpy as np

if TYPE_CHECKING:
    from strandcast.arm.load import Arm

LEAST_KG = 1e-3


def owners(model: mujoco.MjModel, joints: tuple[str, ...]) -> np.ndarray:
    """Return which of `joints` turns each body last, -1 for none: parents come before their children."""
    bodies = [int(model.joint(name).bodyid[0]) for name in joints]
    owner = np.full(model.nbody, -1)
    for body in range(1, model.nbody):
        owner[body] = bodies.index(body) if body in bodies else owner[model.body_parentid[body]]
    return owner


def weightless(arm: Arm) -> list[str]:
    """Return the moving joints whose links the URDF gives no mass: inverse dynamics says nothing of them."""
    model = arm.model()
    owner = owners(model, arm.joints)
    return [name for j, name in enumerate(arm.joints) if model.body_mass[owner == j].sum() < LEAST_KG]


def torque_gap(arm: Arm) -> str | None:
    """Return why torques are not checked, although it may look like it; None where they are."""
    names = weightless(arm)
    if names:
        turn = "turns" if len(names) == 1 else "turn"
        return (
            f"torque is not checked: {arm.urdf_path.name} gives no mass to what {', '.join(names)} {turn}; "
            "give it <inertial>, and the arm's file margins.torque"
        )
    if not np.isfinite(arm.limits.torque_n_m).all():
        return f"torque is not checked: {arm.path.name} says no margins.torque"
    return None
