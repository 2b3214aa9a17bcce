"""A stand-in for a Universal Robots controller, as far as the client ur_rtde needs one. It is no controller.

It follows the public specifications: RTDE on port 30004 (protocol version 2), the dashboard's text
commands on port 29999, the script ports 30001–30003, and the registers by which ur_rtde's own program takes
its commands. The uploaded program is stored, not run: what it would do at a command is written here by hand.

It can show that the driver speaks to the real client library as it must, keeps its log, refuses and
stops when the state says so, and does not go on after the connection broke.
It cannot show what URScript means, servoj's true filter, torques, when a real arm stops itself, how it
brakes, speed scaling by the controller's own judgement, or the timing of a real controller's packages.

Run as a program it listens until it is ended; `StandIn` starts it in a process of its own. Times of faults
are in seconds of the controller's clock since the first servoj command.
"""

import contextlib
import json
import os
import random
import socket
import struct
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

JOINTS = 6
TRANSPORT_S = 0.004  # from a command's arrival until the servo sees it
NOISE_RAD = 2e-5
JUMP_RAD = 0.1  # a servoj target this far from the last one is a protective stop
BRAKE_RAD_S2 = 20.0

RUNNING, POWER_OFF = 7, 3  # robot modes
NORMAL, PROTECTIVE_STOP, ROBOT_EMERGENCY_STOP = 1, 3, 7  # safety modes
STOPPED, PLAYING = 1, 2  # runtime states

MOVEJ, SERVOJ, SERVO_STOP, TRIGGER_STOP, STOPJ, WATCHDOG, STOP_SCRIPT = 1, 11, 16, 31, 34, 35, 255
READY, DONE = 1, 2

CODES = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "UINT64": "Q",
    "INT32": "i",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "VECTOR6UINT32": "6I",
}
OUTPUTS = {
    "timestamp": "DOUBLE",
    "target_q": "VECTOR6D",
    "target_qd": "VECTOR6D",
    "target_qdd": "VECTOR6D",
    "actual_q": "VECTOR6D",
    "actual_qd": "VECTOR6D",
    "actual_current": "VECTOR6D",
    "robot_mode": "INT32",
    "safety_mode": "INT32",
    "safety_status_bits": "UINT32",
    "robot_status_bits": "UINT32",
    "runtime_state": "UINT32",
    "speed_scaling": "DOUBLE",
    "target_speed_fraction": "DOUBLE",
    "actual_digital_output_bits": "UINT64",
    "actual_digital_input_bits": "UINT64",
    "payload": "DOUBLE",
    "payload_cog": "VECTOR3D",
    "payload_inertia": "VECTOR6D",
    **{f"output_int_register_{k}": "INT32" for k in range(48)},
    **{f"output_double_register_{k}": "DOUBLE" for k in range(48)},
}
INPUTS = {
    "speed_slider_mask": "UINT32",
    "speed_slider_fraction": "DOUBLE",
    "standard_digital_output_mask": "UINT8",
    "standard_digital_output": "UINT8",
    "configurable_digital_output_mask": "UINT8",
    "configurable_digital_output": "UINT8",
    "tool_digital_output_mask": "UINT8",
    "tool_digital_output": "UINT8",
    "standard_analog_output_mask": "UINT8",
    "standard_analog_output_type": "UINT8",
    "standard_analog_output_0": "DOUBLE",
    "standard_analog_output_1": "DOUBLE",
    "external_force_torque": "VECTOR6D",
    **{f"input_int_register_{k}": "INT32" for k in range(48)},
    **{f"input_double_register_{k}": "DOUBLE" for k in range(48)},
}


@dataclass
class Setting:
    """The state of the stand-in, and the faults to make and when (None: never)."""

    host: str = "127.0.0.1"
    q_rad: list[float] = field(default_factory=lambda: [0.0] * JOINTS)
    version: tuple[int, int, int] = (5, 11, 0)  # 3.x.x is a CB3 at 125 Hz
    remote: bool = True
    program_runs: bool = False  # somebody else's
    clock_stands: bool = False  # from the beginning
    robot_mode: int = RUNNING
    safety_mode: int = NORMAL
    speed_fraction: float = 1.0  # of the slider on the pendant
    speed_scaling: float = 1.0
    payload_kg: float = 0.0
    payload_centre_m: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    absent: list[str] = field(default_factory=list)  # variables that this controller does not know
    delay_s: float = 0.0  # of every package that it sends
    lose_every: int = 0  # every n-th package is not sent
    double_every: int = 0  # every n-th package is sent twice
    lose: tuple[float, float] | None = None  # no package is sent from … to
    hold: tuple[float, float] | None = None  # packages wait from … to, and then come all at once
    freeze_stamp_at_s: float | None = None  # the time stamp stands still, all else goes on
    slow_at_s: float | None = None  # the slider goes to a half
    slow_above_rad_s: float | None = None  # the same, once a joint is faster
    protective_stop_at_s: float | None = None
    emergency_stop_at_s: float | None = None
    stop_program_at_s: float | None = None
    mute_at_s: float | None = None  # sends nothing and hears nothing; the connections stay open
    half_close_at_s: float | None = None  # closes its side of the RTDE connections
    drop_sender_at_s: float | None = None  # closes the connection that sends, and is well otherwise
    die_at_s: float | None = None  # ends at once


