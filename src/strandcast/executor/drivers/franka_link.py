"""The Franka driver's stream: one joint position in answer to every state of the controller."""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from strandcast.executor.drivers.franka_settings import JOINTS
from strandcast.executor.streaming.easing import EASE_S, Easing
from strandcast.executor.streaming.link import ControllerState, ControllerStopped

CYCLE_S = 0.001
# A stream begins at the controller's own set point, not at the motion's start; after lost cycles it goes on
# where the controller has extrapolated to. That difference is eased out over this time (chosen).
GAP_EASE_S = 0.05
MAX_START_OFFSET_RAD = 0.02
TOO_LATE_NS = 1_000_000  # one cycle
SETTLING_STATES = 100  # to skip in the summary: the success rate is an average over as many commands
ENDING_CYCLES = 500  # enough for an easing to end if some cycles are lost


class FrankaLink:
    """A stream of joint positions (see `strandcast.executor.streaming.link.StreamLink`).

    `vendor` is the package, `robot` its connected `Robot`, `moving` (J,) the indices of the streamed joints
    among the seven; the others stay where they are.
    """

    paces = True

    def __init__(self, vendor: Any, robot: Any, moving: np.ndarray) -> None:
        self._vendor, self._robot, self._moving = vendor, robot, moving
        self._control: Any = None  # while streaming
        self._answered_s = 0.0  # time of the last state that was answered
        self._easing: Easing | None = None
        self._sent = np.zeros(JOINTS)
        self._planned = self._planned_speed = np.zeros(len(moving))
        self.states: list[tuple[int, Any]] = []  # host's time [ns] and state, converted after the stream
        self._answers_ns: list[int] = []  # from each state to its answer

    def start(self) -> None:
        """Take control; from now on the controller waits for an answer to every state."""
        mode = self._vendor.ControllerMode.JointImpedance
        with self._detect_end():
            self._control = self._robot.start_joint_position_control(mode)

    def read(self) -> ControllerState:
        """Wait for the controller's next state; before the stream and after its end, only observe."""
        with self._detect_end():
            state = self._robot.read_once() if self._control is None else self._control.readOnce()[0]
        self.states.append((time.monotonic_ns(), state))
        q, qd = np.array(state.q)[self._moving], np.array(state.dq)[self._moving]
        return ControllerState(state.time.to_sec(), q, qd)

    def write(self, q_rad: np.ndarray, qd_rad_s: np.ndarray) -> None:
        """Answer the newest state with (J,) angles, eased in from the controller's set point.

        An answer that would come too late is not sent: the controller has gone on without it.
        """
        read_ns, state = self.states[-1]
        if time.monotonic_ns() - read_ns > TOO_LATE_NS and self._easing is not None:
            return
        cycles = round((state.time.to_sec() - self._answered_s) / CYCLE_S)
        if self._easing is None:
            self._sent[:] = state.q_d
            self._easing = _start_easing(self._sent[self._moving] - q_rad)
        elif cycles > 1:
            self._easing = self._gap_easing(state, cycles, q_rad, qd_rad_s)
        self._sent[self._moving] = q_rad + self._easing.next()
        self._planned, self._planned_speed = q_rad.copy(), qd_rad_s.copy()
        self._answered_s = state.time.to_sec()
        self._send(finished=False)

    def _gap_easing(self, state: Any, cycles: int, q_rad: np.ndarray, qd_rad_s: np.ndarray) -> Easing:
        """Return the easing back from where the controller has extrapolated to, one cycle ahead."""
        q, qd, qdd = (np.array(value)[self._moving] for value in (state.q_d, state.dq_d, state.ddq_d))
        planned = (qd_rad_s - self._planned_speed) / (cycles * CYCLE_S)
        qd = qd + qdd * CYCLE_S
        return Easing(CYCLE_S, GAP_EASE_S, q + qd * CYCLE_S - q_rad, qd - qd_rad_s, qdd - planned)

    def _send(self, finished: bool) -> None:
        command = self._vendor.JointPositions(self._sent.tolist())
        command.motion_finished = finished
        with self._detect_end():
            self._control.writeOnce(command)
        self._answers_ns.append(time.monotonic_ns() - self.states[-1][0])

    @contextmanager
    def _detect_end(self) -> Iterator[None]:
        """Note if the controller ends the stream; states can only be read after control is released."""
        try:
            yield
        except RuntimeError as error:
            self._control = None
            raise ControllerStopped(str(error).removeprefix("libfranka: ")) from None

    def finish(self) -> None:
        """End the stream, at rest."""
        try:
            if self._control is not None and self._easing is not None:
                self._end_eased()
        except ControllerStopped:
            return
        finally:
            # The controller is released with the last reference to it, which an error's traceback may keep.
            self._control = self._robot = None

    def _end_eased(self) -> None:
        for _ in range(ENDING_CYCLES):
            if self._easing is None or self._easing.ended():
                break
            self.read()
            self.write(self._planned, np.zeros(len(self._planned)))
        self.read()
        self._send(finished=True)

    def signal(self, high: bool) -> None:
        """Do nothing: the controller has no output that its 1 kHz interface can switch."""

    def summary(self) -> dict[str, str]:
        """Return the stream's facts for run.json: success rate of commands, time to answer, peak torques."""
        streamed = [state for _, state in self.states if state.control_command_success_rate > 0.0]
        streamed = streamed[SETTLING_STATES:]
        if not streamed:
            return {}
        least = min(state.control_command_success_rate for state in streamed)
        p50, p99, longest = np.percentile(self._answers_ns, [50, 99, 100]) / 1e3
        torque = np.abs([state.tau_J for state in streamed]).max(axis=0)
        return {
            "least_success_rate": f"{least:.2f}",
            "answer_us": f"p50 {p50:.0f}, p99 {p99:.0f}, longest {longest:.0f}",
            "peak_torque_n_m": " ".join(f"{value:.1f}" for value in torque),
        }

    def states_table(self) -> str:
        """Return all seven joints' states as CSV: set point (q_d), position, speed, torque, success rate."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        units = {"q_d": "rad", "q": "rad", "dq": "rad_s", "tau_J": "n_m"}
        columns = [f"{key}{j}_{unit}" for key, unit in units.items() for j in range(1, JOINTS + 1)]
        writer.writerow(["host_time_ns", "controller_time_s", *columns, "success_rate", "mode"])
        for host_ns, state in self.states:
            values = [repr(float(value)) for key in units for value in getattr(state, key)]
            rate, mode = state.control_command_success_rate, state.robot_mode.name
            writer.writerow([host_ns, repr(state.time.to_sec()), *values, rate, mode])
        return out.getvalue()


def _start_easing(offset_rad: np.ndarray) -> Easing:
    worst = float(np.abs(offset_rad).max())
    if worst > MAX_START_OFFSET_RAD:
        raise ValueError(f"the controller's set point is {worst:.3f} rad from the motion's start")
    return Easing(CYCLE_S, EASE_S, offset_rad)
