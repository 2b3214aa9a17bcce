"""An arm from its TOML file and its URDF, checked as a whole."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from pydantic import ValidationError

from strandcast.arm.checks import geometry_problems, name_problems, number_problems
from strandcast.arm.extract import extract_chain
from strandcast.arm.kinematics import Clamp, PlanarChain
from strandcast.arm.limits import Limits
from strandcast.arm.servo import Servo
from strandcast.arm.settings import ArmKeys
from strandcast.arm.urdf import Burden, JointLimit, coordinates, read_joint_limits, read_model
from strandcast.errors import StrandcastError, StrandcastErrors
from strandcast.records.files import sha256_file

TRACKING_RAD = 0.15  # three times what a servo of 30 ms leaves at 100 rad/s², its lag taken off
STOP_RISE_S = 0.02  # in which a soft stop reaches its full acceleration, unless the file says otherwise


@dataclass(frozen=True)
class HandMarker:
    """An ArUco marker on the hand.

    Attributes
    ----------
    id
        Its number in the dictionary.
    size_m
        Side of the black square [m].
    place_m
        (x, y) of its middle in the hand's frame [m]: origin where the string leaves, x along the string.
    angle_rad
        Direction of its own x axis in the hand's frame [rad].
    offset_m
        Out of the plane of motion, towards the camera [m].
    """

    id: int
    size_m: float
    place_m: tuple[float, float]
    angle_rad: float
    offset_m: float


@dataclass(frozen=True)
class Box:
    """A box in the plane of the throw [m]."""

    x_m: tuple[float, float]
    y_m: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Stop:
    """How the arm stops before its time.

    Attributes
    ----------
    acceleration_rad_s2, jerk_rad_s3
        (J,) of the player's soft stop, finite.
    distance_rad
        (J,) how far each joint turns on while the controller itself stops it from full speed, or zero.
    """

    acceleration_rad_s2: np.ndarray
    jerk_rad_s3: np.ndarray
    distance_rad: np.ndarray


@dataclass(frozen=True)
class Payload:
    """What the controller must have been told that the flange carries.

    Its mass [kg], and where its centre is in the frame of the clamp's link [m].
    """

    mass_kg: float
    centre_m: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Arm:
    """An arm, and how a planar throw lives on it.

    Attributes
    ----------
    name, path, urdf_path, sha256, urdf_sha256
        Its name, its two files and their hashes.
    joints
        Names of the J joints that move, from the base to the hand.
    held
        Angle of every other joint [rad].
    plane
        (2, 3) unit vectors of the plane's x and y axes in the frame of the URDF's root link.
    chain, clamp, link
        Kinematics in the plane, how the string is held, and the link that holds it.
    markers, marker_dictionary
        The ArUco markers on the hand.
    limits, servo
        What the joints can do, margins taken off, and how they nominally follow a command.
    start_tolerance_rad, start_velocity_rad_s
        (J,) how near to its start the arm must be for a throw [rad], and how still [rad/s].
    stop, tracking_rad, payload
        How it stops before its time; (J,) how far it may be off its command while it moves [rad]; what it
        carries, if told.
    workspace
        The box that hand and string must not leave.
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
    plane: np.ndarray
    chain: PlanarChain
    clamp: Clamp
    link: str
    markers: tuple[HandMarker, ...]
    marker_dictionary: str
    limits: Limits
    servo: Servo
    start_tolerance_rad: np.ndarray
    start_velocity_rad_s: float
    stop: Stop
    tracking_rad: np.ndarray
    payload: Payload | None
    workspace: Box
    log_rate_hz: float
    driver: str
    driver_settings: dict[str, Any] = field(default_factory=dict)

    def model(self) -> mujoco.MjModel:
        """Return MuJoCo's model of the URDF (compiled once a process)."""
        return _model(self.urdf_path, self.urdf_sha256)

    @property
    def all_joints(self) -> tuple[str, ...]:
        """Names of all joints, the held ones too, from the base on."""
        model = self.model()
        return tuple(model.joint(k).name for k in range(model.njnt))

    def burdened_model(self) -> mujoco.MjModel:
        """Return it with the payload at the clamp's link, as its motors feel it."""
        told = self.payload
        burden = None if told is None else Burden(self.link, told.mass_kg, told.centre_m)
        return _model(self.urdf_path, self.urdf_sha256, burden)

    def coordinates(self, q: np.ndarray) -> np.ndarray:
        """Return the model's coordinates for (J,) angles of the moving joints, the others held."""
        return coordinates(self.model(), self.held | dict(zip(self.joints, q, strict=True)))


@lru_cache(maxsize=8)
def _model(urdf_path: Path, urdf_sha256: str, burden: Burden | None = None) -> mujoco.MjModel:
    return read_model(urdf_path, burden)


