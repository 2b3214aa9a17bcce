"""An arm from its TOML file and its URDF, checked as a whole."""

import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import mujoco
import numpy as np
from pydantic import ValidationError
from pydantic_core import ErrorDetails

from strandcast.arm.checks import Problem, geometry_problems, name_problems, number_problems
from strandcast.arm.extract import extract_chain
from strandcast.arm.joint_limits import Limits, Stop
from strandcast.arm.kinematics import PlanarChain, hand_pose, link_angles
from strandcast.arm.servo import Servo
from strandcast.arm.settings import AnyArmKeys, AnyClamp, ArmKeys, Clamp, Payload
from strandcast.arm.urdf import JointLimit, coordinates, read_joint_limits, read_model
from strandcast.config.bounded import BoundError, load_toml, read_bounded
from strandcast.config.problems import SHOWN
from strandcast.core.box import Box
from strandcast.core.hand_marker import HandMarker
from strandcast.errors import StrandcastError, StrandcastErrors
from strandcast.records.files import sha256_file

TRACKING_RAD = 0.15  # three times the error of a servo with 30 ms of lag at 100 rad/s², less its mean lag
STOP_RISE_S = 0.02  # time to a soft stop's full acceleration, unless the file gives a jerk; chosen

FileKeys = TypeVar("FileKeys", bound=AnyArmKeys)


@dataclass(frozen=True, eq=False, kw_only=True)
class AnyArm(ABC):
    """An arm, without how it moves: see `Arm` and `strandcast.arm.spatial.SpatialArm`.

    Attributes
    ----------
    name, path, urdf_path, sha256, urdf_sha256
        Its name, its two files and their hashes.
    joints
        Names of the J joints that move, from the base to the hand.
    held
        Angle of every other joint [rad].
    clamp
        How the string is held.
    limits, servo
        The joints' limits less their margins, and how they nominally follow a command.
    start_tolerance_rad, start_velocity_rad_s
        (J,) how close to its start the arm must be for a throw [rad], and how still [rad/s].
    stop, tracking_rad, payload
        How it stops early; (J,) largest tracking error while it moves [rad]; its load, if known.
    log_rate_hz
        Rate of the joint log and of the motion's points.
    driver, driver_settings
        The player's driver.
    """

    name: str
    path: Path
    urdf_path: Path
    sha256: str
    urdf_sha256: str
    joints: tuple[str, ...]
    held: dict[str, float]
    clamp: AnyClamp
    limits: Limits
    servo: Servo
    start_tolerance_rad: np.ndarray
    start_velocity_rad_s: float
    stop: Stop
    tracking_rad: np.ndarray
    payload: Payload | None
    log_rate_hz: float
    driver: str
    driver_settings: dict[str, Any] = field(default_factory=dict)

    @property
    @abstractmethod
    def box_m(self) -> np.ndarray:
        """The workspace: (2 or 3, 2) low and high of each coordinate [m]."""

    @abstractmethod
    def hand_m(self, q: np.ndarray) -> np.ndarray:
        """Return where the string leaves the hand, (..., 2 or 3) [m], at joint angles (..., J) [rad]."""

    def model(self) -> mujoco.MjModel:
        """Return MuJoCo's model of the URDF, compiled once per process."""
        return _model(self.urdf_path, self.urdf_sha256)

    @property
    def all_joints(self) -> tuple[str, ...]:
        """Names of all joints from the base on, including the held ones."""
        model = self.model()
        return tuple(model.joint(k).name for k in range(model.njnt))

    def model_with_payload(self) -> mujoco.MjModel:
        """Return the model with the payload at the clamp's link."""
        if self.payload is None:
            return self.model()
        return _model(self.urdf_path, self.urdf_sha256, self.clamp.link, self.payload)

    def coordinates(self, q: np.ndarray) -> np.ndarray:
        """Return the model's coordinates for (J,) angles of the moving joints, the others held."""
        return coordinates(self.model(), self.held | dict(zip(self.joints, q, strict=True)))


@dataclass(frozen=True, eq=False, kw_only=True)
class Arm(AnyArm):
    """An arm, and how it makes a planar throw.

    Attributes
    ----------
    plane
        (2, 3) unit vectors of the plane's x and y axes in the frame of the URDF's root link.
    chain, clamp
        Kinematics in the plane, and how the string is held.
    markers, marker_dictionary
        The ArUco markers on the hand.
    workspace
        The box that hand and string must not leave.
    """

    clamp: Clamp
    plane: np.ndarray
    chain: PlanarChain
    markers: tuple[HandMarker, ...]
    marker_dictionary: str
    workspace: Box

    @property
    def box_m(self) -> np.ndarray:
        """The workspace: (2, 2) low and high of x and y [m]."""
        return np.array([self.workspace.x_m, self.workspace.y_m])

    def hand_m(self, q: np.ndarray) -> np.ndarray:
        """Return where the string leaves the hand, (..., 2) [m], at joint angles (..., J) [rad]."""
        return hand_pose(self.chain, self.clamp, q).position_m


