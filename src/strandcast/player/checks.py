"""All that is checked before anything moves. The motion's own `predicted` is never trusted."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from strandcast.arm.limits import violations
from strandcast.arm.load import Arm
from strandcast.errors import StrandcastError
from strandcast.player.protocol import Command, State
from strandcast.records.motion import Motion

CHECK_STEP_S = 0.001
REST_RAD_S = 1e-6
REST_RAD_S2 = 1e-3
SPEED_MISMATCH_RAD_S = 0.05


def check_motion(path: Path, motion: Motion, arm: Arm) -> None:
    """Refuse a motion that is for another arm, is not from rest to rest, or leaves the arm's limits.

    Raises
    ------
    StrandcastError
        SC-X001 another arm, SC-X002 times or numbers, SC-X003 not at rest, SC-X004 limits.
    """
    _check_arm(path, motion, arm)
    time_s = motion.time_s()
    q, qd, qdd = motion.joints()
    shape = (len(time_s), len(arm.joints))
    if len(time_s) < 2 or not (q.shape == qd.shape == qdd.shape == shape):
        raise _refusal("SC-X002", path, "points", "are too few, or not one number for each joint")
    if time_s[0] != 0.0 or not (np.diff(time_s) > 0).all():
        raise _refusal("SC-X002", path, "points", "do not start at time 0 and rise")
    if max(np.abs(qd[[0, -1]]).max(), 0) > REST_RAD_S or np.abs(qdd[[0, -1]]).max() > REST_RAD_S2:
        raise _refusal("SC-X003", path, "points", "the motion does not start and end at rest",
                       "plan it with a stop ramp: an arm must not be left moving")  # fmt: skip
    dense = sample(motion, CHECK_STEP_S)
    mismatch = np.abs(np.gradient(dense.q_rad, dense.time_s, axis=0) - dense.qd_rad_s).max()
    if mismatch > SPEED_MISMATCH_RAD_S:
        raise _refusal("SC-X002", path, "points", f"speeds and positions disagree by {mismatch:.3g} rad/s")
    found = violations(arm, dense.time_s, dense.q_rad, dense.qd_rad_s, dense.qdd_rad_s2)
    if found:
        raise _refusal("SC-X004", path, "points", "; ".join(str(violation) for violation in found),
                       "plan again within the limits of the arm's file")  # fmt: skip


def _check_arm(path: Path, motion: Motion, arm: Arm) -> None:
    robot = motion.robot
    if robot.file_sha256 != arm.sha256 or robot.urdf_sha256 != arm.urdf_sha256:
        raise _refusal("SC-X001", path, "robot",
                       f"the motion was planned for {robot.name!r}, with other files than "
                       f"{arm.path.name} and {arm.urdf_path.name} are now", "plan again")  # fmt: skip
    if tuple(motion.joint_names) != arm.joints:
        raise _refusal("SC-X001", path, "joint_names",
                       f"are {motion.joint_names}, the arm's are {list(arm.joints)}")  # fmt: skip


def check_start(path: Path, motion: Motion, arm: Arm, state: State) -> None:
    """Refuse to play from a posture that is not the motion's start, or from an arm that still moves.

    Raises
    ------
    StrandcastError
        SC-X005 the arm cannot play, SC-X006 it stands elsewhere, SC-X007 it still moves.
    """
    if state.trouble is not None:
        raise _refusal("SC-X005", path, None, f"the arm cannot play: {state.trouble}", "mend that first")
    away = np.abs(state.q_rad - np.array(motion.points[0].positions))
    allowed = np.minimum(arm.start_tolerance_rad, motion.start.tolerance_rad)
    if (away > allowed).any():
        worst = int(np.argmax(away - allowed))
        raise _refusal("SC-X006", path, "start",
                       f"{arm.joints[worst]} is {away[worst]:.4f} rad from its start, "
                       f"allowed {allowed[worst]:.4f}",
                       "move the arm to the motion's start; --move-to-start does it slowly")  # fmt: skip
    speed = float(np.abs(state.qd_rad_s).max())
    if speed > arm.start_velocity_rad_s:
        raise _refusal(
            "SC-X007", path, "start", f"the arm still moves at {speed:.4f} rad/s", "wait until it rests"
        )


def sample(motion: Motion, step_s: float) -> Command:
    """Return the motion every `step_s` from its start to its end: the quintic through its points.

    It has the points' positions, speeds and accelerations, which is what controllers interpolate too.
    """
    knots = motion.time_s()
    count = max(1, round(knots[-1] / step_s))
    time_s = np.minimum(np.arange(count + 1) * step_s, knots[-1])
    if time_s[-1] < knots[-1] - 1e-9:
        time_s = np.append(time_s, knots[-1])
    k = np.clip(np.searchsorted(knots, time_s, side="right") - 1, 0, len(knots) - 2)
    h = (knots[k + 1] - knots[k])[:, None]
    s = (time_s - knots[k])[:, None] / h
    q, qd, qdd = motion.joints()
    start, end = (q[k], qd[k] * h, qdd[k] * h * h), (q[k + 1], qd[k + 1] * h, qdd[k + 1] * h * h)
    rise = end[0] - start[0] - start[1] - 0.5 * start[2]
    speed = end[1] - start[1] - start[2]
    bend = end[2] - start[2]
    c3, c4, c5 = (
        10 * rise - 4 * speed + 0.5 * bend,
        -15 * rise + 7 * speed - bend,
        6 * rise - 3 * speed + 0.5 * bend,
    )
    return Command(
        time_s=time_s,
        q_rad=start[0] + s * (start[1] + s * (0.5 * start[2] + s * (c3 + s * (c4 + s * c5)))),
        qd_rad_s=(start[1] + s * (start[2] + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / h,
        qdd_rad_s2=(start[2] + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))) / (h * h),
    )


def _refusal(code: str, path: Path, field: str | None, what: str, fix: str | None = None) -> StrandcastError:
    return StrandcastError(code, what, file=path, field=field, cost="nothing was sent to the arm",
                           fix=fix or "make the motion file again with `strandcast plan`")  # fmt: skip