def load_arm(path: str | Path) -> Arm:
    """Read an arm's TOML file and its URDF.

    Raises
    ------
    StrandcastError
        With all that is wrong with the file: field, value and fix.
    """
    path = Path(path)
    keys = _read_keys(path)
    urdf_path = path.parent / keys.urdf
    said = read_joint_limits(urdf_path)
    model = _model(urdf_path, sha256_file(urdf_path))
    plane = _plane(keys)
    problems = name_problems(keys, said, model)
    problems = problems or number_problems(keys, said) + geometry_problems(keys, model, plane)
    if problems:
        raise StrandcastErrors(
            [
                StrandcastError("SC-F205", what, file=path, field=field, fix=fix)
                for field, what, fix in problems
            ]
        )
    joints = tuple(keys.throw.joints)
    limits = _limits(keys, [said[name] for name in joints])
    return Arm(
        name=keys.name,
        path=path,
        urdf_path=urdf_path,
        sha256=sha256_file(path),
        urdf_sha256=sha256_file(urdf_path),
        joints=joints,
        held=dict(keys.throw.held),
        plane=plane,
        chain=extract_chain(model, joints, keys.throw.held, plane, keys.clamp.link),
        clamp=Clamp(np.array(keys.clamp.offset_m), keys.clamp.angle_rad, keys.clamp.swallowed_m),
        link=keys.clamp.link,
        markers=tuple(
            HandMarker(m.id, m.size_m, (m.place_m[0], m.place_m[1]), m.angle_rad, m.offset_m)
            for m in keys.markers.hand
        ),
        marker_dictionary=keys.markers.dictionary,
        limits=limits,
        servo=_servo(keys),
        start_tolerance_rad=np.array(keys.start.position_rad),
        start_velocity_rad_s=keys.start.velocity_rad_s,
        stop=_stop(keys, limits),
        tracking_rad=np.array(keys.guard.tracking_rad or [TRACKING_RAD] * len(joints)),
        payload=_payload(keys),
        workspace=Box(
            (keys.workspace.x_m[0], keys.workspace.x_m[1]), (keys.workspace.y_m[0], keys.workspace.y_m[1])
        ),
        log_rate_hz=keys.log_rate_hz,
        driver=keys.driver.name,
        driver_settings=dict(keys.driver.settings),
    )


def _read_keys(path: Path) -> ArmKeys:
    try:
        return ArmKeys.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        raise StrandcastError(
            "SC-F203", "the arm's file is not there", file=path, fix="see config/arms/planar3.toml"
        ) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise StrandcastError("SC-F203", f"is not TOML ({error})", file=path, fix="mend the line") from None
    except ValidationError as error:
        raise StrandcastErrors(
            [
                StrandcastError(
                    "SC-F204",
                    f"{problem['msg']} (is {problem['input']!r})",
                    file=path,
                    field=".".join(map(str, problem["loc"])),
                    fix="see config/arms/planar3.toml, which explains every key",
                )
                for problem in error.errors()
            ]
        ) from None


def _plane(keys: ArmKeys) -> np.ndarray:
    plane = np.array([keys.throw.plane_x, keys.throw.plane_y], float)
    lengths = np.linalg.norm(plane, axis=1, keepdims=True)
    return plane / np.where(lengths > 0, lengths, 1.0)


def _limits(keys: ArmKeys, said: list[JointLimit]) -> Limits:
    margins = keys.margins
    lower = [-np.inf if limit.lower_rad is None else limit.lower_rad for limit in said]
    upper = [np.inf if limit.upper_rad is None else limit.upper_rad for limit in said]
    jerk = keys.limits.jerk_rad_s3 or [np.inf] * len(said)
    torque = [limit.effort_n_m * margins.torque if margins.torque else np.inf for limit in said]  # type: ignore[operator]
    return Limits(
        lower_rad=np.array(lower) + margins.position_rad,
        upper_rad=np.array(upper) - margins.position_rad,
        velocity_rad_s=np.array([limit.velocity_rad_s for limit in said], float) * margins.velocity,
        acceleration_rad_s2=np.array(keys.limits.acceleration_rad_s2) * margins.acceleration,
        jerk_rad_s3=np.array(jerk) * margins.jerk,
        torque_n_m=np.array(torque),
    )


def _stop(keys: ArmKeys, limits: Limits) -> Stop:
    acceleration = limits.acceleration_rad_s2
    if keys.stop.acceleration_rad_s2 is not None:
        acceleration = np.minimum(acceleration, keys.stop.acceleration_rad_s2)
    jerk = np.minimum(limits.jerk_rad_s3, keys.stop.jerk_rad_s3 or acceleration / STOP_RISE_S)
    return Stop(acceleration, jerk, np.array(keys.stop.distance_rad or [0.0] * len(acceleration)))


def _payload(keys: ArmKeys) -> Payload | None:
    if keys.payload is None:
        return None
    x, y, z = keys.payload.centre_m
    return Payload(keys.payload.mass_kg, (x, y, z))


def _servo(keys: ArmKeys) -> Servo:
    gain = keys.servo.gain or [1.0] * len(keys.throw.joints)
    return Servo(
        np.array(keys.servo.delay_s),
        np.array(keys.servo.natural_frequency_rad_s),
        np.array(keys.servo.damping_ratio),
        np.array(gain),
    )
