"""Store the states of a Franka stream: a CSV table of all seven joints, and a summary for run.json."""

import csv
import io
from typing import Any

import numpy as np

from strandcast.executor.drivers.franka_settings import JOINTS

# States to skip in the summary: the success rate is an average over as many commands.
SETTLING_STATES = 100


def stream_summary(states: list[tuple[int, Any]], answers_ns: list[int]) -> dict[str, str]:
    """Return a stream's facts for run.json: success rate of commands, time to answer, peak torques."""
    streamed = [state for _, state in states if state.control_command_success_rate > 0.0][SETTLING_STATES:]
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
    """Return all seven joints' states as CSV: set point (q_d), position, speed, torque, success rate."""
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
