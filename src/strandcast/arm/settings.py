"""The keys of an arm's TOML file (see ``config/arms/planar3.toml``, which explains each)."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

Vector2 = Annotated[list[float], Field(min_length=2, max_length=2)]
Vector3 = Annotated[list[float], Field(min_length=3, max_length=3)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Fraction = Annotated[float, Field(gt=0, le=1)]


class Keys(BaseModel):
    """A table of the file; keys that it does not know are errors."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class ThrowKeys(Keys):
    """Which joints move, which are held, and the plane they move in."""

    joints: Annotated[list[str], Field(min_length=1)]
    plane_x: Vector3
    plane_y: Vector3
    held: dict[str, float] = {}


class ClampKeys(Keys):
    """How the hand holds the string."""

    link: str
    offset_m: Vector2 = [0.0, 0.0]
    angle_rad: float = 0.0
    swallowed_m: NotNegative = 0.0


class HandMarkerKeys(Keys):
    """One ArUco marker on the hand."""

    id: Annotated[int, Field(ge=0)]
    size_m: Positive
    place_m: Vector2
    angle_rad: float = 0.0
    offset_m: float = 0.0


class MarkersKeys(Keys):
    """The ArUco markers on the hand."""

    dictionary: str = "DICT_4X4_50"
    hand: list[HandMarkerKeys] = []


class LimitsKeys(Keys):
    """Limits that a URDF cannot say, one number per moving joint."""

    acceleration_rad_s2: list[Positive]
    jerk_rad_s3: list[Positive] | None = None


class MarginsKeys(Keys):
    """How far inside the limits plans stay."""

    position_rad: NotNegative = 0.0
    velocity: Fraction = 1.0
    acceleration: Fraction = 1.0
    jerk: Fraction = 1.0
    torque: Fraction | None = None


class StartKeys(Keys):
    """How near the arm must be to a throw's start, and how still."""

    position_rad: list[Positive]
    velocity_rad_s: Positive = 0.01


class StopKeys(Keys):
    """How the arm stops before its time, one number per moving joint."""

    acceleration_rad_s2: list[Positive] | None = None
    jerk_rad_s3: list[Positive] | None = None
    distance_rad: list[NotNegative] | None = None


class GuardKeys(Keys):
    """What the player stops for while the arm moves, one number per moving joint."""

    tracking_rad: list[Positive] | None = None


class PayloadKeys(Keys):
    """What the flange carries, as the controller must have been told: clamp, markers, the string's weight."""

    mass_kg: NotNegative
    centre_m: Vector3 = [0.0, 0.0, 0.0]


class WorkspaceKeys(Keys):
    """The box that hand and string must not leave, in the plane of the throw."""

    x_m: Vector2
    y_m: Vector2


class ServoKeys(Keys):
    """Nominal response of the joints, one number per moving joint."""

    delay_s: list[NotNegative]
    natural_frequency_rad_s: list[Positive]
    damping_ratio: list[Positive]
    gain: list[Positive] | None = None


class DriverKeys(Keys):
    """The player's driver for this arm."""

    name: str
    settings: dict[str, Any] = {}


class ArmKeys(Keys):
    """The whole file."""

    name: str
    urdf: str
    log_rate_hz: Positive = 500.0
    throw: ThrowKeys
    clamp: ClampKeys
    markers: MarkersKeys = MarkersKeys()
    limits: LimitsKeys
    margins: MarginsKeys = MarginsKeys()
    start: StartKeys
    stop: StopKeys = StopKeys()
    guard: GuardKeys = GuardKeys()
    payload: PayloadKeys | None = None
    workspace: WorkspaceKeys
    servo: ServoKeys
    driver: DriverKeys
