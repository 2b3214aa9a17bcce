"""The xArm driver's connection: set points in servo mode, and the state that port 30000 reports at 250 Hz.

UFACTORY's "Data Description of TCP port" gives the fields; from firmware 2.1.0 on, each report has the
controller's own time.
"""

from __future__ import annotations

import socket
from importlib import import_module
from typing import Any

import numpy as np

from strandcast.executor.joint_mapping import ControllerJoints
from strandcast.executor.streaming.clock import wait_until
from strandcast.executor.streaming.easing import EASE_S, Easing
from strandcast.executor.streaming.link import ControllerState, ControllerStopped

RATE_HZ = 250.0
COMMAND_PORT, REALTIME_PORT = 502, 30000
FRESH_S = 1.0  # chosen; a report comes every 4 ms
POSITION_MODE, SERVO_MODE = 0, 1
READY, PAUSED = 0, 3  # states to set, and the first that is reported of an arm that does not move
MOVE_SERVOJ = 29  # the command of a set point
UNDELIVERED_MS = 500  # chosen: a stop has been asked for long before


def answers(host: str) -> bool:
    """Ask for the version once, by the vendor's client; return whether an answer comes within 2 s."""
    port = import_module("xarm.core.comm").SocketPort(host, COMMAND_PORT)
    try:
        code = import_module("xarm.core.wrapper").UxbusCmdTcp(port).get_version()[0]
    finally:
        port.close()
    return bool(code < import_module("xarm.core.config.x_config").XCONF.UxbusState.ERR_TOUT)


class RealtimeReport:
    """The newest report of port 30000, read by the vendor's client."""

    def __init__(self, host: str) -> None:
        self._port = import_module("xarm.core.comm").SocketPort(host, REALTIME_PORT)
        self._data = import_module("xarm.x3.report").ReportDataStructure.create(REALTIME_PORT, is_radian=True)
        self.time_s, self._newest = 0.0, b""

    def update(self, within_s: float = 0.0) -> bool:
        """Take the newest report in; wait for one if none has come since. Return whether one has come."""
        # The client's own thread keeps the queue short; taking reports out could leave it waiting for one.
        reports = self._port.rx_que.queue
        came = wait_until(lambda: bool(reports) and reports[-1] is not self._newest, within_s)
        if came:
            self._newest = reports[-1]
            self._data.update(self._newest)
        self.time_s = 1e-6 * self._data.timestamp
        return came

    def joints(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the measured angles [rad] and speeds [rad/s] of the arm's joints, (J,) each."""
        data = self._data
        return np.array(data.actual_joint_angle[:count]), np.array(data.actual_joint_velocity[:count])

    @property
    def moves(self) -> bool:
        """Whether the arm is ready to move, or does."""
        return bool(self._data.state < PAUSED)

    @property
    def mode(self) -> int:
        """The controller's mode."""
        return int(self._data.mode)

    def close(self) -> None:
        """Close the connection."""
        self._port.close()


class XArmLink:
    """An xArm's `strandcast.executor.streaming.link.StreamLink`; without `joints`, all of them move."""

    paces = False

    def __init__(self, api: Any, report: RealtimeReport, count: int, joints: ControllerJoints | None) -> None:
        self._api, self._report, self._count, self._joints = api, report, count, joints
        self._easing: Easing | None = None

    def start(self) -> None:
        """Enter servo mode: from now on the arm follows each set point at once."""
        # No set point may wait in the host for those before it to be acknowledged.
        connection = self._api._arm._stream.com
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # Set points that a broken connection holds back must not reach the arm once it is back (Linux alone).
        if hasattr(socket, "TCP_USER_TIMEOUT"):
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, UNDELIVERED_MS)
        self._enter(SERVO_MODE)

    def _enter(self, mode: int) -> None:
        self._api.set_mode(mode)
        self._api.set_state(READY)
        if not wait_until(lambda: self._is_in(mode), FRESH_S):
            raise ControllerStopped(self._stopped(f"it does not enter its mode {mode}"))

    def _is_in(self, mode: int) -> bool:
        self._report.update(FRESH_S)
        return self._report.moves and mode == self._report.mode == self._api.mode

    def read(self) -> ControllerState:
        """Return the newest report's state."""
        self._report.update()
        q, qd = self._report.joints(self._count)
        fault = None if self._report.moves else self._stopped("it has stopped the arm")
        if self._joints is not None:
            q, qd = self._joints.moving(q), self._joints.moving(qd)
        return ControllerState(self._report.time_s, q, qd, fault)

    def write(self, q_rad: np.ndarray, qd_rad_s: np.ndarray) -> None:
        """Send one set point; servo mode takes no speeds.

        Raises
        ------
        ConnectionError
            The connection is lost.
        """
        wanted = q_rad if self._joints is None else self._joints.all_angles(q_rad)
        if self._easing is None:
            stands_rad = self._report.joints(self._count)[0]
            self._easing = Easing(1.0 / RATE_HZ, EASE_S, stands_rad - wanted)
        self._send(wanted + self._easing.next())

    def _send(self, q_rad: np.ndarray) -> None:
        """Send a set point without waiting for its answer, as the client's own function does.

        A late answer would hold up the next set point; what the controller refuses, its reports show.
        """
        values = np.zeros(10, "<f4")  # up to seven joints; speed, acceleration and time have no effect here
        values[: self._count] = q_rad
        if self._api._arm.arm_cmd.send_modbus_request(MOVE_SERVOJ, values.tobytes(), values.nbytes) < 0:
            raise ConnectionError("the connection to the controller is lost")

    def _stopped(self, otherwise: str) -> str:
        return fault_of(self._api) or f"the controller gives no error: {otherwise}"

    def signal(self, high: bool) -> None:
        """Do nothing: switching an output would delay set points."""

    def finish(self) -> None:
        """Leave servo mode, if the controller has not stopped the arm."""
        self._report.update()
        if self._report.moves:
            self._enter(POSITION_MODE)


def fault_of(api: Any) -> str | None:
    """Return the controller's error in words; None if it has none."""
    code, found = api.get_err_warn_code()
    if code:
        return f"the controller does not answer (code {code})"
    error = found[0]
    if not error:
        return None
    words = import_module("xarm.core.config.x_code").ControllerError(error).title["en"]
    return f"the controller reports error C{error}: {words}"
