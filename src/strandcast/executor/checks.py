"""The checks before anything moves. The motion's own `predicted` is never trusted."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import scipy

from strandcast.arm.limits import differences, violations
from strandcast.arm.load import Arm
from strandcast.arm.reach import Reach, outside_m, reach_of
from strandcast.core.trajectory import JointTrajectory
from strandcast.errors import StrandcastError
from strandcast.executor.drivers.protocol import ArmState, Driver
from strandcast.executor.locks import NOTHING_SENT
from strandcast.executor.streaming.clock import Clock
from strandcast.records.motion import Motion

# Chosen, unless said otherwise.
CHECK_STEP_S = 0.001  # finer than any controller's cycle but Franka's, which has the same
REST_RAD_S = 1e-6
REST_RAD_S2 = 1e-3
MISMATCH_RAD_S = 0.05
MISMATCH_RAD_S2 = 1.0
SAME_RAD = 1e-6
FULL_SPEED_TOLERANCE = 0.001
PAYLOAD_TOLERANCE_KG = 0.05
STILL_S = 0.3  # arms still creep 0.2 s after they report the end of a motion (ros-industrial/motoman #324)
SETTLING_S = 3.0
POLL_S = 0.02


def check_motion(path: Path, motion: Motion, arm: Arm) -> JointTrajectory:
    """Return the motion as the checks sample it; refuse one that the arm cannot play from rest to rest.

    Limits are held against the file's points and against samples of the quintic between them.

    Raises
    ------
    StrandcastError
        SC-X004 for another arm; wrong times, numbers or start; not at rest at its ends; beyond the limits.
    """
    _check_arm(path, motion, arm)
    played = motion.trajectory()
    time_s, q, qd, qdd = played.time_s, played.q_rad, played.qd_rad_s, played.qdd_rad_s2
    shape = (len(time_s), len(arm.joints))
    if len(time_s) < 2 or not (q.shape == qd.shape == qdd.shape == shape):
        raise _refusal(path, "points", "are too few, or do not have one number per joint")
    if time_s[0] != 0.0 or not (np.diff(time_s) > 0).all():
        raise _refusal(path, "points", "do not have rising times from 0")
    if np.abs(qd[[0, -1]]).max() > REST_RAD_S or np.abs(qdd[[0, -1]]).max() > REST_RAD_S2:
        raise _refusal(
            path,
            "points",
            "the motion does not start and end at rest",
            "plan it with a stop ramp: the arm must be at rest at the end",
        )
    _check_start_posture(path, motion, arm)
    dense = _by_cycles(played, CHECK_STEP_S)
    check_limits(path, "the motion", arm, played)
    check_limits(path, "the motion", arm, dense)
    _check_stated(path, played)
    return dense


def check_set_points(path: Path, motion: Motion, arm: Arm, rate_hz: float) -> JointTrajectory:
    """Return what is sent of a checked motion at a rate; refuse it beyond the arm's limits (SC-X004)."""
    played = motion.trajectory()
    check_limits(path, f"the set points at {rate_hz:g} Hz", arm, _by_cycles(played, 1.0 / rate_hz))
    return played.resampled(1.0 / rate_hz)


def _by_cycles(played: JointTrajectory, step_s: float) -> JointTrajectory:
    """Return the motion at each cycle of a controller, the last one at its end or after it."""
    return played.at(np.arange(np.ceil(played.end_s / step_s - 1e-6) + 1) * step_s)


def _check_start_posture(path: Path, motion: Motion, arm: Arm) -> None:
    start, first = motion.start, motion.points[0].positions
    sizes = len(start.positions_rad), len(start.tolerance_rad)
    if sizes != (len(first), len(first)):
        raise _refusal(path, "start", "does not have one number per joint")
    away = np.abs(np.subtract(start.positions_rad, first)).max()
    if not away <= SAME_RAD:
        raise _refusal(path, "start.positions_rad", f"differ from the first point by {away:.3g} rad")
    if not (np.array(start.tolerance_rad) <= arm.start_tolerance_rad).all():
        allowed = ", ".join(f"{x:g}" for x in arm.start_tolerance_rad)
        raise _refusal(path, "start.tolerance_rad", f"is wider than the arm's start.position_rad, {allowed}")


def _check_stated(path: Path, played: JointTrajectory) -> None:
    """Refuse speeds and accelerations other than those of the positions.

    Differences over the neighbours of a sample are off by less than they vary around it.
    """
    (_, slope), (_, bend), _ = differences(played)  # from two steps before the first sample on
    step_s = np.pad(np.diff(played.time_s), 2, mode="edge")[:, None]
    before_s, after_s = step_s[1:-2], step_s[2:-1]
    speed = (before_s * slope[2:-1] + after_s * slope[1:-2]) / (before_s + after_s)
    for what, unit, stated, found, varying, allowed in (
        ("speeds", "rad/s", played.qd_rad_s, speed, _spread(slope, 4)[2:-1], MISMATCH_RAD_S),
        ("accelerations", "rad/s²", played.qdd_rad_s2, bend[1:-1], _spread(bend, 3)[1:-1], MISMATCH_RAD_S2),
    ):
        off = np.abs(stated - found)
        if (off > varying + allowed).any():
            most = off[off > varying + allowed].max()
            what += f" and positions disagree by {most:.3g} {unit}"
            raise _refusal(path, "points", what, f"give the {what.split()[0]} of the positions")


def _spread(values: np.ndarray, count: int) -> np.ndarray:
    """Return by how much values (T, J) differ among `count` neighbours."""
    return np.asarray(
        scipy.ndimage.maximum_filter1d(values, count, axis=0)
        - scipy.ndimage.minimum_filter1d(values, count, axis=0)
    )


