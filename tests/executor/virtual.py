"""A host's clock that does not sleep, and a controller with a lagging servo that lives on it."""

from contextlib import nullcontext
from pathlib import Path

import numpy as np

from strandcast.arm.load import PlanarArm
from strandcast.core.trajectory import JointTrajectory
from strandcast.executor.drivers.protocol import ArmState, Recording
from strandcast.executor.move_to_start import move_to_start
from strandcast.executor.streaming.bounds import safety_bounds
from strandcast.executor.streaming.link import ControllerState, ControllerStopped
from strandcast.executor.streaming.loop import stream

MS = 1_000_000


class VirtualClock:
    """Time goes on only where somebody waits; at given times [s] the host is kept from waking up [s]."""

    def __init__(self) -> None:
        self.ns = 5_000_000_000
        self.late: dict[float, float] = {}
        self.origin_ns = self.ns

    @property
    def since_s(self) -> float:
        return (self.ns - self.origin_ns) * 1e-9

    def now_ns(self) -> int:
        self.ns += 500  # reading a clock takes time too
        return self.ns

    def sleep_until(self, deadline_ns: int) -> None:
        self.ns = max(self.ns, deadline_ns) + 30_000
        for when in [when for when in self.late if when <= self.since_s]:
            self.ns += round(self.late.pop(when) * 1e9)

    def undisturbed(self):
        return nullcontext("virtual")


class Controller:
    """Joints that follow the newest set point by a second-order servo after a dead time.

    It has a clock of its own, a cycle, and packets that arrive 0.6 ms late. Its faults are given
    by times since the clock's origin [s].
    """

    def __init__(self, clock: VirtualClock, arm: PlanarArm, q: np.ndarray, rate_hz: float = 500.0) -> None:
        self.clock, self.arm = clock, arm
        self.cycle_ns = round(1e9 / rate_hz)
        self.at_ns = clock.ns
        self.q, self.qd = np.array(q, float), np.zeros(len(q))
        self.target = self.q.copy()
        self.sent: list[tuple[int, np.ndarray, np.ndarray]] = []
        self.packets = [self._packet()]
        self.frozen_at = self.protective_at = self.pushed_at = np.inf
        self.scaled_at = np.inf
        self.broken_at = self.deaf_at = np.inf  # for two writes; for good
        self.fault: str | None = None
        self.high = False
        self.switched: list[tuple[float, bool]] = []

    def since(self, ns: int) -> float:
        return (ns - self.clock.origin_ns) * 1e-9

    def _packet(self) -> tuple[int, float, np.ndarray, np.ndarray]:
        return self.at_ns, 1000.0 + self.at_ns * 1e-9, self.q.copy(), self.qd.copy()

    def run_to(self, ns: int) -> None:
        servo, step = self.arm.servo, 250_000
        while self.at_ns + step <= ns:
            self.at_ns += step
            heard = self.at_ns - round(servo.delay_s[0] * 1e9)
            while self.sent and self.sent[0][0] <= heard:
                self.target = self.sent.pop(0)[1]
            now = self.since(self.at_ns)
            if now >= self.protective_at:
                self.fault = "protective stop"
            if self.fault:
                self.qd *= 0.99
            else:
                w, z = servo.natural_frequency_rad_s, servo.damping_ratio
                push = np.where(now >= self.pushed_at, 1000.0, 0.0) * np.eye(len(self.q))[0]
                self.qd = self.qd + 2.5e-4 * (w * w * (self.target - self.q) - 2 * z * w * self.qd + push)
            self.q = self.q + 2.5e-4 * self.qd
            if self.at_ns % self.cycle_ns < step and now < self.frozen_at:
                self.packets.append(self._packet())

    # The link.

    paces = False
    finished = 0

    def start(self) -> None:
        self.finished = 0

    def read(self) -> ControllerState:
        self.run_to(self.clock.ns)
        while len(self.packets) > 1 and self.packets[1][0] <= self.clock.ns - 600_000:
            self.packets.pop(0)
        _, time_s, q, qd = self.packets[0]
        scaling = 0.5 if self.since(self.clock.ns) >= self.scaled_at else 1.0
        return ControllerState(time_s, q, qd, self.fault, scaling, self.high)

    def write(self, q_rad: np.ndarray, qd_rad_s: np.ndarray) -> None:
        now = self.since(self.clock.ns)
        if now >= self.deaf_at:
            raise OSError("broken pipe")
        if self.broken_at <= now < self.broken_at + 0.004:
            raise OSError("no buffer")
        if self.fault:
            raise ControllerStopped(self.fault)
        self.sent.append((self.clock.ns, q_rad.copy(), qd_rad_s.copy()))

    def finish(self) -> None:
        self.finished += 1

    def signal(self, high: bool) -> None:
        self.high = high
        self.switched.append((self.since(self.clock.ns), high))


class PacingController(Controller):
    """A controller that lets the host wait for its cycle, as Franka's does."""

    paces = True

    def read(self) -> ControllerState:
        if self.since(self.clock.ns) < self.frozen_at:  # then it has nothing to wait for
            cycles = (self.clock.ns - self.clock.origin_ns) // self.cycle_ns + 1
            self.clock.sleep_until(self.clock.origin_ns + cycles * self.cycle_ns + 600_000)
        return super().read()


class StreamedArm:
    """A driver over such a controller (see `strandcast.executor.drivers.protocol.Driver`)."""

    name = "streamed"
    streams = True
    address: str | None = None

    def __init__(self, arm: PlanarArm, controller: Controller) -> None:
        self.arm, self.controller, self.clock = arm, controller, controller.clock
        self.rate_hz = 1e9 / controller.cycle_ns
        self.played = self.stopped = 0

    def connect(self) -> None:
        pass

    def state(self) -> ArmState:
        reading = self.controller.read()
        return ArmState(reading.q_rad, reading.qd_rad_s, reading.fault, time_s=reading.time_s)

    def move_to_start(self, q_rad: np.ndarray) -> None:
        names = list(self.arm.joints)
        move_to_start(self.controller, self.arm, self.state().q_rad, q_rad, self.rate_hz, names, self.clock)

    def play(self, command: JointTrajectory, folder: Path) -> Recording:
        self.played += 1
        self.clock.origin_ns = self.clock.ns
        names = list(self.arm.joints)
        return stream(
            self.controller, command, safety_bounds(self.arm), self.rate_hz, names, clock=self.clock
        )

    def stop(self) -> None:
        self.stopped += 1
