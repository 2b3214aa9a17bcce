"""Joint logs from ROS bags: rosbag1, rosbag2 (SQLite, MCAP), read by the optional package `rosbags`."""

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.imports.mapping import JointMapping, JointSource
from strandcast.imports.table import NumberTable
from strandcast.packages import optional_package
from strandcast.records.files import sha256_file
from strandcast.records.record import refusal

SUFFIXES = (".bag", ".db3", ".mcap")
JOINT_STATE = "sensor_msgs/msg/JointState"
CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"

Clock = Literal["header", "receive"]


@dataclass
class _Row:
    """One message: times [ns], and numbers by the joint's name."""

    header_ns: int
    receive_ns: int
    number: int
    q: dict[str, float]
    more: dict[str, dict[str, float]] = field(default_factory=dict)  # qd, q_cmd, qd_cmd


def is_bag(path: str | Path) -> bool:
    """Return whether a path is a bag by its name: .bag, .db3, .mcap, or a folder."""
    path = Path(path)
    return path.suffix in SUFFIXES or path.is_dir()


def read_bag(path: Path, topic: str | None, clock: Clock, namings: Sequence[list[str]]) -> JointSource:
    """Read JointState or JointTrajectoryControllerState messages of one topic; a row's line is its message.

    `topic` is by default the only one with joints. `clock` is the stamp in each message's header, or the time
    at which the recorder received it. `namings` are names that the arm's joints may have, in its order; the
    longest list that the bag has completely is used (a prefix before each name is allowed). Without any, all
    joints, in the first message's order.

    Raises
    ------
    StrandcastError
        SC-W012 rosbags is not installed; SC-I001 the bag cannot be read; SC-I042 no topic has joints,
        or several do; SC-I006 the arm's joints are not in the bag.
    """
    with _opened(path) as reader:
        topic = _topic(path, reader, topic)
        rows = list(_rows(reader, topic))
    there = list(dict.fromkeys(name for row in rows for name in row.q))
    if not there:
        what = f"no message of {topic} has positions"
        raise refusal("SC-I042", path, None, what, "record the joints' states")
    found = _match(path, list(rows[0].q) or there, there, namings)
    whole = [row for row in rows if all(name in row.q for name in found.values())]
    if not whole:
        what = f"no message of {topic} has all of {', '.join(found)}"
        raise refusal("SC-I006", path, None, what, "record a topic with all joints in one message")
    notes = []
    if len(whole) < len(rows):
        notes.append(f"{len(rows) - len(whole)} of {len(rows)} messages do not have all joints; left out")
    notes += [f"{alias} of the bag is {name}" for name, alias in found.items() if alias != name]
    time_s, words, clock_notes = _times(whole, clock)
    table, columns = _table(path, whole, found, time_s)
    of_clock = f"{words} of {topic}", notes + clock_notes
    return JointSource("bag", table, columns, [list(found)], _sha256(path), *of_clock)


def _sha256(path: Path) -> str:
    """Return the SHA-256 of a bag's file, or of the names and hashes of a folder's files."""
    if path.is_file():
        return sha256_file(path)
    files = sorted(file for file in path.iterdir() if file.is_file())
    return hashlib.sha256("".join(f"{f.name} {sha256_file(f)}\n" for f in files).encode()).hexdigest()


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    highlevel, typesys = (
        optional_package(f"rosbags.{name}", "rosbags", "ros", ", or hand the joints in as CSV")
        for name in ("highlevel", "typesys")
    )
    if not path.exists():
        raise refusal("SC-I001", path, None, "the bag is missing", "check the path")
    try:
        types = typesys.get_typestore(typesys.Stores.LATEST)  # for bags without their own
        with _other_channels_left_out(), highlevel.AnyReader([path], default_typestore=types) as reader:
            yield reader
    except StrandcastError:
        raise
    except Exception as error:  # damaged bags end in whatever their storage raises
        what = f"the bag cannot be read ({type(error).__name__}: {error})"
        fix = "copy it again; a bag that was not closed: `rosbag reindex` or `ros2 bag reindex`"
        raise refusal("SC-I001", path, None, what, fix) from None


@contextmanager
def _other_channels_left_out() -> Iterator[None]:
    """Let rosbags read MCAP files that have channels of other encodings than ROS' beside."""
    storage: Any = import_module("rosbags.rosbag2.storage_mcap")
    definition_of = storage.get_msgdef

    def known_definition_of(schema: Any) -> Any:
        try:
            return definition_of(schema)
        except KeyError:
            return definition_of(None)

    storage.get_msgdef = known_definition_of
    try:
        yield
    finally:
        storage.get_msgdef = definition_of


