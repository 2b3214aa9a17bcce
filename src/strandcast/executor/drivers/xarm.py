"""Driver of a UFACTORY xArm, through xarm-python-sdk: set points at 250 Hz in servo mode.

In servo mode the controller follows each set point at once, and stops the arm, with an error, where the tool
or a joint would become too fast. Enabling the motors and clearing an error stay the person's part.

Tested against a protocol stand-in (tests/executor/drivers/xarm_standin.py), not against a control box.
"""

from __future__ import annotations

import contextlib
import io
import socket
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
from strandcast.executor.drivers.xarm_link import (
    FRESH_S,
    RATE_HZ,
    RealtimeReport,
    XArmLink,
    answers,
    fault_of,
)
from strandcast.executor.drivers.xarm_settings import XArmSettings
from strandcast.executor.joint_mapping import ControllerJoints
from strandcast.executor.locks import NOTHING_SENT
from strandcast.executor.move_to_start import move_to_start
from strandcast.executor.streaming.bounds import safety_bounds
from strandcast.executor.streaming.clock import wait_until
from strandcast.executor.streaming.loop import stream
from strandcast.records.motion import Motion

PACKAGE = "xarm-python-sdk"
LEAST_FIRMWARE = (2, 1, 0)  # the first that reports joints with the controller's time
ANSWER_S = 0.1  # chosen: an answer takes about 1 ms; five such failures in a row end the stream


def xarm_driver(arm: Arm, motion: Motion) -> XArmDriver:
    """Return the driver of an xArm (see `strandcast.executor.drivers.registry`)."""
    return XArmDriver(arm)


class XArmDriver:
    """An xArm of five to seven joints (see `strandcast.executor.drivers.protocol.Driver`).

    Raises
    ------
    StrandcastError
        SC-F003 settings, or another number of joints; SC-X061 no connection.
    """

    name = "xarm"
    rate_hz = RATE_HZ
    streams = True

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._settings = driver_settings(XArmSettings, arm)
        self._joints = ControllerJoints.of(arm, self._settings.joints)
        self._count = len(self._settings.joints)
        self.address = self._settings.host
        self._api: Any = None
        self._report: RealtimeReport | None = None

    def connect(self) -> None:
        """Open both connections; nothing is sent that changes anything."""
        require_address(self._arm, self.address)
        least, before_s = ".".join(map(str, LEAST_FIRMWARE)), socket.getdefaulttimeout()
        try:
            with contextlib.redirect_stdout(io.StringIO()):  # the client prints what run.json says
                client = import_module("xarm.wrapper").XArmAPI
                self._report = RealtimeReport(self.address)
                # The client asks a silent controller a hundred times, which takes four minutes.
                if not self._report.update(FRESH_S):
                    raise ConnectionError("no report comes on port 30000")
                if not answers(self.address):
                    raise ConnectionError("it reports, but answers no command on port 502")
                self._api = client(self.address, is_radian=True, do_not_open=True, report_type="normal")
                self._api.connect()
        except ImportError as error:
            raise missing_package(PACKAGE, "xarm", error) from None
        except Exception as error:  # the client raises no other class
            fix = f"check address, cable and control box; its firmware must be {least} or later"
            raise self._unusable(str(error), fix) from None
        finally:
            socket.setdefaulttimeout(before_s)  # the client sets one for the whole process
        if self._api.version_number < LEAST_FIRMWARE:
            raise self._unusable(
                f"its firmware {self._firmware()} reports no time", f"update it to {least} or later"
            )
        if self._api.axis != self._count:
            raise StrandcastError(
                "SC-F003",
                f"names {self._count} joints; the arm has {self._api.axis}",
                file=self._arm.path,
                field="driver.settings.joints",
                cost=NOTHING_SENT,
                fix="name the controller's joints from the base on",
            )
        self._api.set_timeout(ANSWER_S)
        # The client has motors and payload from its own reports, five a second; until then, a motor is -1.
        if not wait_until(lambda: min(self._api.motor_enable_states) >= 0, FRESH_S):
            raise self._unusable("no report came on port 30001", "check the network and its firewall")

    def _firmware(self) -> str:
        return ".".join(map(str, self._api.version_number))

    def _unusable(self, why: str, fix: str) -> StrandcastError:
        return no_connection(self._arm, f"the controller at {self.address} cannot be used: {why}", fix)

    def state(self) -> ArmState:
        """Return the current state; an error, a motor not enabled or a silent controller is a fault."""
        report = self._connected()
        fault = None if report.update(FRESH_S) else f"no report came on port 30000 for {FRESH_S:.0f} s"
        q, qd = report.joints(self._count)
        return ArmState(
            q_rad=self._joints.moving(q),
            qd_rad_s=self._joints.moving(qd),
            fault=fault or self._fault(report),
            q_held_rad=self._joints.held(q),
            payload_kg=self._api.tcp_load[0],
            time_s=report.time_s,
        )

    def _connected(self) -> RealtimeReport:
        assert self._report is not None
        return self._report

    def _fault(self, report: RealtimeReport) -> str | None:
        fix = "check the arm, then clear it and enable the arm in UFACTORY Studio"
        if error := fault_of(self._api):
            return f"{error}; {fix}"
        if any(enabled != 1 for enabled in self._api.motor_enable_states[: self._count]):
            return "its motors are not enabled (UFACTORY Studio, Enable Robot)"
        return None if report.moves else "it is stopped or paused (UFACTORY Studio, Enable Robot)"

    def move_to_start(self, q_rad: np.ndarray) -> None:
        """Move all joints slowly: the moving ones to (J,) angles, the held ones to theirs."""
        report = self._connected()
        report.update()
        link = XArmLink(self._api, report, self._count, None)
        q_from = report.joints(self._count)[0]
        move_to_start(link, self._arm, q_from, self._joints.all_angles(q_rad), RATE_HZ, self._settings.joints)

    def play(self, command: JointTrajectory, folder: Path) -> Recording:
        """Stream the motion in servo mode; the log has a row per set point, with the newest report."""
        link = XArmLink(self._api, self._connected(), self._count, self._joints)
        recording = stream(link, command, safety_bounds(self._arm), RATE_HZ, list(self._arm.joints))
        facts = {
            "model": f"xArm {self._count}",
            "firmware": self._firmware(),
            "serial": str(self._api.sn),
            "host": self.address,
            PACKAGE: version(PACKAGE),
        }
        return replace(recording, clock="xArm controller", controller=facts)

    def stop(self) -> None:
        """Close the connections; safe to call at any time."""
        report, self._report = self._report, None
        api, self._api = self._api, None
        if report is not None:
            report.close()
        if api is not None:
            api.disconnect()
