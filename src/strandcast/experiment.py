"""experiment.yaml as one typed object; every error names file:line, field and fix, all at once."""

from __future__ import annotations

import difflib
import json
import math
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
    model_validator,
)
from pydantic_core import ErrorDetails
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import AliasEvent

from strandcast.errors import StrandcastError, StrandcastErrors
from strandcast.records.motion import PARAMETERS

LARGEST_FILE_BYTES = 1 << 20
LENS_PHOTOS, PLANE_PHOTO = "calibration/lens-*.png", "calibration/plane.png"
SPACING_M = 0.03  # of the mass points, where `points` is not given
SCHEMA_FILE = "config/experiment.schema.json"
NAME = r"[a-z0-9][a-z0-9-]{0,63}"

Length = Annotated[float, Field(gt=0, le=5)]
Place = Annotated[float, Field(ge=0, le=5)]
Position = Annotated[float, Field(ge=-10, le=10)]
Pixel = Annotated[int, Field(ge=0, le=65535)]
Trial = Annotated[int, Field(ge=1, le=98)]
Dictionary = Annotated[
    str,
    Field(
        pattern=r"^DICT_([4567]X[4567]_(50|100|250|1000)|ARUCO_ORIGINAL|APRILTAG_(16h5|25h9|36h10|36h11))$"
    ),
]


def _below(value: str) -> str:
    if value.startswith("/") or ".." in Path(value).parts:
        raise ValueError("must be a path below the experiment's folder")
    return value


Below = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_below)]


class Section(BaseModel):
    """A group of settings; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Weight(Section):
    """A weight at a known place on the string."""

    place_m: Place = Field(description="Distance from the clamp along the string.")
    mass_kg: Annotated[float, Field(gt=0, le=1)] | None = Field(
        None, description="What the lab's weight weighs; the estimate finds the mass by itself."
    )


class StiffSection(Section):
    """A stretch of the string that does not bend, e.g. a pipe."""

    from_m: Place
    to_m: Place


class String(Section):
    """What is known of the string before it is thrown."""

    length_m: Length = Field(
        description="Its length, e.g. 0.3; what the clamp swallows (arm's file) is taken off."
    )
    points: Annotated[int, Field(ge=2, le=100)] | None = Field(
        None, description="Free mass points n; by default one every 30 mm."
    )
    weights: list[Weight] = []
    stiff_sections: list[StiffSection] = []
    thickness_m: Annotated[float, Field(gt=0, le=0.05)] | None = Field(
        None, description="As the camera sees it; found from the video if not given."
    )

    @property
    def n(self) -> int:
        """Return the number of free mass points."""
        return self.points if self.points is not None else max(2, round(self.length_m / SPACING_M))

    @model_validator(mode="after")
    def _places_lie_on_the_string(self) -> String:
        places = [w.place_m for w in self.weights] + [s.to_m for s in self.stiff_sections]
        if any(place > self.length_m + 1e-9 for place in places):
            raise ValueError(f"a weight or stiff section lies beyond the string's {self.length_m} m")
        if any(s.from_m >= s.to_m for s in self.stiff_sections):
            raise ValueError("a stiff section's from_m must be less than its to_m")
        return self


class Board(Section):
    """The ChArUco board of the lens photos."""

    squares_x: Annotated[int, Field(ge=3, le=50)] = 7
    squares_y: Annotated[int, Field(ge=3, le=50)] = 5
    square_m: Annotated[float, Field(gt=0.001, le=1)] = 0.035
    marker_m: Annotated[float, Field(gt=0.001, le=1)] = 0.026
    dictionary: Dictionary = "DICT_5X5_100"
    legacy: bool = Field(False, description="Boards printed by OpenCV before 4.6 with even rows.")

    @model_validator(mode="after")
    def _markers_fit_into_squares(self) -> Board:
        if self.marker_m >= self.square_m:
            raise ValueError(f"marker_m ({self.marker_m}) must be less than square_m ({self.square_m})")
        return self


class PlaneMarker(Section):
    """A marker lying in the plane of motion."""

    id: Annotated[int, Field(ge=0, le=1023)]
    x_m: Position = Field(description="Its centre in the world frame.")
    y_m: Position
    angle_rad: Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi)] = 0.0


class PlaneBoard(Board):
    """A ChArUco board that lies in the plane of motion."""

    x_m: Position = Field(description="Its lower left corner, as printed, in the world frame.")
    y_m: Position
    angle_rad: Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi)] = 0.0


class Plane(Section):
    """The markers, or the board, that carry the world frame into the picture."""

    dictionary: Dictionary = "DICT_4X4_50"
    size_m: Annotated[float, Field(gt=0.002, le=1)] = 0.08
    markers: list[PlaneMarker] = []
    board: PlaneBoard | None = Field(None, description="Instead of single markers.")
    place_sd_m: Annotated[float, Field(ge=0, le=0.1)] | None = Field(
        None,
        description="How well the markers' places were measured, one standard deviation; by default found "
        "from how well they fit each other.",
    )

    @field_validator("markers")
    @classmethod
    def _each_id_lies_there_once(cls, value: list[PlaneMarker]) -> list[PlaneMarker]:
        ids = [marker.id for marker in value]
        twice = sorted({number for number in ids if ids.count(number) > 1})
        if twice:
            raise ValueError(f"marker {twice[0]} is there twice")
        return value

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
    lens_photos: Below = LENS_PHOTOS
    lens_video: Below | None = Field(
        None, description="A video of the ChArUco board, moved slowly about, instead of photos."
    )
    distortion: Literal["auto", "none", "k1", "k1k2", "k1k2p1p2", "k1k2k3p1p2", "rational"] = Field(
        "auto", description="The lens' free coefficients; by default those that predict unseen photos best."
    )
    plane_photo: Below = PLANE_PHOTO
    board: Board = Board()
    plane: Plane = Plane()
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


class TrackSettings(Section):
    """The tracker's few settings; what is not given is found from the video and written down."""

    hand: Literal["marker", "pivot"] = "marker"
    background_frames: Annotated[int, Field(ge=5, le=500)] = 40
    background_picture: Below | None = Field(
        None,
        description="A picture of the empty scene from the same camera; by default a median over frames.",
    )
    polarity: Literal["auto", "bright", "dark"] = "auto"
    contrast_grey: Annotated[float, Field(gt=0, le=65535)] | None = Field(
        None,
        description="By how many grey levels a clear piece of the string differs from the background; "
        "found from the video if not given.",
    )


