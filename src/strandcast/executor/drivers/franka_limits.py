"""Speed limits of the Franka Research 3, which depend on position."""

import numpy as np

from strandcast.arm.load import Arm
from strandcast.core.trajectory import JointTrajectory
from strandcast.errors import StrandcastError
from strandcast.executor.locks import NOTHING_SENT

# min(maximum, max(0, sqrt(2 braking (end - q)) - offset)), and likewise towards the lower end (Franka
# Robotics, "Robot specifications", limits for the Franka Research 3).
MAX_SPEED_RAD_S = np.array([2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26])
SPEED_OFFSET_RAD_S = np.array([0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35])
BRAKING_RAD_S2 = np.array([6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0])
LOWER_RAD = np.array([-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196])
UPPER_RAD = np.array([2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196])
SPEED_MARGIN = 0.95  # chosen


def check_speeds(arm: Arm, moving: np.ndarray, command: JointTrajectory) -> None:
    """Refuse a motion that is too fast near the end of a joint's range (SC-X004).

    The controller would stop it. `moving` (J,) are the indices of the moving joints among the seven.
    """
    lowest, highest = speed_limits(command.q_rad, moving)
    excess = np.maximum(command.qd_rad_s - highest, lowest - command.qd_rad_s)
    if (excess <= 0.0).all():
        return
    k, j = np.unravel_index(int(np.argmax(excess)), excess.shape)
    raise StrandcastError(
        "SC-X004",
        f"{arm.joints[j]} would move at {command.qd_rad_s[k, j]:.2f} rad/s at {command.time_s[k]:.3f} s; at "
        f"{command.q_rad[k, j]:.2f} rad, near its end, the controller allows {lowest[k, j]:.2f} to "
        f"{highest[k, j]:.2f} rad/s",
        cost=NOTHING_SENT,
        fix="widen margins.position_rad, and plan again",
    )


def speed_limits(q_rad: np.ndarray, moving: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and the highest allowed speeds [rad/s] at positions (T, J), margin subtracted."""
    most, offset, braking = MAX_SPEED_RAD_S[moving], SPEED_OFFSET_RAD_S[moving], BRAKING_RAD_S2[moving]
    up, down = UPPER_RAD[moving] - q_rad, q_rad - LOWER_RAD[moving]
    highest = np.clip(np.sqrt(2.0 * braking * np.maximum(up, 0.0)) - offset, 0.0, most)
    lowest = -np.clip(np.sqrt(2.0 * braking * np.maximum(down, 0.0)) - offset, 0.0, most)
    return SPEED_MARGIN * lowest, SPEED_MARGIN * highest