def check_limits(path: Path, what: str, arm: Arm, motion: JointTrajectory) -> None:
    """Refuse a motion that exceeds the arm's limits (SC-X004)."""
    if found := violations(arm, motion):
        raise _refusal(path, "points", f"{what}: {'; '.join(map(str, found))}")


def _check_arm(path: Path, motion: Motion, arm: Arm) -> None:
    robot = motion.robot
    if robot.file_sha256 != arm.sha256 or robot.urdf_sha256 != arm.urdf_sha256:
        raise _refusal(
            path,
            "robot",
            f"the motion was planned for {robot.name!r}, with versions of {arm.path.name} and "
            f"{arm.urdf_path.name} that differ from the present ones",
        )
    if tuple(motion.joint_names) != arm.joints:
        raise _refusal(path, "joint_names", f"are {motion.joint_names}, the arm's are {list(arm.joints)}")


def check_reach(path: Path, arm: Arm, motion: JointTrajectory, hanging_m: float) -> Reach:
    """Return the region that a motion sweeps, stopped at any instant, if it is in the workspace (SC-X004)."""
    reach = reach_of(arm, motion, hanging_m)
    outside = outside_m(arm, reach.swept_m)
    if outside > 0.0:
        raise _refusal(
            path,
            "points",
            f"the hand with {hanging_m:.2f} m hanging sweeps {box_words(reach.swept_m)}, if stopped at the "
            f"worst instant: {outside:.2f} m outside the workspace",
            "plan with a smaller workspace_m in the experiment, or widen the arm's",
        )
    return reach


def box_words(box_m: np.ndarray) -> str:
    """Return a box (2 or 3, 2) [m] in words."""
    sides = [f"{axis} {low:.2f} to {high:.2f}" for axis, (low, high) in zip("xyz", box_m, strict=False)]
    return f"{', '.join(sides)} m"


def check_state(path: Path, arm: Arm, state: ArmState) -> None:
    """Refuse an arm whose present state does not allow it to play (SC-X005)."""
    for what, fix in _state_problems(arm, state):
        raise _refusal(path, None, f"the arm cannot play: {what}", fix, code="SC-X005")


def _state_problems(arm: Arm, state: ArmState) -> Iterator[tuple[str, str]]:
    if state.fault is not None:
        yield state.fault, "clear this fault first"
    if abs(state.speed_scaling - 1.0) > FULL_SPEED_TOLERANCE:
        yield (
            f"its speed scaling is {100 * state.speed_scaling:.0f} %, which would stretch the motion",
            "set the speed slider to 100 %",
        )
    declared = arm.payload
    if (
        declared
        and state.payload_kg is not None
        and abs(state.payload_kg - declared.mass_kg) > PAYLOAD_TOLERANCE_KG
    ):
        yield (
            f"the controller's payload is {state.payload_kg:.3f} kg, "
            f"the arm's file has {declared.mass_kg:.3f} kg",
            "set the payload on the controller, or correct payload.mass_kg",
        )


def check_start(path: Path, motion: Motion, arm: Arm, state: ArmState) -> None:
    """Refuse an arm that is not at the motion's start (SC-X006), or that still moves (SC-X007)."""
    speed = float(np.abs(state.qd_rad_s).max())
    if not speed <= arm.start_velocity_rad_s:
        raise _refusal(path, "start", f"the arm still moves at {speed:.4f} rad/s", code="SC-X007")
    allowed = np.minimum(arm.start_tolerance_rad, motion.start.tolerance_rad)
    away = np.abs(state.q_rad - np.array(motion.points[0].positions))
    names = list(arm.joints) + list(state.q_held_rad)
    held = [abs(q - arm.held[name]) for name, q in state.q_held_rad.items()]
    away = np.append(away, held)
    allowed = np.append(allowed, np.full(len(held), arm.start_tolerance_rad.min()))
    if not (away <= allowed).all():
        worst = int(np.argmax(away - allowed))
        raise _refusal(
            path,
            "start",
            f"{names[worst]} is {away[worst]:.4f} rad from its start, allowed {allowed[worst]:.4f}",
            code="SC-X006",
        )


def await_start(path: Path, motion: Motion, arm: Arm, driver: Driver, clock: Clock) -> None:
    """Wait until the arm has been at rest at the motion's start for 0.3 s, and its clock has advanced.

    The refusals are those of `check_state` and `check_start`; SC-X005 also if the clock does not advance.
    """
    begun_ns = still_since_ns = clock.now_ns()
    first = state = driver.state()
    while clock.now_ns() - still_since_ns < STILL_S * 1e9:
        clock.sleep_until(clock.now_ns() + round(POLL_S * 1e9))
        state = driver.state()
        check_state(path, arm, state)
        try:
            check_start(path, motion, arm, state)
        except StrandcastError as error:
            if error.code != "SC-X007" or clock.now_ns() - begun_ns > SETTLING_S * 1e9:
                raise
            still_since_ns = clock.now_ns()
    if first.time_s is not None and state.time_s is not None and not state.time_s > first.time_s:
        raise _refusal(
            path,
            None,
            f"the controller's clock has stopped at {state.time_s} s",
            "connect again",
            code="SC-X005",
        )


def _refusal(
    path: Path, field: str | None, what: str, fix: str | None = None, code: str = "SC-X004"
) -> StrandcastError:
    return StrandcastError(code, what, file=path, field=field, cost=NOTHING_SENT, fix=fix)
