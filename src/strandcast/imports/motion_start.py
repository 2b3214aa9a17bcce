"""When, on the log's clock, a played motion began: by laying its trajectory over the logged joints."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize_scalar

from strandcast.arm.load import Arm
from strandcast.arm.servo import respond
from strandcast.errors import StrandcastError
from strandcast.records.joint_log import JointLog
from strandcast.records.motion import Motion

LARGEST_RMS_RAD = 0.1
COARSE_S = 0.005
TAIL_S = 0.1  # the joints arrive after their command


def motion_times(log: JointLog, motion: Motion, arm: Arm, file: str | None = None) -> tuple[float, float]:
    """Return the motion's start and end on the log's clock [s].

    Commanded joints are compared with the trajectory as it is; where the log has none, the measured ones with
    the response of the arm's nominal servo to it.

    Raises
    ------
    StrandcastError
        SC-I030 the log lacks a joint of the motion; SC-I031 no part of the log looks like the motion.
    """
    missing = [name for name in motion.joint_names if name not in log.joint_names]
    if missing:
        raise StrandcastError(
            "SC-I030",
            f"the log has no {', '.join(missing)}, which motion.json moves",
            file=file,
            field="joints",
            fix="name the log's joints with --joint, from the base on",
        )
    columns = [log.joint_names.index(name) for name in motion.joint_names]
    step_s = 1.0 / arm.log_rate_hz
    time_s = np.arange(round((motion.time_s()[-1] + TAIL_S) / step_s) + 1) * step_s
    told = np.stack([np.interp(time_s, motion.time_s(), joint) for joint in motion.joints()[0].T], axis=1)
    commanded = np.isfinite(log.q_cmd_rad[:, columns]).all(axis=1)
    if commanded.any():
        rows, values, expected = commanded, log.q_cmd_rad, told
    else:
        rows, values, expected = np.ones(len(log.time_s), bool), log.q_rad, respond(arm.servo, time_s, told)
    logged_s, logged = log.time_s[rows], values[rows][:, columns]

    def rms_rad(start_s: float) -> float:
        there = np.stack([np.interp(start_s + time_s, logged_s, joint) for joint in logged.T], axis=1)
        known = (start_s + time_s >= logged_s[0] - step_s) & (start_s + time_s <= logged_s[-1] + step_s)
        return float(np.sqrt(((there - expected)[known] ** 2).mean())) if known.any() else np.inf

    # Also where the log lacks a part of the motion, so that this can be told.
    half_s = 0.5 * float(motion.time_s()[-1])
    starts = np.arange(logged_s[0] - half_s, max(logged_s[-1] - half_s, logged_s[0]), COARSE_S)
    best = float(starts[int(np.argmin([rms_rad(start) for start in starts]))])
    # From there on: the search's tolerance is relative, and a clock may count from 1970.
    found = minimize_scalar(
        lambda later_s: rms_rad(best + later_s),
        bounds=(-COARSE_S, COARSE_S),
        method="bounded",
        options={"xatol": 1e-6},
    )
    if found.fun > LARGEST_RMS_RAD:
        raise StrandcastError(
            "SC-I031",
            f"no part of the log looks like motion.json: the joints are {found.fun:.2f} rad off at best",
            file=file,
            cost="clock and fit would be of another throw",
            fix="put the motion that was played beside the raw files, and check the joints' order and units",
        )
    start_s = best + float(found.x)
    return start_s, start_s + float(motion.time_s()[-1])
