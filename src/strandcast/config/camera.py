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

    squares_x: Annotated[int, Field(ge=3, le=50)] = Field(
        7, description="Number of squares per row. Set it to the board that you printed."
    )
    squares_y: Annotated[int, Field(ge=3, le=50)] = Field(
        5, description="Number of squares per column. Set it to the board that you printed."
    )
    square_m: Annotated[float, Field(gt=0.001, le=1)] = Field(
        0.035, description="Side of a square. Measure the print and set it."
    )
    marker_m: Annotated[float, Field(gt=0.001, le=1)] = Field(
        0.026, description="Side of a marker; less than square_m. Measure the print and set it."
    )
    dictionary: Dictionary = Field(
        "DICT_5X5_100",
        description="OpenCV's name of the board's markers. Set it for a board from another generator.",
    )
    legacy: bool = Field(
        False,
        description="The layout that OpenCV before 4.6 printed for even numbers of rows. Set it for such "
        "a board; calibrate recognises one, too.",
    )
    first_id: Annotated[int, Field(ge=0, le=1023)] = Field(
        0,
        description="Id of the board's first marker. Set it for one of several boards of one dictionary; "
        "calibrate recognises it, too.",
    )

    @model_validator(mode="after")
    def _markers_fit_into_squares(self) -> Board:
        if self.marker_m >= self.square_m:
            raise ValueError(f"marker_m ({self.marker_m}) must be less than square_m ({self.square_m})")
        return self


class PlaneMarker(Section):
    """A marker lying in the plane of motion."""

    id: Annotated[int, Field(ge=0, le=1023)] = Field(description="Id of the marker in its dictionary.")
    x_m: Position = Field(description="x of its centre in the world frame.")
    y_m: Position = Field(description="y of its centre in the world frame.")
    angle_rad: Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi)] = Field(
        0.0, description="Its rotation, counter-clockwise. Set it for a marker that is not upright."
    )


class PlaneBoard(Board):
    """A ChArUco board that lies in the plane of motion; what it does not give is as in `camera.board`."""

    x_m: Position = Field(description="x of its lower left corner, as printed, in the world frame.")
    y_m: Position = Field(description="y of its lower left corner, as printed, in the world frame.")
    angle_rad: Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi)] = Field(
        0.0, description="Its rotation, counter-clockwise. Set it for a board that is not upright."
    )


class Plane(Section):
    """The markers, or the board, that carry the world frame into the picture."""

    dictionary: Dictionary = Field(
        "DICT_4X4_50",
        description="OpenCV's name of the dictionary of the single markers. Set it to what you printed.",
    )
    size_m: Annotated[float, Field(gt=0.002, le=1)] = Field(
        0.08, description="Side of the single markers' black squares. Measure the print and set it."
    )
    markers: Annotated[list[PlaneMarker], each_once("id", "marker {} is there twice")] = Field(
        [],
        description="Single markers in the plane of motion, with their measured positions. Give four or "
        "more at the edges of the workspace, or a board.",
    )
    board: PlaneBoard | None = Field(
        None,
        description="A ChArUco board in the plane of motion. Give it instead of single markers. What you do "
        "not set of it is as in camera.board.",
    )
    place_sd_m: Annotated[float, Field(ge=0, le=0.1)] | None = Field(
        None,
        description="How well the markers' places were measured, one standard deviation; by default found "
        "from how well they fit each other. Set it with fewer than four markers, which cannot "
        "show it.",
    )

    @model_validator(mode="after")
    def _markers_or_a_board(self) -> Plane:
        if self.markers and self.board is not None:
            raise ValueError("give the plane's markers or a board, not both")
        return self


