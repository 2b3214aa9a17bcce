"""An arm from its TOML file and its URDF, checked as a whole."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import mujoco
import numpy as np
from pydantic import ValidationError
from pydantic_core import ErrorDetails

from strandcast.arm.checks import (
    Problem,
    geometry_problems,
    mass_problems,
    name_problems,
    number_problems,
    problems_in_space,
)
from strandcast.arm.dynamics import Dynamics, PlanarDynamics, planar_dynamics
from strandcast.arm.joint_limits import Limits, Stop
from strandcast.arm.kinematics import (
    PlanarChain,
    hand_pose,
    hand_poses,
    link_angles,
    link_capsules,
    planar_chain,
)
from strandcast.arm.servo import Servo
from strandcast.arm.settings import (
    AnyArmKeys,
    AnyClamp,
    ArmKeys,
    Clamp,
    Payload,
    SpatialArmKeys,
    SpatialClamp,
)
from strandcast.arm.spatial import (
    SpatialChain,
    capsules_in_space,
    clamp_axes,
    hand_poses_in_space,
    spatial_chain,
)
from strandcast.arm.spatial_dynamics import SpatialDynamics, spatial_dynamics
from strandcast.arm.urdf import JointLimit, posed, read_joint_limits, read_model
from strandcast.config.bounded import BoundError, load_toml, read_bounded
from strandcast.config.problems import SHOWN
from strandcast.core.hand_marker import HandMarker
from strandcast.errors import StrandcastError, StrandcastErrors
from strandcast.records.files import sha256_file

TRACKING_RAD = 0.15  # three times the error of a servo with 30 ms of lag at 100 rad/s², less its mean lag
PLATE_RIM_M = 0.015  # of the plate beyond the markers' edge; chosen
UPRIGHT = (0.0, 0.0, 1.0)  # upwards in the frame of the root of an arm that stands
STOP_RISE_S = 0.02  # time to a soft stop's full acceleration, unless the file gives a jerk; chosen

FileKeys = TypeVar("FileKeys", bound=AnyArmKeys)


@dataclass(frozen=True, eq=False, kw_only=True)
class Arm(ABC):
    """An arm that throws in a plane (`PlanarArm`) or in space (`SpatialArm`).

    Attributes
    ----------
    axes
        Coordinates of a place: 2 in a plane, 3 in space.
    joints
        Names of the J joints that move, from the base to the hand.
    held
        Angle of every other joint [rad].
    box_m
        (2 or 3, 2) the workspace, which hand and string must not leave: low and high of each coordinate [m].
    limits, servo
        The joints' limits less their margins, and how they nominally follow a command.
    start_tolerance_rad, start_velocity_rad_s
        (J,) how close to its start the arm must be for a throw [rad], and how still [rad/s].
    stop, tracking_rad, payload
        How it stops early; (J,) largest tracking error while it moves [rad]; its load, if known.
    log_rate_hz
        Rate of the joint log and of the motion's points.
    driver, driver_settings
        The player's driver; None: motions are exported as files.
    """

    axes: ClassVar[int]
    name: str
    path: Path
    urdf_path: Path
    sha256: str
    urdf_sha256: str
    joints: tuple[str, ...]
    held: dict[str, float]
    clamp: AnyClamp
    box_m: np.ndarray
    limits: Limits
    servo: Servo
    start_tolerance_rad: np.ndarray
    start_velocity_rad_s: float
    stop: Stop
    tracking_rad: np.ndarray
    payload: Payload | None
    log_rate_hz: float
    driver: str | None
    driver_settings: dict[str, Any] = field(default_factory=dict)

    @property
    def upwards(self) -> tuple[float, ...]:
        """Upwards in the frame of the URDF's root link."""
        return UPRIGHT

    @abstractmethod
    def hand_m(self, q: np.ndarray) -> np.ndarray:
        """Return where the string leaves the hand, (..., 2 or 3) [m], at joint angles (..., J) [rad]."""

    @abstractmethod
    def hand_poses(self, q: np.ndarray, zero_rad: np.ndarray, longer_m: np.ndarray) -> np.ndarray:
        """Return the hand's poses (P * K, T, 3), or (P * K, T, 9) in space, of joint paths with K strings.

        Parameters
        ----------
        q
            (P, T, J) angles [rad].
        zero_rad
            (K, J) added to the joints' angles [rad].
        longer_m
            (K,) a longer string hangs out further: the hand of the nominal one is further out [m].
        """

    def hand_path(self, q: np.ndarray) -> np.ndarray:
        """Return the hand's poses (T, 3), or (T, 9) in space, at joint angles (T, J) [rad]."""
        return np.asarray(self.hand_poses(q[None], np.zeros((1, q.shape[1])), np.zeros(1))[0])

    @abstractmethod
    def capsules(self, q: np.ndarray) -> np.ndarray:
        """Return both ends of each link, and in a plane of the plate between the outer markers.

        They are (..., S, 2, 2 or 3) [m], at joint angles (..., J) [rad].
        """

    def capsule_radii(self, clearance_m: float) -> np.ndarray:
        """Return (S,) how near to each capsule the string may come [m]."""
        return np.full(len(self.joints), clearance_m)

    def limited_places(self, q: np.ndarray) -> np.ndarray:
        """Return flange, clamp and elbow, which controllers limit.

        They are (..., 3, 2 or 3) [m], at joint angles (..., J) [rad]. The elbow is where the further one of
        the two longest links begins.
        """
        links_m = self.capsules(q)[..., : len(self.joints), :, :]
        first_m = links_m.reshape(-1, *links_m.shape[-3:])[0]
        lengths_m = np.linalg.norm(first_m[:, 1] - first_m[:, 0], axis=1)
        elbow = int(np.argsort(lengths_m.round(6), kind="stable")[-2:].max())
        return np.stack([self._flange_m(q, links_m), self.hand_m(q), links_m[..., elbow, 0, :]], axis=-2)

    def _flange_m(self, q: np.ndarray, links_m: np.ndarray) -> np.ndarray:
        """Return the origin of the clamp's link, (..., 2 or 3) [m]: in a plane the end of the last link."""
        return np.asarray(links_m[..., -1, 1, :])

    @abstractmethod
    def reach(self) -> tuple[np.ndarray, float]:
        """Return the place of the first joint, and how far from it the hand can be, stretched out [m]."""

    @cached_property
    def dynamics(self) -> Dynamics:
        """The joints' torques with the payload, as fast as the arm allows."""
        return self.spatial_dynamics

    @cached_property
    def spatial_dynamics(self) -> SpatialDynamics:
        """The joints' torques and inertia with the payload."""
        return spatial_dynamics(self.model_with_payload(), self.held, self.joints)

    def planar(self) -> PlanarArm:
        """Return the arm, which throws in a plane; SC-F207: it throws in space."""
        raise StrandcastError(
            "SC-F207",
            "the arm throws in space, and this needs one that throws in a plane",
            file=self.path,
            field="throw",
        )

    def spatial(self) -> SpatialArm:
        """Return the arm, which throws in space."""
        raise TypeError(f"{self.name!r} throws in a plane")

    def model(self) -> mujoco.MjModel:
        """Return MuJoCo's model of the URDF."""
        return read_model(self.urdf_path, self.urdf_sha256, self.upwards)

    @property
    def all_joints(self) -> tuple[str, ...]:
        """Names of all joints from the base on, including the held ones."""
        model = self.model()
        return tuple(model.joint(k).name for k in range(model.njnt))

    def model_with_payload(self) -> mujoco.MjModel:
        """Return the model with the payload at the clamp's link."""
        if self.payload is None:
            return self.model()
        return read_model(self.urdf_path, self.urdf_sha256, self.upwards, self.clamp.link, self.payload)


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanarArm(Arm):
    """An arm, and how it makes a planar throw.

    Attributes
    ----------
    plane
        (2, 3) unit vectors of the plane's x and y axes in the frame of the URDF's root link.
    """

    axes = 2
    clamp: Clamp
    plane: np.ndarray
    chain: PlanarChain
    markers: tuple[HandMarker, ...]
    marker_dictionary: str

    @property
    def upwards(self) -> tuple[float, ...]:
        """The plane's y axis: on a wall or a ceiling it is not the root's z axis."""
        return tuple(self.plane[1].tolist())

    def hand_m(self, q: np.ndarray) -> np.ndarray:
        """Return where the string leaves the hand, (..., 2) [m], at joint angles (..., J) [rad]."""
        return hand_pose(self.chain, self.clamp, q).position_m

    def hand_poses(self, q: np.ndarray, zero_rad: np.ndarray, longer_m: np.ndarray) -> np.ndarray:
        """Return the hand's poses (P * K, T, 3), see `Arm.hand_poses`."""
        return hand_poses(q, zero_rad, longer_m, self.chain, self.clamp)

    def capsules(self, q: np.ndarray) -> np.ndarray:
        """Return both ends of each link, and of the plate, (..., S, 2, 2) [m] at angles (..., J) [rad]."""
        along = [marker.place_m[0] for marker in self.markers]
        plate_m = np.array([min(along), max(along)]) if along else np.zeros(0)
        return link_capsules(q, self.chain, self.clamp, plate_m)

    def capsule_radii(self, clearance_m: float) -> np.ndarray:
        """Return (S,) how near to each capsule, the plate's last, the string may come [m]."""
        plate = [abs(marker.place_m[1]) + 0.5 * marker.size_m for marker in self.markers]
        radii = super().capsule_radii(clearance_m)
        return np.append(radii, PLATE_RIM_M + max(plate)) if plate else radii

    def reach(self) -> tuple[np.ndarray, float]:
        """Return the place (2,) of the first joint, and how far from it the hand can be [m]."""
        return self.chain.origin_m, float(self.chain.lengths_m.sum() + np.hypot(*self.clamp.offset_m))

    @cached_property
    def dynamics(self) -> PlanarDynamics:
        """The joints' torques with the payload, by the planar chain."""
        return planar_dynamics(self.model_with_payload(), self.held, self.joints, self.plane)

    def planar(self) -> PlanarArm:
        """Return the arm."""
        return self


