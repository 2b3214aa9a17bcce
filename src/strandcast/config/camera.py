"""`cameras:` each camera's set-up and calibration files, by name."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from strandcast.core.quantities import Position, value_and_sd
from strandcast.core.section import Section

MAIN = "main"  # the camera of an experiment that gives `camera:` and no names
CameraName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,31}$")]
LENS, PLANE_PHOTO = "calibration/lens-*.png", "calibration/plane.png"
LENS_FILES = (".yaml", ".yml", ".json", ".toml", ".txt", ".xml")
OFFSET_SD_M = 1e-3  # of a distance that was measured; chosen
Dictionary = Annotated[
    str,
    Field(
        pattern=r"^DICT_([4567]X[4567]_(50|100|250|1000)|ARUCO_ORIGINAL|APRILTAG_(16h5|25h9|36h10|36h11))$"
    ),
]


def _below(value: str) -> str:
    if value.startswith("/") or ".." in Path(value).parts or not Path(value).name or "\0" in value:
        raise ValueError("must be a path below the experiment's folder")
    return value


def _pattern(value: str) -> str:
    if any("**" in part and part != "**" for part in Path(value).parts):
        raise ValueError("** must stand alone between slashes")
    return value


Below = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_below)]


def each_once(field: str, message: str) -> AfterValidator:
    """Return a validator of lists of sections that refuses a second section with the same `field`."""

    def validate(sections: list[Any]) -> list[Any]:
        for value, following in pairwise(sorted(getattr(section, field) for section in sections)):
            if value == following:
                raise ValueError(message.format(value))
        return sections

    return AfterValidator(validate)


class Board(Section):
    """The ChArUco board of the lens photos."""

    squares_x: Annotated[int, Field(ge=3, le=50)] = Field(7, description="Squares per row.")
    squares_y: Annotated[int, Field(ge=3, le=50)] = Field(5, description="Squares per column.")
    square_m: Annotated[float, Field(gt=0.001, le=1)] = Field(0.035, description="Side of a square.")
    marker_m: Annotated[float, Field(gt=0.001, le=1)] = Field(
        0.026, description="Side of a marker; less than square_m."
    )
    dictionary: Dictionary = Field(
        "DICT_5X5_100",
        description="OpenCV's name of the markers' dictionary.",
    )

    @model_validator(mode="after")
    def _markers_fit_into_squares(self) -> Board:
        if self.marker_m >= self.square_m:
            raise ValueError(f"marker_m ({self.marker_m}) must be less than square_m ({self.square_m})")
        return self


class PlaneMarker(Section):
    """A marker lying in the plane of motion."""

    id: Annotated[int, Field(ge=0, le=1023)] = Field(description="Id in the dictionary.")
    x_m: Position = Field(description="x of its centre in the world frame.")
    y_m: Position = Field(description="y of its centre in the world frame.")
    angle_rad: Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi)] = Field(
        0.0, description="Rotation, counter-clockwise. Set it if the marker is not upright."
    )


class PlaneBoard(Board):
    """A ChArUco board that lies in the plane of motion; what it does not give is as in `camera.board`."""

    x_m: Position = Field(description="x of its lower left corner, as printed, in the world frame.")
    y_m: Position = Field(description="y of its lower left corner, as printed, in the world frame.")
    angle_rad: Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi)] = Field(
        0.0, description="Rotation, counter-clockwise. Set it if the board is not upright."
    )


class Plane(Section):
    """The markers, or the board, that carry the world frame into the picture."""

    dictionary: Dictionary = Field(
        "DICT_4X4_50",
        description="OpenCV's name of the single markers' dictionary. Set it to what you printed.",
    )
    size_m: Annotated[float, Field(gt=0.002, le=1)] = Field(
        0.08, description="Side of the single markers' black squares. Measure the print and set it."
    )
    markers: Annotated[list[PlaneMarker], each_once("id", "marker {} is there twice")] = Field(
        [],
        description="Single markers with measured positions. Give four or more at the edges of the "
        "workspace, or a board.",
    )
    board: PlaneBoard | None = Field(
        None,
        description="A ChArUco board instead of single markers: its place and, where they differ from "
        "camera.board, its numbers. Set them as printed and measured.",
    )
    place_sd_m: Annotated[float, Field(ge=0, le=0.1)] | None = Field(
        None,
        description="Standard deviation of the markers' measured places; by default derived from their "
        "fit. Set it with fewer than four markers.",
    )

    @model_validator(mode="after")
    def _markers_or_a_board(self) -> Plane:
        if self.markers and self.board is not None:
            raise ValueError("give the plane's markers or a board, not both")
        return self


Offset = Annotated[float, Field(ge=-1, le=1)]


class CameraSettings(Section):
    """The camera set-up and its calibration files, relative to the experiment's folder."""

    lens: Annotated[Below, AfterValidator(_pattern)] = Field(
        LENS,
        description="Pattern of the photos of the lens board, with *; a video of it, moved slowly; or the "
        "file of a lens that OpenCV, ROS, Kalibr, caliscope or anipose calibrated. Set it to what you have.",
    )
    lens_name: Annotated[str, Field(min_length=1, max_length=100)] | None = Field(
        None, description="Camera of that file, e.g. cam0. Set it where the file has several."
    )
    distortion: Literal["auto", "none", "k1", "k1k2", "k1k2p1p2", "k1k2k3p1p2", "rational", "fisheye"] = (
        Field(
            "auto",
            description="Free coefficients of the lens; auto takes fisheye where no polynomial fits as well, "
            "else the smallest model that predicts unseen photos well. Set it if the photos leave edges of "
            "the picture empty.",
        )
    )
    plane_photo: Below = Field(
        PLANE_PHOTO,
        description="Photo of the plane's markers or board. Set it if yours has another name.",
    )
    board: Board = Field(
        Board(),
        description="Numbers of the lens board (ChArUco). Set them as printed and measured.",
    )
    plane: Plane = Field(
        Plane(),
        description="Markers, or one board, in the plane of motion; they define the world frame.",
    )
    string_offset_m: Offset | tuple[Offset, Annotated[float, Field(ge=0, le=0.1)]] = Field(
        (0.0, OFFSET_SD_M),
        description="Distance of the string's plane from the markers', positive towards the camera, and its "
        "standard deviation. Measure and set it.",
    )
    exposure_s: Annotated[float, Field(gt=0, le=0.1)] | None = Field(
        None,
        description="Exposure per frame; by default a fifth of the frame interval. Set it to the camera's"
        " value.",
    )
    frame_rate_hz: Annotated[float, Field(gt=1, le=1e6)] | None = Field(
        None,
        description="True frame rate. Set it where the file states another (slow-motion exports) or none "
        "(image folders).",
    )
    missing_policy: Literal["refuse", "use_prefix"] = Field(
        "refuse",
        description="Refuse a video that was cut, or use the frames before the cut. Set use_prefix only "
        "if the throw is complete.",
    )

    @property
    def lens_kind(self) -> Literal["photos", "file", "video"]:
        """What `lens` names."""
        if "*" in self.lens or "?" in self.lens or "[" in self.lens:
            return "photos"
        return "file" if Path(self.lens).suffix.lower() in LENS_FILES else "video"

    @property
    def has_markers(self) -> bool:
        """Whether markers or a board in the plane show the metric scale."""
        return bool(self.plane.markers) or self.plane.board is not None

    @property
    def string_offset_and_sd_m(self) -> tuple[float, float]:
        """Distance of the string's plane from the markers' and its standard deviation [m]."""
        return value_and_sd(self.string_offset_m, OFFSET_SD_M)
