"""What a controller limits of the arm as a whole: speeds of tool and elbow, power, momentum, its stop."""

import numpy as np

from strandcast.arm.load import Arm
from strandcast.arm.stop import turned_in_stop
from strandcast.arm.urdf import dofs_of
from strandcast.records.motion import WHOLE_ARM

SPEEDS, POWER, MOMENTUM, STOP = slice(0, 3), 3, 4, slice(5, 8)  # of `WHOLE_ARM`
ALL = np.ones(len(WHOLE_ARM), dtype=bool)
PARTS = (0.0, 0.2, 0.4, 0.7, 1.0)  # of a stop, between which tool and elbow go straight; chosen
TINY_S = 1e-12  # of joints that rest already


def whole_arm(arm: Arm, q: np.ndarray, time_s: np.ndarray, wanted: np.ndarray = ALL) -> np.ndarray:
    """Return the values of `WHOLE_ARM` between the samples of joint paths, zero where not wanted.

    The power is that of all joints together, the payload being a part of the arm. The arm
    stops as `turned_in_stop` says.

    Parameters
    ----------
    q, time_s
        (..., T, J) angles [rad] at times (T,) [s].
    wanted
        (8,) which quantities are wanted.

    Returns
    -------
    (..., T - 1, 8)
    """
    step_s = np.diff(time_s)[:, None]
    qd, middle = np.diff(q, axis=-2) / step_s, 0.5 * (q[..., 1:, :] + q[..., :-1, :])
    qdd = np.gradient(qd, axis=-2) / step_s if len(step_s) > 1 else np.zeros_like(qd)
    found = np.zeros((*qd.shape[:-1], len(WHOLE_ARM)))
    if wanted[SPEEDS].any():
        found[..., SPEEDS] = np.linalg.norm(np.diff(arm.limited_places(q), axis=-3), axis=-1) / step_s
    rows = [np.ascontiguousarray(x).reshape(-1, q.shape[-1]) for x in (middle, qd, qdd)]
    if wanted[POWER]:
        torque, model = arm.dynamics.torques(*rows), arm.model()
        dry = model.dof_frictionloss[dofs_of(model, arm.joints)]
        # Joints that brake give back what others need, but not what is lost to dry friction.
        power_w = np.abs(((torque - np.copysign(dry, torque)) * rows[1]).sum(axis=1)) + np.abs(rows[1]) @ dry
        found[..., POWER] = power_w.reshape(qd.shape[:-1])
    if wanted[MOMENTUM]:
        found[..., MOMENTUM] = arm.dynamics.momentum(*rows[:2]).reshape(qd.shape[:-1])
    if wanted[STOP].any():
        turned_rad, stop_s = turned_in_stop(arm.stop, arm.limits.velocity_rad_s, qd, qdd)
        longest_s = stop_s.max(axis=-1)
        # Each joint brakes evenly, and rests at its own time.
        since = [np.minimum(part * longest_s[..., None] / np.maximum(stop_s, TINY_S), 1.0) for part in PARTS]
        way_m = [arm.limited_places(middle + (1.0 - (1.0 - x) ** 2) * turned_rad) for x in since]
        gone_m = np.linalg.norm(np.diff(way_m, axis=0), axis=-1).sum(axis=0)
        found[..., STOP] = np.stack([longest_s, gone_m[..., :2].max(axis=-1), gone_m[..., 2]], axis=-1)
    return found
