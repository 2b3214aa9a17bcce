"""The streaming loop: set points in time, monitored in every cycle, one soft stop for every fault.

It follows absolute deadlines (or the controller's cycle), samples the motion by elapsed time and never by
counting, writes only the set point and a preallocated row, and always ends with a log.
"""

import math
from collections.abc import Callable

import numpy as np

from strandcast.arm.stop import SoftStop
from strandcast.core.trajectory import JointTrajectory
from strandcast.executor.drivers.protocol import Recording
from strandcast.executor.streaming.bounds import SafetyBounds
from strandcast.executor.streaming.clock import Clock, HostClock
from strandcast.executor.streaming.interrupts import interrupts
from strandcast.executor.streaming.jitter import jitter_of
from strandcast.executor.streaming.link import ControllerState, ControllerStopped, StreamLink
from strandcast.executor.streaming.log_buffer import LogBuffer
from strandcast.executor.streaming.safety_monitor import GAP_TICKS, SafetyMonitor
from strandcast.executor.streaming.set_points import SetPoints
from strandcast.records.joint_log import LATE, SYNC_HIGH

# Chosen.
LEAD_S = 0.5
TAIL_S = 0.6  # the run record requires 0.5 s
STOPPING_S = 2.0  # space in the log for a soft stop and its tail
MAX_FAILURES = 5  # failed cycles in a row: the link is lost
# Without set points for longer, an arm that the host paces stands at the last one.
STANDS_S = 0.1
# Cycles that a pacing controller (Franka) extrapolates; after more it has stopped, or its clock jumped.
MAX_EXTRAPOLATED = 20


def stream(
    link: StreamLink,
    command: JointTrajectory,
    bounds: SafetyBounds,
    rate_hz: float,
    joint_names: list[str],
    *,
    hold_s: tuple[float, float] = (LEAD_S, TAIL_S),
    clock: Clock | None = None,
) -> Recording:
    """Hold the first posture, play, hold the last; or stop softly. The log covers all of it.

    Parameters
    ----------
    link
        To the controller; it is finished in every case, but not closed.
    command
        The motion, from rest to rest.
    rate_hz
        Rate of the controller's cycle.
    hold_s
        How long to hold the arm before and after the motion [s].
    clock
        The host's clock; tests pass one that does not sleep.

    Returns
    -------
    Recording
        Errors during streaming are recorded, not raised.
    """
    loop = _Loop(link, command, bounds, rate_hz, joint_names, hold_s, clock or HostClock())
    with interrupts(loop.interrupt):
        scheduling = loop.run()
    return loop.recording(scheduling)