@dataclass(frozen=True, eq=False, kw_only=True)
class SpatialArm(Arm):
    """An arm, and how it makes a throw in space.

    The world frame is that of the URDF's root link, z upwards.
    """

    axes = 3
    clamp: SpatialClamp
    chain: SpatialChain

    def hand_m(self, q: np.ndarray) -> np.ndarray:
        """Return where the string leaves the hand, (..., 3) [m], at joint angles (..., J) [rad]."""
        return self.hand_path(q.reshape(-1, q.shape[-1]))[:, :3].reshape(*q.shape[:-1], 3)

    def hand_poses(self, q: np.ndarray, zero_rad: np.ndarray, longer_m: np.ndarray) -> np.ndarray:
        """Return the hand's poses (P * K, T, 9), see `Arm.hand_poses`."""
        return hand_poses_in_space(self.chain, q, zero_rad, longer_m)

    def capsules(self, q: np.ndarray) -> np.ndarray:
        """Return both ends of each link, (..., J, 2, 3) [m] at joint angles (..., J) [rad]."""
        return capsules_in_space(self.chain, q)

    def _flange_m(self, q: np.ndarray, links_m: np.ndarray) -> np.ndarray:
        """Return the origin of the clamp's link, (..., 3) [m]; the last link ends at the clamp."""
        hand_m, direction, normal = np.split(self.hand_path(q.reshape(-1, q.shape[-1])), 3, axis=1)
        axes = np.stack([direction, normal, np.cross(direction, normal)], axis=1)
        offset_m = np.einsum("a,nax->nx", clamp_axes(self.clamp) @ np.array(self.clamp.offset_m), axes)
        return np.asarray(hand_m - offset_m).reshape(*q.shape[:-1], 3)

    def reach(self) -> tuple[np.ndarray, float]:
        """Return the place (3,) of the first joint, and how far from it the hand can be [m]."""
        places_m = np.vstack([self.chain.anchors_m, self.chain.hand_m])
        return places_m[0], float(np.linalg.norm(np.diff(places_m, axis=0), axis=1).sum())

    def spatial(self) -> SpatialArm:
        """Return the arm."""
        return self


