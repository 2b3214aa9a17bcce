"""Driver of a Franka arm, through pylibfranka: positions at 1 kHz, paced by the controller.

The controller's reflexes stop the arm at any command that is not continuous up to the acceleration, that
comes late twenty times in a row, or that leaves its limits. So every stream starts at the posture that the
controller holds, and eases back to the motion after lost cycles. A reflex stays until a person clears it in
Desk.
"""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.arm.load import Arm
from strandcast.core.trajectory import JointTrajectory
from strandcast.errors import ENVIRONMENT, StrandcastError
from strandcast.executor.drivers.franka_limits import check_speeds
from strandcast.executor.drivers.franka_link import FrankaLink
from strandcast.executor.drivers.franka_settings import JOINTS, FrankaSettings
from strandcast.executor.drivers.protocol import ArmState, Recording
from strandcast.executor.drivers.registry import driver_settings, missing_package, require_address
from strandcast.executor.joint_mapping import ControllerJoints
from strandcast.executor.move_to_start import move_to_start
from strandcast.executor.streaming.bounds import safety_bounds
from strandcast.executor.streaming.loop import stream
from strandcast.records.files import write_text
from strandcast.records.motion import Motion

PACKAGE = "pylibfranka"
RATE_HZ = 1000.0
STATES_FILE = "franka.csv"
PAYLOAD_CYCLES = 200  # chosen: the states to wait for until the controller reports a new payload
LOAD_ROUNDING_KG = 1e-5


def franka_driver(arm: Arm, motion: Motion) -> FrankaDriver:
    """Return the driver of a Franka arm (see `strandcast.executor.drivers.registry`)."""
    return FrankaDriver(arm)


class FrankaDriver:
    """A Franka Research 3 (see `strandcast.executor.drivers.protocol.Driver`).

    Raises
    ------
    StrandcastError
        SC-F003 settings; SC-X061 no connection; SC-X004 too fast near a joint's end.
    """

    name = "franka"
    rate_hz = RATE_HZ
    streams = True

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._settings = driver_settings(FrankaSettings, arm)
        self.address = self._settings.host
        self._joints = ControllerJoints.of(arm, self._settings.joints)
        self._vendor: Any = None
        self._robot: Any = None

    def connect(self) -> None:
        """Connect, and set collision behaviour and payload on the controller."""
        require_address(self._arm, self.address)
        try:
            self._vendor = import_module(PACKAGE)
        except ImportError as error:
            raise missing_package(PACKAGE, "franka", error) from None
        vendor, settings = self._vendor, self._settings
        config = vendor.RealtimeConfig
        config = config.kEnforce if settings.realtime == "enforce" else config.kIgnore
        try:
            self._robot = vendor.Robot(settings.host, config)
            if self._fault(self._robot.read_once()) is None:  # else it takes no settings; `state` says why
                self._configure()
        except vendor.RealtimeException as error:
            raise self._connection_error(
                error, 'use a kernel with PREEMPT_RT; for a simulator, realtime = "ignore"'
            ) from None
        except RuntimeError as error:
            self._robot = None
            raise self._connection_error(
                error,
                "unlock the joints and activate FCI in Desk; check the address, and whether another "
                "program is connected",
            ) from None

    def _connection_error(self, error: RuntimeError, fix: str) -> StrandcastError:
        reason = str(error).removeprefix("libfranka: ")
        return StrandcastError(
            "SC-X061",
            f"the controller at {self._settings.host} refuses the connection: {reason}",
            file=self._arm.path,
            field="driver.settings",
            cost="the motion was not played",
            fix=fix,
            exit_code=ENVIRONMENT,
        )

    def _configure(self) -> None:
        settings, payload = self._settings, self._arm.payload
        torque, force = settings.torque_threshold_n_m, settings.force_threshold_n
        if torque is not None and force is not None:
            self._robot.set_collision_behavior(torque, torque, force, force)
        if payload is not None:
            inertia = np.diag(settings.load_inertia_kg_m2).ravel().tolist()
            self._robot.set_load(payload.mass_kg, list(payload.centre_m), inertia)
            # The next states may still be older; `state` reports whether the payload was accepted.
            for _ in range(PAYLOAD_CYCLES):
                if abs(self._robot.read_once().m_load - payload.mass_kg) < LOAD_ROUNDING_KG:
                    break

    def state(self) -> ArmState:
        """Return the current state; a mode other than idle or an error of the controller is a fault."""
        state = self._read_state()
        return ArmState(
            q_rad=self._joints.moving(np.array(state.q)),
            qd_rad_s=self._joints.moving(np.array(state.dq)),
            fault=self._fault(state),
            q_held_rad=self._joints.held(np.array(state.q)),
            payload_kg=state.m_load,
            time_s=state.time.to_sec(),
        )

    def _read_state(self) -> Any:
        try:
            return self._robot.read_once()
        except RuntimeError as error:
            raise self._connection_error(error, "check the controller, and connect again") from None

    def _fault(self, state: Any) -> str | None:
        mode = state.robot_mode
        if mode == self._vendor.RobotMode.Idle and not state.current_errors:
            return None
        errors = f", errors {state.current_errors}" if state.current_errors else ""
        fix = "check the arm, then clear the error in Desk, or by its enabling device"
        return f"the controller is in mode {mode.name}{errors}; {fix}"

    def check(self, command: JointTrajectory) -> None:
        """Refuse a motion that the controller would stop (SC-X004)."""
        check_speeds(self._arm, self._joints.moving_index, command)

    def move_to_start(self, q_rad: np.ndarray) -> None:
        """Move all seven joints slowly, the moving ones to (J,) angles, the held ones to theirs."""
        link = FrankaLink(self._vendor, self._robot, np.arange(JOINTS))
        q_from = np.array(self._read_state().q_d)
        move_to_start(link, self._arm, q_from, self._joints.all_angles(q_rad), RATE_HZ, self._settings.joints)

    def play(self, command: JointTrajectory, folder: Path) -> Recording:
        """Stream the motion; write all seven joints' states to franka.csv in `folder`, also after a fault."""
        link = FrankaLink(self._vendor, self._robot, self._joints.moving_index)
        # The controller monitors measured speeds itself, with a reflex that is faster than our stop.
        bounds = replace(safety_bounds(self._arm), velocity_rad_s=np.full(len(self._arm.joints), np.inf))
        recording = stream(link, command, bounds, RATE_HZ, list(self._arm.joints))
        facts = {
            "model": "Franka Research 3",
            "host": self._settings.host,
            "realtime": self._settings.realtime,
            PACKAGE: version(PACKAGE),
            **link.summary(),
        }
        try:
            write_text(folder / STATES_FILE, link.states_table())
        except StrandcastError as error:  # joints.csv may still fit on the disk, and is the one that counts
            facts[STATES_FILE] = f"not written ({error.what})"
        return replace(recording, clock="Franka controller", controller=facts)

    def stop(self) -> None:
        """Stop whatever still moves and release the connection; safe to call at any time."""
        robot, self._robot = self._robot, None
        if robot is not None:
            try:
                robot.stop()
            except RuntimeError:
                return  # the connection is gone, and with it the motion
