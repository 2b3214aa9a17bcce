"""The player's driver of a Universal Robots arm, through ur_rtde: set points by servoJ, state by RTDE.

Nothing is sent before every check of the state has passed: until then there is a reading connection only.
What moves the arm goes through a process of its own (`ur_sender`), which can neither reconnect nor outlive
the streaming: left alone, ur_rtde would reconnect and send an old set point again. Should that process or
this host die, the controller's watchdog ends the program and the arm brakes.

Tested against a protocol stand-in (tests/drivers/rtde_standin.py), not against a controller.
"""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from strandcast.arm.load import Arm
from strandcast.errors import ENVIRONMENT, StrandcastError, StrandcastErrors
from strandcast.player.approach import approach
from strandcast.player.bounds import bounds_of
from strandcast.player.drivers import missing_package, refuse_nowhere
from strandcast.player.posture import Posture
from strandcast.player.protocol import Command, Recording, State
from strandcast.player.stream import ControllerStopped, Reading, stream
from strandcast.player.ur_sender import (
    ANSWER,
    LARGEST,
    MESSAGE,
    OUTPUT,
    READY,
    SERVO,
    STOP,
    WATCH,
    realtime,
    threads,
)
from strandcast.records.joint_log import SYNC_HIGH, JointLog, SyncEvent
from strandcast.records.motion import Motion

PACKAGE = "ur_rtde"
JOINTS = 6
E_SERIES, CB3 = 500.0, 125.0  # Hz, of RTDE and of servoj
REMOTE_KNOWN = (5, 6)  # the first PolyScope whose dashboard tells remote control
# What servoj adds to its look-ahead: others measured 34 ms at 30 ms (Universal_Robots_Client_Library, 86).
SERVOJ_TRANSPORT_S = 0.004
CENTRE_TOLERANCE_M = 0.001
CONNECT_S, STOP_S, FRESH_S = 10.0, 2.0, 1.0
PACKAGE_S, POLL_S = 0.05, 5e-5
EASE_S = 0.3  # over which the arm goes from where it stands to where the motion starts
UNANSWERED = 10  # set points: so many the sender may be behind
FIRST_S = 0.2  # until the first is answered: ur_rtde waits for its program, and the arm does not move yet
SAME_PACKAGE_TRIES = 5

READ = [
    "timestamp", "actual_q", "actual_qd", "robot_mode", "safety_mode", "runtime_state", "speed_scaling",
    "target_speed_fraction", "actual_digital_output_bits", "robot_status_bits",
]  # fmt: skip
PAYLOAD = ["payload", "payload_cog"]  # not told by old controllers

RUNNING, NORMAL = 7, 1
PROGRAM_RUNS = 2  # bit of the robot status
PAUSING, PAUSED = 3, 4  # runtime states
ROBOT_MODES = {
    -1: "no controller", 0: "disconnected", 1: "confirm safety", 2: "booting", 3: "power off", 4: "power on",
    5: "idle (brakes on)", 6: "backdrive", 8: "updating firmware",
}  # fmt: skip
SAFETY_MODES = {
    2: "reduced", 3: "protective stop", 4: "recovery", 5: "safeguard stop", 6: "system emergency stop",
    7: "robot emergency stop", 8: "violation", 9: "fault", 10: "validate joint id", 11: "undefined",
}  # fmt: skip


class Settings(BaseModel):
    """What `[driver.settings]` of the arm's file may say.

    Attributes
    ----------
    host
        The controller's address. There is no default; a dry run needs none.
    rate_hz
        500 for an e-Series, 125 for a CB3.
    look_ahead_s, gain
        Of servoj. The look-ahead delays the arm by as much; the gain is that of UR's own ROS driver.
    watchdog_hz
        The controller ends the program when set points come more seldom than this.
    stop_rad_s2
        Deceleration of servoStop [rad/s²], which ends the streaming, at rest if all went well.
    sync_output
        The standard digital output (0–7) that is high during the throw, for an LED in the video; or none.
    joints
        The controller's six joints, by their names in the URDF.
    """

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    host: str
    rate_hz: Literal[500, 125] = 500
    look_ahead_s: Annotated[float, Field(ge=0.03, le=0.2)] = 0.03
    gain: Annotated[float, Field(ge=100, le=2000)] = 2000.0
    watchdog_hz: Annotated[float, Field(gt=0, le=100)] = 10.0
    stop_rad_s2: Annotated[float, Field(gt=0, le=40)] = 10.0
    sync_output: Annotated[int, Field(ge=0, le=7)] | None = None
    joints: Annotated[list[str], Field(min_length=JOINTS, max_length=JOINTS)] = [
        "shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint",
        "wrist_3_joint",
    ]  # fmt: skip