class CameraSettings(Section):
    """The camera set-up and its calibration files, relative to the experiment's folder."""

    scale: Literal["markers", "arc"] = Field(
        "markers",
        description="Metric scale from markers, or from a pendulum's arc and known length. Use arc only "
        "with `tracker: pendulum`, for videos without markers.",
    )
    lens_photos: Annotated[Below, AfterValidator(_pattern)] = Field(
        LENS_PHOTOS,
        description="Pattern of the lens photos of the board, relative to the experiment's folder. Set it "
        "if your photos have other names.",
    )
    lens_video: Below | None = Field(
        None, description="A video of the ChArUco board, moved slowly about. Give it instead of photos."
    )
    lens_file: Below | None = Field(
        None,
        description="A lens that another program calibrated: OpenCV's YAML, ROS camera_info, Kalibr's "
        "camchain, or the TOML of caliscope or anipose. Give it instead of photos of the "
        "board; the resolution must be that of the plane's photo.",
    )
    lens_name: Annotated[str, Field(min_length=1, max_length=100)] | None = Field(
        None, description="Which camera of lens_file, e.g. cam0. Set it where the file has several."
    )
    distortion: Literal["auto", "none", "k1", "k1k2", "k1k2p1p2", "k1k2k3p1p2", "rational"] = Field(
        "auto",
        description="The lens' free coefficients; auto takes the smallest model that predicts unseen "
        "photos well. Set it to compare with another program, or where you know the lens.",
    )
    plane_photo: Below = Field(
        PLANE_PHOTO,
        description="Photo of the plane's markers or board, relative to the experiment's folder. Set it "
        "if your photo has another name.",
    )
    board: Board = Field(
        Board(),
        description="The ChArUco board of the lens photos or video. Set it to the board that you printed.",
    )
    plane: Plane = Field(
        Plane(),
        description="The markers, or the board, in the plane of motion; they define the world frame. Give "
        "one or the other, unless scale is arc.",
    )
    string_offset_m: Annotated[float, Field(ge=-1, le=1)] = Field(
        0.0,
        description="How far the string's plane lies before the markers' plane, towards the camera. "
        "Measure and set it: forgetting 10 mm at 2.3 m costs 0.44 % of every length.",
    )
    string_offset_sd_m: Annotated[float, Field(ge=0, le=0.1)] = Field(
        1e-3,
        description="How well that distance was measured, one standard deviation; it enters the standard "
        "error of every point. Raise it if you estimated the distance by eye.",
    )
    exposure_s: Annotated[float, Field(gt=0, le=0.1)] | None = Field(
        None,
        description="Exposure time per frame; by default a fifth of the time between frames. Set it to "
        "the camera's value: a moving marker's blur depends on it.",
    )
    frame_rate_hz: Annotated[float, Field(gt=1, le=1e6)] | None = Field(
        None,
        description="True frame rate of the video. Set it where the file's header gives another one, as "
        "slow-motion exports do.",
    )
    missing_policy: Literal["refuse", "use_prefix"] = Field(
        "refuse",
        description="Refuse a video that was cut, or use the frames before the cut. Set use_prefix only "
        "if the throw itself is complete.",
    )

    @model_validator(mode="before")
    @classmethod
    def _plane_has_the_lens_board(cls, given: Any) -> Any:
        board, plane = (given.get(name) if isinstance(given, dict) else None for name in ("board", "plane"))
        if isinstance(board, dict) and isinstance(plane, dict) and isinstance(plane.get("board"), dict):
            return given | {"plane": plane | {"board": board | plane["board"]}}
        return given

    @model_validator(mode="after")
    def _one_source_of_the_lens(self) -> CameraSettings:
        if self.lens_file is not None and self.lens_video is not None:
            raise ValueError("give lens_file or lens_video, not both")
        return self


def only_camera(names: Iterable[str]) -> str:
    """Return the name of the one camera.

    Raises
    ------
    StrandcastError
        SC-F003 there are several: each has an experiment of its own.
    """
    given = list(names)
    if len(given) != 1:
        raise StrandcastError(
            "SC-F003",
            f"names {len(given)} cameras ({', '.join(given)}); an experiment has one",
            field="cameras",
            fix="keep one; give the other an experiment of its own, and see `strandcast import views`",
        )
    return given[0]