def load_arm(path: str | Path) -> Arm:
    """Read the TOML file of an arm that throws in a plane or in space, as its keys say, and its URDF.

    The file of an arm in space has no plane and no markers: ``throw`` has the joints that move and those that
    are held, ``clamp.offset_m`` and ``clamp.direction`` have three numbers in the frame of the clamp's link,
    and ``workspace`` has ``z_m``, too. The error reports every problem with field, value and fix.
    """
    path = Path(path)
    if _throws_in_space(path):
        spatial = _read_keys(path, SpatialArmKeys)
        values, model = _read_urdf(path, spatial, problems_in_space)
        return SpatialArm(**values, clamp=spatial.clamp, chain=spatial_chain(model, spatial))
    keys = _read_keys(path, ArmKeys)
    values, model = _read_urdf(path, keys, geometry_problems)
    return PlanarArm(
        **values,
        clamp=keys.clamp,
        plane=keys.throw.plane(),
        chain=planar_chain(model, keys),
        markers=keys.markers.hand,
        marker_dictionary=keys.markers.dictionary,
    )


def _throws_in_space(path: Path) -> bool:
    """Return whether an arm's file has keys of an arm in space: a direction of the clamp, or heights.

    A file that cannot be read has none; loading it reports what is wrong.
    """
    try:
        keys = load_toml(read_bounded(path))
        return "direction" in keys["clamp"] or "z_m" in keys["workspace"]
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _read_urdf(
    path: Path, keys: FileKeys, geometry: Callable[[FileKeys, mujoco.MjModel], list[Problem]]
) -> tuple[dict[str, Any], mujoco.MjModel]:
    """Return the values of an `Arm` but for its clamp, and the URDF's model; refuse all problems.

    `geometry` finds those of the joints' places and axes.
    """
    urdf_path = _urdf_beside(path, keys.urdf)
    urdf_limits = read_joint_limits(urdf_path)
    model = read_model(urdf_path, sha256_file(urdf_path), UPRIGHT)
    problems = name_problems(keys, urdf_limits, model)
    problems = problems or [
        *number_problems(keys, urdf_limits),
        *mass_problems(keys, model),
        *geometry(keys, model),
    ]
    if problems:
        raise StrandcastErrors(
            [
                StrandcastError("SC-F205", what, file=path, field=field, fix=fix)
                for field, what, fix in problems
            ]
        )
    return _values_of(path, urdf_path, keys, urdf_limits), model