class SyncInVideo(Section):
    """An event in a trial's video that the joint log tells of too, such as an LED that the robot switches."""

    trial: Trial
    camera_time_s: Annotated[float, Field(ge=0, le=36000)] = Field(
        description="When it is in the video: frame over frame rate."
    )
    sigma_s: Annotated[float, Field(gt=0, le=1)] = Field(
        0.001, description="Standard deviation of that; a frame time over 3.5 where the frame is known."
    )
    kind: Annotated[str, Field(min_length=1, max_length=100)] = Field(
        "any", description="As run.json's sync_events has it; 'any': the nearest event of the log."
    )


class Led(Section):
    """Where an LED is seen that the robot switches: on before the swing, off after it."""

    x_m: Position | None = Field(None, description="Its place in the motion plane, in the world frame.")
    y_m: Position | None = None
    radius_m: Annotated[float, Field(gt=0, le=0.2)] = Field(
        0.01, description="Half the side of the window around it."
    )
    box_px: tuple[Pixel, Pixel, Pixel, Pixel] | None = Field(
        None, description="Instead of its place: left, top, right, bottom in the picture."
    )
    gamma: Annotated[float, Field(ge=0.3, le=4)] | None = Field(
        None,
        description="The camera's, grey = light^(1/gamma); 1 for most machine-vision cameras. By default it "
        "may be anything from 1 to 2.4, and the LED's times are so much less sure.",
    )
    latency_s: Annotated[float, Field(ge=-0.1, le=0.1)] = Field(
        0.0, description="From the time in the joint log to the light."
    )
    latency_sd_s: Annotated[float, Field(ge=0, le=0.1)] = Field(
        5e-4, description="How well that is known, one standard deviation; all events share it."
    )

    @model_validator(mode="after")
    def _a_place_or_a_box(self) -> Led:
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
        0.0, description="The drift that drift_prior is about, e.g. as shared by earlier trials."
    )
    largest_offset_s: Annotated[float, Field(gt=0, le=3600)] = 10.0
    sync_events: list[SyncInVideo] = Field(
        [], description="Events found by hand; a trial that has one does without the LED."
    )
    led: Led | None = Field(None, description="An LED that the robot switches, found in the video by itself.")


