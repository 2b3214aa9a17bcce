"""A UR controller's state, read by RTDE."""

from typing import Any

from strandcast.executor.streaming.clock import wait_until

FRESH_S = 1.0  # chosen; a controller sends a package every 2 or 8 ms

FIELDS = [
    "timestamp",
    "actual_q",
    "actual_qd",
    "robot_mode",
    "safety_mode",
    "runtime_state",
    "speed_scaling",
    "target_speed_fraction",
    "actual_digital_output_bits",
    "robot_status_bits",
]
PAYLOAD_FIELDS = ["payload", "payload_cog"]  # old controllers do not have them

# Values of UR's RTDE guide.
RUNNING, NORMAL = 7, 1  # robot mode, safety mode
PROGRAM_RUNS = 2  # bit of the robot status
PAUSING, PAUSED = 3, 4  # runtime states
ROBOT_MODES = {
    -1: "no controller",
    0: "disconnected",
    1: "confirm safety",
    2: "booting",
    3: "power off",
    4: "power on",
    5: "idle (brakes on)",
    6: "backdrive",
    8: "updating firmware",
}
SAFETY_MODES = {
    2: "reduced",
    3: "protective stop",
    4: "recovery",
    5: "safeguard stop",
    6: "system emergency stop",
    7: "robot emergency stop",
    8: "violation",
    9: "fault",
    10: "validate joint id",
    11: "undefined",
}


def fault_of(receive: Any) -> str | None:
    """Return why the controller cannot move the arm, by its safety mode or robot mode; None if it can."""
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


def idle_speed_scaling(receive: Any) -> float:
    """Return the speed scaling of an arm that may have no program running."""
    # The trajectory limiter may be zero while no program runs; the slider is always reported.
    limiter, slider = receive.getSpeedScaling(), receive.getTargetSpeedFraction()
    if limiter == 0.0 and not program_runs(receive):
        return float(slider)
    return float(limiter * slider)


def silence_of(receive: Any) -> str | None:
    """Return a fault if no new package arrives from the controller; None if one does."""
    before = receive.getTimestamp()
    if wait_until(lambda: receive.getTimestamp() != before, FRESH_S):
        return None
    return f"nothing new came from the controller for {FRESH_S:.0f} s"
