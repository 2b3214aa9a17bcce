"""The player's driver of a Franka arm, through pylibfranka: positions at 1 kHz, paced by the controller.

The controller's reflexes stop the arm at any command that is not continuous up to the acceleration, that
comes late twenty times running, or that leaves its limits. So every stream starts at the posture that the
controller holds, and eases back to the motion after cycles that were lost. A reflex stays until somebody
clears it: in Desk, or by `FrankaDriver.recover`.
"""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from strandcast.arm.load import Arm
from strandcast.errors import ENVIRONMENT, STOPPED_BY_CONTROLLER, StrandcastError, StrandcastErrors
from strandcast.player.approach import approach
from strandcast.player.bounds import bounds_of
from strandcast.player.drivers import missing_package, refuse_nowhere
from strandcast.player.posture import Posture
from strandcast.player.protocol import Command, Recording, State
from strandcast.player.stream import ControllerStopped, Reading, stream
from strandcast.records.files import write_text
from strandcast.records.motion import Motion

PACKAGE = "pylibfranka"
RATE_HZ = 1000.0
CYCLE_S = 0.001
JOINTS = 7
STATES = "franka.csv"
# A stream begins where the controller's own set point is, not where the motion's start is, and after lost
# cycles where the controller has extrapolated to: what lies between is eased out over these times.
START_EASE_S = 0.3
START_MOST_RAD = 0.02
GAP_EASE_S = 0.05
TOO_LATE_NS = 1_000_000
TELLING_CYCLES = 200
LOAD_ROUNDING_KG = 1e-5
ENDING_CYCLES = 500  # in which an ease comes to its end, some cycles being lost
SETTLED = 100  # states until the success rate, over so many commands, says something

# Speed limits of the FR3 by position: min(most, max(0, sqrt(2 braking (end - q)) - offset)), and likewise
# towards the lower end (Franka Robotics, "Robot specifications", limits for the Franka Research 3).
MOST_SPEED_RAD_S = np.array([2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26])
SPEED_OFFSET_RAD_S = np.array([0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35])
BRAKING_RAD_S2 = np.array([6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0])
LOWER_RAD = np.array([-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196])
UPPER_RAD = np.array([2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196])
SPEED_MARGIN = 0.95

Seven = Annotated[list[Annotated[float, Field(gt=0)]], Field(min_length=JOINTS, max_length=JOINTS)]
Six = Annotated[list[Annotated[float, Field(gt=0)]], Field(min_length=6, max_length=6)]
Three = Annotated[list[float], Field(min_length=3, max_length=3)]


class Settings(BaseModel):
    """What `[driver.settings]` of the arm's file may say.

    Attributes
    ----------
    host
        The controller's address. There is no default; a dry run needs none.
    realtime
        "enforce": refuse a kernel without real-time scheduling; "ignore": for simulators.
    joints
        The controller's seven joints, by their names in the URDF.
    torque_threshold_n_m, force_threshold_n
        Collision behaviour: the controller stops the arm beyond these; left as Desk has them if not given.
    load_inertia_kg_m2
        (Ixx, Iyy, Izz) of the payload about its centre.
    """

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    host: str
    realtime: Literal["enforce", "ignore"] = "enforce"
    joints: Annotated[list[str], Field(min_length=JOINTS, max_length=JOINTS)] = [
        f"fr3_joint{j}" for j in range(1, JOINTS + 1)
    ]
    torque_threshold_n_m: Seven | None = None
    force_threshold_n: Six | None = None
    load_inertia_kg_m2: Three = [1e-5, 1e-5, 1e-5]

    @model_validator(mode="after")
    def _both_thresholds(self) -> Settings:
        if (self.torque_threshold_n_m is None) != (self.force_threshold_n is None):
            raise ValueError("torque_threshold_n_m and force_threshold_n are set together, or left alone")
        return self