Ranges = Literal["wide", "paper"] | dict[str, tuple[float, float]]


def _known_parameters(names: Iterable[str]) -> None:
    unknown = [name for name in names if name not in PARAMETERS]
    if unknown:
        raise ValueError(f"{unknown[0]!r} is no string parameter; these are: {', '.join(PARAMETERS)}")


class PaperSearch(Section):
    """Numbers of eq. 3 that the paper does not print."""

    centre: Literal["fixed", "running"] = "running"
    chi_0: Annotated[float, Field(gt=0, le=1)] = 1.0
    beta: Annotated[float, Field(gt=0, lt=1)] = 0.999


class EstimateSettings(Section):
    """The fit of the string."""

    search: Literal["descent", "cma", "evolution", "paper"] = Field(
        "descent",
        description="Descents from several draws, CMA-ES, differential evolution, or the paper's eq. 3.",
    )
    evaluations: Annotated[int, Field(ge=100, le=1_000_000)] = Field(
        4000,
        description="Strings to simulate for the search, which ends earlier where nothing gains any more; "
        "forecast and profiles may add to them.",
    )
    trials: Literal["all", "latest"] = "all"
    older_trials_weight: Annotated[float, Field(ge=0, le=1)] = 0.6
    evaluation: Literal["world", "hand"] = "world"
    w: Annotated[float, Field(ge=0, le=10)] = Field(0.1, description="Weight of eq. 6 towards the tip.")
    ranges: Ranges = "wide"
    reading: Literal["rate", "sign", "strain"] = "rate"
    integrator: Literal["lfcn", "semi_implicit", "euler"] = "lfcn"
    dt_s: Annotated[float, Field(gt=0, le=0.005)] = 1e-3
    start_shape: Literal["observed", "hanging"] = "observed"
    rest_curl: bool = Field(True, description="Fit a constant rest curvature (real cables keep one).")
    clamp_offset: bool = Field(False, description="Fit a turn of the clamp against the arm's file.")
    clamp_offset_sd_rad: Annotated[float, Field(gt=0, le=0.5)] = Field(
        0.05, description="How far the clamp's turn may well lie from the arm's file (prior, one sigma)."
    )
    camera_offset_sd_m: Annotated[float, Field(gt=0, le=0.05)] | None = Field(
        None,
        description="Fit an offset of the camera against the robot with this prior; null: none.",
    )
    stiff_bend: bool = Field(
        False, description="Fit how much stiffer the stiff sections bend than the string."
    )
    bend_friction: bool = Field(
        False, description="Fit one dry friction of all joints: for thick cables, whose swings stop dead."
    )
    find_weights: Annotated[int, Field(ge=0, le=3)] = Field(
        0, description="Number of weights of which not even the place is known: both are found."
    )
    horizon_s: Annotated[float, Field(ge=0, le=60)] | None = Field(
        0.03, description="Frames up to this long after the closest approach enter E; null: the whole motion."
    )
    joints: Literal["measured", "commanded"] = "measured"
    ensemble: Annotated[int, Field(ge=1, le=64)] = 6
    profiles: bool = Field(
        True, description="Find how far each number may move while E rises by 2 %, all others fitted again."
    )
    paper: PaperSearch = PaperSearch()

    @field_validator("ranges")
    @classmethod
    def _ranges_have_names_and_order(cls, value: Ranges) -> Ranges:
        if isinstance(value, dict):
            _known_parameters(value)
            bad = [name for name, (low, high) in value.items() if not 0 < low < high]
            if bad:
                raise ValueError(f"the range of {bad[0]} must be [least, greatest], both above 0")
        return value


