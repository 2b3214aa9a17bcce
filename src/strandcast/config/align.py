"""`align:` the fit of the camera's clock to the robot's."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from strandcast.core.quantities import Pixel, Position, Trial, value_and_sd
from strandcast.core.section import Section

DRIFT_SD = 5e-5  # of quartz clocks; chosen
LATENCY_SD_S = 5e-4  # chosen


class VideoSyncEvent(Section):
    """An event in a trial's video that the joint log records too, such as an LED that the robot switches."""

    trial: Trial = Field(description="Number of the trial, from 1.")
    camera_time_s: Annotated[float, Field(ge=0, le=36000)] = Field(
        description="Time of the event in the video: frame number over frame rate."
    )
    sigma_s: Annotated[float, Field(gt=0, le=1)] = Field(
        0.001,
        description="Standard deviation of that time. Set it to the frame interval over 3.5 if the frame "
        "is known.",
    )
    kind: Annotated[str, Field(min_length=1, max_length=100)] = Field(
        "any",
        description="Kind in run.json's sync_events; any: the nearest event. Set it if the log has "
        "several kinds.",
    )


Latency = Annotated[float, Field(ge=-0.1, le=0.1)]


class LedSettings(Section):
    """An LED in the picture that the robot switches on before the swing and off after it."""

    place_m: tuple[Position, Position] | None = Field(
        None,
        description="x and y of the LED in the plane of motion; the lab has one there. Give it, or box_px.",
    )
    radius_m: Annotated[float, Field(gt=0, le=0.2)] = Field(
        0.01,
        description="Half the side of the window around the LED. Raise it for a large LED; lower it if "
        "something moves nearby.",
    )
    box_px: tuple[Pixel, Pixel, Pixel, Pixel] | None = Field(
        None,
        description="Window in the picture: left, top, right, bottom. Give it if the LED is outside the "
        "plane.",
    )
    gamma: Annotated[float, Field(ge=0.3, le=4)] | None = Field(
        None,
        description="The camera's gamma, grey = light^(1/gamma); by default anything from 1 to 2.4. Set "
        "it, for more certain times, if you know it: 1 for most machine-vision cameras.",
    )
    latency_s: Latency | tuple[Latency, Annotated[float, Field(ge=0, le=0.1)]] = Field(
        (0.0, LATENCY_SD_S),
        description="Delay from the logged time to the light, and its standard deviation, shared by all "
        "events. Set it if you measured it.",
    )

    @property
    def latency_and_sd_s(self) -> tuple[float, float]:
        """The delay and its standard deviation [s]."""
        return value_and_sd(self.latency_s, LATENCY_SD_S)

    @model_validator(mode="after")
    def _position_or_box(self) -> LedSettings:
        if (self.place_m is None) == (self.box_px is None):
            raise ValueError("give the LED's place_m, or its box_px")
        if self.box_px and not (self.box_px[0] < self.box_px[2] and self.box_px[1] < self.box_px[3]):
            raise ValueError("box_px must be [left, top, right, bottom]")
        return self


class AlignSettings(Section):
    """The fit of the camera's clock to the robot's."""

    drift: tuple[Annotated[float, Field(ge=-0.1, le=0.1)], Annotated[float, Field(gt=0, le=0.1)]] = Field(
        (0.0, DRIFT_SD),
        description="The clocks' relative drift before the fit, and its standard deviation. Raise that for a "
        "camera without a quartz clock, or set both to what `python -m strandcast.alignment.shared_drift` "
        "finds from several trials.",
    )
    largest_offset_s: Annotated[float, Field(gt=0, le=3600)] = Field(
        10.0,
        description="Largest time between the video's first frame and the log's first row. Raise it if "
        "the recordings start further apart (slower).",
    )
    sync_events: list[VideoSyncEvent] = Field(
        [],
        description="Events in the video found by hand, e.g. the first frame with a lit LED; they replace"
        " the LED's detection in their trial.",
    )
    led: LedSettings | None = Field(
        None,
        description="An LED that the robot switches, detected in the video.",
    )