def _values_of(
    path: Path, urdf_path: Path, keys: AnyArmKeys, urdf_limits: dict[str, JointLimit]
) -> dict[str, Any]:
    joints = tuple(keys.throw.joints)
    limits, servo = _limits(keys, [urdf_limits[name] for name in joints]), keys.servo
    return {
        "name": keys.name,
        "path": path,
        "urdf_path": urdf_path,
        "sha256": sha256_file(path),
        "urdf_sha256": sha256_file(urdf_path),
        "joints": joints,
        "held": dict(keys.throw.held),
        "box_m": np.array(list(keys.workspace.model_dump().values())),
        "limits": limits,
        "servo": Servo(
            np.array(servo.delay_s),
            np.array(servo.natural_frequency_rad_s),
            np.array(servo.damping_ratio),
            np.array(servo.gain or [1.0] * len(joints)),
        ),
        "start_tolerance_rad": np.array(keys.start.position_rad),
        "start_velocity_rad_s": keys.start.velocity_rad_s,
        "stop": _stop(keys, limits),
        "tracking_rad": np.array(keys.guard.tracking_rad or [TRACKING_RAD] * len(joints)),
        "payload": keys.payload,
        "log_rate_hz": keys.log_rate_hz,
        "driver": keys.driver.name,
        "driver_settings": dict(keys.driver.settings),
    }