def franka_driver(arm: Arm, motion: Motion) -> FrankaDriver:
    """Return the driver of the Franka arm that an arm's file names (see `player.drivers`)."""
    return FrankaDriver(arm)


class FrankaDriver:
    """A Franka Research 3 (see `strandcast.player.protocol.Driver`).

    Raises
    ------
    StrandcastError
        SC-X060 settings; SC-X061 no connection; SC-X062 too fast so near a joint's end; SC-X063 no recovery.
    """

    name = "franka"
    rate_hz = RATE_HZ
    streams = True

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._settings = _settings(arm)
        self.address = self._settings.host
        self._posture = Posture.of(arm, self._settings.joints)
        self._vendor: Any = None
        self._robot: Any = None

    def connect(self) -> None:
        """Connect, and tell the controller collision behaviour and payload."""
        refuse_nowhere(self._arm, self.address)
        try:
            self._vendor = import_module(PACKAGE)
        except ImportError as error:
            raise missing_package(PACKAGE, "franka", error) from None
        vendor, settings = self._vendor, self._settings
        config = vendor.RealtimeConfig
        config = config.kEnforce if settings.realtime == "enforce" else config.kIgnore
        try:
            self._robot = vendor.Robot(settings.host, config)
            self._tell()
        except vendor.RealtimeException as error:
            raise self._no_service(
                error, 'use a kernel with PREEMPT_RT; for a simulator, realtime = "ignore"'
            ) from None
        except RuntimeError as error:
            self._robot = None
            raise self._no_service(
                error, "unlock the joints and activate FCI in Desk; look at the address, and for another "
                       "program that is connected") from None  # fmt: skip

    def _no_service(self, error: RuntimeError, fix: str) -> StrandcastError:
        said = str(error).removeprefix("libfranka: ")
        return StrandcastError(
            "SC-X061", f"the controller at {self._settings.host} does not serve us: {said}",
            file=self._arm.path, field="driver.settings", cost="the motion was not played", fix=fix,
            exit_code=ENVIRONMENT)  # fmt: skip

    def _tell(self) -> None:
        settings, payload = self._settings, self._arm.payload
        torque, force = settings.torque_threshold_n_m, settings.force_threshold_n
        if torque is not None and force is not None:
            self._robot.set_collision_behavior(torque, torque, force, force)
        if payload is not None:
            inertia = np.diag(settings.load_inertia_kg_m2).ravel().tolist()
            self._robot.set_load(payload.mass_kg, list(payload.centre_m), inertia)
            # The next states may still be older; `state` then tells the core whether it was taken.
            for _ in range(TELLING_CYCLES):
                if abs(self._robot.read_once().m_load - payload.mass_kg) < LOAD_ROUNDING_KG:
                    break

    def state(self) -> State:
        """Return how the arm stands now; trouble is a mode other than idle, or an error of the controller."""
        state = self._look()
        return State(
            q_rad=self._posture.moving(np.array(state.q)),
            qd_rad_s=self._posture.moving(np.array(state.dq)),
            trouble=self._trouble(state),
            q_held_rad=self._posture.held(np.array(state.q)),
            payload_kg=state.m_load,
            time_s=state.time.to_sec(),
        )

    def _look(self) -> Any:
        try:
            return self._robot.read_once()
        except RuntimeError as error:
            raise self._no_service(error, "look at the controller, and connect anew") from None

    def _trouble(self, state: Any) -> str | None:
        mode = state.robot_mode
        if mode == self._vendor.RobotMode.Idle and not state.current_errors:
            return None
        errors = f", errors {state.current_errors}" if state.current_errors else ""
        mend = "look at the arm, then clear it in Desk, or by its enabling device"
        return f"the controller is in mode {mode.name}{errors}; {mend}"

    def recover(self) -> str:
        """Clear a reflex once somebody has looked at the arm, and return what was cleared."""
        before = self._look()
        try:
            self._robot.automatic_error_recovery()
        except RuntimeError as error:
            raise StrandcastError(
                "SC-X063", f"the controller does not recover: {error}", file=self._arm.path,
                fix="clear the error in Desk", exit_code=STOPPED_BY_CONTROLLER) from None  # fmt: skip
        return f"recovered from mode {before.robot_mode.name}, errors {before.current_errors}"

    def move_to_start(self, q_rad: np.ndarray) -> None:
        """Move all seven joints slowly, the throw's to (J,) angles, the others to where they are held."""
        link = FrankaLink(self._vendor, self._robot, np.arange(JOINTS))
        stands = np.array(self._look().q_d)
        approach(link, stands, self._posture.whole(q_rad), RATE_HZ, self._settings.joints)

    def play(self, command: Command, folder: Path) -> Recording:
        """Stream the motion; all seven joints' states go to franka.csv in `folder`, fault or none."""
        check_speeds(self._arm, self._posture.places, command)
        link = FrankaLink(self._vendor, self._robot, self._posture.places)
        # The controller watches measured speeds itself, with a reflex that is faster than our stop.
        bounds = replace(bounds_of(self._arm), velocity_rad_s=np.full(len(self._arm.joints), np.inf))
        recording = stream(
            link, command, bounds, RATE_HZ, list(self._arm.joints),
            clock_name="Franka controller", controller=self._controller(),
        )  # fmt: skip
        recording.controller.update(summary(link.states, link.answers_ns))
        try:
            write_text(folder / STATES, states_table(link.states))
        except OSError as error:  # joints.csv may find room yet, and is what counts
            recording.controller[STATES] = f"not written ({error.strerror})"
        return recording

    def _controller(self) -> dict[str, str]:
        return {"model": "Franka Research 3", "host": self._settings.host,
                "realtime": self._settings.realtime, PACKAGE: version(PACKAGE)}  # fmt: skip

    def stop(self) -> None:
        """Stop whatever still moves and let the connection go; safe to call at any time."""
        robot, self._robot = self._robot, None
        if robot is not None:
            try:
                robot.stop()
            except RuntimeError:
                return  # the connection is gone, and with it the motion