class _Loop:
    """One streaming; read `_cycle` first."""

    def __init__(
        self,
        link: StreamLink,
        command: JointTrajectory,
        bounds: SafetyBounds,
        rate_hz: float,
        joint_names: list[str],
        hold_s: tuple[float, float],
        clock: Clock,
    ) -> None:
        self._link, self._clock, self._names = link, clock, joint_names
        # In whole cycles: what is sent is what was checked.
        self._lead_s, self._tail_s = (math.ceil(s * rate_hz - 1e-6) / rate_hz for s in hold_s)
        self._motion_s = command.end_s
        stop = SoftStop(bounds.stop_acceleration_rad_s2, bounds.stop_jerk_rad_s3)
        self._set_points = SetPoints(command, self._lead_s, stop)
        self._monitor = SafetyMonitor(bounds, joint_names, 1.0 / rate_hz)
        self._period_s, self._period_ns = 1.0 / rate_hz, round(1e9 / rate_hz)
        self._over_s = self._lead_s + self._motion_s + self._tail_s
        self._stopping_rows = math.ceil(STOPPING_S * rate_hz)
        self._rows = LogBuffer(math.ceil(self._over_s * rate_hz) + 1 + self._stopping_rows, len(joint_names))
        self._host_paced = not link.paces
        self._start_ns = self._tick = 0
        self._first_s = self._newest_s = math.nan  # of the controller's clock
        self._elapsed_s = self._sent_s = 0.0
        self._status = "ok"
        self._reason: str | None = None
        self._interrupted: str | None = None
        self._failures = self._missed = 0
        self._accepts = True  # whether the controller still accepts set points
        self._sync = False

    def interrupt(self, name: str) -> None:
        """Request the soft stop."""
        self._interrupted = name

    def run(self) -> str:
        """Stream to the end, or to rest, and end the streaming; return the granted scheduling.

        The end must be undisturbed as well: a link may send set points of its own there.
        """
        with self._clock.undisturbed() as scheduling:
            try:
                self._stream()
            finally:
                self._finish()
        return scheduling

    def _stream(self) -> None:
        self._guarded(self._link.start)
        if self._status != "ok":
            return
        self._start_ns = self._clock.now_ns()
        while self._elapsed_s < self._over_s and self._rows.left and self._failures < MAX_FAILURES:
            self._guarded(self._cycle)

    def _guarded(self, step: Callable[[], None]) -> None:
        """Take a step; any error leads to the soft stop, unless the controller has stopped the arm itself."""
        try:
            step()
            self._failures = 0
        except ControllerStopped as error:
            self._failures += not self._accepts
            self._ended(str(error))
        except Exception as error:
            self._failures += 1
            self._begin_stop(f"{type(error).__name__}: {error}")

    def _cycle(self) -> None:
        late_ns = self._wait()
        state = self._link.read()
        host_ns = self._clock.now_ns()
        ticks = self._advance(state)
        if state.fault:
            self._ended(state.fault)
        problem = self._problem(state, ticks)
        if problem:
            self._begin_stop(problem, restart=ticks > GAP_TICKS)
        if self._accepts:
            self._set_points.advance(self._elapsed_s)
            self._sent_s = self._elapsed_s
        self._log(state, host_ns, late_ns, ticks)
        if self._accepts:
            self._link.write(self._set_points.q, self._set_points.qd)
            self._switch()

    def _log(self, state: ControllerState, host_ns: int, late_ns: int, ticks: int) -> None:
        rows, points = self._rows, self._set_points
        k = rows.count
        rows.host_ns[k], rows.late_ns[k] = host_ns, late_ns
        rows.controller_s[k], rows.elapsed_s[k] = state.time_s, self._elapsed_s
        rows.q[k], rows.qd[k] = state.q_rad, state.qd_rad_s
        rows.q_cmd[k], rows.qd_cmd[k] = points.q, points.qd
        if self._status == "ok":
            rows.since_start_s[k] = points.since_start_s(self._elapsed_s)
        rows.flags[k] = (LATE if ticks > 1 else 0) | (SYNC_HIGH if state.sync_high else 0)
        rows.count = k + 1

    def _wait(self) -> int:
        """Wait for the next deadline, if the host sets the pace; return the delay [ns]."""
        if not self._host_paced:
            return 0
        deadline_ns = self._start_ns + (self._tick + 1) * self._period_ns
        self._clock.sleep_until(deadline_ns)
        now_ns = self._clock.now_ns()
        self._tick = max(self._tick + 1, (now_ns - self._start_ns) // self._period_ns)
        return now_ns - deadline_ns

    def _advance(self, state: ControllerState) -> int:
        """Advance the elapsed time, by the host's clock in whole ticks; return the number of ticks."""
        if math.isnan(self._first_s):
            self._first_s, self._newest_s = state.time_s, -math.inf
        before_s = self._elapsed_s
        if self._host_paced:
            now_s = self._tick * self._period_s
        elif state.time_s > self._newest_s:
            now_s = state.time_s - self._first_s
        else:  # a repeated time stamp must not halt the command
            now_s = before_s + self._period_s
        self._newest_s = max(self._newest_s, state.time_s)
        self._elapsed_s = max(before_s, now_s)
        ticks = round((self._elapsed_s - before_s) / self._period_s)
        self._missed += max(0, ticks - 1)
        return ticks

    def _problem(self, state: ControllerState, ticks: int) -> str | None:
        if self._monitor.frozen(state):
            self._use_host_clock()
            return "the controller's clock has stopped"
        if ticks > GAP_TICKS:
            return f"{ticks - 1} set points in a row were missed"
        if self._rows.left < self._stopping_rows:
            return "the controller's cycles are faster than its rate: the log is full"
        if self._interrupted:
            return self._interrupted
        return self._monitor.problem(state, self._elapsed_s, self._rows)

    def _use_host_clock(self) -> None:
        """Switch to the host's clock if the controller's has stopped: the soft stop must continue."""
        if not self._host_paced:
            self._host_paced = True
            self._tick = round(self._elapsed_s / self._period_s)
            self._start_ns = self._clock.now_ns() - self._tick * self._period_ns

    def _ended(self, reason: str) -> None:
        """Note that the controller ended the motion; only the log continues, for its tail."""
        if self._accepts:
            self._accepts = False
            self._over_s = self._elapsed_s + self._tail_s
            if self._status == "ok":
                self._status, self._reason = "fault", reason

    def _begin_stop(self, reason: str, restart: bool = False) -> None:
        """Bring the command to rest from its present state; with `restart`, also if a stop has begun."""
        if not self._accepts or (self._set_points.stopping and not restart):
            return
        if self._status == "ok":
            self._status, self._reason = "aborted", reason
        began_s = max(self._sent_s, self._elapsed_s - self._period_s)
        if self._link.paces and 0.0 < began_s - self._sent_s <= MAX_EXTRAPOLATED * self._period_s:
            # Such a controller extrapolates over missing set points: take over where it is now.
            self._set_points.advance(began_s)
        if not self._link.paces and began_s - self._sent_s > STANDS_S:
            self._set_points.rest()
        self._over_s = began_s + self._set_points.begin_stop(began_s) + self._tail_s

    def _switch(self) -> None:
        """Keep the sync output high during the motion."""
        high = self._set_points.moving(self._elapsed_s)
        if high != self._sync:
            self._sync = high
            self._link.signal(high)

    def _finish(self) -> None:
        """End the vendor's streaming; an error while ending it makes the run aborted."""
        try:
            self._link.finish()
        except Exception as error:
            if self._status == "ok":
                self._status = "aborted"
                self._reason = f"the streaming could not be ended ({type(error).__name__}: {error})"
        if self._interrupted and self._status == "ok":  # while it ended: nothing may follow
            self._status, self._reason = "aborted", self._interrupted

    def recording(self, scheduling: str) -> Recording:
        """Return the log and how the streaming ended."""
        rows = self._rows
        taken = slice(0, rows.count)
        start_s = self._controller_start_s()
        late_ns = rows.late_ns[taken]
        if self._link.paces and rows.count:
            # Cycle by cycle, since the two clocks may run at different rates.
            behind_ns = rows.host_ns[taken] - np.round(rows.controller_s[taken] * 1e9).astype(np.int64)
            late_ns = np.maximum(np.diff(behind_ns, prepend=behind_ns[:1]), 0)
        return Recording(
            log=rows.log(self._names, every_cycle=self._status != "ok"),
            status=self._status,
            reason=self._reason,
            motion_start_s=start_s,
            motion_end_s=start_s + self._motion_s,
            clock="controller",
            jitter=jitter_of(late_ns, self._missed, scheduling),
        )

    def _controller_start_s(self) -> float:
        """Return the motion's start on the controller's clock, by the packet with the least delay."""
        rows = self._rows
        if self._link.paces or not rows.count:
            return self._first_s + self._lead_s
        ahead_s = rows.controller_s[: rows.count] - (rows.host_ns[: rows.count] - self._start_ns) * 1e-9
        return float(ahead_s.max()) + self._lead_s