def ur_driver(arm: Arm, motion: Motion) -> UrDriver:
    """Return the driver of the UR arm that an arm's file names (see `player.drivers`)."""
    return UrDriver(arm)


class UrDriver:
    """A UR arm, e-Series or CB3 (see `strandcast.player.protocol.Driver`).

    Raises
    ------
    StrandcastError
        SC-X070 settings; SC-X071 no connection; SC-X072 another rate; SC-X073 it refuses to be led.
    """

    name = "ur"
    streams = True

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._settings = _settings(arm)
        self._posture = Posture.of(arm, self._settings.joints)
        self.rate_hz = float(self._settings.rate_hz)
        self.address = self._settings.host
        self._dashboard: Any = None
        self._receive: Any = None
        self._tells_payload = True
        self._controller: dict[str, str] = {}

    def connect(self) -> None:
        """Open the dashboard and the reading connection; nothing is sent that changes anything."""
        refuse_nowhere(self._arm, self.address)
        try:
            dashboard, receive = import_module("dashboard_client"), import_module("rtde_receive")
        except ImportError as error:
            raise missing_package(PACKAGE, "ur", error) from None
        try:
            self._dashboard = dashboard.DashboardClient(self.address)
            self._dashboard.connect()
            self._controller = self._who()
            before = threads()
            self._receive = self._reader(receive)
            # ur_rtde keeps the newest package alone: its receiving thread must not be late.
            for thread in threads() - before:
                realtime(thread)
        except RuntimeError as error:
            raise StrandcastError(
                "SC-X071", f"the controller at {self.address} does not answer: {error}",
                file=self._arm.path, field="driver.settings.host", cost="nothing was sent to the arm",
                fix="check address and network; dashboard, secondary interface and RTDE must be enabled "
                    "under Settings, Security, Services", exit_code=ENVIRONMENT) from None  # fmt: skip
        self._check_rate()

    def _who(self) -> dict[str, str]:
        board = self._dashboard
        who = {"software": board.polyscopeVersion(), "host": self.address, PACKAGE: version(PACKAGE)}
        for key, ask in (("model", board.getRobotModel), ("serial", board.getSerialNumber)):
            with contextlib.suppress(RuntimeError):  # before PolyScope 5.6
                who[key] = ask()
        return who

    def _reader(self, receive: Any) -> Any:
        try:
            return receive.RTDEReceiveInterface(self.address, self.rate_hz, READ + PAYLOAD)
        except RuntimeError as error:
            if "payload" not in str(error):
                raise
            self._tells_payload = False
            return receive.RTDEReceiveInterface(self.address, self.rate_hz, READ)

    def _check_rate(self) -> None:
        major = self._software()[0]
        rate_hz = CB3 if major and major < 5 else E_SERIES
        if rate_hz != self.rate_hz:
            software = self._controller["software"]
            raise StrandcastError(
                "SC-X072", f"is {self.rate_hz:.0f}; PolyScope {software} has {rate_hz:.0f} Hz",
                file=self._arm.path, field="driver.settings.rate_hz", cost="nothing was sent to the arm",
                fix=f"rate_hz = {rate_hz:.0f}")  # fmt: skip

    def _software(self) -> tuple[int, ...]:
        parts = self._controller["software"].split(".")[:2]
        return tuple(int(part) for part in parts) if all(part.isdigit() for part in parts) else (0, 0)

    def state(self) -> State:
        """Return how the arm stands now; a running program, or a controller that says nothing, is trouble."""
        receive = self._receive
        q = np.array(receive.getActualQ())
        return State(
            q_rad=self._posture.moving(q),
            qd_rad_s=self._posture.moving(np.array(receive.getActualQd())),
            trouble=self._silence() or self._unready() or trouble_of(receive),
            q_held_rad=self._posture.held(q),
            speed_scaling=_idle_scaling(receive),
            payload_kg=receive.getPayload() if self._tells_payload else None,
            time_s=receive.getTimestamp(),
        )

    def _silence(self) -> str | None:
        """Return that the controller's clock stands still, if it does."""
        before = self._receive.getTimestamp()
        if _wait_until(lambda: self._receive.getTimestamp() != before):
            return None
        return f"nothing new came from the controller for {FRESH_S:.0f} s"

    def _unready(self) -> str | None:
        if self._software() >= REMOTE_KNOWN and not self._dashboard.isInRemoteControl():
            return "it is not in remote control (switch it at the top right of the pendant)"
        if program_runs(self._receive):
            return "a program runs on the controller (stop it at the pendant)"
        payload = self._arm.payload
        if payload is not None and self._tells_payload:
            off = np.abs(np.subtract(self._receive.getPayloadCog(), payload.centre_m)).max()
            if off > CENTRE_TOLERANCE_M:
                return f"its payload's centre is {off:.3f} m from the arm's file's (Installation, Payload)"
        return None

    def move_to_start(self, q_rad: np.ndarray) -> None:
        """Move all six joints slowly: the moving ones to (J,) angles, the held ones to theirs."""
        self._refuse_trouble()
        names = self._settings.joints
        with _Sender(self._settings) as sender:
            link = UrLink(self._receive, sender, None, self._settings)
            q_from = np.array(self._receive.getActualQ())
            approach(link, q_from, self._posture.whole(q_rad), self.rate_hz, names)
        _wait_until(lambda: not program_runs(self._receive))

    def _refuse_trouble(self) -> None:
        state = self.state()
        trouble = state.trouble
        if trouble is None and state.speed_scaling != 1.0:
            trouble = f"its speed is scaled to {state.speed_scaling:.0%} (set the slider to 100 %)"
        if trouble is not None:
            raise StrandcastError(
                "SC-X073", f"the arm cannot be moved: {trouble}", file=self._arm.path,
                cost="nothing was sent to the arm", fix="mend that first")  # fmt: skip

    def play(self, command: Command, folder: Path) -> Recording:
        """Stream the motion by servoJ; the log has one row for each package that was seen."""
        settings = self._settings
        lag_s = np.full(len(self._arm.joints), settings.look_ahead_s + SERVOJ_TRANSPORT_S)
        controller = self._controller | {
            "look_ahead_s": repr(settings.look_ahead_s), "gain": repr(settings.gain),
            "watchdog_hz": repr(settings.watchdog_hz),
        }  # fmt: skip
        with _Sender(settings) as sender:
            link = UrLink(self._receive, sender, self._posture, settings)
            bounds = replace(bounds_of(self._arm), lag_s=lag_s)
            recording = stream(
                link, command, bounds, self.rate_hz, list(self._arm.joints),
                clock_name="UR controller", controller=controller,
            )  # fmt: skip
        return replace(recording, sync_events=switchings(recording.log))

    def stop(self) -> None:
        """Let the connections go; what moved the arm has ended with the streaming."""
        for connection in (self._receive, self._dashboard):
            if connection is not None:
                with contextlib.suppress(RuntimeError):
                    connection.disconnect()
        self._receive = self._dashboard = None


