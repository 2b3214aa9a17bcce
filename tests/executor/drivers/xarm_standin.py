"""A stand-in for UFACTORY's control box: its command port, its reports, and its refusals, over TCP.

Written from UFACTORY's "Data Description of TCP port" and developer manual, and from what xarm-python-sdk
sends: port 502 with the private protocol, port 30000 at 250 Hz, port 30001 at 5 Hz. In servo mode each cycle
takes the newest set point; a joint that would be faster than 180 °/s (C24) or a flange faster than 1.2 m/s
(C60) stops the arm with that error, as does following that lags behind (C34 here). Errors stay until they are
cleared, which a test does, not a driver.
"""

import multiprocessing
import socket
import struct
import threading
import time
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from strandcast.arm.load import PlanarArm, load_arm

CYCLE_S = 0.004
FOLLOW = 0.35  # share of the way to the set point that a cycle goes
FASTEST_RAD_S, FASTEST_M_S = np.pi, 1.2
GET_VERSION, MOTION_EN, SET_STATE, GET_STATE, GET_ERROR, SET_MODE, MOVE_SERVOJ = 1, 11, 12, 13, 15, 19, 29
MOVING, STANDING, STOPPED = 1, 2, 4
SPEED, LINEAR_SPEED, COLLISION = 24, 60, 31
VERSION = b"6,6,XI130402B01,AC130402B01,v%s"


class ControlBox:
    """The state of the box; a test changes it by `Handle`."""

    def __init__(self, arm: PlanarArm, moving: list[int], q_rad: list[float], firmware: str) -> None:
        self.arm, self.moving, self.firmware = arm, moving, firmware
        self.q = np.array(q_rad)
        self.qd = np.zeros(6)
        self.command = self.q.copy()
        self.mode, self.state, self.error = 0, STANDING, 0
        self.enabled = True
        self.silent = False  # answers and reports nothing more
        self.answers = True  # if not, it only reports
        self.longer = 1.0  # how much faster than by the arm's file the hand is
        self.deaf_at_s: float | None = None  # of the time in servo mode: the connection is lost
        self.hit_at_s: float | None = None  # an obstacle
        self.hit_above_rad_s = np.inf  # the same, once a joint is faster
        self.delay_s = 0.0  # of the answers to set points
        self.set_points: list[np.ndarray] = []
        self.path: list[list[float]] = []  # time and angles since the last servo mode began
        self.servo_s = 0.0
        self.lock = threading.Lock()
        self.alive = True

    def stop(self, error: int) -> None:
        """Stop the arm with an error."""
        self.error, self.state = error, STOPPED

    def cycle(self) -> None:
        """Go on by one cycle."""
        with self.lock:
            before = self.q.copy()
            if self.mode == 1 and self.state != STOPPED:
                self.servo_s += CYCLE_S
                self.path.append([self.servo_s, *self.q])
                fast = np.abs(self.qd).max() > self.hit_above_rad_s
                if fast or (self.hit_at_s is not None and self.servo_s > self.hit_at_s):
                    self.stop(COLLISION)
                elif self.deaf_at_s is not None and self.servo_s > self.deaf_at_s:
                    self.silent = True
                else:
                    self.q += FOLLOW * (self.command - self.q)
            self.qd = (self.q - before) / CYCLE_S

    def take(self, wanted: np.ndarray) -> None:
        """Take a set point in, or refuse it with an error."""
        if self.mode != 1 or self.state == STOPPED:
            return
        self.set_points.append(wanted)
        step = wanted - self.command
        hand = self.arm.hand_m(np.array([self.command[self.moving], wanted[self.moving]]))
        if np.abs(step).max() > FASTEST_RAD_S * CYCLE_S:
            self.stop(SPEED)
        elif self.longer * np.linalg.norm(hand[1] - hand[0]) > FASTEST_M_S * CYCLE_S:
            self.stop(LINEAR_SPEED)
        else:
            self.command = wanted

    def answer(self, function: int, data: bytes) -> bytes:
        """Return the data that answer a command."""
        with self.lock:
            if function == GET_VERSION:
                return (VERSION % self.firmware.encode()).ljust(40, b"\0")
            if function == SET_MODE:
                self.mode, self.command = data[0], self.q.copy()
                if self.mode == 1:
                    self.servo_s, self.path = 0.0, []
            elif function == SET_STATE and not self.error and self.enabled:
                self.state = {0: STANDING}.get(data[0], data[0])
            elif function == GET_STATE:
                return bytes([self.state])
            elif function == GET_ERROR:
                return bytes([self.error, 0])
            elif function == MOVE_SERVOJ:
                self.take(np.array(struct.unpack("<10f", data)[:6], float))
            return b""

    def flags(self) -> int:
        """Return the state byte of an answer: an error, and not ready to move."""
        return (0x40 if self.error else 0) | (0x10 if self.state == STOPPED else 0)

    def realtime(self) -> bytes:
        """Return a report of port 30000."""
        q, qd = (np.append(values, 0.0).astype("<f4").tobytes() for values in (self.q, self.qd))
        target, zeros = np.append(self.command, 0.0).astype("<f4").tobytes(), bytes(28)
        now = round(1e6 * (time.monotonic() + 1000.0))  # a clock of its own
        body = struct.pack(">QBH", now, self.mode << 4 | self.state, 0) + bytes(17)
        body += target + zeros + zeros + q + qd + zeros * 3 + bytes(168 + 144 + 144 + 96 - 48)
        return struct.pack(">I", 4 + len(body)) + body

    def normal(self) -> bytes:
        """Return a report of port 30001."""
        q = np.append(self.q, 0.0).astype("<f4").tobytes()
        enabled = 0x7F if self.enabled else 0
        body = struct.pack(">BH", self.mode << 4 | self.state, 0) + q + bytes(24 + 28)
        body += bytes([enabled, enabled, self.error, 0]) + bytes(24)
        body += struct.pack("<4f", 0.1, 0.0, 0.0, 30.0) + bytes([3, 3]) + struct.pack("<3f", 0.0, 0.0, -9.81)
        return struct.pack(">I", 4 + len(body)) + body


