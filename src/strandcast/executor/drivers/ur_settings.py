"""Settings of the UR driver: `[driver.settings]` of the arm's file."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

JOINTS = 6
UR_JOINTS = [
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
]


class UrSettings(BaseModel):
    """The keys of `[driver.settings]` for a UR arm.

    Attributes
    ----------
    host
        The controller's address; no default. A dry run does not need it.
    rate_hz
        500 for an e-Series, 125 for a CB3.
    look_ahead_s, gain
        Of servoj. The look-ahead delays the arm; the default is the least that servoj takes (34 ms behind).
        The default gain is that of UR's ROS driver.
    watchdog_hz
        The controller ends the program if set points arrive at a lower rate.
    stop_rad_s2
        Deceleration of servoStop [rad/s²], which ends the streaming, normally at rest.
    sync_output
        Standard digital output (0–7) that is high during the throw, for an LED in the video; or none.
    joints
        The controller's six joints, by their names in the URDF.
    """

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    host: str
    rate_hz: Literal[500, 125] = 500
    look_ahead_s: Annotated[float, Field(ge=0.03, le=0.2)] = 0.03
    gain: Annotated[float, Field(ge=100, le=2000)] = 2000.0
    watchdog_hz: Annotated[float, Field(gt=0, le=100)] = 10.0
    stop_rad_s2: Annotated[float, Field(gt=0, le=40)] = 10.0
    sync_output: Annotated[int, Field(ge=0, le=7)] | None = None
    joints: Annotated[list[str], Field(min_length=JOINTS, max_length=JOINTS)] = UR_JOINTS
