"""The streaming loop: set points in time, watched in every cycle, one soft stop for every fault.

It keeps the time of absolute deadlines (or the controller's), samples the motion by elapsed time and never by
a count, writes nothing but the set point and a row that is there already, and ends in a log whatever happens.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

import numpy as np

from strandcast.arm.stop import SoftStop
from strandcast.player.bounds import Bounds
from strandcast.player.clock import Clock, HostClock
from strandcast.player.interrupts import interrupts
from strandcast.player.lateness import lateness_of
from strandcast.player.protocol import Command, Recording
from strandcast.player.rows import Rows
from strandcast.player.trajectory import Trajectory
from strandcast.player.watch import GAP_TICKS, Reading, Watch

__all__ = ["ControllerStopped", "Link", "Reading", "stream"]

LEAD_S = 0.5
TAIL_S = 0.6
STOPPING_S = 2.0  # room in the log for a soft stop and its tail
LOST = 5  # cycles running in which the link fails: it will not come back
LEFT_ALONE = (
    20  # cycles for which a controller that paces goes on by itself; then it stops, or its clock jumped
)


class ControllerStopped(Exception):
    """The controller has ended the motion by itself; its text is the reason."""


class Link(Protocol):
    """An open connection to a controller that takes set points.

    Attributes
    ----------
    paces
        Whether `read` waits for the controller's next cycle; if not, the host's deadlines keep the time.
    """

    paces: bool

    def start(self) -> None:
        """Begin the streaming as the vendor wants it; the first `read` follows at once."""

    def read(self) -> Reading:
        """Return the controller's newest state; ControllerStopped if it has ended the motion.

        It must not block; where it paces, it must give up after a while. After ControllerStopped, it goes on
        returning states for the log's tail, as long as there are any.
        """

    def write(self, q_rad: np.ndarray, qd_rad_s: np.ndarray) -> None:
        """Send one set point, (J,) angles and speeds; ControllerStopped if it is not taken any more."""

    def finish(self) -> None:
        """End the streaming as the vendor wants it, the sync output low.

        Called once in every ending, at rest where there was a way to get there.
        """

    def signal(self, high: bool) -> None:
        """Switch the sync output; nothing where there is none."""


def stream(
    link: Link,
    command: Command,
    bounds: Bounds,
    rate_hz: float,
    joint_names: list[str],
    *,
    lead_s: float = LEAD_S,
    tail_s: float = TAIL_S,
    clock: Clock | None = None,
    clock_name: str = "controller",
    controller: dict[str, str] | None = None,
) -> Recording:
    """Hold the first posture, play, hold the last; or stop softly. The log is of all of it.

    Parameters
    ----------
    link
        To the controller; it is finished in every case, not closed.
    command
        The motion, from rest to rest.
    bounds
        What is watched, and how the arm is stopped.
    rate_hz
        Of the controller's cycle.
    joint_names
        Of the J joints.
    lead_s, tail_s
        How long the arm is held before and after [s].
    clock
        The host's; the tests bring one that does not sleep.
    clock_name, controller
        As they stand in run.json.

    Returns
    -------
    What happened; nothing that happens while streaming is raised.
    """
    loop = _Loop(link, command, bounds, rate_hz, joint_names, lead_s, tail_s, clock or HostClock())
    with interrupts(loop.interrupt):
        scheduling = loop.run()
    return loop.recording(scheduling, clock_name, dict(controller or {}))


class _Loop:
    """One streaming; `cycle` reads like what happens in it."""

    def __init__(
        self, link: Link, command: Command, bounds: Bounds, rate_hz: float, joint_names: list[str],
        lead_s: float, tail_s: float, clock: Clock,
    ) -> None:  # fmt: skip
        self._link, self._clock, self._names = link, clock, joint_names
        self._path = Trajectory(command.time_s, command.q_rad, command.qd_rad_s, command.qdd_rad_s2)
        self._stop = SoftStop(bounds.stop_acceleration_rad_s2, bounds.stop_jerk_rad_s3)
        self._watch = Watch(bounds, joint_names, 1.0 / rate_hz)
        self._period_s, self._period_ns = 1.0 / rate_hz, round(1e9 / rate_hz)
        self._lead_s, self._tail_s = lead_s, tail_s
        self._over_s = lead_s + self._path.end_s + tail_s
        self._stopping_rows = math.ceil(STOPPING_S * rate_hz)
        self._rows = Rows(math.ceil(self._over_s * rate_hz) + 1 + self._stopping_rows, len(joint_names))
        self._by_host = not link.paces
        self._start_ns = self._tick = 0
        self._first_s = self._newest_s = math.nan  # of the controller's clock
        self._elapsed_s = self._sent_s = 0.0
        self._stop_began_s: float | None = None
        self._status = "ok"
        self._reason: str | None = None
        self._interrupted: str | None = None
        self._failures = self._missed = 0
        self._taken = True  # whether the controller still takes set points
        self._sync = False
        self._q, self._qd, self._qdd = (row[0].copy() for row in self._path.at(np.zeros(1)))

    def interrupt(self, name: str) -> None:
        """Ask for the soft stop."""
        self._interrupted = name

    def run(self) -> str:
        """Stream to the end, or to rest, and end the streaming; return what scheduling was granted.

        The end too must be undisturbed: a link may have set points of its own to send there.
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
        while self._elapsed_s < self._over_s and self._rows.left and self._failures < LOST:
            self._guarded(self._cycle)

    def _guarded(self, step: Callable[[], None]) -> None:
        """Take a step; whatever goes wrong in it leads to the one soft stop, or is the controller's own."""
        try:
            step()
            self._failures = 0
        except ControllerStopped as error:
            self._failures += not self._taken
            self._ended(str(error))
        except Exception as error:
            self._failures += 1
            self._begin_stop(f"{type(error).__name__}: {error}")

    def _cycle(self) -> None:
        late_ns = self._wait()
        reading = self._link.read()
        host_ns = self._clock.now_ns()
        ticks = self._advance(reading)
        if reading.trouble:
            self._ended(reading.trouble)
        problem = self._problem(reading, ticks)
        if problem:
            self._begin_stop(problem, anew=ticks > GAP_TICKS)
        self._next_set_point()
        rows = self._rows
        k = rows.count
        rows.host_ns[k], rows.late_ns[k] = host_ns, late_ns
        rows.controller_s[k], rows.elapsed_s[k] = reading.time_s, self._elapsed_s
        rows.q[k], rows.qd[k] = reading.q_rad, reading.qd_rad_s
        rows.q_cmd[k], rows.qd_cmd[k] = self._q, self._qd
        rows.since_start_s[k] = self._since_start()
        rows.flag(ticks > 1, reading.sync_high)
        rows.count = k + 1
        if self._taken:
            self._link.write(self._q, self._qd)
            self._switch()

    def _wait(self) -> int:
        """Wait for the next deadline, where the host keeps the time; return how late it is [ns]."""
        if not self._by_host:
            return 0
        deadline_ns = self._start_ns + (self._tick + 1) * self._period_ns
        self._clock.sleep_until(deadline_ns)
        now_ns = self._clock.now_ns()
        self._tick = max(self._tick + 1, (now_ns - self._start_ns) // self._period_ns)
        return now_ns - deadline_ns

    def _advance(self, reading: Reading) -> int:
        """Set the elapsed time, by the host's clock in whole ticks; return by how many ticks it went on."""
        if math.isnan(self._first_s):
            self._first_s, self._newest_s = reading.time_s, -math.inf
        before_s = self._elapsed_s
        if self._by_host:
            now_s = self._tick * self._period_s
        elif reading.time_s > self._newest_s:
            now_s = reading.time_s - self._first_s
        else:  # the command must not jerk to a halt because a stamp does
            now_s = before_s + self._period_s
        self._newest_s = max(self._newest_s, reading.time_s)
        self._elapsed_s = max(before_s, now_s)
        ticks = round((self._elapsed_s - before_s) / self._period_s)
        self._missed += max(0, ticks - 1)
        return ticks

    def _problem(self, reading: Reading, ticks: int) -> str | None:
        if self._watch.frozen(reading):
            self._go_by_host()
            return "the controller's clock stands still"
        if ticks > GAP_TICKS:
            return f"{ticks - 1} set points running were missed"
        if self._rows.left < self._stopping_rows:
            return "the controller's cycles come faster than its rate: the log has no room"
        if self._interrupted:
            return self._interrupted
        return self._watch.problem(reading, self._elapsed_s, self._rows)

    def _go_by_host(self) -> None:
        """Leave a controller's clock that stands still for the host's: the stop must go on."""
        if not self._by_host:
            self._by_host = True
            self._tick = round(self._elapsed_s / self._period_s)
            self._start_ns = self._clock.now_ns() - self._tick * self._period_ns

    def _ended(self, reason: str) -> None:
        """Note that the controller ended the motion; only the log goes on, for its tail."""
        if self._taken:
            self._taken = False
            self._over_s = self._elapsed_s + self._tail_s
            if self._status == "ok":
                self._status, self._reason = "fault", reason

    def _begin_stop(self, reason: str, anew: bool = False) -> None:
        """Bring the command to rest from where it is; begun already, it begins `anew` or goes on."""
        if not self._taken or (self._stop_began_s is not None and not anew):
            return
        if self._status == "ok":
            self._status, self._reason = "aborted", reason
        began_s = max(self._sent_s, self._elapsed_s - self._period_s)
        if self._link.paces and 0.0 < began_s - self._sent_s <= LEFT_ALONE * self._period_s:
            # Such a controller goes on by itself where set points are missing: take over where it is now.
            self._set_point_at(began_s)
        self._stop_began_s = began_s
        self._over_s = self._stop_began_s + self._stop.begin(self._q, self._qd, self._qdd) + self._tail_s

    def _next_set_point(self) -> None:
        if self._taken:
            self._set_point_at(self._elapsed_s)
            self._sent_s = self._elapsed_s

    def _set_point_at(self, elapsed_s: float) -> None:
        if self._stop_began_s is None:
            q, qd, qdd = self._path.at(np.array([elapsed_s - self._lead_s]))
            self._q[:], self._qd[:], self._qdd[:] = q[0], qd[0], qdd[0]
        else:
            self._q[:], self._qd[:], self._qdd[:] = self._stop.at(elapsed_s - self._stop_began_s)

    def _since_start(self) -> float:
        since_s = self._elapsed_s - self._lead_s
        inside = -1e-9 <= since_s <= self._path.end_s + 1e-9 and self._status == "ok"
        return max(0.0, since_s) if inside else math.nan

    def _switch(self) -> None:
        """Let the sync output be high while the motion lasts."""
        high = 0.0 <= self._elapsed_s - self._lead_s < self._path.end_s and self._stop_began_s is None
        if high != self._sync:
            self._sync = high
            self._link.signal(high)

    def _finish(self) -> None:
        """End the vendor's streaming; that it cannot be ended is a fault of its own."""
        try:
            self._link.finish()
        except Exception as error:
            if self._status == "ok":
                self._status = "aborted"
                self._reason = f"the streaming could not be ended ({type(error).__name__}: {error})"

    def recording(self, scheduling: str, clock_name: str, controller: dict[str, str]) -> Recording:
        """Return what was logged."""
        rows = self._rows
        taken = slice(0, rows.count)
        start_s = self._controller_start_s()
        late_ns = rows.late_ns[taken]
        if self._link.paces and rows.count:
            # Cycle by cycle, for the two clocks need not run at the same rate.
            behind_ns = rows.host_ns[taken] - np.round(rows.controller_s[taken] * 1e9).astype(np.int64)
            late_ns = np.maximum(np.diff(behind_ns, prepend=behind_ns[:1]), 0)
        return Recording(
            log=rows.log(self._names, every_cycle=self._status != "ok"),
            status=self._status,
            reason=self._reason,
            motion_start_s=start_s,
            motion_end_s=start_s + self._path.end_s,
            clock=clock_name,
            controller=controller,
            lateness=lateness_of(late_ns, self._missed, scheduling),
        )

    def _controller_start_s(self) -> float:
        """Return when the motion began on the controller's clock, by the packet that came soonest."""
        rows = self._rows
        if self._link.paces or not rows.count:
            return self._first_s + self._lead_s
        ahead_s = rows.controller_s[: rows.count] - (rows.host_ns[: rows.count] - self._start_ns) * 1e-9
        return float(ahead_s.max()) + self._lead_s