def trouble_of(receive: Any) -> str | None:
    """Return why the controller cannot move the arm by itself: its safety mode or its robot mode; or None."""
    safety, mode = receive.getSafetyMode(), receive.getRobotMode()
    if safety != NORMAL:
        return f"the controller's safety mode is: {SAFETY_MODES.get(safety, safety)}"
    if mode != RUNNING:
        return f"the controller's robot mode is: {ROBOT_MODES.get(mode, mode)}"
    return None


def program_runs(receive: Any) -> bool:
    """Return whether a program runs on the controller, and is not paused."""
    paused = receive.getRuntimeState() in (PAUSING, PAUSED)
    return bool(receive.getRobotStatus() & PROGRAM_RUNS) and not paused


def switchings(log: JointLog) -> list[SyncEvent]:
    """Return when the sync output switched: between two packages, and no better than they are apart."""
    high = (log.flags & SYNC_HIGH) != 0
    return [
        SyncEvent(
            kind="led_on" if high[k + 1] else "led_off",
            time_s=round(float(log.time_s[k] + log.time_s[k + 1]) / 2.0, 6),
            sigma_s=round(float(log.time_s[k + 1] - log.time_s[k]) / 12**0.5, 6),
        )
        for k in np.flatnonzero(np.diff(high))
    ]