class PaperReading(Section):
    """How section V is read where its text allows more than one way, for `planner: paper`."""

    altered_from: Literal["executed", "walking"] = Field(
        "executed",
        description="Later tries alter the motion thrown last, or walk from the nearest try so far.",
    )
    accept: Literal["first_hit", "best"] = Field(
        "first_hit",
        description="Throw the first motion that hits in the simulation, or the nearest of all tries.",
    )
    ends: Literal["ramp", "rest"] = Field(
        "ramp",
        description="A ramp stops the arm after eq. 1's curve, or the curve itself begins and ends at rest.",
    )
    altered_rad_s: Annotated[float, Field(gt=0, le=10)] = 0.5
    largest_slope_rad_s2: Annotated[float, Field(gt=0, le=10_000)] = Field(
        60.0, description="Of alpha_k in eq. 1; not given in the paper."
    )


class PlanSettings(Section):
    """The planner."""

    planner: Literal["ensemble", "paper"] = "ensemble"
    duration_s: tuple[float, float] | None = Field(
        None, description="Shortest and longest first motion: [0.35, 0.9], or the paper's [0.2, 1.2]."
    )
    control_points: Annotated[int, Field(ge=3, le=20)] = Field(6, description="Free heights per joint.")
    screening: Annotated[int, Field(ge=8, le=100_000)] = 1500
    evaluations: Annotated[int, Field(ge=8, le=1_000_000)] = 3000
    ensemble: Annotated[int, Field(ge=1, le=64)] = 16
    use_servo: bool | None = Field(
        None,
        description="Plan with the servo's response: true, but for the paper, which plans commanded angles.",
    )
    paper: PaperReading = PaperReading()
    disturbances: Annotated[float, Field(ge=0, le=10)] = Field(
        1.0,
        description="How much throws of one motion differ on the rig, 1 as usual: new motions resist it, "
        "predictions reckon with it.",
    )
    finer: bool = Field(
        True, description="Search new motions with every other string as a chain of twice as many points."
    )
    carry_residual: bool = Field(
        True, description="Add what the simulation missed by in earlier throws to its next prediction."
    )

    @field_validator("duration_s")
    @classmethod
    def _shortest_first(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and not 0.05 <= value[0] <= value[1] <= 5.0:
            raise ValueError("must be [shortest, longest] within 0.05 and 5 s")
        return value


class PointObjective(Section):
    """The tip hits the target; on request moving in a direction, and not too slowly."""

    kind: Literal["point"] = "point"
    direction_rad: Annotated[float, Field(ge=-7, le=7)] | None = Field(
        None, description="Of the tip's motion at the hit, counter-clockwise from x."
    )
    tolerance_rad: Annotated[float, Field(gt=0, le=math.pi)] = Field(
        0.35, description="How far the direction may be off."
    )
    least_speed_m_s: Annotated[float, Field(ge=0, le=100)] = 0.0


class SegmentObjective(Section):
    """The tip hits a bar anywhere between two ends; target_m is its middle if not given."""

    kind: Literal["segment"]
    ends_m: tuple[tuple[Position, Position], tuple[Position, Position]]


class ShapePlace(Section):
    """A place on the string, from the hand, and where it is to be."""

    along_m: Place
    at_m: tuple[Position, Position]


class ShapeObjective(Section):
    """The string takes a shape for a moment; target_m is where its last place is to be if not given."""

    kind: Literal["shape"]
    places: Annotated[list[ShapePlace], Field(min_length=1, max_length=50)]


class SwingObjective(Section):
    """The tip gets as high or as fast as told, or as it can."""

    kind: Literal["swing"]
    height_m: Position | None = None
    speed_m_s: Annotated[float, Field(gt=0, le=1000)] | None = None

    @model_validator(mode="after")
    def _one_of_both(self) -> SwingObjective:
        if (self.height_m is None) == (self.speed_m_s is None):
            raise ValueError("give height_m or speed_m_s")
        return self


ObjectiveSettings = Annotated[
    PointObjective | SegmentObjective | ShapeObjective | SwingObjective, Field(discriminator="kind")
]


class LabString(Section):
    """A string of the lab's own making."""

    linear_density_kg_m: Annotated[float, Field(gt=0, le=1)]
    bending_stiffness_n_m2: Annotated[float, Field(ge=0, le=1)] = 2e-6
    curl_rad_m: Annotated[float, Field(ge=-50, le=50)] = 2.5
    diameter_m: Annotated[float, Field(gt=0, le=0.05)] = 0.003


PaperString = Literal["paper-1", "paper-2", "paper-3", "paper-4", "paper-5", "paper-6", "paper-7"]


class LabCamera(Section):
    """The lab's camera."""

    width_px: Annotated[int, Field(ge=320, le=4096)] = 1280
    height_px: Annotated[int, Field(ge=240, le=4096)] = 720
    frame_rate_hz: Annotated[float, Field(ge=60, le=5000)] = 500.0
    exposure_s: Annotated[float, Field(gt=0, le=0.02)] = 4e-4
    noise_grey: Annotated[float, Field(ge=0, le=50)] = 2.5
    background: Literal["plain", "textured", "cluttered"] = "textured"


class LabSettings(Section):
    """The virtual rig, for experiments without a robot."""

    string: PaperString | LabString = Field("paper-1", description="paper-1 … paper-7, or values.")
    noise: Annotated[float, Field(ge=0, le=10)] = Field(
        1.0, description="Scale of the trial-to-trial variation; 1 is a usual rig."
    )
    servo: Literal["servoj", "stiff", "pd", "soft", "weak"] = "servoj"
    camera: LabCamera = LabCamera()
    led: bool = Field(
        False, description="An LED at the place of align.led, which the controller switches around the swing."
    )


class Exclusion(Section):
    """A trial that does not count, with the reason that the report shows."""

    trial: Trial
    reason: Annotated[str, Field(min_length=1, max_length=500)]


class Box(Section):
    """Where the hand and the string may go, and what the camera sees."""

    x_m: tuple[Position, Position]
    y_m: tuple[Position, Position]

    @model_validator(mode="after")
    def _lower_bound_first(self) -> Box:
        if self.x_m[0] >= self.x_m[1] or self.y_m[0] >= self.y_m[1]:
            raise ValueError("x_m and y_m must be [least, greatest]")
        return self


StartString = Literal["ensemble", "minima", "random"]


class Conflict(ValueError):
    """Settings that do not fit each other: the one to look at, and what to do."""

    def __init__(self, what: str, field: str, fix: str) -> None:
        super().__init__(what)
        self.field = field
        self.fix = fix


class Experiment(Section):
    """One string, arm, camera set-up and target, and the settings of every stage."""

    schema_version: Literal[1] = 1
    title: Annotated[str, Field(max_length=200)] = ""
    string: String
    arm: str = Field("planar3", description="A name in config/arms, or the path of an arm's file.")
    target_m: tuple[Position, Position] = Field(description="The target in the world frame.")
    objective: ObjectiveSettings = Field(
        PointObjective(), description="What a throw is for; if not told, the tip hits target_m."
    )
    hit_radius_m: Annotated[float, Field(gt=0, le=0.5)] = 0.02
    max_trials: Trial = 5
    min_trials: Trial = Field(
        1, description="The lab throws at least so often, also after a hit: how near do later throws come?"
    )
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 1
    start_string: StartString | dict[str, float] = Field(
        "ensemble", description="What the first motion is planned with; or values by parameter."
    )
    workspace_m: Box | None = Field(None, description="Where the hand and the string may go.")
    excluded: list[Exclusion] = []
    camera: CameraSettings = CameraSettings()
    track: TrackSettings = TrackSettings()
    align: AlignSettings = AlignSettings()
    estimate: EstimateSettings = EstimateSettings()
    plan: PlanSettings = PlanSettings()
    lab: LabSettings | None = None

    @field_validator("start_string")
    @classmethod
    def _start_values_have_names(
        cls, value: StartString | dict[str, float]
    ) -> StartString | dict[str, float]:
        if isinstance(value, dict):
            _known_parameters(value)
            bad = [name for name, number in value.items() if number <= 0]
            if bad:
                raise ValueError(f"{bad[0]} must be above 0")
        return value

    @field_validator("excluded")
    @classmethod
    def _a_trial_is_excluded_once(cls, value: list[Exclusion]) -> list[Exclusion]:
        numbers = [exclusion.trial for exclusion in value]
        twice = sorted({number for number in numbers if numbers.count(number) > 1})
        if twice:
            raise ValueError(f"trial {twice[0]} is excluded twice")
        return value

    @model_validator(mode="after")
    def _least_is_not_above_most(self) -> Experiment:
        if self.min_trials > self.max_trials:
            raise Conflict(
                f"min_trials ({self.min_trials}) is above max_trials ({self.max_trials})",
                "min_trials",
                "raise max_trials, or lower it",
            )
        return self

    @model_validator(mode="after")
    def _the_target_lies_in_the_workspace(self) -> Experiment:
        box = self.workspace_m
        if box is not None:
            for value, (low, high), axis in zip(self.target_m, (box.x_m, box.y_m), "xy", strict=True):
                if not low <= value <= high:
                    raise Conflict(
                        f"the target's {axis}, {value} m, lies outside workspace_m, {low} to {high} m",
                        "target_m",
                        "move the target, or widen workspace_m where the room is free",
                    )
        return self

    @model_validator(mode="after")
    def _a_shapes_places_lie_on_the_string(self) -> Experiment:
        told, length_m = self.objective, self.string.length_m
        if isinstance(told, ShapeObjective):
            beyond = [place.along_m for place in told.places if place.along_m > length_m + 1e-9]
            if beyond:
                raise Conflict(
                    f"the shape's place at {beyond[0]} m lies beyond the string's {length_m} m",
                    "objective",
                    "give along_m from the hand, up to string.length_m",
                )
        return self

    @model_validator(mode="after")
    def _the_lab_names_its_own_photos(self) -> Experiment:
        named = (self.camera.lens_photos, self.camera.plane_photo, self.camera.lens_video)
        if self.lab is not None and named != (LENS_PHOTOS, PLANE_PHOTO, None):
            raise Conflict(
                f"the lab writes {LENS_PHOTOS} and {PLANE_PHOTO}",
                "camera",
                "leave lens_photos, plane_photo and lens_video out",
            )
        return self

    @model_validator(mode="after")
    def _the_labs_led_has_a_place(self) -> Experiment:
        if self.lab is not None and self.lab.led and (self.align.led is None or self.align.led.x_m is None):
            raise Conflict("lab.led needs the LED's place", "lab", "add align.led: {x_m: …, y_m: …}")
        return self

    def excluded_reason(self, trial: int) -> str | None:
        """Return why a trial does not count, or None if it does."""
        return next((e.reason for e in self.excluded if e.trial == trial), None)


def load_experiment(path: str | Path) -> Experiment:
    """Read experiment.yaml.

    Raises
    ------
    StrandcastErrors
        Everything that is wrong with the file: line, field, value, suggestion.
    """
    path = Path(path)
    data = _parse(path)
    try:
        # JSON in strict mode: no "0.3" for 0.3, no true for 1, but a list may stand for a pair.
        return Experiment.model_validate_json(
            json.dumps(_with_target(_plain(data)), default=str), strict=True
        )
    except ValidationError as error:
        found = _one_per_place(data, error.errors())
        raise StrandcastErrors([_problem(path, data, place, detail) for place, detail in found]) from None


def _parse(path: Path) -> CommentedMap:
    if not path.is_file():
        raise StrandcastError(
            "SC-F001",
            "the experiment's file is not there",
            file=path,
            fix="write it; config/experiments/demo.yaml is a commented example",
        )
    if path.stat().st_size > LARGEST_FILE_BYTES:
        raise StrandcastError("SC-F002", "the file is too large for settings", file=path, fix="look inside")
    try:
        text = path.read_text(encoding="utf-8")
        if any(isinstance(event, AliasEvent) for event in YAML(typ="rt").parse(text)):
            raise StrandcastError(
                "SC-F002", "uses a YAML alias (*name)", file=path, fix="write the value out"
            )
        data = YAML(typ="rt").load(text)
    except UnicodeDecodeError as error:
        raise StrandcastError(
            "SC-F002", f"is not UTF-8 text (byte {error.start})", file=path, fix="save it as UTF-8"
        ) from None
    except MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else None
        what = str(error.problem).splitlines()[0] if error.problem else "is not YAML"
        raise StrandcastError("SC-F002", what, file=path, line=line, fix="mend the YAML") from None
    except YAMLError as error:
        raise StrandcastError("SC-F002", str(error).splitlines()[0], file=path, fix="mend the YAML") from None
    if not isinstance(data, CommentedMap):
        raise StrandcastError(
            "SC-F002",
            "holds no settings",
            file=path,
            fix="config/experiments/demo.yaml is a commented example",
        )
    return data


def _with_target(data: dict[str, Any]) -> dict[str, Any]:
    """Return settings as written with the target where the objective has it, if they tell none."""
    try:
        objective = data["objective"]
        if objective["kind"] == "segment":
            (ax, ay), (bx, by) = objective["ends_m"]
            return {"target_m": [0.5 * (ax + bx), 0.5 * (ay + by)]} | data
        return {"target_m": objective["places"][-1]["at_m"]} | data
    except (TypeError, KeyError, IndexError, ValueError):
        return data  # what is wrong, or not told, the fields say themselves


def _plain(node: Any, depth: int = 0) -> Any:
    """Return YAML nodes as plain data."""
    if depth > 12:
        return None
    if isinstance(node, CommentedMap):
        return {str(key): _plain(value, depth + 1) for key, value in node.items()}
    if isinstance(node, CommentedSeq):
        return [_plain(value, depth + 1) for value in node]
    if isinstance(node, bool):
        return bool(node)
    for kind in (int, float, str):
        if isinstance(node, kind):
            return kind(node)
    return node


def _one_per_place(data: Any, details: list[ErrorDetails]) -> list[tuple[tuple[str, ...], ErrorDetails]]:
    """Return place and problem; of the branches of a union, the one that says most of what is allowed."""
    kept: dict[tuple[str, ...], ErrorDetails] = {}
    for detail in details:
        place = _place(data, detail)
        if place not in kept or detail["type"] == "literal_error":
            kept[place] = detail
    # A union tells of the whole value and of its parts; the parts say where.
    wholes = {place[:k] for place in kept for k in range(len(place))}
    return [(place, detail) for place, detail in kept.items() if place not in wholes]


def _conflict(detail: ErrorDetails) -> Conflict | None:
    told = detail.get("ctx", {}).get("error")
    return told if isinstance(told, Conflict) else None


def _place(node: Any, detail: ErrorDetails) -> tuple[str, ...]:
    """Return where an error lies in the file: pydantic's location without its names of union branches."""
    place = []
    conflict = _conflict(detail)
    for part in detail["loc"] if conflict is None else (*detail["loc"], conflict.field):
        child = _child(node, part)
        if child is not None:
            node = child
        elif not (detail["type"] == "missing" and part == detail["loc"][-1]):
            continue
        place.append(str(part))
    return tuple(place)


def _child(node: Any, part: int | str) -> Any:
    """Return what lies under a key or index of a YAML node, or None."""
    if isinstance(node, CommentedMap):
        return node.get(part)
    if isinstance(node, CommentedSeq) and str(part).isdigit() and int(part) < len(node):
        return node[int(part)]
    return None


def _problem(path: Path, data: CommentedMap, place: tuple[str, ...], detail: ErrorDetails) -> StrandcastError:
    value = detail["input"]
    what = detail["msg"].removeprefix("Value error, ")
    what = what[0].lower() + what[1:]
    if detail["type"] == "extra_forbidden":
        what = "there is no such setting"
    elif detail["type"] == "union_tag_not_found":
        what = "does not say its kind"
    elif detail["type"] != "missing" and not isinstance(value, dict | list):
        what += f" (got {value!r})"
    return StrandcastError(
        "SC-F003",
        what,
        file=path,
        line=_line(data, place),
        field=".".join(place) or None,
        fix=_suggestion(detail, place),
    )


def _line(node: Any, place: tuple[str, ...]) -> int:
    """Return the line of the deepest part of `place` that the file has."""
    line = 1
    for part in place:
        child = _child(node, part)
        if child is None:
            break
        where = node.lc.key(part) if isinstance(node, CommentedMap) else node.lc.item(int(part))
        line, node = where[0] + 1, child
    return line


def _suggestion(detail: ErrorDetails, place: tuple[str, ...]) -> str:
    kind, value, name = detail["type"], detail["input"], place[-1] if place else ""
    conflict = _conflict(detail)
    if conflict is not None:
        return conflict.fix
    if kind == "extra_forbidden":
        allowed = _fields_beside(detail["loc"])
        near = difflib.get_close_matches(name, allowed, n=1, cutoff=0.5)
        return f"did you mean {near[0]!r}?" if near else f"one of: {', '.join(allowed)}"
    if kind == "missing":
        return "add it"
    if kind.startswith("less_than"):
        return _unit_hint(place, value)
    if kind.startswith("union_tag"):
        return f"kind is one of {detail.get('ctx', {}).get('expected_tags', 'point, segment, shape, swing')}"
    if kind == "literal_error":
        choices = str(detail.get("ctx", {}).get("expected", ""))
        names = [choice.strip("' ") for choice in choices.replace(" or ", ",").split(",")]
        near = difflib.get_close_matches(str(value), names, n=1)
        return f"did you mean {near[0]!r}?" if near else f"one of {choices}"
    if isinstance(value, str) and kind in {"float_type", "int_type"}:
        return "write a number, without quotes"
    return f"see {SCHEMA_FILE} for what is allowed"


def _unit_hint(place: tuple[str, ...], value: Any) -> str:
    named = [part for part in place if not part.isdigit()]
    if named and named[-1].endswith("_m"):
        return f"lengths are in metres: {value:g} mm would be {value / 1000:g}"
    if named and named[-1].endswith("_s"):
        return f"times are in seconds: {value:g} ms would be {value / 1000:g}"
    return f"see {SCHEMA_FILE} for what is allowed"


def _fields_beside(loc: tuple[int | str, ...]) -> list[str]:
    """Return the names that are allowed where an unknown one was found, of the kind that is there."""
    annotation: Any = Experiment
    for part in loc[:-1]:
        models = _models_in(annotation)
        of_kind = [model for model in models if part in _kinds(model)]
        if of_kind:
            annotation = of_kind[0]
        elif models and part in models[0].model_fields:
            annotation = models[0].model_fields[str(part)].annotation
    return [name for model in _models_in(annotation)[:1] for name in model.model_fields]


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models_in(part)]


