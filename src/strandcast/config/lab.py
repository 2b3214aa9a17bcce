"""`lab:` the virtual rig."""

import math
from typing import Annotated, Literal

from pydantic import Field, field_validator

from strandcast.config.estimate import known_names
from strandcast.core.section import Section


class LabString(Section):
    """A string given by values."""

    linear_density_kg_m: Annotated[float, Field(gt=0, le=1)] = Field(description="Mass per length.")
    bending_stiffness_n_m2: Annotated[float, Field(ge=0, le=1)] = Field(
        2e-6, description="Bending stiffness EI. Raise it for a stiff cable."
    )
    curl_rad_m: Annotated[float, Field(ge=-50, le=50)] = Field(
        2.5, description="Curvature without load. Set it to 0 for a string without memory."
    )
    diameter_m: Annotated[float, Field(gt=0, le=0.05)] = Field(
        0.003, description="Diameter in the picture and for drag. Set it to your string's."
    )


PaperString = Literal["paper-1", "paper-2", "paper-3", "paper-4", "paper-5", "paper-6", "paper-7"]


LAB_SIZE_PX = (1280, 720)


class LabCamera(Section):
    """The lab's camera."""

    size_px: tuple[
        Annotated[int, Field(ge=320, le=4096, multiple_of=2)],
        Annotated[int, Field(ge=240, le=4096, multiple_of=2)],
    ] = Field(LAB_SIZE_PX, description="Width and height of the picture, even numbers.")
    frame_rate_hz: Annotated[float, Field(ge=60, le=5000)] = Field(500.0, description="Frames per second.")
    exposure_s: Annotated[float, Field(gt=0, le=0.02)] = Field(
        4e-4,
        description="Exposure per frame; it blurs what moves.",
    )
    noise_grey: Annotated[float, Field(ge=0, le=50)] = Field(
        2.5,
        description="Standard deviation of the noise, in levels of 8 bits.",
    )
    background: Literal["plain", "textured", "cluttered"] = Field(
        "textured", description="Scene behind the string."
    )


# How throws of one motion differ on a typical rig: standard deviations, chosen.
TYPICAL = {
    "grasp_length_m": 0.002,  # length of string beyond the clamp
    "grasp_lateral_m": 0.001,  # place of the string in the clamp
    "grasp_angle_rad": math.radians(3.0),  # turn of the string in the clamp
    "sway_rad": 0.010,  # turn of the hanging string about the hand at the start
    "sway_rad_s": 0.050,  # rate of that turn
    "joint_zero_rad": 0.001,  # zero positions of the joints
    "servo_gain": 0.01,  # relative gain of the servo
    "joint_log_rad": 0.0005,  # noise of the logged angles
}
Noise = Annotated[float, Field(ge=0, le=10)] | dict[str, Annotated[float, Field(ge=0)]]


class LabSettings(Section):
    """The virtual rig, for experiments without a robot."""

    string: PaperString | LabString = Field(
        "paper-1",
        description="paper-1 … paper-7, or values. Change it to throw another string; string.length_m "
        "must fit it.",
    )
    noise: Noise = Field(
        1.0,
        description="Scale of the throw-to-throw variation, or its standard deviations by name, where not "
        f"given those of a typical rig: {', '.join(f'{name} {sd:.2g}' for name, sd in TYPICAL.items())}. Set "
        "it to 0 for throws that repeat exactly, or to your rig's.",
    )
    draws: Literal["normal", "heavy_tails", "unknown_rig"] = Field(
        "normal",
        description="normal; heavy_tails: Student's t with 4 degrees of freedom; unknown_rig: sizes by the "
        "experiment's name and seed, from 0.3 to 3 times those of noise, and heavy tails half the time. "
        "Change it to test how the method fares on worse rigs.",
    )
    servo: Literal["servoj", "stiff", "pd", "soft", "weak"] = Field(
        "servoj",
        description="Joints with smoothed commands (servoj), stiff, without feed-forward (pd), soft, or "
        "with weak motors. Change it to compare.",
    )
    camera: LabCamera = Field(
        LabCamera(),
        description="Figures of the lab's camera; in space, motion capture replaces it. Set them to your "
        "camera's.",
    )
    rehearsal: bool = Field(
        True,
        description="Play the first motion with an empty clamp and plan it again; not with another "
        "start_string or the paper's planner. Set it to false to see what that is worth.",
    )

    @property
    def sizes(self) -> dict[str, float]:
        """Standard deviations of the throw-to-throw variation, by name."""
        if isinstance(self.noise, dict):
            return TYPICAL | self.noise
        return {name: self.noise * sd for name, sd in TYPICAL.items()}

    @field_validator("noise")
    @classmethod
    def _noise_has_known_names(cls, value: Noise) -> Noise:
        known_names(value if isinstance(value, dict) else (), TYPICAL, "size of the lab's noise")
        return value
