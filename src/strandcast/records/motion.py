"""motion.json: a timed joint trajectory, from rest to rest, with the control points it came from.

The points have the field names of ROS' trajectory_msgs/JointTrajectory, so that drivers can pass them on.
"""

from __future__ import annotations

from typing import Any, ClassVar, Self

import numpy as np
from pydantic import SerializerFunctionWrapHandler, field_validator, model_serializer, model_validator

from strandcast.core.strings import PARAMETERS, StringBatch
from strandcast.core.trajectory import JointTrajectory
from strandcast.records.record import Part, Record

LONGEST_NS = 600 * 10**9  # chosen: a throw lasts seconds, and its playback is at most slowed down
LARGEST = 1e6  # rad, rad/s, rad/s²; chosen, far above any joint, so that squares stay numbers
UNITS = {"angle": "rad", "time": "s", "length": "m"}


class TimeFromStart(Part):
    """Whole seconds and nanoseconds; a float would round."""

    sec: int
    nanosec: int


class TrajectoryPoint(Part):
    """The joints at one instant [rad, rad/s, rad/s²]."""

    positions: list[float]
    velocities: list[float]
    accelerations: list[float]
    time_from_start: TimeFromStart


class Robot(Part):
    """The arm for which the motion was planned."""

    name: str
    file_sha256: str
    urdf_sha256: str


class StartPosture(Part):
    """The posture in which the motion starts."""

    positions_rad: list[float]
    tolerance_rad: list[float]


class Bezier(Part):
    """Control heights of each joint's velocity curve (eq. 1)."""

    duration_s: float
    heights_rad_s: list[list[float]]
    stop_ramp_from_s: float | None = None


class StringSet(Part):
    """String parameters by name, relative masses of points 1…n, and other numbers (rest curl, clamp)."""

    parameters: dict[str, float]
    masses: list[float]
    options: dict[str, float] = {}

    @classmethod
    def first_of(cls, strings: StringBatch) -> StringSet:
        """Return the first string of a batch."""
        first = strings.first(1)
        return cls(
            parameters=dict(zip(PARAMETERS, first.parameters[0].tolist(), strict=True)),
            masses=first.masses[0].tolist(),
            options={name: float(values[0]) for name, values in first.options().items()},
        )

    def strings(self, stiff_joints: np.ndarray) -> StringBatch:
        """Return it as a batch of one, with these stiff joints (n,)."""
        values = {name: np.array([value]) for name, value in self.options.items()}
        parameters = np.array([[self.parameters[name] for name in PARAMETERS]])
        return StringBatch(parameters, np.array([self.masses]), values, stiff_joints=stiff_joints)