class Arm:
    """Six joints that follow their commands; each with a servo that lags, none with any dynamics."""

    def __init__(self, q: list[float], period_s: float) -> None:
        self.period_s = period_s
        self.q, self.qd, self.target, self.target_qd = list(q), [0.0] * JOINTS, list(q), [0.0] * JOINTS
        self._late: deque[list[float]] = deque(maxlen=1 + max(1, round(TRANSPORT_S / period_s)))
        self._do: Callable[[], bool] | None = None
        self._do_until_rest = False

    @property
    def busy(self) -> bool:
        return self._do is not None

    def step(self) -> None:
        if self._do is not None and self._do():
            self._do = None

    def servo(self, target: list[float], look_ahead_s: float) -> None:
        """Follow a target through a critically damped filter that lags by `look_ahead_s`."""
        if self._do is None or self._do.__name__ != "follow":
            self._late.clear()
            self.target = list(self.q)
        self.target_qd = [(a - b) / self.period_s for a, b in zip(target, self.target, strict=True)]
        self.target = list(target)
        rate, h = 2.0 / look_ahead_s, self.period_s
        fade = 2.718281828459045 ** (-rate * h)

        def follow() -> bool:
            self._late.append(self.target)
            for j, commanded in enumerate(self._late[0]):
                off = self.q[j] - commanded
                bend = self.qd[j] + rate * off
                self.q[j] = commanded + (off + bend * h) * fade
                self.qd[j] = (self.qd[j] - rate * bend * h) * fade
            return False

        self._do = follow

    def move(self, target: list[float], speed: float, acceleration: float) -> None:
        """Go straight to a target: the longest joint ramps up, goes on and ramps down, the others in step."""
        start, way = list(self.q), [b - a for a, b in zip(self.q, target, strict=True)]
        far = max(map(abs, way))
        top = min(speed, (far * acceleration) ** 0.5) or 1.0
        ramp_s, whole_s, t = top / acceleration, far / top + top / acceleration, 0.0

        def go() -> bool:
            nonlocal t
            t = min(t + self.period_s, whole_s)
            left = whole_s - t
            if t < ramp_s:
                s = 0.5 * acceleration * t * t
            elif left < ramp_s:
                s = far - 0.5 * acceleration * left * left
            else:
                s = 0.5 * top * ramp_s + top * (t - ramp_s)
            share = s / far if far else 1.0
            last, self.q = self.q, [a + share * w for a, w in zip(start, way, strict=True)]
            self.qd = [(a - b) / self.period_s for a, b in zip(self.q, last, strict=True)]
            self.target = list(self.q)
            if left <= 0:
                self.qd = [0.0] * JOINTS
            return left <= 0

        self._do = go

    def brake(self, deceleration: float) -> None:
        """Come to rest, the fastest joint at this deceleration, the others in step."""

        def slow() -> bool:
            fastest = max(map(abs, self.qd))
            share = max(0.0, 1.0 - deceleration * self.period_s / fastest) if fastest else 0.0
            self.qd = [v * share for v in self.qd]
            self.q = [a + v * self.period_s for a, v in zip(self.q, self.qd, strict=True)]
            self.target = list(self.q)
            self.target_qd = [0.0] * JOINTS
            return share == 0.0

        self._do = slow


class Connection:
    """One RTDE connection: its recipes, and what waits to be sent."""

    def __init__(self, link: socket.socket, after_break: bool) -> None:
        self.link, self.after_break = link, after_break
        self.inputs: list[tuple[list[str], struct.Struct]] = []
        self.outputs: list[str] = []
        self.layout = struct.Struct(">B")
        self.every, self.started = 1, False
        self.waiting: deque[tuple[float, bytes]] = deque()

    def send(self, kind: bytes, body: bytes) -> None:
        self.link.sendall(struct.pack(">Hc", 3 + len(body), kind) + body)


