"""The driver of the virtual rig's arm, as a lab would write it: a client of the controller's socket."""

import json
import os
import socket
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.arm.load import Arm
from strandcast.core.trajectory import JointTrajectory
from strandcast.executor.drivers.protocol import ArmState, Recording
from strandcast.records.joint_log import JointLog
from strandcast.records.motion import Motion


def ask_arm(command: JointTrajectory, port: str) -> dict[str, Any]:
    """Have the controller play a command; return what it logged."""
    line = {key: value.tolist() for key, value in vars(command).items()}
    link = socket.create_connection(("127.0.0.1", int(port)))
    with link, link.makefile("rw") as stream:
        stream.write(json.dumps(line) + "\n")
        stream.flush()
        answer: dict[str, Any] = json.loads(stream.readline())
    return answer


class SocketArm:
    """An arm behind a socket, one throw per connection."""

    name = "socket"
    streams = False

    def __init__(self, arm: Arm) -> None:
        self.rate_hz = arm.log_rate_hz
        self.address = Path(os.environ["RIG_PORT"]).read_text()
        self._joints = list(arm.joints)
        self._q_rad = np.zeros(len(arm.joints))

    def connect(self) -> None:
        """Do nothing: each throw connects."""

    def state(self) -> ArmState:
        """Return the arm at rest."""
        return ArmState(self._q_rad, np.zeros_like(self._q_rad))

    def move_to_start(self, q_rad: np.ndarray) -> None:
        """Set the posture."""
        self._q_rad = np.array(q_rad)

    def play(self, command: JointTrajectory, folder: Path) -> Recording:
        """Send the command; return what the controller logged."""
        answer = ask_arm(command, self.address)
        columns = {key: np.array(value) for key, value in answer["log"].items()}
        log = JointLog(joint_names=self._joints, **columns)
        times = answer["motion_start_s"], answer["motion_end_s"]
        return Recording(log, answer["status"], answer["reason"], *times, clock="rig")

    def stop(self) -> None:
        """Do nothing: the arm is at rest between throws."""


def socket_driver(arm: Arm, motion: Motion) -> SocketArm:
    """Return the driver of an arm, for strandcast."""
    return SocketArm(arm)