class FrankaLink:
    """One stream of joint positions (see `strandcast.player.stream.Link`).

    Parameters
    ----------
    vendor, robot
        The package, and its connected `Robot`.
    moving
        (J,) which of the seven joints are streamed; the others stay where they are.
    """

    paces = True

    def __init__(self, vendor: Any, robot: Any, moving: np.ndarray) -> None:
        self._vendor, self._robot, self._moving = vendor, robot, moving
        self._control: Any = None  # while streaming
        self._answered_s = 0.0  # time of the last state that was answered
        self._ease: Ease | None = None
        self._sent = np.zeros(JOINTS)
        self._planned = self._planned_speed = np.zeros(len(moving))
        self.states: list[tuple[int, Any]] = []  # host's time [ns] and state, converted after the stream
        self.answers_ns: list[int] = []  # from each state to its answer

    def start(self) -> None:
        """Take control; from now on the controller waits for an answer to every state."""
        mode = self._vendor.ControllerMode.JointImpedance
        with self._controllers_end():
            self._control = self._robot.start_joint_position_control(mode)

    def read(self) -> Reading:
        """Wait for the controller's next state; before the stream and after its end, look on."""
        with self._controllers_end():
            state = self._robot.read_once() if self._control is None else self._control.readOnce()[0]
        self.states.append((time.monotonic_ns(), state))
        return Reading(state.time.to_sec(), np.array(state.q)[self._moving], np.array(state.dq)[self._moving])

    def write(self, q_rad: np.ndarray, qd_rad_s: np.ndarray) -> None:
        """Answer the newest state with (J,) angles, eased in from where the controller's set point is.

        An answer that would come too late is not sent: the controller has gone on without it.
        """
        read_ns, state = self.states[-1]
        if time.monotonic_ns() - read_ns > TOO_LATE_NS and self._ease is not None:
            return
        cycles = round((state.time.to_sec() - self._answered_s) / CYCLE_S)
        if self._ease is None:
            self._sent[:] = state.q_d
            self._ease = _ease_in(self._sent[self._moving] - q_rad)
        elif cycles > 1:
            self._ease = self._caught_up(state, cycles, q_rad, qd_rad_s)
        self._sent[self._moving] = q_rad + self._ease.next()
        self._planned, self._planned_speed = q_rad.copy(), qd_rad_s.copy()
        self._answered_s = state.time.to_sec()
        self._send(finished=False)

    def _caught_up(self, state: Any, cycles: int, q_rad: np.ndarray, qd_rad_s: np.ndarray) -> Ease:
        """Return how to ease back from where the controller has extrapolated to, one cycle ahead."""
        q, qd, qdd = (np.array(value)[self._moving] for value in (state.q_d, state.dq_d, state.ddq_d))
        planned = (qd_rad_s - self._planned_speed) / (cycles * CYCLE_S)
        qd = qd + qdd * CYCLE_S
        return Ease(GAP_EASE_S, q + qd * CYCLE_S - q_rad, qd - qd_rad_s, qdd - planned)

    def _send(self, finished: bool) -> None:
        command = self._vendor.JointPositions(self._sent.tolist())
        command.motion_finished = finished
        with self._controllers_end():
            self._control.writeOnce(command)
        self.answers_ns.append(time.monotonic_ns() - self.states[-1][0])

    @contextmanager
    def _controllers_end(self) -> Iterator[None]:
        """Note the end of the stream where the controller ends it; the control must be let go to look on."""
        try:
            yield
        except RuntimeError as error:
            self._control = None
            raise ControllerStopped(str(error).removeprefix("libfranka: ")) from None

    def finish(self) -> None:
        """End the stream, at rest."""
        try:
            if self._control is not None and self._ease is not None:
                self._end_eased(self._ease)
        except ControllerStopped:
            return
        finally:
            # The controller is let go with the last reference to it, which an error's traceback may keep.
            self._control = self._robot = None

    def _end_eased(self, ease: Ease) -> None:
        for _ in range(ENDING_CYCLES):
            if not ease.left():
                break
            self.read()
            self.write(self._planned, np.zeros(len(self._planned)))
            ease = self._ease or ease
        self.read()
        self._send(finished=True)

    def signal(self, high: bool) -> None:
        """Do nothing: the controller has no output that its 1 kHz interface can switch."""