class Handle:
    """A control box in a process of its own, so that its threads do not hold up those of the driver."""

    def __init__(
        self, arm_file: Path, moving: list[int], q_rad: list[float], firmware: str, host: str
    ) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, other = context.Pipe()
        given = (other, arm_file, moving, q_rad, firmware, host)
        self._process = context.Process(target=_serve, args=given, daemon=True)
        self._process.start()
        self.seen()  # its ports are open

    def change(self, **values: object) -> None:
        """Set some of its values."""
        self._pipe.send(values)
        self._pipe.recv()

    def seen(self) -> SimpleNamespace:
        """Return its values as they are now."""
        self._pipe.send({})
        return SimpleNamespace(**self._pipe.recv())

    def end(self) -> None:
        """End it."""
        self._process.kill()
        self._process.join()


def _serve(
    pipe: Connection, arm_file: Path, moving: list[int], q_rad: list[float], firmware: str, host: str
) -> None:
    box = ControlBox(load_arm(arm_file).planar(), moving, q_rad, firmware)
    servers = [socket.create_server((host, port)) for port in (502, 30000, 30001)]
    work = (
        (_physics, box),
        (_commands, box, servers[0]),
        (_reports, box, servers[1], box.realtime, CYCLE_S),
        (_reports, box, servers[2], box.normal, 0.2),
    )
    for function, *given in work:
        threading.Thread(target=function, args=given, daemon=True).start()
    while True:
        vars(box).update(pipe.recv())
        shown = ("q", "mode", "state", "error", "set_points", "path")
        pipe.send({name: getattr(box, name) for name in shown})


def _physics(box: ControlBox) -> None:
    due_s = time.monotonic()
    while box.alive:
        box.cycle()
        due_s += CYCLE_S
        time.sleep(max(0.0, due_s - time.monotonic()))


def _commands(box: ControlBox, server: socket.socket) -> None:
    with suppress(OSError):
        while box.alive:
            threading.Thread(target=_client, args=(box, server.accept()[0]), daemon=True).start()


def _client(box: ControlBox, link: socket.socket) -> None:
    link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    with suppress(OSError, ValueError), link, link.makefile("rb") as stream:
        while head := stream.read(6):
            transaction, protocol, length = struct.unpack(">HHH", head)
            request = stream.read(length)
            if box.silent or not box.answers or length < 1:
                continue
            data = box.answer(request[0], request[1:])
            head = struct.pack(">HHHBB", transaction, protocol, 2 + len(data), request[0], box.flags())
            late_s = box.delay_s if request[0] == MOVE_SERVOJ else 0.0
            if late_s:
                threading.Timer(late_s, _answer, (link, head + data)).start()
            else:
                link.sendall(head + data)


def _answer(link: socket.socket, data: bytes) -> None:
    with suppress(OSError):
        link.sendall(data)


def _reports(box: ControlBox, server: socket.socket, report: object, every_s: float) -> None:
    with suppress(OSError):
        while box.alive:
            link = server.accept()[0]
            link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            threading.Thread(target=_report, args=(box, link, report, every_s), daemon=True).start()


def _report(box: ControlBox, link: socket.socket, report: object, every_s: float) -> None:
    due_s = time.monotonic()
    with suppress(OSError), link:
        while box.alive:
            if not box.silent:
                link.sendall(report())  # type: ignore[operator]
            due_s += every_s
            time.sleep(max(0.0, due_s - time.monotonic()))