class Controller:
    """The state of the stand-in, advanced every 2 ms (8 ms as a CB3), and its four doors."""

    def __init__(self, setting: Setting) -> None:
        self.setting = setting
        self.period_s = 0.002 if setting.version[0] > 3 else 0.008
        self.arm = Arm(setting.q_rad, self.period_s)
        self.lock = threading.RLock()
        self.registers: dict[str, Any] = {}
        self.connections: list[Connection] = []
        self.claimed: dict[str, Connection] = {}
        self.ticks, self.sent = 500_000, 0
        self.first_servoj: int | None = None
        self.playing, self.executing, self.answer = setting.program_runs, False, 0
        self.watchdog_s, self.heard = 0.0, 0
        self.output_bits = 0
        self.counts = {
            "servoj": 0,
            "movej": 0,
            "servo_stop": 0,
            "uploads": 0,
            "watchdog_trips": 0,
            "lost": 0,
            "rtde": 0,
            "remote_asked": 0,
            "servoj_after_break": 0,
        }
        self.broken = self.dropped = False
        self.mode, self.safety = setting.robot_mode, setting.safety_mode
        self.fraction = setting.speed_fraction
        self.random = random.Random(1)
        self.stamp = 0.0
        self.last_target = self.arm.target
        self.path: list[list[float]] = []  # time stamp and true angles while servoj moves the arm

    # The clock.

    def run(self) -> None:
        start, count = time.monotonic(), 0
        while True:
            count += 1
            wait = start + count * self.period_s - time.monotonic()
            if wait > 0:
                time.sleep(wait)
            with self.lock:
                self.tick()

    def since_s(self) -> float:
        """Return the time since the first servoj command, negative before."""
        return -1.0 if self.first_servoj is None else (self.ticks - self.first_servoj) * self.period_s

    def due(self, at_s: float | None) -> bool:
        return at_s is not None and self.first_servoj is not None and self.since_s() >= at_s

    def tick(self) -> None:
        self.ticks += 1
        self._faults()
        if not self.broken or self.setting.mute_at_s is None:
            self._program()
        self.arm.step()
        if self.playing and self.first_servoj is not None:
            self.path.append([self.ticks * self.period_s, *self.arm.q])
            moved = max(abs(a - b) for a, b in zip(self.arm.target, self.last_target, strict=True))
            self.counts["largest_cycle_rad"] = max(moved, self.counts.get("largest_cycle_rad", 0.0))
        self.last_target = self.arm.target
        if not (self.setting.clock_stands or self.due(self.setting.freeze_stamp_at_s)):
            self.stamp = self.ticks * self.period_s
        self._publish()

    def _faults(self) -> None:
        s = self.setting
        if self.due(s.die_at_s):
            os._exit(9)
        fast = s.slow_above_rad_s is not None and max(map(abs, self.arm.qd)) > s.slow_above_rad_s
        if fast or self.due(s.slow_at_s):
            self.fraction = 0.5
        if self.due(s.protective_stop_at_s) and self.safety == NORMAL:
            self.halt(PROTECTIVE_STOP)
        if self.due(s.emergency_stop_at_s) and self.safety == NORMAL:
            self.halt(ROBOT_EMERGENCY_STOP)
        if self.due(s.stop_program_at_s) and self.playing:
            self.end_program()
        self._broken_connections()

    def _broken_connections(self) -> None:
        s = self.setting
        if self.due(s.mute_at_s):
            self.broken = True
        if self.due(s.drop_sender_at_s) and not self.dropped:
            self.dropped = True
            self.claimed["input_int_register_0"].link.shutdown(socket.SHUT_RDWR)
        if self.due(s.half_close_at_s) and not self.broken:
            self.broken = True
            for connection in self.connections:
                with contextlib.suppress(OSError):
                    connection.link.shutdown(socket.SHUT_WR)

    def halt(self, safety: int) -> None:
        self.safety = safety
        if safety == ROBOT_EMERGENCY_STOP:
            self.mode = POWER_OFF
        self.end_program()

    def end_program(self) -> None:
        self.playing, self.answer, self.watchdog_s = False, 0, 0.0
        self.arm.brake(BRAKE_RAD_S2)

    # ur_rtde's program, as far as the driver uses it.

    def _program(self) -> None:
        if not self.playing or self.safety != NORMAL:
            return
        if self.watchdog_s and (self.ticks - self.heard) * self.period_s > self.watchdog_s:
            self.counts["watchdog_trips"] += 1
            self.end_program()
            return
        command = self.registers.get("input_int_register_0", 0)
        if command == SERVOJ:
            self.answer = READY
        elif command == 0:
            self.executing, self.answer = False, READY
        elif not self.executing:
            self.executing = True
            self._execute(command)
        elif command == STOP_SCRIPT:
            self.end_program()
        elif not self.arm.busy:
            self.answer = DONE

    def _execute(self, command: int) -> None:
        number = [self.registers.get(f"input_double_register_{k}", 0.0) for k in range(8)]
        if command == MOVEJ:
            self.counts["movej"] += 1
            self.arm.move(number[:6], number[6], number[7])
        elif command in (SERVO_STOP, STOPJ):
            self.counts["servo_stop"] += 1
            self.arm.brake(number[0])
        elif command == WATCHDOG:
            self.watchdog_s, self.heard = 1.0 / number[0], self.ticks
        elif command == TRIGGER_STOP:
            self.halt(PROTECTIVE_STOP)
        elif command == STOP_SCRIPT:
            self.end_program()

    def _servoj(self) -> None:
        if not self.playing or self.safety != NORMAL:
            return
        number = [self.registers[f"input_double_register_{k}"] for k in range(11)]
        if self.first_servoj is None:
            self.first_servoj = self.ticks
            self.counts["first_step_rad"] = max(
                abs(a - b) for a, b in zip(number[:6], self.arm.q, strict=True)
            )
        self.counts["servoj"] += 1
        if self.counts["servoj"] > 1:
            moved = max(abs(a - b) for a, b in zip(number[:6], self.arm.target, strict=True))
            self.counts["largest_step_rad"] = max(moved, self.counts.get("largest_step_rad", 0.0))
            if moved > JUMP_RAD:
                self.halt(PROTECTIVE_STOP)
                return
        self.arm.servo(number[:6], number[9])

    # Port 30004.

    def values(self) -> dict[str, Any]:
        stopped = 1 << 10
        bits = {NORMAL: 1, PROTECTIVE_STOP: 1 << 2 | stopped, ROBOT_EMERGENCY_STOP: 1 << 6 | 1 << 7 | stopped}
        q = [a + self.random.gauss(0.0, NOISE_RAD) for a in self.arm.q]
        return {
            "timestamp": self.stamp,
            "actual_q": q,
            "actual_qd": self.arm.qd,
            "target_q": self.arm.target,
            "target_qd": self.arm.target_qd,
            "robot_mode": self.mode,
            "safety_mode": self.safety,
            "safety_status_bits": bits.get(self.safety, stopped),
            "robot_status_bits": (self.mode == RUNNING) | self.playing << 1,
            "runtime_state": PLAYING if self.playing else STOPPED,
            "speed_scaling": self.setting.speed_scaling,
            "target_speed_fraction": self.fraction,
            "actual_digital_output_bits": self.output_bits,
            "payload": self.setting.payload_kg,
            "payload_cog": self.setting.payload_centre_m,
            "output_int_register_0": self.answer,
        }

    def _publish(self) -> None:
        s = self.setting
        if self.broken:
            return
        self.sent += 1
        since = self.since_s()
        lost = bool(s.lose_every and since >= 0 and self.sent % s.lose_every == 0)
        lost = lost or bool(s.lose and s.lose[0] <= since < s.lose[1])
        if lost:
            self.counts["lost"] += 1
            return
        copies = 2 if s.double_every and self.sent % s.double_every == 0 else 1
        held = bool(s.hold and s.hold[0] <= since < s.hold[1])
        values = None
        for connection in list(self.connections):
            if connection.started and self.ticks % connection.every == 0:
                values = values or self.values()
                package = _pack(connection, values)
                connection.waiting.extend([(self.ticks * self.period_s + s.delay_s, package)] * copies)
            if not held:
                self._flush(connection)

    def _flush(self, connection: Connection) -> None:
        now = self.ticks * self.period_s
        try:
            while connection.waiting and connection.waiting[0][0] <= now + 1e-9:
                connection.link.sendall(connection.waiting.popleft()[1])
        except OSError:
            self._forget(connection)

    def _forget(self, connection: Connection) -> None:
        with self.lock:
            if connection in self.connections:
                self.connections.remove(connection)
            self.claimed = {k: c for k, c in self.claimed.items() if c is not connection}

    def rtde(self, link: socket.socket) -> None:
        connection = Connection(link, self.broken or self.dropped)
        with self.lock:
            self.connections.append(connection)
            self.counts["rtde"] += 1
        try:
            while head := _read(link, 3):
                size, kind = struct.unpack(">Hc", head)
                body = _read(link, size - 3)
                with self.lock:
                    if not (self.broken and self.setting.mute_at_s is not None):
                        self._rtde(connection, kind, body)
        finally:
            self._forget(connection)

    def _rtde(self, connection: Connection, kind: bytes, body: bytes) -> None:
        if kind == b"V":
            connection.send(kind, bytes([struct.unpack(">H", body)[0] <= 2]))
        elif kind == b"v":
            connection.send(kind, struct.pack(">4I", *self.setting.version, 1))
        elif kind == b"O":
            self._outputs(connection, body)
        elif kind == b"I":
            self._inputs(connection, body)
        elif kind in b"SP":
            connection.started = kind == b"S"
            connection.send(kind, b"\1")
        elif kind == b"U" and 0 < body[0] <= len(connection.inputs):
            names, layout = connection.inputs[body[0] - 1]
            values = dict(zip(names, _group(names, layout.unpack(body[1:])), strict=True))
            self._take(values, connection.after_break)

    def _outputs(self, connection: Connection, body: bytes) -> None:
        (frequency,) = struct.unpack(">d", body[:8])
        names = [name for name in body[8:].decode().split(",") if name]
        kinds = [
            "NOT_FOUND" if name in self.setting.absent else OUTPUTS.get(name, "NOT_FOUND") for name in names
        ]
        connection.outputs = names
        connection.layout = struct.Struct(">B" + "".join(CODES.get(kind, "") for kind in kinds))
        connection.every = max(1, round(1.0 / (frequency * self.period_s)))
        connection.send(b"O", b"\1" + ",".join(kinds).encode())

    def _inputs(self, connection: Connection, body: bytes) -> None:
        names = [name for name in body.decode().split(",") if name]
        kinds = []
        for name in names:
            mine = self.claimed.setdefault(name, connection) is connection
            kinds.append(INPUTS.get(name, "NOT_FOUND") if mine else "IN_USE")
        whole = not {"NOT_FOUND", "IN_USE"} & set(kinds)
        connection.inputs.append((names, struct.Struct(">" + "".join(CODES.get(kind, "") for kind in kinds))))
        connection.send(b"I", bytes([len(connection.inputs) if whole else 0]) + ",".join(kinds).encode())

    def _take(self, values: dict[str, Any], after_break: bool) -> None:
        self.registers.update(values)
        if "standard_digital_output_mask" in values:
            mask = values["standard_digital_output_mask"]
            self.output_bits = self.output_bits & ~mask | values["standard_digital_output"] & mask
        if "input_int_register_0" in values:
            self.heard = self.ticks
            if values["input_int_register_0"] == SERVOJ:
                self.counts["servoj_after_break"] += after_break
                self._servoj()

    # Ports 29999 and 30001–30003.

    def dashboard(self, link: socket.socket) -> None:
        link.sendall(b"Connected: Universal Robots Dashboard Server\n")
        for line in link.makefile("r"):
            link.sendall((self._dashboard(line.strip().lower()) + "\n").encode())

    def _dashboard(self, command: str) -> str:
        modes = {RUNNING: "RUNNING", POWER_OFF: "POWER_OFF"}
        safety = {
            NORMAL: "NORMAL",
            PROTECTIVE_STOP: "PROTECTIVE_STOP",
            ROBOT_EMERGENCY_STOP: "ROBOT_EMERGENCY_STOP",
        }
        answers = {
            "polyscopeversion": "URSoftware {}.{}.{}.108249 (Mar 01 2021)".format(*self.setting.version),
            "robotmode": f"Robotmode: {modes.get(self.mode, 'IDLE')}",
            "safetymode": f"Safetymode: {safety}",
            "safetystatus": f"Safetystatus: {safety}",
            "get robot model": "UR5",
            "get serial number": "20225500000",
            "programstate": "PLAYING ur_rtde" if self.playing else "STOPPED",
            "running": f"Program running: {'true' if self.playing else 'false'}",
        }
        if command == "is in remote control" and self.setting.version[0] > 3:
            self.counts["remote_asked"] += 1
            return "true" if self.setting.remote else "false"
        if command == "stop":
            with self.lock:
                self.end_program()
            return "Stopped"
        return answers.get(command, f"could not understand: '{command}'")

    def script(self, link: socket.socket) -> None:
        """Take a program; it counts as whole when nothing more comes for a moment, and "runs" then."""
        text = b""
        link.settimeout(None)
        while True:
            try:
                piece = link.recv(65536)
            except TimeoutError:
                piece, whole, text = None, text, b""
                link.settimeout(None)
                self._start(whole)
            if piece is not None:
                if not piece:
                    return
                text += piece
                link.settimeout(0.01)

    def _start(self, program: bytes) -> None:
        with self.lock:
            if b"def rtde_control" not in program or (self.broken and self.setting.mute_at_s is not None):
                return
            self.counts["uploads"] += 1
            if self.safety == NORMAL and self.mode == RUNNING and self.setting.remote:
                self.playing, self.executing, self.answer = True, False, READY
                self.path.clear()
                self.registers["input_int_register_0"] = 0

    def change(self, values: dict[str, Any]) -> None:
        """Change settings, as a person at the pendant does."""
        with self.lock:
            vars(self.setting).update(values)
            self.fraction = values.get("speed_fraction", self.fraction)

    def report(self) -> dict[str, Any]:
        with self.lock:
            return self.counts | {
                "q_rad": self.arm.q,
                "qd_rad_s": self.arm.qd,
                "playing": self.playing,
                "moved": self.counts["servoj"] + self.counts["movej"] > 0,
            }