def _kinds(model: type[BaseModel]) -> tuple[Any, ...]:
    field = model.model_fields.get("kind")
    return () if field is None else get_args(field.annotation)


def find_experiment(name: str, root: Path) -> Path:
    """Return the file of an experiment: data/<name>/experiment.yaml, or config/experiments/<name>.yaml."""
    if not re.fullmatch(NAME, name):
        raise StrandcastError(
            "SC-F005",
            f"{name!r} is no name of an experiment",
            fix="use small letters, digits and hyphens, up to 64, as in `string-1`",
        )
    own, shipped = root / "data" / name / "experiment.yaml", root / "config" / "experiments" / f"{name}.yaml"
    for path in (own, shipped):
        if path.is_file():
            return path
    known = sorted(
        {p.parent.name for p in root.glob("data/*/experiment.yaml")}
        | {p.stem for p in root.glob("config/experiments/*.yaml")}
    )
    near = difflib.get_close_matches(name, known, n=1)
    raise StrandcastError(
        "SC-F001",
        f"there is no experiment {name!r}",
        file=own,
        fix=f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known) or 'none'}",
    )


def find_arm(experiment: Experiment, experiment_file: Path, root: Path) -> Path:
    """Return the arm's file: a name in config/arms, or a path relative to the experiment's file."""
    named = root / "config" / "arms" / f"{experiment.arm}.toml"
    beside = experiment_file.parent / experiment.arm
    for path in (named, beside):
        if path.is_file():
            return path
    known = sorted(p.stem for p in root.glob("config/arms/*.toml"))
    raise StrandcastError(
        "SC-F004",
        f"there is no arm {experiment.arm!r}",
        file=experiment_file,
        field="arm",
        fix=f"one of {', '.join(known)}, or the path of an arm's file",
    )


def json_schema() -> str:
    """Return the JSON schema of experiment.yaml; config/experiment.schema.json holds it."""
    return json.dumps(Experiment.model_json_schema(), indent=1) + "\n"
