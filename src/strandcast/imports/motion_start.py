"""Start of a played motion on the log's clock: its trajectory is matched with the logged joints."""

import numpy as np
from scipy.optimize import minimize_scalar

from strandcast.arm.load import AnyArm
from strandcast.arm.servo import respond
from strandcast.errors import StrandcastError
from strandcast.records.joint_log import JointLog
from strandcast.records.motion import Motion

# Chosen; not sensitive.
LARGEST_RMS_RAD = 0.1
COARSE_S = 0.005
TAIL_S = 0.1  # the joints arrive after their command


def motion_times(log: JointLog, motion: Motion, arm: AnyArm, file: str | None = None) -> tuple[float, float]:
    """Return the motion's start and end on the log's clock [s].

    Commanded joints are compared with the trajectory itself; in a log without them, the measured joints are
    compared with the response of the arm's nominal servo to it.

    Raises
    ------
    StrandcastError
        SC-I030 a joint of the motion is missing in the log; SC-I031 no part of the log looks like the motion;
        SC-I034 the motion's times do not rise.
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
    planned = motion.trajectory()
    back = np.flatnonzero(np.diff(planned.time_s) <= 0)
    if len(back):
        k = int(back[0])
        raise StrandcastError(
            "SC-I034",
            f"point {k + 1} of motion.json is at {planned.time_s[k + 1]:g} s, after {planned.time_s[k]:g} s "
            f"({len(back)} such points)",
            file=file,
            field="points",
            fix="put the motion that was played beside the raw files",
        )
    time_s = np.arange(round((planned.end_s + TAIL_S) / step_s) + 1) * step_s
    command = np.stack([np.interp(time_s, planned.time_s, joint) for joint in planned.q_rad.T], axis=1)
    commanded = np.isfinite(log.q_cmd_rad[:, columns]).all(axis=1)
    if commanded.any():
        rows, values, expected = commanded, log.q_cmd_rad, command
    else:
        rows, values, expected = (
            np.ones(len(log.time_s), bool),
            log.q_rad,
            respond(arm.servo, time_s, command),
        )
    logged_s, logged = log.time_s[rows], values[rows][:, columns]

    def rms_rad(start_s: float) -> float:
        shifted = np.stack([np.interp(start_s + time_s, logged_s, joint) for joint in logged.T], axis=1)
        known = (start_s + time_s >= logged_s[0] - step_s) & (start_s + time_s <= logged_s[-1] + step_s)
        return float(np.sqrt(((shifted - expected)[known] ** 2).mean())) if known.any() else np.inf

    # Starts at which the log misses a part of the motion are included, so that this can be reported.
    half_s = 0.5 * planned.end_s
    starts = np.arange(logged_s[0] - half_s, max(logged_s[-1] - half_s, logged_s[0]), COARSE_S)
    best = float(starts[int(np.argmin([rms_rad(start) for start in starts]))])
    # Relative to the best start: the search's tolerance is relative, and a clock may count from 1970.
    found = minimize_scalar(
        lambda shift_s: rms_rad(best + shift_s),
        bounds=(-COARSE_S, COARSE_S),
        method="bounded",
        options={"xatol": 1e-6},
    )
    if not found.fun <= LARGEST_RMS_RAD:  # NaN too: numbers too large to compare
        raise StrandcastError(
            "SC-I031",
            f"no part of the log looks like motion.json: the joints are {found.fun:.2f} rad off at best",
            file=file,
            cost="clock and fit would belong to another throw",
            fix="put the motion that was played beside the raw files, and check the joints' order and units",
        )
    start_s = best + float(found.x)
    return start_s, start_s + planned.end_s