@lru_cache(maxsize=8)
def _model(
    urdf_path: Path, urdf_sha256: str, carrier: str = "", payload: Payload | None = None
) -> mujoco.MjModel:
    return read_model(urdf_path, carrier, payload)


def load_arm(path: str | Path) -> Arm:
    """Read the TOML file of an arm that throws in a plane, and its URDF.

    The error reports every problem with field, value and fix; SC-F207: the arm throws in space.
    """
    path = Path(path)
    if throws_in_space(path):
        raise StrandcastError(
            "SC-F207",
            "the arm throws in space, and this needs one that throws in a plane",
            file=path,
            field="throw",
        )
    keys = read_keys(path, ArmKeys)
    plane = _plane(keys)
    values, model = read_urdf(path, keys, lambda model: geometry_problems(keys, model, plane))
    return Arm(
        **values,
        clamp=keys.clamp,
        plane=plane,
        chain=extract_chain(model, tuple(keys.throw.joints), keys.throw.held, plane, keys.clamp.link),
        markers=keys.markers.hand,
        marker_dictionary=keys.markers.dictionary,
        workspace=Box.unchecked(keys.workspace.x_m, keys.workspace.y_m),
    )


def throws_in_space(path: Path) -> bool:
    """Return whether an arm's file has keys of an arm in space: a direction of the clamp, or heights.

    A file that cannot be read has none; loading it reports what is wrong.
    """
    try:
        keys = load_toml(read_bounded(path))
        return "direction" in keys["clamp"] or "z_m" in keys["workspace"]
    except (OSError, ValueError, KeyError, TypeError):
        return False


def read_urdf(
    path: Path, keys: AnyArmKeys, geometry: Callable[[mujoco.MjModel], list[Problem]]
) -> tuple[dict[str, Any], mujoco.MjModel]:
    """Return the values of an `AnyArm` but for its clamp, and the URDF's model; refuse all problems.

    `geometry` finds those of the joints' places and axes.
    """
    urdf_path = _urdf_beside(path, keys.urdf)
    urdf_limits = read_joint_limits(urdf_path)
    model = _model(urdf_path, sha256_file(urdf_path))
    problems = name_problems(keys, urdf_limits, model)
    problems = problems or number_problems(keys, urdf_limits) + geometry(model)
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


def read_keys(path: Path, keys: type[FileKeys]) -> FileKeys:
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
                    fix="see config/arms/planar3.toml, which explains every key",
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


def _plane(keys: ArmKeys) -> np.ndarray:
    plane = np.array([keys.throw.plane_x, keys.throw.plane_y], float)
    lengths = np.linalg.norm(plane, axis=1, keepdims=True)
    return plane / np.where(lengths > 0, lengths, 1.0)


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
    )


def _stop(keys: AnyArmKeys, limits: Limits) -> Stop:
    acceleration = limits.acceleration_rad_s2
    if keys.stop.acceleration_rad_s2 is not None:
        acceleration = np.minimum(acceleration, keys.stop.acceleration_rad_s2)
    jerk = np.minimum(limits.jerk_rad_s3, keys.stop.jerk_rad_s3 or acceleration / STOP_RISE_S)
    return Stop(acceleration, jerk, np.array(keys.stop.distance_rad or [0.0] * len(acceleration)))


def clamp_frame(arm: Arm, lateral_m: float = 0.0, turn_rad: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return where the string leaves the hand (3,) and its axes as rows (3, 3), in the clamp's link.

    The first axis points along the string, the last along the plane's normal.

    Parameters
    ----------
    lateral_m, turn_rad
        Deviation of the string in the clamp from the arm's file.
    """
    model = arm.model()
    data = mujoco.MjData(model)
    rest = np.zeros(len(arm.joints))
    data.qpos[:] = arm.coordinates(rest)
    mujoco.mj_kinematics(model, data)
    turn = data.body(arm.clamp.link).xmat.reshape(3, 3)
    x, y = arm.plane
    angle = float(link_angles(arm.chain, rest)[-1])
    along, left = np.cos(angle) * x + np.sin(angle) * y, -np.sin(angle) * x + np.cos(angle) * y
    offset = arm.clamp.offset_m[0] * along + (arm.clamp.offset_m[1] + lateral_m) * left
    bent = arm.clamp.angle_rad + turn_rad
    forward = np.cos(bent) * along + np.sin(bent) * left
    axes = np.stack([forward, np.cross(np.cross(x, y), forward), np.cross(x, y)])
    return turn.T @ offset, axes @ turn
