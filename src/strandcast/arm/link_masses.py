"""Which link turns with which joint, and whether the URDF gives its mass."""

import mujoco
import numpy as np

from strandcast.arm.load import AnyArm

LEAST_KG = 1e-3  # chosen: lighter links are placeholders


def owners(model: mujoco.MjModel, joints: tuple[str, ...]) -> np.ndarray:
    """Return the last of `joints` that turns each body, -1 for none."""
    bodies = [int(model.joint(name).bodyid[0]) for name in joints]
    owner = np.full(model.nbody, -1)
    for body in range(1, model.nbody):  # parents come before their children
        owner[body] = bodies.index(body) if body in bodies else owner[model.body_parentid[body]]
    return owner


def massless_joints(arm: AnyArm) -> list[str]:
    """Return the moving joints whose links have no mass in the URDF, for which torques are unknown."""
    model = arm.model()
    owner = owners(model, arm.joints)
    return [name for j, name in enumerate(arm.joints) if model.body_mass[owner == j].sum() < LEAST_KG]


def torque_gap(arm: AnyArm) -> str | None:
    """Return why torques are not checked, or None if they are."""
    names = massless_joints(arm)
    if names:
        turn = "turns" if len(names) == 1 else "turn"
        return (
            f"torque is not checked: {arm.urdf_path.name} gives no mass to what {', '.join(names)} {turn}; "
            "give it <inertial>, and the arm's file margins.torque"
        )
    if not np.isfinite(arm.limits.torque_n_m).all():
        return f"torque is not checked: {arm.path.name} has no margins.torque"
    return None