def _wait_until(true: Callable[[], bool], patience_s: float = FRESH_S) -> bool:
    """Wait until something is true; return whether it is, after so long at most."""
    until = time.monotonic() + patience_s
    while not true():
        if time.monotonic() > until:
            return False
        time.sleep(POLL_S)
    return True


def _idle_scaling(receive: Any) -> float:
    # The trajectory limiter may stand at zero while no program runs; the slider is told always.
    limiter, slider = receive.getSpeedScaling(), receive.getTargetSpeedFraction()
    if limiter == 0.0 and not program_runs(receive):
        return float(slider)
    return float(limiter * slider)


class UrLink:
    """What the streaming loop reads and writes (see `player.stream.Link`).

    Parameters
    ----------
    receive
        ur_rtde's RTDEReceiveInterface.
    sender
        The process that sends.
    posture
        Of the moving joints among all six; None: all six move.
    settings
        The driver's.
    """

    paces = False

    def __init__(self, receive: Any, sender: _Sender, posture: Posture | None, settings: Settings) -> None:
        self._receive, self._sender, self._settings = receive, sender, settings
        self._whole: Callable[[np.ndarray], np.ndarray] = posture.whole if posture else np.asarray
        self._moving: Callable[[np.ndarray], np.ndarray] = posture.moving if posture else np.asarray
        self._off_rad: np.ndarray | None = None  # from the motion's start, where the arm stands at first
        self._written = 0
        self._bit = 0 if settings.sync_output is None else 1 << settings.sync_output

    def start(self) -> None:
        """Have the controller watch over us: from now on it ends the program when set points fail to come."""
        self.signal(False)  # the first time takes long: a connection of its own is opened
        self._sender.watch()
        if not _wait_until(lambda: program_runs(self._receive)):
            raise ControllerStopped("the program does not run on the controller")
        # Half a cycle off the packages: read then, none is missed that is a little early or late.
        before = self._receive.getTimestamp()
        _wait_until(lambda: self._receive.getTimestamp() != before, PACKAGE_S)
        time.sleep(0.5 / self._settings.rate_hz)

    def read(self) -> Reading:
        """Return the newest package's state."""
        return self._reading(self._trouble())

    def _trouble(self) -> str | None:
        trouble = trouble_of(self._receive)
        if trouble is None and not program_runs(self._receive):
            return "the program on the controller was stopped"
        return trouble

    def _reading(self, trouble: str | None) -> Reading:
        receive = self._receive
        for _ in range(SAME_PACKAGE_TRIES):  # each value is asked for by itself: all must be of one package
            time_s = receive.getTimestamp()
            q, qd = receive.getActualQ(), receive.getActualQd()
            bits = receive.getActualDigitalOutputBits()
            scaling = receive.getSpeedScaling() * receive.getTargetSpeedFraction()
            if receive.getTimestamp() == time_s:
                break
        return Reading(time_s, self._moving(q), self._moving(qd), trouble, scaling, bool(bits & self._bit))

    def write(self, q_rad: np.ndarray, qd_rad_s: np.ndarray) -> None:
        """Hand one set point to the sender; servoJ takes no speeds.

        Raises
        ------
        ControllerStopped
            An earlier one was refused.
        ConnectionError
            The sender is behind, or has ended: the connection is broken.
        """
        self._sender.send(SERVO, self._eased(self._whole(q_rad)))
        if not self._sender.taken():
            raise ControllerStopped(self._trouble() or "the controller refused a set point")

    def _eased(self, whole_rad: np.ndarray) -> np.ndarray:
        """Return set points (6,) that begin where the arm stands: servoj would answer a step with a jerk."""
        if self._off_rad is None:
            self._off_rad = np.array(self._receive.getActualQ()) - whole_rad
        s = min(1.0, self._written / (EASE_S * self._settings.rate_hz))
        self._written += 1
        return whole_rad + self._off_rad * (1.0 - s**3 * (10.0 - 15.0 * s + 6.0 * s * s))

    def signal(self, high: bool) -> None:
        """Switch the sync output, if the arm's file names one."""
        if self._settings.sync_output is not None:
            self._sender.send(OUTPUT, [self._settings.sync_output, high, 0, 0, 0, 0])

    def finish(self) -> None:
        """Leave servo mode and end the program; whatever comes of it, the sender's process has ended then."""
        with contextlib.suppress(OSError):
            self.signal(False)
        self._sender.end()


