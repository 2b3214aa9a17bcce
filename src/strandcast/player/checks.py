"""All that is checked before anything moves. The motion's own `predicted` is never trusted."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from strandcast.arm.limits import Violation, violations
from strandcast.arm.load import Arm
from strandcast.arm.reach import Reach, outside_m
from strandcast.errors import StrandcastError
from strandcast.player.clock import Clock
from strandcast.player.protocol import Command, Driver, State
from strandcast.player.surroundings import NOTHING_SENT
from strandcast.player.trajectory import Trajectory
from strandcast.records.motion import Motion

CHECK_STEP_S = 0.001
REST_RAD_S = 1e-6
REST_RAD_S2 = 1e-3
SPEED_MISMATCH_RAD_S = 0.05
FULL_SPEED_WITHIN = 0.001
PAYLOAD_WITHIN_KG = 0.05
STILL_S = 0.3
SETTLING_S = 3.0
LOOK_EVERY_S = 0.02


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
    refuse_limits(path, "the motion", found)


def refuse_limits(path: Path, what: str, found: list[Violation]) -> None:
    """Refuse what leaves the arm's limits (SC-X004)."""
    if found:
        raise _refusal("SC-X004", path, "points", f"{what}: {'; '.join(map(str, found))}",
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


def check_reach(path: Path, arm: Arm, reach: Reach, hanging_m: float) -> None:
    """Refuse a motion whose hand, or what hangs from it, can leave the workspace, a stop included.

    Raises
    ------
    StrandcastError
        SC-X008.
    """
    outside = outside_m(arm, reach.swept_m)
    if outside > 0.0:
        (x_low, x_high), (y_low, y_high) = reach.swept_m
        raise _refusal("SC-X008", path, "points",
                       f"the hand with {hanging_m:.2f} m hanging sweeps x {x_low:.2f} to {x_high:.2f}, "
                       f"y {y_low:.2f} to {y_high:.2f} m, stopped at the worst instant: {outside:.2f} m out "
                       "of the workspace",
                       "plan within a smaller workspace_m of the experiment, or widen the arm's")  # fmt: skip


def check_state(path: Path, arm: Arm, state: State) -> None:
    """Refuse an arm that cannot play as it is.

    Raises
    ------
    StrandcastError
        SC-X005.
    """
    for what, fix in _state_problems(arm, state):
        raise _refusal("SC-X005", path, None, f"the arm cannot play: {what}", fix)


def _state_problems(arm: Arm, state: State) -> Iterator[tuple[str, str]]:
    if state.trouble is not None:
        yield state.trouble, "mend that first"
    if abs(state.speed_scaling - 1.0) > FULL_SPEED_WITHIN:
        yield (
            f"its speed scaling is {100 * state.speed_scaling:.0f} %, which would stretch the motion",
            "set the speed slider to 100 %",
        )
    told = arm.payload
    if told and state.payload_kg is not None and abs(state.payload_kg - told.mass_kg) > PAYLOAD_WITHIN_KG:
        yield (
            f"the controller was told of {state.payload_kg:.3f} kg at the flange, "
            f"the arm's file of {told.mass_kg:.3f}",
            "set the payload on the controller, or mend payload.mass_kg",
        )


def check_start(path: Path, motion: Motion, arm: Arm, state: State) -> None:
    """Refuse to play from a posture that is not the motion's start, or from an arm that still moves.

    Raises
    ------
    StrandcastError
        SC-X006 it stands elsewhere, SC-X007 it still moves.
    """
    speed = float(np.abs(state.qd_rad_s).max())
    if not speed <= arm.start_velocity_rad_s:
        raise _refusal(
            "SC-X007", path, "start", f"the arm still moves at {speed:.4f} rad/s", "wait until it rests"
        )
    allowed = np.minimum(arm.start_tolerance_rad, motion.start.tolerance_rad)
    away = np.abs(state.q_rad - np.array(motion.points[0].positions))
    names = list(arm.joints) + list(state.q_held_rad)
    held = [abs(q - arm.held[name]) for name, q in state.q_held_rad.items()]
    away = np.append(away, held)
    allowed = np.append(allowed, np.full(len(held), arm.start_tolerance_rad.min()))
    if not (away <= allowed).all():
        worst = int(np.argmax(away - allowed))
        raise _refusal("SC-X006", path, "start",
                       f"{names[worst]} is {away[worst]:.4f} rad from its start, "
                       f"allowed {allowed[worst]:.4f}",
                       "move the arm to the motion's start; --move-to-start does it slowly")  # fmt: skip


def await_start(path: Path, motion: Motion, arm: Arm, driver: Driver, clock: Clock) -> None:
    """Wait until the arm has stood at the motion's start, still, for 0.3 s, its clock going on.

    Raises
    ------
    StrandcastError
        SC-X005, SC-X006, SC-X007 as above; SC-X005 too where the controller's clock stands still.
    """
    begun_ns = still_since_ns = clock.now_ns()
    first = state = driver.state()
    while clock.now_ns() - still_since_ns < STILL_S * 1e9:
        clock.sleep_until(clock.now_ns() + round(LOOK_EVERY_S * 1e9))
        state = driver.state()
        check_state(path, arm, state)
        try:
            check_start(path, motion, arm, state)
        except StrandcastError as error:
            if error.code != "SC-X007" or clock.now_ns() - begun_ns > SETTLING_S * 1e9:
                raise
            still_since_ns = clock.now_ns()
    if first.time_s is not None and state.time_s is not None and not state.time_s > first.time_s:
        raise _refusal("SC-X005", path, None, f"the controller's clock stands still at {state.time_s} s",
                       "connect anew")  # fmt: skip


def sample(motion: Motion, step_s: float) -> Command:
    """Return the motion every `step_s` from its start to its end: the quintic through its points."""
    trajectory = Trajectory(motion.time_s(), *motion.joints())
    count = max(1, round(trajectory.end_s / step_s))
    time_s = np.minimum(np.arange(count + 1) * step_s, trajectory.end_s)
    if time_s[-1] < trajectory.end_s - 1e-9:
        time_s = np.append(time_s, trajectory.end_s)
    return Command(time_s, *trajectory.at(time_s))


def _refusal(code: str, path: Path, field: str | None, what: str, fix: str | None = None) -> StrandcastError:
    return StrandcastError(code, what, file=path, field=field, cost=NOTHING_SENT,
                           fix=fix or "make the motion file again with `strandcast plan`")  # fmt: skip
