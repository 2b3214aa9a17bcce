"""Jitter of the streaming loop on this machine: ``python -m strandcast_studies.benchmarks.streaming``.

The benchmark reports only; it has no pass or fail. One loop only wakes up; the other is the player's own, for
many throws, with all the work of a cycle (read, check, sample the motion, log, write) over a link without
cost. Each runs with normal scheduling, and with SCHED_FIFO and locked memory as far as the system permits.
"""

import argparse
import json
import os
import platform
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.core.trajectory import JointTrajectory
from strandcast.executor.streaming.bounds import SafetyBounds
from strandcast.executor.streaming.clock import HostClock
from strandcast.executor.streaming.jitter import measure_wakeups
from strandcast.executor.streaming.link import ControllerState
from strandcast.executor.streaming.loop import LEAD_S, TAIL_S, stream
from strandcast.records.files import write_text

RATES_HZ = (125.0, 500.0, 1000.0)
JOINTS = 6
SWING_S = 1.0
WAKE, PLAYER = "wakes up", "player's loop"
NAMES = [f"joint_{j}" for j in range(JOINTS)]


class EchoController:
    """A controller that is always at its last set point, and records how late each set point arrives."""

    paces = False

    def __init__(self, clock: HostClock, rate_hz: float, capacity: int) -> None:
        self._clock, self._period_ns = clock, round(1e9 / rate_hz)
        self._q, self._qd = np.zeros(JOINTS), np.zeros(JOINTS)
        self._start_ns = self._tick = 0
        self.late_ns, self.count, self.missed = np.zeros(capacity, np.int64), 0, 0

    def start(self) -> None:
        """Record the start of the first period."""
        self._start_ns = self._clock.now_ns()

    def read(self) -> ControllerState:
        """Return the last set point as the state."""
        return ControllerState(self._clock.now_ns() * 1e-9, self._q, self._qd)

    def write(self, q_rad: np.ndarray, qd_rad_s: np.ndarray) -> None:
        """Move to a set point."""
        self._q[:], self._qd[:] = q_rad, qd_rad_s
        since_ns = self._clock.now_ns() - self._start_ns
        due = self._tick + 1
        self._tick = max(due, since_ns // self._period_ns)
        self.late_ns[self.count] = since_ns - due * self._period_ns
        self.count += 1
        self.missed += self._tick - due

    def finish(self) -> None:
        """Do nothing."""

    def signal(self, high: bool) -> None:
        """Do nothing."""


def main() -> None:
    """Measure, write the JSON and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/bench-streaming.json"))
    parser.add_argument("--seconds", type=float, default=10.0, help="for each loop")
    options = parser.parse_args()
    rows = []
    for realtime in (False, True):
        for rate_hz in RATES_HZ:
            rows += [waking(rate_hz, realtime, options.seconds), playing(rate_hz, realtime, options.seconds)]
    machine = {
        "system": platform.platform(),
        "python": platform.python_version(),
        "cores": os.cpu_count(),
        "load_average": os.getloadavg()[0],
    }
    write_text(options.out, json.dumps({"machine": machine, "loops": rows}, indent=1) + "\n")
    print("\n".join(table(rows)))
    print(f"load average {machine['load_average']:.1f} on {machine['cores']} cores; {options.out}")


def waking(rate_hz: float, realtime: bool, seconds: float) -> dict[str, Any]:
    """Measure a loop that only wakes up."""
    late_ns, missed, scheduling = measure_wakeups(rate_hz, seconds, HostClock(realtime))
    return _row(WAKE, rate_hz, scheduling, late_ns, missed)


def playing(rate_hz: float, realtime: bool, seconds: float) -> dict[str, Any]:
    """Measure the player's loop up to each written set point, over as many throws as fit into the time."""
    throws = max(1, round(seconds / (LEAD_S + SWING_S + TAIL_S)))
    none = np.zeros(JOINTS)
    wide = SafetyBounds(
        none, none + 10.0, none + 100.0, none + 50.0, none + 2000.0, outside=lambda q: bool(q[0] > 9.0)
    )
    clock, late_ns, missed, stopped = HostClock(realtime), [], 0, []
    for _ in range(throws):
        link = EchoController(clock, rate_hz, round(4.0 * rate_hz))
        done = stream(link, _swing(rate_hz), wide, rate_hz, NAMES, clock=clock)
        late_ns.append(link.late_ns[: link.count])
        missed += link.missed
        stopped += [done.reason] if done.reason else []
    assert done.jitter is not None
    row = _row(PLAYER, rate_hz, done.jitter.scheduling, np.concatenate(late_ns), missed)
    return row | {"throws": throws, "stopped": stopped}


def _swing(rate_hz: float) -> JointTrajectory:
    time_s = np.arange(round(SWING_S * rate_hz) + 1) / rate_hz
    s = (time_s / SWING_S)[:, None]
    ones = np.ones(JOINTS)
    return JointTrajectory(
        time_s,
        s**3 * (10.0 - 15.0 * s + 6.0 * s**2) * ones,
        30.0 * s**2 * (1.0 - s) ** 2 / SWING_S * ones,
        60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / SWING_S**2 * ones,
    )


def _row(loop: str, rate_hz: float, scheduling: str, late_ns: np.ndarray, missed: int) -> dict[str, Any]:
    p50, p99, p999, worst = np.percentile(late_ns * 1e-6, [50.0, 99.0, 99.9, 100.0]).round(4).tolist()
    return {
        "loop": loop,
        "rate_hz": rate_hz,
        "scheduling": scheduling,
        "cycles": len(late_ns),
        "missed": int(missed),
        "p50_ms": p50,
        "p99_ms": p99,
        "p999_ms": p999,
        "max_ms": worst,
    }


def table(rows: list[dict[str, Any]]) -> list[str]:
    """Return the rows as a Markdown table."""
    lines = [
        "| scheduling | loop | Hz | late p50, p99, p99.9, max [ms] | missed | throws stopped |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows:
        late = ", ".join(f"{row[key]:.2f}" for key in ("p50_ms", "p99_ms", "p999_ms", "max_ms"))
        stops = f"{len(row['stopped'])} of {row['throws']}" if "throws" in row else ""
        missed = f"{row['missed']} of {row['missed'] + row['cycles']}"
        lines.append(
            f"| {row['scheduling']} | {row['loop']} | {row['rate_hz']:.0f} | {late} | {missed} | {stops} |"
        )
    return lines


if __name__ == "__main__":
    main()
