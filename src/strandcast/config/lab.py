"""`lab:` the virtual rig."""

from typing import Annotated, Literal

from pydantic import Field

from strandcast.core.section import Section


class LabString(Section):
    """A string given by values."""

    linear_density_kg_m: Annotated[float, Field(gt=0, le=1)] = Field(description="Mass per length [kg/m].")
    bending_stiffness_n_m2: Annotated[float, Field(ge=0, le=1)] = Field(
        2e-6, description="Bending stiffness EI [N m^2]."
    )
    curl_rad_m: Annotated[float, Field(ge=-50, le=50)] = Field(
        2.5, description="Curvature without load [rad/m]."
    )
    diameter_m: Annotated[float, Field(gt=0, le=0.05)] = Field(0.003, description="Diameter [m].")


PaperString = Literal["paper-1", "paper-2", "paper-3", "paper-4", "paper-5", "paper-6", "paper-7"]


class LabCamera(Section):
    """The lab's camera."""

    width_px: Annotated[int, Field(ge=320, le=4096)] = Field(1280, description="Width of the picture [px].")
    height_px: Annotated[int, Field(ge=240, le=4096)] = Field(720, description="Height of the picture [px].")
    frame_rate_hz: Annotated[float, Field(ge=60, le=5000)] = Field(
        500.0, description="Frames per second [Hz]."
    )
    exposure_s: Annotated[float, Field(gt=0, le=0.02)] = Field(
        4e-4, description="Exposure time per frame [s]."
    )
    noise_grey: Annotated[float, Field(ge=0, le=50)] = Field(
        2.5, description="Standard deviation of the noise [grey levels of 8 bits]."
    )
    background: Literal["plain", "textured", "cluttered"] = Field(
        "textured", description="Scene behind the string."
    )


class LabSettings(Section):
    """The virtual rig, for experiments without a robot."""

    string: PaperString | LabString = Field("paper-1", description="paper-1 … paper-7, or values.")
    noise: Annotated[float, Field(ge=0, le=10)] = Field(
        1.0, description="Scale of the throw-to-throw variation; 1 is a typical rig."
    )
    servo: Literal["servoj", "stiff", "pd", "soft", "weak"] = Field(
        "servoj",
        description="Behaviour of the joints: smoothed commands, stiff, without feed-forward (pd), soft, "
        "or with weak motors.",
    )
    camera: LabCamera = Field(LabCamera(), description="The lab's camera.")
    led: bool = Field(
        False,
        description="An LED at the position of align.led, which the controller switches around the throw.",
    )
