"""Whether the URDF gives the masses that torques depend on."""

import numpy as np

from strandcast.arm.load import Arm
from strandcast.arm.urdf import massless


def torque_gap(arm: Arm) -> str | None:
    """Return why torques are not checked, or None if they are."""
    names = massless(arm.model(), arm.joints)
    if names:
        turn = "turns" if len(names) == 1 else "turn"
        return (
            f"torque is not checked: {arm.urdf_path.name} gives no mass to what {', '.join(names)} {turn}; "
            "give it <inertial>, and the arm's file margins.torque"
        )
    if not np.isfinite(arm.limits.torque_n_m).all():
        return f"torque is not checked: {arm.path.name} has no margins.torque"
    return None
