"""The keys of an arm's TOML file (see ``config/arms/planar3.toml``, which explains each)."""

from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from strandcast.core.hand_marker import HandMarker

Vector3 = Annotated[list[float], Field(min_length=3, max_length=3)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Fraction = Annotated[float, Field(gt=0, le=1)]


class Keys(BaseModel):
    """A table of the file; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class MovingJoints(Keys):
    """Which joints move, and at which angles the others are held."""

    joints: Annotated[list[str], Field(min_length=1)]
    held: dict[str, float] = {}


class ThrowKeys(MovingJoints):
    """Which joints move, which are held, and the plane they move in."""

    plane_x: Vector3
    plane_y: Vector3

    def plane(self) -> np.ndarray:
        """Return the plane's x and y axes (2, 3) as unit vectors in the frame of the URDF's root link."""
        axes = np.array([self.plane_x, self.plane_y], float)
        lengths = np.linalg.norm(axes, axis=1, keepdims=True)
        return axes / np.where(lengths > 0, lengths, 1.0)


class AnyClamp(Keys):
    """The clamp of the string.

    Attributes
    ----------
    clamped_length_m
        String inside the clamp [m]: free length = string length - this. The file says ``swallowed_m``.
    """

    model_config = ConfigDict(populate_by_name=True)

    link: str
    clamped_length_m: NotNegative = Field(0.0, alias="swallowed_m")


class Clamp(AnyClamp):
    """How the hand holds the string: from the end of the last link, in its direction.

    Attributes
    ----------
    offset_m
        Where the string leaves, along the last link and to its left [m].
    angle_rad
        Direction in which the string leaves, relative to the last link [rad].
    """

    offset_m: tuple[float, float] = (0.0, 0.0)
    angle_rad: float = 0.0


class SpatialClamp(AnyClamp):
    """How the hand of an arm that moves in space holds the string, in the frame of its link.

    Attributes
    ----------
    offset_m
        Where the string leaves [m].
    direction
        In which direction it leaves; any length above 0.
    """

    offset_m: Vector3 = [0.0, 0.0, 0.0]
    direction: Vector3


class MarkersKeys(Keys):
    """The ArUco markers on the hand."""

    dictionary: str = "DICT_4X4_50"
    hand: tuple[HandMarker, ...] = ()


class LimitsKeys(Keys):
    """Limits that a URDF has no place for: one number per moving joint, and what else the controller limits.

    Attributes
    ----------
    tool_speed_m_s
        Of flange and clamp.
    elbow_speed_m_s
        Of the place where the forearm begins: the further one of the two longest links.
    power_w
        Of all joints together.
    momentum_kg_m_s
        Of all moving links and the payload.
    stopping_time_s, stopping_distance_m
        Until the arm rests, and how far tool and elbow go until then.
    """

    acceleration_rad_s2: list[Positive]
    jerk_rad_s3: list[Positive] | None = None
    tool_speed_m_s: Positive | None = None
    elbow_speed_m_s: Positive | None = None
    power_w: Positive | None = None
    momentum_kg_m_s: Positive | None = None
    stopping_time_s: Positive | None = None
    stopping_distance_m: Positive | None = None

    def of_whole_arm(self) -> tuple[float | None, ...]:
        """Return the limits of `strandcast.records.motion.WHOLE_ARM`; None: no limit."""
        tool, metres = self.tool_speed_m_s, self.stopping_distance_m
        stopping = self.stopping_time_s, metres, metres
        return tool, tool, self.elbow_speed_m_s, self.power_w, self.momentum_kg_m_s, *stopping


class MarginsKeys(Keys):
    """Margins that plans keep from the limits."""

    position_rad: NotNegative = 0.0
    velocity: Fraction = 1.0
    acceleration: Fraction = 1.0
    jerk: Fraction = 1.0
    torque: Fraction | None = None


class StartKeys(Keys):
    """How close to a throw's start the arm must be, and how still."""

    position_rad: list[Positive]
    velocity_rad_s: Positive = 0.01


class StopKeys(Keys):
    """How the arm stops before the motion's end, one number per moving joint."""

    acceleration_rad_s2: list[Positive] | None = None
    jerk_rad_s3: list[Positive] | None = None
    distance_rad: list[NotNegative] | None = None
    time_s: list[NotNegative] | None = None


class GuardKeys(Keys):
    """Tracking errors at which the player stops the arm, one number per moving joint."""

    tracking_rad: list[Positive] | None = None


class Payload(Keys):
    """The load of the flange, as configured in the controller: clamp, markers, the string's weight.

    `centre_m` is in the frame of the clamp's link.
    """

    mass_kg: NotNegative
    centre_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


class WorkspaceKeys(Keys):
    """The box in the plane of the throw that hand and string must not leave."""

    x_m: tuple[float, float]
    y_m: tuple[float, float]


class SpatialWorkspaceKeys(WorkspaceKeys):
    """The same box in space, z upwards."""

    z_m: tuple[float, float]


class ServoKeys(Keys):
    """Nominal response of the joints, one number per moving joint."""

    delay_s: list[NotNegative]
    natural_frequency_rad_s: list[Positive]
    damping_ratio: list[Positive]
    gain: list[Positive] | None = None


class DriverKeys(Keys):
    """The player's driver for this arm; none: its motions are exported as files."""

    name: str | None = None
    settings: dict[str, Any] = {}


class AnyArmKeys(Keys):
    """What the files of all arms have."""

    name: str
    urdf: str
    log_rate_hz: Positive = 500.0
    throw: MovingJoints
    clamp: AnyClamp
    limits: LimitsKeys
    margins: MarginsKeys = MarginsKeys()
    start: StartKeys
    stop: StopKeys = StopKeys()
    guard: GuardKeys = GuardKeys()
    payload: Payload | None = None
    workspace: WorkspaceKeys
    servo: ServoKeys
    driver: DriverKeys = DriverKeys()


class ArmKeys(AnyArmKeys):
    """The whole file of an arm that throws in a plane."""

    throw: ThrowKeys
    clamp: Clamp
    markers: MarkersKeys = MarkersKeys()


class SpatialArmKeys(AnyArmKeys):
    """The whole file of an arm that throws in space."""

    clamp: SpatialClamp
    workspace: SpatialWorkspaceKeys
