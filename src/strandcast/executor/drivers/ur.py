"""Driver of a Universal Robots arm, through ur_rtde: set points by servoJ, state by RTDE.

Nothing is sent before every check of the state has passed: until then there is only a reading connection.
All commands go through a process of their own (`ur_sender`), which can neither reconnect nor outlive the
streaming: by itself, ur_rtde would reconnect and send an old set point again. If that process or this host
dies, the controller's watchdog ends the program and the arm brakes.

Tested against a protocol stand-in (tests/executor/drivers/rtde_standin.py), not against a controller.
"""

from __future__ import annotations

import contextlib
from dataclasses import replace
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.arm.load import Arm
from strandcast.core.trajectory import JointTrajectory
from strandcast.errors import StrandcastError
from strandcast.executor.drivers.protocol import ArmState, Recording
from strandcast.executor.drivers.registry import (
    driver_settings,
    missing_package,
    no_connection,
    require_address,
)
from strandcast.executor.drivers.ur_link import UrLink, sync_events
from strandcast.executor.drivers.ur_sender import make_realtime, thread_ids
from strandcast.executor.drivers.ur_sender_handle import UrSender
from strandcast.executor.drivers.ur_settings import UrSettings
from strandcast.executor.drivers.ur_state import (
    FIELDS,
    FRESH_S,
    PAYLOAD_FIELDS,
    fault_of,
    idle_speed_scaling,
    program_runs,
    silence_of,
)
from strandcast.executor.joint_mapping import ControllerJoints
from strandcast.executor.locks import NOTHING_SENT
from strandcast.executor.move_to_start import move_to_start
from strandcast.executor.streaming.bounds import safety_bounds
from strandcast.executor.streaming.clock import wait_until
from strandcast.executor.streaming.loop import stream
from strandcast.records.motion import Motion

PACKAGE = "ur_rtde"
E_SERIES_HZ, CB3_HZ = 500.0, 125.0  # of RTDE and of servoj
REMOTE_CONTROL_SINCE = (5, 6)  # the first PolyScope whose dashboard reports remote control
# The delay of servoj besides its look-ahead: 34 ms measured at 30 ms (Universal_Robots_Client_Library #86).
SERVOJ_TRANSPORT_S = 0.004
CENTRE_TOLERANCE_M = 0.001  # chosen


def ur_driver(arm: Arm, motion: Motion) -> UrDriver:
    """Return the driver of a UR arm (see `strandcast.executor.drivers.registry`)."""
    return UrDriver(arm)


