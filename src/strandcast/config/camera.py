"""`cameras:` each camera's set-up and calibration files, by name."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from strandcast.core.quantities import Position
from strandcast.core.section import Section
from strandcast.errors import StrandcastError

MAIN = "main"  # the camera of an experiment that gives `camera:` and no names
CameraName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,31}$")]
LENS_PHOTOS, PLANE_PHOTO = "calibration/lens-*.png", "calibration/plane.png"
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

    squares_x: Annotated[int, Field(ge=3, le=50)] = Field(7, description="Number of squares per row.")
    squares_y: Annotated[int, Field(ge=3, le=50)] = Field(5, description="Number of squares per column.")
    square_m: Annotated[float, Field(gt=0.001, le=1)] = Field(0.035, description="Side of a square [m].")
    marker_m: Annotated[float, Field(gt=0.001, le=1)] = Field(
        0.026, description="Side of a marker [m]; less than square_m."
    )
    dictionary: Dictionary = Field("DICT_5X5_100", description="OpenCV's name of the markers' dictionary.")
    legacy: bool = Field(False, description="Boards printed by OpenCV before 4.6 with even rows.")

    @model_validator(mode="after")
    def _markers_fit_into_squares(self) -> Board:
        if self.marker_m >= self.square_m:
            raise ValueError(f"marker_m ({self.marker_m}) must be less than square_m ({self.square_m})")
        return self


class PlaneMarker(Section):
    """A marker lying in the plane of motion."""

    id: Annotated[int, Field(ge=0, le=1023)] = Field(description="Id of the marker in its dictionary.")
    x_m: Position = Field(description="Its centre in the world frame.")
    y_m: Position = Field(description="Its centre in the world frame.")
    angle_rad: Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi)] = Field(
        0.0, description="Its rotation, counter-clockwise [rad]."
    )


class PlaneBoard(Board):
    """A ChArUco board that lies in the plane of motion."""

    x_m: Position = Field(description="Its lower left corner, as printed, in the world frame.")
    y_m: Position = Field(description="Its lower left corner, as printed, in the world frame.")
    angle_rad: Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi)] = Field(
        0.0, description="Its rotation, counter-clockwise [rad]."
    )


class Plane(Section):
    """The markers, or the board, that carry the world frame into the picture."""

    dictionary: Dictionary = Field(
        "DICT_4X4_50", description="OpenCV's name of the dictionary of the single markers."
    )
    size_m: Annotated[float, Field(gt=0.002, le=1)] = Field(
        0.08, description="Side of the single markers [m]."
    )
    markers: Annotated[list[PlaneMarker], each_once("id", "marker {} is there twice")] = Field(
        [], description="Single markers in the plane of motion, with their measured positions."
    )
    board: PlaneBoard | None = Field(None, description="Instead of single markers.")
    place_sd_m: Annotated[float, Field(ge=0, le=0.1)] | None = Field(
        None,
        description="How well the markers' places were measured, one standard deviation; by default found "
        "from how well they fit each other.",
    )

    @model_validator(mode="after")
    def _markers_or_a_board(self) -> Plane:
        if self.markers and self.board is not None:
            raise ValueError("give the plane's markers or a board, not both")
        return self


class CameraSettings(Section):
    """The camera set-up and its calibration files, relative to the experiment's folder."""

    scale: Literal["markers", "arc"] = Field(
        "markers", description="Metric scale from markers, or from a pendulum's arc and known length."
    )
    lens_photos: Annotated[Below, AfterValidator(_pattern)] = Field(
        LENS_PHOTOS,
        description="Pattern of the lens photos of the board, relative to the experiment's folder.",
    )
    lens_video: Below | None = Field(
        None, description="A video of the ChArUco board, moved slowly about, instead of photos."
    )
    distortion: Literal["auto", "none", "k1", "k1k2", "k1k2p1p2", "k1k2k3p1p2", "rational"] = Field(
        "auto", description="The lens' free coefficients; by default those that predict unseen photos best."
    )
    plane_photo: Below = Field(
        PLANE_PHOTO, description="Photo of the plane's markers or board, relative to the experiment's folder."
    )
    board: Board = Field(Board(), description="The ChArUco board of the lens photos or video.")
    plane: Plane = Field(
        Plane(), description="The markers, or the board, in the plane of motion; they define the world frame."
    )
    string_offset_m: Annotated[float, Field(ge=-1, le=1)] = Field(
        0.0, description="How far the string's plane lies before the markers' plane, towards the camera."
    )
    string_offset_sd_m: Annotated[float, Field(ge=0, le=0.1)] = Field(
        1e-3, description="How well that distance was measured, one standard deviation."
    )
    exposure_s: Annotated[float, Field(gt=0, le=0.1)] | None = Field(
        None, description="By default a fifth of the time between frames."
    )
    frame_rate_hz: Annotated[float, Field(gt=1, le=1e6)] | None = Field(
        None, description="True rate, where the file's header lies (slow-motion exports)."
    )
    missing_policy: Literal["refuse", "use_prefix"] = Field(
        "refuse", description="Refuse a video that was cut, or take the frames before the cut."
    )


def only_camera(names: Iterable[str]) -> str:
    """Return the name of the one camera.

    Raises
    ------
    StrandcastError
        SC-F008 there are several: reconstruction from more than one camera is not implemented.
    """
    given = list(names)
    if len(given) != 1:
        raise StrandcastError(
            "SC-F008",
            f"names {len(given)} cameras ({', '.join(given)}); strandcast uses one camera for now",
            field="cameras",
            fix="keep one of them",
        )
    return given[0]