def _topic(path: Path, reader: Any, wanted: str | None) -> str:
    """Return the topic to read: the named one, or the only one with joints."""
    found = {c.topic: c.msgtype for c in reader.connections if c.msgtype in (JOINT_STATE, CONTROLLER_STATE)}
    if wanted in found:
        return str(wanted)
    listed = "; ".join(f"{topic} ({kind.rsplit('/', 1)[1]})" for topic, kind in sorted(found.items()))
    if not found:
        others = ", ".join(sorted({c.topic for c in reader.connections})) or "none"
        what = f"no topic has joints; the topics are {others}"
        raise refusal("SC-I042", path, None, what, "record /joint_states, or the controller's state")
    if wanted is not None:
        what = f"{wanted} has no joints; these do: {listed}"
        raise refusal("SC-I042", path, None, what, "name one of them: --topic")
    if len(found) > 1:
        what = f"several topics have joints: {listed}"
        fix = "name one: --topic TOPIC; a controller's state has the commanded joints too"
        raise refusal("SC-I042", path, None, what, fix)
    return str(next(iter(found)))


def _rows(reader: Any, topic: str) -> Iterator[_Row]:
    connections = [c for c in reader.connections if c.topic == topic]
    for number, (connection, receive_ns, raw) in enumerate(reader.messages(connections=connections), 1):
        message = reader.deserialize(raw, connection.msgtype)
        stamp = message.header.stamp
        header_ns = stamp.sec * 10**9 + stamp.nanosec
        if connection.msgtype == JOINT_STATE:
            names = list(message.name)
            q, more = message.position, {"qd": message.velocity}
        else:
            names = list(message.joint_names)
            actual, commanded = _controller_points(message)
            q = actual.positions
            more = {"qd": actual.velocities, "q_cmd": commanded.positions, "qd_cmd": commanded.velocities}
        rows = {key: _by_name(names, values) for key, values in more.items()}
        yield _Row(header_ns, int(receive_ns), number, _by_name(names, q), rows)


def _controller_points(message: Any) -> tuple[Any, Any]:
    """Return the measured and the commanded point, by the fields' names since ROS Iron or before it."""
    if hasattr(message, "feedback") and len(message.feedback.positions):
        return message.feedback, message.reference
    return message.actual, message.desired


def _by_name(names: list[str], values: Any) -> dict[str, float]:
    return dict(zip(names, map(float, values), strict=True)) if len(values) == len(names) else {}


def _match(path: Path, order: list[str], there: list[str], namings: Sequence[list[str]]) -> dict[str, str]:
    """Return the bag's name of each joint, by the arm's name, in the arm's order."""
    if not namings:
        return {name: name for name in order}
    for names in sorted(namings, key=len, reverse=True):
        found = {name: _same(name, there) for name in names}
        if all(found.values()) and len(set(found.values())) == len(names):
            return {name: str(alias) for name, alias in found.items()}
    what = f"the bag's joints are {', '.join(there)}; the arm's are {', '.join(namings[0])}"
    fix = "use the bag of this arm, or name its joints from the base on as the bag does: --joint NAME …"
    raise refusal("SC-I006", path, None, what, fix)


def _same(name: str, there: list[str]) -> str | None:
    if name in there:
        return name
    ending = [other for other in there if other.endswith((f"_{name}", f"/{name}"))]
    return ending[0] if len(ending) == 1 else None


def _times(rows: list[_Row], wanted: Clock) -> tuple[np.ndarray, str, list[str]]:
    """Return times (rows,) [s], the clock in words, and notes on it."""
    header = np.array([row.header_ns for row in rows], np.int64)
    receive = np.array([row.receive_ns for row in rows], np.int64)
    if wanted == "header" and not header.all():
        note = "header stamps are zero: the times of reception are used, late by an unknown delay"
        return receive * 1e-9, "time of reception", [note]
    late_ms = (receive - header) * 1e-6
    if wanted == "receive":
        jitter = f"{np.median(late_ms):.1f} ms after the stamp, up to {late_ms.max():.1f} ms"
        return receive * 1e-9, f"time of reception ({jitter})", []
    jitter = f"received {np.median(late_ms):.1f} ms later, up to {late_ms.max():.1f} ms"
    return header * 1e-9, f"header stamp ({jitter})", []


def _table(
    path: Path, rows: list[_Row], found: dict[str, str], time_s: np.ndarray
) -> tuple[NumberTable, JointMapping]:
    """Return the table, and the mapping of those columns that every message has."""
    names, values, columns = ["time"], [time_s], {}
    blocks = {"q": [row.q for row in rows]}
    blocks |= {key: [row.more.get(key, {}) for row in rows] for key in ("qd", "q_cmd", "qd_cmd")}
    for key, block in blocks.items():
        if all(alias in values_of for values_of in block for alias in found.values()):
            columns[key] = [f"{key} of {name}" for name in found]
            names += columns[key]
            values += [np.array([values_of[alias] for values_of in block]) for alias in found.values()]
    lines = np.array([row.number for row in rows])
    return NumberTable(path, names, np.column_stack(values), lines, True), JointMapping(
        time="time", **columns
    )
