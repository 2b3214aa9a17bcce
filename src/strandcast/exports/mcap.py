"""`export mcap`: a throw as ROS 2 messages, for Foxglove, RViz and ros2 bag.

/joint_states and /joint_commands (sensor_msgs/JointState), /string/measured and /string/fitted
(nav_msgs/Path), all in the frame of the arm's base and stamped with the robot's clock.
"""

import struct
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from strandcast.exports.throw import ThrowData
from strandcast.packages import optional_package
from strandcast.records.files import atomic_write

BASE_FRAME = "base"
JOINT_STATE, PATH = "sensor_msgs/msg/JointState", "nav_msgs/msg/Path"
TOPICS = {
    "/joint_states": JOINT_STATE,
    "/joint_commands": JOINT_STATE,
    "/string/measured": PATH,
    "/string/fitted": PATH,
}
PARTS = {
    "std_msgs/Header": ("builtin_interfaces/Time stamp", "string frame_id"),
    "builtin_interfaces/Time": ("int32 sec", "uint32 nanosec"),
    "geometry_msgs/PoseStamped": ("std_msgs/Header header", "geometry_msgs/Pose pose"),
    "geometry_msgs/Pose": ("geometry_msgs/Point position", "geometry_msgs/Quaternion orientation"),
    "geometry_msgs/Point": ("float64 x", "float64 y", "float64 z"),
    "geometry_msgs/Quaternion": ("float64 x", "float64 y", "float64 z", "float64 w"),
}
WHOLES = {
    JOINT_STATE: (
        *("std_msgs/Header header", "string[] name"),
        *("float64[] position", "float64[] velocity", "float64[] effort"),
    ),
    PATH: ("std_msgs/Header header", "geometry_msgs/PoseStamped[] poses"),
}


def definition(kind: str) -> str:
    """Return the definition of a message type, followed by those of its parts, as MCAP stores it."""
    parts = [f"MSG: {name}\n" + "\n".join(fields) for name, fields in PARTS.items()]
    return f"\n{'=' * 80}\n".join(["\n".join(WHOLES[kind]), *parts])


Message = tuple[float, str, bytes]  # robot time [s], topic, content


def export_mcap(throw: ThrowData, out: Path) -> int:
    """Write a throw as MCAP; return the number of messages.

    Raises
    ------
    StrandcastError
        SC-W012 the package mcap is not installed.
    """
    mcap = optional_package("mcap.writer", "mcap", "mcap")
    messages = sorted(_messages(throw), key=lambda message: message[0])
    # MCAP's own times are unsigned; a camera may start before a log that begins at 0.
    shift_ns = max(0, -round(1e9 * messages[0][0])) if messages else 0
    with atomic_write(out) as temporary, temporary.open("wb") as file:
        writer = mcap.Writer(file)
        writer.start(profile="ros2", library="strandcast")
        texts = {kind: definition(kind).encode() for kind in WHOLES}
        schemas = {kind: writer.register_schema(kind, "ros2msg", text) for kind, text in texts.items()}
        topics = {name: writer.register_channel(name, "cdr", schemas[kind]) for name, kind in TOPICS.items()}
        for time_s, topic, content in messages:
            stamp = round(1e9 * time_s) + shift_ns
            writer.add_message(topics[topic], log_time=stamp, publish_time=stamp, data=content)
        writer.finish()
    return len(messages)


def _messages(throw: ThrowData) -> Iterator[Message]:
    for topic, values in (("/joint_states", throw.q_rad), ("/joint_commands", throw.q_cmd_rad)):
        for time_s, row in zip(throw.joint_time_s, values, strict=True):
            if np.isfinite(row).all():
                yield time_s, topic, joint_state(time_s, throw.arm.joints, row)
    for topic, points_m in (("/string/measured", throw.points_m), ("/string/fitted", throw.fitted_m)):
        for time_s, string in zip(throw.robot_time_s, throw.in_space(points_m), strict=True):
            known = string[np.isfinite(string).all(axis=1)]
            if len(known):
                yield time_s, topic, path(time_s, known)


class Cdr:
    """Little-endian CDR: values are aligned to their size, from behind the four bytes of the header."""

    def __init__(self) -> None:
        self.content = bytearray()

    def put(self, kind: str, *values: float) -> None:
        """Append numbers of one `struct` type."""
        size = struct.calcsize(f"<{kind}")
        self.content.extend(b"\0" * (-len(self.content) % size))
        self.content.extend(struct.pack(f"<{len(values)}{kind}", *values))

    def text(self, text: str) -> None:
        """Append a string, which ends with a zero."""
        data = text.encode() + b"\0"
        self.put("I", len(data))
        self.content.extend(data)

    def header(self, time_s: float) -> None:
        """Append a std_msgs/Header."""
        seconds, nanoseconds = divmod(round(1e9 * time_s), 10**9)
        self.put("i", seconds)
        self.put("I", nanoseconds)
        self.text(BASE_FRAME)

    def message(self) -> bytes:
        """Return the message with its header."""
        return b"\0\1\0\0" + bytes(self.content)


def joint_state(time_s: float, names: Iterable[str], q_rad: np.ndarray) -> bytes:
    """Return a sensor_msgs/JointState with positions."""
    cdr = Cdr()
    cdr.header(time_s)
    cdr.put("I", len(q_rad))
    for name in names:
        cdr.text(name)
    cdr.put("I", len(q_rad))
    cdr.put("d", *q_rad)
    cdr.put("I", 0)
    cdr.put("I", 0)
    return cdr.message()


def path(time_s: float, points_m: np.ndarray) -> bytes:
    """Return a nav_msgs/Path through points (K, 3)."""
    cdr = Cdr()
    cdr.header(time_s)
    cdr.put("I", len(points_m))
    for point in points_m:
        cdr.header(time_s)
        cdr.put("d", *point, 0.0, 0.0, 0.0, 1.0)
    return cdr.message()