def _ease_in(off_rad: np.ndarray) -> Ease:
    worst = float(np.abs(off_rad).max())
    if worst > START_MOST_RAD:
        raise ValueError(f"the controller's set point is {worst:.3f} rad from where the motion starts")
    return Ease(START_EASE_S, off_rad)


class Ease:
    """What is to be added to a command, cycle by cycle: from a start with speed and acceleration to nothing.

    Parameters
    ----------
    duration_s
        How long it takes.
    e, ed, edd
        (J,) where it starts [rad], its speed and its acceleration there.
    """

    def __init__(self, duration_s: float, e: np.ndarray, ed: Any = 0.0, edd: Any = 0.0) -> None:
        count = round(duration_s / CYCLE_S)
        s = (np.arange(count + 1) / count)[:, None]
        c0, c1, c2 = e, ed * duration_s, 0.5 * edd * duration_s**2
        c3, c4, c5 = -10 * c0 - 6 * c1 - 3 * c2, 15 * c0 + 8 * c1 + 3 * c2, -6 * c0 - 3 * c1 - c2
        self._rows = c0 + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5))))
        self._next = 0

    def next(self) -> np.ndarray:
        """Return (J,) what to add now [rad], and go on to the next cycle."""
        row: np.ndarray = self._rows[min(self._next, len(self._rows) - 1)]
        self._next += 1
        return row

    def left(self) -> bool:
        """Return whether there is something left to add."""
        return self._next < len(self._rows)


