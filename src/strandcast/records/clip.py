"""clip.json: the throw as a small video for the page, and a few of its frames as pictures."""

from typing import Annotated, ClassVar

from pydantic import Field

from strandcast.records.record import Part, Record

PLAYED_HZ = 25  # frame rate of the small video, whatever the camera's; chosen

Base64 = Annotated[str, Field(pattern=r"\A[A-Za-z0-9+/]+={0,2}\z")]
Positive = Annotated[int, Field(gt=0, le=16384)]


class StripPicture(Part):
    """One frame of the film strip, as large as the page shows it."""

    frame: int
    webp: Base64


class Clip(Record):
    """The frames of the throw, cropped to what the string sweeps, in a small H.264 video.

    Its frame k, shown from k/25 s on, is frame ``first_frame + k * step`` of the camera. Video and pictures
    are inside the record, so that its hash covers them.
    """

    SCHEMA: ClassVar[str] = "strandcast/clip"

    experiment: str
    trial: int
    rate_hz: Annotated[float, Field(gt=0)]  # of the camera
    first_frame: Annotated[int, Field(ge=0)]
    step: Annotated[int, Field(gt=0)]
    frames: Annotated[int, Field(gt=0, le=100_000)]  # of the small video
    box_px: tuple[
        int, int, Positive, Positive
    ]  # left, top, width and height of the crop in the camera's frames
    width_px: Positive  # of the small video
    height_px: Positive
    mp4: Base64
    strip: list[StripPicture]