class UrDriver:
    """A UR arm, e-Series or CB3 (see `strandcast.executor.drivers.protocol.Driver`).

    Raises
    ------
    StrandcastError
        SC-F003 settings, or a wrong rate; SC-X061 no connection; SC-X005 no external control.
    """

    name = "ur"
    streams = True

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._settings = driver_settings(UrSettings, arm)
        self._joints = ControllerJoints.of(arm, self._settings.joints)
        self.rate_hz = float(self._settings.rate_hz)
        self.address = self._settings.host
        self._dashboard: Any = None
        self._receive: Any = None
        self._reports_payload = True
        self._controller: dict[str, str] = {}

    def connect(self) -> None:
        """Open the dashboard and the reading connection; nothing is sent that changes anything."""
        require_address(self._arm, self.address)
        try:
            dashboard, receive = import_module("dashboard_client"), import_module("rtde_receive")
        except ImportError as error:
            raise missing_package(PACKAGE, "ur", error) from None
        try:
            self._dashboard = dashboard.DashboardClient(self.address)
            self._dashboard.connect()
            self._controller = self._identify()
            before = thread_ids()
            self._receive = self._open_receive(receive)
            # ur_rtde keeps only the newest package: its receiving thread must not be late.
            for thread in thread_ids() - before:
                make_realtime(thread)
        except RuntimeError as error:
            raise no_connection(
                self._arm,
                f"the controller at {self.address} does not answer: {error}",
                "check address and network; dashboard, secondary interface and RTDE must be enabled "
                "under Settings, Security, Services",
            ) from None
        self._check_rate()

    def _identify(self) -> dict[str, str]:
        board = self._dashboard
        facts = {"software": board.polyscopeVersion(), "host": self.address, PACKAGE: version(PACKAGE)}
        for key, ask in (("model", board.getRobotModel), ("serial", board.getSerialNumber)):
            with contextlib.suppress(RuntimeError):  # before PolyScope 5.6
                facts[key] = ask()
        return facts

    def _open_receive(self, receive: Any) -> Any:
        try:
            return receive.RTDEReceiveInterface(self.address, self.rate_hz, FIELDS + PAYLOAD_FIELDS)
        except RuntimeError as error:
            if "payload" not in str(error):
                raise
            self._reports_payload = False
            return receive.RTDEReceiveInterface(self.address, self.rate_hz, FIELDS)

    def _check_rate(self) -> None:
        major = self._software()[0]
        rate_hz = CB3_HZ if major and major < 5 else E_SERIES_HZ
        if rate_hz != self.rate_hz:
            software = self._controller["software"]
            raise StrandcastError(
                "SC-F003",
                f"is {self.rate_hz:.0f}; PolyScope {software} has {rate_hz:.0f} Hz",
                file=self._arm.path,
                field="driver.settings.rate_hz",
                cost=NOTHING_SENT,
                fix=f"rate_hz = {rate_hz:.0f}",
            )

    def _software(self) -> tuple[int, ...]:
        parts = self._controller["software"].split(".")[:2]
        return tuple(int(part) for part in parts) if all(part.isdigit() for part in parts) else (0, 0)

    def state(self) -> ArmState:
        """Return the current state; a running program or a silent controller is a fault."""
        receive = self._receive
        q = np.array(receive.getActualQ())
        return ArmState(
            q_rad=self._joints.moving(q),
            qd_rad_s=self._joints.moving(np.array(receive.getActualQd())),
            fault=silence_of(receive) or self._not_ready() or fault_of(receive),
            q_held_rad=self._joints.held(q),
            speed_scaling=idle_speed_scaling(receive),
            payload_kg=receive.getPayload() if self._reports_payload else None,
            time_s=receive.getTimestamp(),
        )

    def _not_ready(self) -> str | None:
        if self._software() >= REMOTE_CONTROL_SINCE and not self._dashboard.isInRemoteControl():
            return "it is not in remote control (switch it at the top right of the pendant)"
        if program_runs(self._receive):
            return "a program runs on the controller (stop it at the pendant)"
        payload = self._arm.payload
        if payload is not None and self._reports_payload:
            off = np.abs(np.subtract(self._receive.getPayloadCog(), payload.centre_m)).max()
            if off > CENTRE_TOLERANCE_M:
                return f"its payload's centre is {off:.3f} m from the arm's file's (Installation, Payload)"
        return None

    def move_to_start(self, q_rad: np.ndarray) -> None:
        """Move all six joints slowly: the moving ones to (J,) angles, the held ones to theirs."""
        names = self._settings.joints
        with UrSender(self._settings) as sender:
            link = UrLink(self._receive, sender, None, self._settings)
            q_from = np.array(self._receive.getActualQ())
            move_to_start(link, self._arm, q_from, self._joints.all_angles(q_rad), self.rate_hz, names)
        wait_until(lambda: not program_runs(self._receive), FRESH_S)

    def play(self, command: JointTrajectory, folder: Path) -> Recording:
        """Stream the motion by servoJ; the log has one row for each package received."""
        settings = self._settings
        lag_s = np.full(len(self._arm.joints), settings.look_ahead_s + SERVOJ_TRANSPORT_S)
        controller = self._controller | {
            key: repr(getattr(settings, key)) for key in ("look_ahead_s", "gain", "watchdog_hz")
        }
        with UrSender(settings) as sender:
            link = UrLink(self._receive, sender, self._joints, settings)
            bounds = replace(safety_bounds(self._arm), lag_s=lag_s)
            recording = stream(link, command, bounds, self.rate_hz, list(self._arm.joints))
        return replace(
            recording,
            clock="UR controller",
            controller=controller,
            sync_events=sync_events(recording.log),
        )

    def stop(self) -> None:
        """Close the connections; what moved the arm has ended with the streaming."""
        for connection in (self._receive, self._dashboard):
            if connection is not None:
                with contextlib.suppress(RuntimeError):
                    connection.disconnect()
        self._receive = self._dashboard = None