def check_speeds(arm: Arm, moving: np.ndarray, command: Command) -> None:
    """Refuse a motion that is too fast so near a joint's end: the controller would stop it there.

    Parameters
    ----------
    moving
        (J,) which of the seven joints the motion moves.

    Raises
    ------
    StrandcastError
        SC-X062.
    """
    lowest, highest = speed_limits(command.q_rad, moving)
    over = np.maximum(command.qd_rad_s - highest, lowest - command.qd_rad_s)
    if (over <= 0.0).all():
        return
    k, j = np.unravel_index(int(np.argmax(over)), over.shape)
    raise StrandcastError(
        "SC-X062",
        f"{arm.joints[j]} would move at {command.qd_rad_s[k, j]:.2f} rad/s at {command.time_s[k]:.3f} s; at "
        f"{command.q_rad[k, j]:.2f} rad, near its end, the controller allows {lowest[k, j]:.2f} to "
        f"{highest[k, j]:.2f} rad/s",
        cost="nothing was sent to the arm", fix="widen margins.position_rad, and plan again")  # fmt: skip


def speed_limits(q_rad: np.ndarray, moving: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and the highest speeds [rad/s] allowed at positions (T, J), margin taken off."""
    most, offset, braking = MOST_SPEED_RAD_S[moving], SPEED_OFFSET_RAD_S[moving], BRAKING_RAD_S2[moving]
    up, down = UPPER_RAD[moving] - q_rad, q_rad - LOWER_RAD[moving]
    highest = np.clip(np.sqrt(2.0 * braking * np.maximum(up, 0.0)) - offset, 0.0, most)
    lowest = -np.clip(np.sqrt(2.0 * braking * np.maximum(down, 0.0)) - offset, 0.0, most)
    return SPEED_MARGIN * lowest, SPEED_MARGIN * highest


def summary(states: list[tuple[int, Any]], answers_ns: list[int]) -> dict[str, str]:
    """Return what a run's record says of a stream: commands that came too late, time to answer, torques."""
    streamed = [state for _, state in states if state.control_command_success_rate > 0.0][SETTLED:]
    if not streamed:
        return {}
    least = min(state.control_command_success_rate for state in streamed)
    p50, p99, longest = np.percentile(answers_ns, [50, 99, 100]) / 1e3
    torque = np.abs([state.tau_J for state in streamed]).max(axis=0)
    return {
        "least_success_rate": f"{least:.2f}",
        "answer_us": f"p50 {p50:.0f}, p99 {p99:.0f}, longest {longest:.0f}",
        "peak_torque_n_m": " ".join(f"{value:.1f}" for value in torque),
    }


def states_table(states: list[tuple[int, Any]]) -> str:
    """Return all seven joints' states as CSV: what was asked for (q_d), what was done, torques, success."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    groups = ("q_d", "q", "dq", "tau_J")
    units = ("rad", "rad", "rad_s", "n_m")
    columns = [f"{g}{j}_{unit}" for g, unit in zip(groups, units, strict=True) for j in range(1, JOINTS + 1)]
    writer.writerow(["host_time_ns", "controller_time_s", *columns, "success_rate", "mode"])
    for host_ns, state in states:
        values = [repr(float(value)) for group in groups for value in getattr(state, group)]
        rate, mode = state.control_command_success_rate, state.robot_mode.name
        writer.writerow([host_ns, repr(state.time.to_sec()), *values, rate, mode])
    return out.getvalue()


def _settings(arm: Arm) -> Settings:
    try:
        return Settings.model_validate(arm.driver_settings)
    except ValidationError as error:
        raise StrandcastErrors(
            [
                StrandcastError(
                    "SC-X060", f"{problem['msg']} (is {problem['input']!r})", file=arm.path,
                    field=".".join(["driver.settings", *map(str, problem["loc"])]),
                    fix="see config/arms/fr3-example.toml, which explains every key")
                for problem in error.errors()
            ]
        ) from None  # fmt: skip