def _read_keys(path: Path, keys: type[FileKeys]) -> FileKeys:
    """Read an arm's TOML file as `keys`."""
    try:
        return keys.model_validate(load_toml(read_bounded(path)))
    except FileNotFoundError:
        raise StrandcastError("SC-F001", "the arm's file is missing", file=path) from None
    except BoundError as error:
        raise StrandcastError("SC-F002", str(error), file=path, line=error.line) from None
    except ValidationError as error:
        raise StrandcastErrors(
            [
                StrandcastError(
                    "SC-F003",
                    problem["msg"] + _value(problem),
                    file=path,
                    field=".".join(map(str, problem["loc"])),
                    fix="`strandcast docs reference/arm-file` explains every key",
                )
                for problem in error.errors()
            ]
        ) from None


def _value(problem: ErrorDetails) -> str:
    """Return the value of an entry in words; a missing one has none."""
    return "" if problem["type"] == "missing" else f" (is {SHOWN.repr(problem['input'])})"


def _urdf_beside(path: Path, name: str) -> Path:
    """Return the path of the URDF, which lies in the folder of the arm's file or below."""
    urdf = path.parent / name
    if "\0" in name or not Path(os.path.realpath(urdf)).is_relative_to(path.parent.resolve()):
        raise StrandcastError(
            "SC-F010",
            f"{name!r} does not lie below {path.parent}",
            file=path,
            field="urdf",
            fix="copy the URDF beside the arm's file",
        )
    return urdf


def _limits(keys: AnyArmKeys, urdf: list[JointLimit]) -> Limits:
    margins = keys.margins
    lower = [-np.inf if limit.lower_rad is None else limit.lower_rad for limit in urdf]
    upper = [np.inf if limit.upper_rad is None else limit.upper_rad for limit in urdf]
    jerk = keys.limits.jerk_rad_s3 or [np.inf] * len(urdf)
    torque = [limit.effort_n_m * margins.torque if margins.torque else np.inf for limit in urdf]  # type: ignore[operator]
    return Limits(
        lower_rad=np.array(lower) + margins.position_rad,
        upper_rad=np.array(upper) - margins.position_rad,
        velocity_rad_s=np.array([limit.velocity_rad_s for limit in urdf], float) * margins.velocity,
        acceleration_rad_s2=np.array(keys.limits.acceleration_rad_s2) * margins.acceleration,
        jerk_rad_s3=np.array(jerk) * margins.jerk,
        torque_n_m=np.array(torque),
        whole_arm=np.array([limit or np.inf for limit in keys.limits.of_whole_arm()]) * margins.velocity,
    )


def _stop(keys: AnyArmKeys, limits: Limits) -> Stop:
    acceleration = limits.acceleration_rad_s2
    if keys.stop.acceleration_rad_s2 is not None:
        acceleration = np.minimum(acceleration, keys.stop.acceleration_rad_s2)
    jerk = np.minimum(limits.jerk_rad_s3, keys.stop.jerk_rad_s3 or acceleration / STOP_RISE_S)
    distance = np.array(keys.stop.distance_rad or [0.0] * len(acceleration))
    # Of a deceleration that does not change, if the file does not say.
    time = np.array(keys.stop.time_s or 2.0 * distance / limits.velocity_rad_s)
    return Stop(acceleration, jerk, distance, time)


def clamp_frame(
    arm: PlanarArm, lateral_m: float = 0.0, turn_rad: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return where the string leaves the hand (3,) and its axes as rows (3, 3), in the clamp's link.

    The first axis points along the string, the last along the plane's normal.

    Parameters
    ----------
    lateral_m, turn_rad
        Deviation of the string in the clamp from the arm's file.
    """
    data = posed(arm.model(), arm.held)
    turn = data.body(arm.clamp.link).xmat.reshape(3, 3)
    x, y = arm.plane
    angle = float(link_angles(arm.chain, np.zeros(len(arm.joints)))[-1])
    along, left = np.cos(angle) * x + np.sin(angle) * y, -np.sin(angle) * x + np.cos(angle) * y
    offset = arm.clamp.offset_m[0] * along + (arm.clamp.offset_m[1] + lateral_m) * left
    bent = arm.clamp.angle_rad + turn_rad
    forward = np.cos(bent) * along + np.sin(bent) * left
    axes = np.stack([forward, np.cross(np.cross(x, y), forward), np.cross(x, y)])
    return turn.T @ offset, axes @ turn