class OmitsUnset(Part):
    """Written without fields that were not set, so that files older than a field keep their hash."""

    @model_serializer(mode="wrap")
    def _set_fields(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {name: value for name, value in dump(self).items() if name in self.model_fields_set}


# What a controller may limit of the arm as a whole, and its unit.
WHOLE_ARM = {
    "flange speed": "m/s",
    "clamp speed": "m/s",
    "elbow speed": "m/s",
    "power": "W",
    "momentum": "kg m/s",
    "stopping time": "s",
    "tool's stopping distance": "m",
    "elbow's stopping distance": "m",
}


class Prediction(OmitsUnset):
    """The planner's prediction of the throw."""

    miss_m: float  # with the best string, undisturbed
    ensemble_miss_m: list[float]  # with each string of the ensemble, undisturbed
    # Probability of a hit, and quantiles of the miss, p10 to p90: calibrated by how far such motions really
    # missed or, if that was not counted for this kind, as simulated.
    hit_probability: float
    miss_quantiles_m: dict[str, float] = {}
    calibrated: bool = False
    # Over all strings with all disturbances: the number of simulated throws, share of hits and rms miss.
    simulated_hit_probability: float | None = None
    miss_rms_m: float | None = None
    hit_time_s: float  # from the motion's start
    largest_bend_rad: float
    peak_speed_rad_s: list[float]
    peak_acceleration_rad_s2: list[float]
    peak_jerk_rad_s3: list[float] = []
    peak_torque_n_m: list[float] = []
    peak_whole_arm: list[float | None] = []  # of `WHOLE_ARM`, if any of it is limited; null: not known
    lowest_rad: list[float] = []
    highest_rad: list[float] = []
    # Upper limits of the peaks by name, less their margins; null where there is no limit.
    limits: dict[str, list[float | None]] = {}
    # Least distance of hand and best string from the workspace's edges, negative outside.
    workspace_room_m: float | None = None
    peak_tip_speed_m_s: float
    # Sampled every 2 ms from the start: the hand, and the tip of the best string with its bias correction.
    time_s: list[float]
    hand_m: list[list[float]]
    tip_m: list[list[float]]


class Provenance(OmitsUnset):
    """How the motion was planned, and from which files."""

    planner: str
    kind: str  # "first", "rehearsed", "refined" or "replanned"
    seed: int
    planned_from: dict[str, str]  # file -> hash of its content
    parent_motion_sha256: str | None
    simulations: int
    start_string: str | None
    objective: str | None = None  # in words; null: a point
    string: StringSet
    flags: list[str]


class Motion(Record):
    """One motion of one arm."""

    SCHEMA: ClassVar[str] = "strandcast/motion"
    REUSABLE: ClassVar[bool] = True  # a throw may be repeated; run.json names the motion that was played

    experiment: str
    trial: int
    target_m: list[float]
    robot: Robot
    joint_names: list[str]
    units: dict[str, str] = UNITS
    start: StartPosture
    bezier: Bezier | None
    points: list[TrajectoryPoint]
    predicted: Prediction | None
    provenance: Provenance | None

    @field_validator("units")
    @classmethod
    def _known(cls, units: dict[str, str]) -> dict[str, str]:
        if units != UNITS:
            raise ValueError(f"{units} are not those of every motion, {UNITS}")
        return units

    @model_validator(mode="after")
    def _whole(self) -> Self:
        """Refuse points that are no trajectory of the joints; player and importer check the times' order."""
        joints = len(self.joint_names)
        if not joints or len(set(self.joint_names)) < joints or len(self.points) < 2:
            raise ValueError(f"joint_names {self.joint_names} with {len(self.points)} points are no motion")
        for k, point in enumerate(self.points):
            sizes = {len(point.positions), len(point.velocities), len(point.accelerations)}
            if sizes != {joints}:
                raise ValueError(f"point {k} has {sorted(sizes)} numbers, the motion {joints} joints")
            largest = max(map(abs, [*point.positions, *point.velocities, *point.accelerations]))
            if largest > LARGEST:
                raise ValueError(f"point {k} has {largest:g} rad, rad/s or rad/s²")
            time_ns = point.time_from_start.sec * 10**9 + point.time_from_start.nanosec
            if not 0 <= time_ns <= LONGEST_NS:
                raise ValueError(f"point {k} is at {time_ns} ns; a throw lasts seconds")
        return self

    def limits_used(self) -> list[tuple[str, str, float]]:
        """Return for each kind of limit which joint or place uses the largest share, and that share."""
        found, predicted = [], self.predicted
        if predicted is None:
            return []
        for kind, names, peaks, limit in (
            ("speed", self.joint_names, predicted.peak_speed_rad_s, "velocity_rad_s"),
            ("acceleration", self.joint_names, predicted.peak_acceleration_rad_s2, "acceleration_rad_s2"),
            ("jerk", self.joint_names, predicted.peak_jerk_rad_s3, "jerk_rad_s3"),
            ("torque", self.joint_names, predicted.peak_torque_n_m, "torque_n_m"),
            ("the whole arm", [*WHOLE_ARM], predicted.peak_whole_arm, "whole_arm"),
        ):
            triples = zip(names, peaks, predicted.limits.get(limit, []), strict=False)
            if used := [(peak / most, name) for name, peak, most in triples if most and peak is not None]:
                share, name = max(used)
                found.append((kind, name, share))
        return found

    def trajectory(self) -> JointTrajectory:
        """Return the points as a joint trajectory."""
        stamps = [(p.time_from_start.sec, p.time_from_start.nanosec) for p in self.points]
        return JointTrajectory(
            np.array([sec + nanosec * 1e-9 for sec, nanosec in stamps]),
            np.array([p.positions for p in self.points]),
            np.array([p.velocities for p in self.points]),
            np.array([p.accelerations for p in self.points]),
        )


def points_of(time_ns: np.ndarray, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> list[TrajectoryPoint]:
    """Return trajectory points from integer times (T,) and joints (T, J)."""
    return [
        TrajectoryPoint(
            positions=q[k].tolist(),
            velocities=qd[k].tolist(),
            accelerations=qdd[k].tolist(),
            time_from_start=TimeFromStart(sec=int(t) // 10**9, nanosec=int(t) % 10**9),
        )
        for k, t in enumerate(time_ns)
    ]
