"""`align:` the fit of the camera's clock to the robot's."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from strandcast.core.quantities import Pixel, Position, Trial
from strandcast.core.section import Section


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


class LedSettings(Section):
    """An LED in the picture that the robot switches on before the swing and off after it."""

    x_m: Position | None = Field(
        None, description="x of the LED in the plane of motion. Give x_m and y_m, or box_px."
    )
    y_m: Position | None = Field(
        None, description="y of the LED in the plane of motion. Give x_m and y_m, or box_px."
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
    latency_s: Annotated[float, Field(ge=-0.1, le=0.1)] = Field(
        0.0,
        description="Delay from the logged time to the light. Set it if you measured it.",
    )
    latency_sd_s: Annotated[float, Field(ge=0, le=0.1)] = Field(
        5e-4,
        description="Standard deviation of that delay, shared by all events. Raise it for a guess.",
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
        5e-5,
        description="Standard deviation of the clocks' relative drift. Raise it for a camera without a "
        "quartz clock.",
    )
    known_drift: Annotated[float, Field(ge=-0.1, le=0.1)] = Field(
        0.0,
        description="Mean of that drift. Set it to what `python -m strandcast.alignment.shared_drift` "
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
