"""`align:` the fit of the camera's clock to the robot's."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from strandcast.core.quantities import Pixel, Position, Trial
from strandcast.core.section import Section


class VideoSyncEvent(Section):
    """An event in a trial's video that the joint log records too, such as an LED that the robot switches."""

    trial: Trial = Field(description="Number of the trial, counted from 1.")
    camera_time_s: Annotated[float, Field(ge=0, le=36000)] = Field(
        description="Its time in the video: frame over frame rate."
    )
    sigma_s: Annotated[float, Field(gt=0, le=1)] = Field(
        0.001, description="Standard deviation of that time; a frame time over 3.5 if the frame is known."
    )
    kind: Annotated[str, Field(min_length=1, max_length=100)] = Field(
        "any", description="Its kind in run.json's sync_events; 'any': the nearest event of the log."
    )


class LedSettings(Section):
    """An LED in the picture that the robot switches on before the swing and off after it."""

    x_m: Position | None = Field(None, description="Its position in the motion plane, in the world frame.")
    y_m: Position | None = Field(None, description="Its position in the motion plane, in the world frame.")
    radius_m: Annotated[float, Field(gt=0, le=0.2)] = Field(
        0.01, description="Half the side of the window around it."
    )
    box_px: tuple[Pixel, Pixel, Pixel, Pixel] | None = Field(
        None, description="Instead of its position: left, top, right, bottom in the picture."
    )
    gamma: Annotated[float, Field(ge=0.3, le=4)] | None = Field(
        None,
        description="The camera's, grey = light^(1/gamma); 1 for most machine-vision cameras. By default any "
        "value from 1 to 2.4 is allowed for, which makes the LED's times less certain.",
    )
    latency_s: Annotated[float, Field(ge=-0.1, le=0.1)] = Field(
        0.0, description="From the time in the joint log to the light."
    )
    latency_sd_s: Annotated[float, Field(ge=0, le=0.1)] = Field(
        5e-4, description="Standard deviation of that delay, which all events share."
    )

    @model_validator(mode="after")
    def _position_or_box(self) -> LedSettings:
        place = (self.x_m, self.y_m)
        if (None in place) == (self.box_px is None) or (self.box_px and place != (None, None)):
            raise ValueError("give the LED's x_m and y_m, or its box_px")
        if self.box_px and not (self.box_px[0] < self.box_px[2] and self.box_px[1] < self.box_px[3]):
            raise ValueError("box_px must be [left, top, right, bottom]")
        return self


class AlignSettings(Section):
    """The fit of the camera's clock to the robot's."""

    drift_prior: Annotated[float, Field(gt=0, le=0.1)] = Field(
        5e-5, description="Standard deviation of the clocks' relative drift."
    )
    known_drift: Annotated[float, Field(ge=-0.1, le=0.1)] = Field(
        0.0, description="Mean of the drift's prior, e.g. the drift shared by past trials."
    )
    largest_offset_s: Annotated[float, Field(gt=0, le=3600)] = Field(
        10.0, description="How far the video's first frame may lie from the log's first row."
    )
    sync_events: list[VideoSyncEvent] = Field(
        [], description="Events found by hand; a trial that has one does not use the LED."
    )
    led: LedSettings | None = Field(
        None, description="An LED that the robot switches, detected in the video automatically."
    )