class _Sender:
    """The sending process (see `ur_sender`), from its start, when the program is uploaded, to its end."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._waiting, self._patience = 0, FIRST_S * settings.rate_hz
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> _Sender:
        """Start it, and wait until the controller runs its program."""
        s = self._settings
        self._link, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        numbers = [str(x) for x in (s.look_ahead_s, s.gain, s.rate_hz)]
        module = [sys.executable, "-m", "strandcast.player.ur_sender"]
        command = [*module, str(theirs.fileno()), s.host, *numbers]
        with theirs:
            self._process = subprocess.Popen(
                command, pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL, start_new_session=True,
            )  # fmt: skip
        self._link.settimeout(CONNECT_S)
        what, well, text = self._answer() or (STOP, False, f"no answer for {CONNECT_S:.0f} s")
        if what != READY or not well:
            self.__exit__()
            raise StrandcastError(
                "SC-X073", f"the controller does not let itself be led: {text}",
                field="driver.settings.host", cost="the arm was not moved",
                fix="see the pendant; end other programs and clients")  # fmt: skip
        self._link.setblocking(False)
        return self

    def __exit__(self, *error: object) -> None:
        """End the process, however it is."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None
            self._link.close()

    def _answer(self) -> tuple[bytes, bool, str] | None:
        """Return the next answer; None if none has come (yet)."""
        try:
            message = self._link.recv(LARGEST)
        except (BlockingIOError, TimeoutError):
            return None
        if not message:
            return STOP, False, "the sending process has ended"
        what, well = ANSWER.unpack(message[: ANSWER.size])
        return what, well, message[ANSWER.size :].decode(errors="replace")

    def send(self, what: bytes, numbers: Any) -> None:
        """Hand over one message; it does not wait."""
        self._link.send(MESSAGE.pack(what, *numbers))
        self._waiting += what == SERVO

    def watch(self) -> None:
        """Arm the controller's watchdog, and wait until it is: that takes longer than a set point may."""
        self.send(WATCH, [self._settings.watchdog_hz, 0, 0, 0, 0, 0])
        self._link.settimeout(CONNECT_S)
        while (answer := self._answer()) is not None and answer[0] not in (WATCH, STOP):
            pass
        self._link.setblocking(False)
        if answer is None or answer[0] == STOP:
            raise ConnectionError(answer[2] if answer else "the controller did not take the watchdog")

    def taken(self) -> bool:
        """Take the answers that have come; return whether all set points among them were taken.

        Raises
        ------
        ConnectionError
            The sender has ended, or no answers come any more.
        """
        well = True
        while (answer := self._answer()) is not None:
            what, good, text = answer
            if what == STOP:
                raise ConnectionError(text or "the sending process has ended")
            if what == SERVO:
                self._waiting, self._patience = 0, UNANSWERED
                well = well and good
        if self._hangs():
            raise ConnectionError(f"ur_rtde did not return from servoJ for {self._waiting} set points")
        return well

    def _hangs(self) -> bool:
        return self._waiting > self._patience

    def end(self) -> None:
        """Ask for the stop, wait for it a moment, end the process.

        One that hangs in a set point is ended at once: it would send it as soon as the connection is back.
        """
        with contextlib.suppress(OSError):
            if not self._hangs():
                self._link.settimeout(STOP_S)
                self.send(STOP, [self._settings.stop_rad_s2, 0, 0, 0, 0, 0])
                while (answer := self._answer()) is not None and answer[0] != STOP:
                    pass
        self.__exit__()


def _settings(arm: Arm) -> Settings:
    try:
        return Settings.model_validate(arm.driver_settings)
    except ValidationError as error:
        raise StrandcastErrors(
            [
                StrandcastError(
                    "SC-X070", problem["msg"], file=arm.path, cost="nothing was sent to the arm",
                    field=".".join(["driver", "settings", *map(str, problem["loc"])]),
                    fix="see `strandcast.player.ur.Settings`, which explains every key",
                )
                for problem in error.errors()
            ]
        ) from None  # fmt: skip
