"""motion.json: a timed joint trajectory, from rest to rest, with the control points it came from.

The points carry the field names of ROS' trajectory_msgs/JointTrajectory, so that drivers can pass them on.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from pydantic import SerializerFunctionWrapHandler, model_serializer

from strandcast.records.record import Part, Record

UNITS = {"angle": "rad", "time": "s", "length": "m"}

# The string's ten parameters as the paper's Table 1 names them, in the order of every array of them.
PARAMETERS = ("k_s", "c_s", "k_h", "c_h", "k_sh", "c_sh", "C_c1", "C_c2", "k_ph", "c_ph")


class TimeFromStart(Part):
    """Whole seconds and nanoseconds: floats would round."""

    sec: int
    nanosec: int


class Point(Part):
    """The joints at one instant [rad, rad/s, rad/s²]."""

    positions: list[float]
    velocities: list[float]
    accelerations: list[float]
    time_from_start: TimeFromStart


class Robot(Part):
    """The arm that the motion is for."""

    name: str
    file_sha256: str
    urdf_sha256: str


class Start(Part):
    """The posture that the motion starts from."""

    positions_rad: list[float]
    tolerance_rad: list[float]


class Bezier(Part):
    """Control heights of each joint's velocity curve (eq. 1), joint by joint."""

    duration_s: float
    heights_rad_s: list[list[float]]
    stop_ramp_from_s: float | None = None


class StringSet(Part):
    """Parameters by name, the relative masses of points 1…n, and further numbers (rest curl, clamp)."""

    parameters: dict[str, float]
    masses: list[float]
    options: dict[str, float] = {}


class AsGiven(Part):
    """Written with the fields that it was given: a file from before a field was there keeps its hash."""

    @model_serializer(mode="wrap")
    def _as_given(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {name: value for name, value in dump(self).items() if name in self.model_fields_set}


class Prediction(AsGiven):
    """What the planner expects of the throw."""

    miss_m: float  # of the best string, undisturbed
    ensemble_miss_m: list[float]  # of every string, undisturbed
    hit_probability: float  # over strings and disturbances
    # Over every string with every disturbance: how many throws, and quantiles of their misses, p10 to p90.
    disturbed_throws: int | None = None
    miss_quantiles_m: dict[str, float] = {}
    hit_time_s: float  # from the motion's start
    largest_bend_rad: float
    peak_speed_rad_s: list[float]
    peak_acceleration_rad_s2: list[float]
    peak_jerk_rad_s3: list[float] = []
    peak_torque_n_m: list[float] = []
    lowest_rad: list[float] = []
    highest_rad: list[float] = []
    # What the peaks must stay below, margins taken off, by name; null where there is no limit.
    limits: dict[str, list[float | None]] = {}
    workspace_room_m: float | None = None  # of hand and best string to the workspace's edges, below 0 outside
    peak_tip_speed_m_s: float
    # Sampled every 2 ms from the start: the hand, and the tip of the best string, carried residual included.
    time_s: list[float]
    hand_m: list[list[float]]
    tip_m: list[list[float]]


class Provenance(AsGiven):
    """What the motion was made from."""

    planner: str
    kind: str  # "first", "refined" or "replanned"
    seed: int
    planned_from: dict[str, str]  # name of a file -> its content hash
    parent_motion_sha256: str | None
    simulations: int
    start_string: str | None
    objective: str | None = None  # in words; a point if not told
    string: StringSet
    flags: list[str]


class Motion(Record):
    """One motion of one arm."""

    SCHEMA: ClassVar[str] = "strandcast/motion"

    experiment: str
    trial: int
    target_m: list[float]
    robot: Robot
    joint_names: list[str]
    units: dict[str, str] = UNITS
    start: Start
    bezier: Bezier | None
    points: list[Point]
    predicted: Prediction | None
    provenance: Provenance | None

    def time_s(self) -> np.ndarray:
        """Return the times of the points (T,) from the start."""
        stamps = [(p.time_from_start.sec, p.time_from_start.nanosec) for p in self.points]
        return np.array([sec + nanosec * 1e-9 for sec, nanosec in stamps])

    def joints(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return positions, velocities, accelerations, each (T, J)."""
        return (
            np.array([p.positions for p in self.points]),
            np.array([p.velocities for p in self.points]),
            np.array([p.accelerations for p in self.points]),
        )


def points_of(time_ns: np.ndarray, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> list[Point]:
    """Return trajectory points from integer times (T,) and joints (T, J)."""
    return [
        Point(
            positions=q[k].tolist(),
            velocities=qd[k].tolist(),
            accelerations=qdd[k].tolist(),
            time_from_start=TimeFromStart(sec=int(t) // 10**9, nanosec=int(t) % 10**9),
        )
        for k, t in enumerate(time_ns)
    ]