def _pack(connection: Connection, values: dict[str, Any]) -> bytes:
    flat: list[Any] = [1]
    width = {"VECTOR3D": 3, "VECTOR6D": 6, "VECTOR6INT32": 6, "VECTOR6UINT32": 6}
    for name in connection.outputs:
        kind = OUTPUTS.get(name)
        if kind is None:
            continue
        value = values.get(name, [0] * width[kind] if kind in width else 0)
        flat.extend(value) if kind in width else flat.append(value)
    body = connection.layout.pack(*flat)
    return struct.pack(">Hc", 3 + len(body), b"U") + body


def _group(names: list[str], flat: tuple[Any, ...]) -> list[Any]:
    taken, at = [], 0
    for name in names:
        count = 6 if INPUTS[name] == "VECTOR6D" else 1
        taken.append(flat[at] if count == 1 else list(flat[at : at + count]))
        at += count
    return taken


def _read(link: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        try:
            piece = link.recv(count - len(data))
        except OSError:
            return b""
        if not piece:
            return b""
        data += piece
    return data


def listen(host: str, port: int, serve: Callable[[socket.socket], None]) -> None:
    """Serve every connection to a port in a thread of its own."""
    door = socket.create_server((host, port))

    def one(link: socket.socket) -> None:
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with link, contextlib.suppress(OSError):
            serve(link)

    def accept() -> None:
        while True:
            link, _ = door.accept()
            threading.Thread(target=one, args=(link,), daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()


def main() -> None:
    """Serve with the settings of the first argument; every line from stdin is answered.

    "path" with the arm's path; settings as JSON, which are changed, with a report.
    """
    with contextlib.suppress(OSError, AttributeError):  # a controller keeps time; its threads inherit this
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(60))
    controller = Controller(Setting(**json.loads(sys.argv[1])))
    host = controller.setting.host
    listen(host, 29999, controller.dashboard)
    for port in (30001, 30002, 30003):
        listen(host, port, controller.script)
    listen(host, 30004, controller.rtde)
    threading.Thread(target=controller.run, daemon=True).start()
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    for line in sys.stdin:
        if line == "path\n":
            answer: Any = controller.path
        else:
            controller.change(json.loads(line))
            answer = controller.report()
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()


class StandIn:
    """The stand-in in a process of its own, on a loopback address of its own."""

    def __init__(self, setting: Setting) -> None:
        self.host = setting.host
        self._process = subprocess.Popen(
            [sys.executable, __file__, json.dumps(asdict(setting))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout is not None
        if self._process.stdout.readline() != "ready\n":
            raise OSError(f"the stand-in could not listen at {setting.host}")

    def report(self, **settings: Any) -> dict[str, Any]:
        """Return the received commands and the posture; change settings before."""
        return dict(self._ask(json.dumps(settings)))

    def path(self) -> list[list[float]]:
        """Return time stamp and true angles of the newest program, while servoj moved the arm."""
        return list(self._ask("path"))

    def _ask(self, line: str) -> Any:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{line}\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())

    def end(self) -> None:
        """End the process, if it still lives."""
        self._process.kill()
        self._process.communicate()


if __name__ == "__main__":
    main()
