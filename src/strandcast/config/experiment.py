"""One experiment: string, arm, camera set-up, target, and the settings of every stage."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from strandcast.config.align import AlignSettings
from strandcast.config.camera import (
    LENS,
    MAIN,
    PLANE_PHOTO,
    CameraName,
    CameraSettings,
    each_once,
)
from strandcast.config.estimate import EstimateSettings, known_names
from strandcast.config.lab import LabSettings
from strandcast.config.plan import PlanSettings
from strandcast.config.sitting import SittingSettings
from strandcast.config.string import String
from strandcast.config.track import CHAIN, TrackSettings
from strandcast.core.box import Box
from strandcast.core.objectives import OBJECTIVES, AnyObjective, Objective, PointObjective
from strandcast.core.quantities import Position, Trial
from strandcast.core.section import Section
from strandcast.core.trial_names import PREFIX

HELD_OUT = "held out"  # why a trial does not count
# Folders of results, and the name of a single camera's films.
TAKEN = ("boards", "cameras", "logs", "made", "motions", "predictions", "rehearsal", "sitting", "video")


class Exclusion(Section):
    """A trial that does not count, with the reason that the report shows."""

    trial: Trial = Field(description="Number of the trial, from 1.")
    reason: Annotated[str, Field(min_length=1, max_length=500)] = Field(
        description="Why it does not count; the report shows it."
    )


StartString = Literal["ensemble", "minima", "random"]
KnownString = dict[Literal["from"], str]  # an experiment's name, or the path of an estimate.json


class Conflict(ValueError):
    """Settings that contradict each other; `field` is the one to change."""

    def __init__(self, what: str, field: str, fix: str) -> None:
        super().__init__(what)
        self.field = field
        self.fix = fix


class Experiment(Section):
    """One string, arm, camera set-up and target, and the settings of every stage."""

    title: Annotated[str, Field(max_length=200)] = Field(
        "", description="Title of the report. Set it if the name does not say enough."
    )
    method: Literal["paper"] | None = Field(
        None,
        description="paper: the paper's search, ranges, start string and planner together. Set it to "
        "reproduce the paper.",
    )
    string: String = Field(description="What is known of the string before it is thrown.")
    arm: Annotated[str, Field(min_length=1, max_length=200)] = Field(
        "planar3",
        description="A name in config/arms, or the path of an arm's file. Set it for every real arm.",
    )
    target_m: Annotated[tuple[Position, ...], Field(min_length=2, max_length=3)] | None = Field(
        None,
        description="Target from the arm's base: [x, y], x to the right and y up; for an arm in space [x,"
        " y, z], z up. Leave it out to fit captured motion only.",
    )
    objective: AnyObjective = Field(
        PointObjective(),
        description="Goal of a throw; by default the tip hits target_m. Set it to hit from a direction, "
        "at a speed or on a bar, to take a shape, or to swing high or fast.",
    )
    hit_radius_m: Annotated[float, Field(gt=0, le=0.5)] = Field(
        0.02,
        description="A throw hits if the tip's path passes the target within this distance. Set it to "
        "what the task tolerates.",
    )
    max_trials: Trial = Field(
        5,
        description="The lab stops after this many trials; a real experiment ignores it. Raise it for a "
        "difficult string.",
    )
    min_trials: Trial = Field(
        1,
        description="The lab throws at least this often, even after a hit. Raise it to study later throws.",
    )
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = Field(
        1,
        description="Seed of all random numbers. Change it to repeat an experiment with other ones.",
    )
    start_string: StartString | KnownString | dict[str, float] = Field(
        "ensemble",
        description="Strings that the first motion is planned for: a random ensemble, the minima of the "
        "ranges, one random string, values by parameter, or {from: NAME}, what was fitted in another "
        "experiment (or an estimate.json). Give it for a string that was thrown before.",
    )
    workspace_m: Box | None = Field(
        None,
        description="Box that hand and string may enter; by default the arm's. Set it to what is free of "
        "people and things and in the camera's view.",
    )
    excluded: Annotated[list[Exclusion], each_once("trial", "trial {} is excluded twice")] = Field(
        [],
        description="Trials that are not fitted or planned from. Use `strandcast exclude` for a throw "
        "that went wrong.",
    )
    held_out: list[Trial] = Field(
        [],
        description="Trials that are never fitted or planned from. Use it for recordings to test "
        "`strandcast predict` on.",
    )
    cameras: dict[CameraName, CameraSettings] = Field(
        {MAIN: CameraSettings()},
        min_length=1,
        description="Set-up and calibration of each camera, by name; `camera: {…}` is short for `cameras:"
        " {main: {…}}`. Name two or more to measure the string in space.",
    )
    track: TrackSettings = Field(TrackSettings(), description="Tracking of the string in the video.")
    align: AlignSettings = Field(
        AlignSettings(), description="Alignment of the camera's clock with the robot's."
    )
    estimate: EstimateSettings = Field(
        EstimateSettings(), description="Fit of the string parameters to the throws."
    )
    plan: PlanSettings = Field(PlanSettings(), description="Planning of the next motion.")
    sitting: SittingSettings = Field(
        SittingSettings(), description="What a sitting at the rig (`strandcast throw`) runs and waits for."
    )
    lab: LabSettings | None = Field(None, description="The virtual rig. Leave it out for a real robot.")

    @field_validator("start_string")
    @classmethod
    def _start_values_are_known_and_positive(
        cls, value: StartString | KnownString | dict[str, float]
    ) -> StartString | KnownString | dict[str, float]:
        if isinstance(value, dict) and not isinstance(value.get("from"), str):
            known_names(value)
            bad = [name for name, number in value.items() if float(number) <= 0]
            if bad:
                raise ValueError(f"{bad[0]} must be above 0")
        return value

    @model_validator(mode="after")
    def _settings_fit_each_other(self) -> Experiment:
        if (conflict := next(self._conflicts(), None)) is not None:
            raise conflict
        return self

    def _conflicts(self) -> Iterator[Conflict]:
        """Yield what contradicts each other; each check may rely on those before it."""
        if self.min_trials > self.max_trials:
            what = f"min_trials ({self.min_trials}) is above max_trials ({self.max_trials})"
            yield Conflict(what, "min_trials", "raise max_trials, or lower it")
        if self.target_m is None and (self.lab is not None or self.objective != PointObjective()):
            what = f"{'the lab' if self.lab is not None else 'the objective'} needs a target"
            yield Conflict(what, "target_m", "add target_m: [x, y], or [x, y, z] for an arm in space")
        if self.aims_in_space:
            yield from self._conflicts_in_space()
        if self.workspace_m is not None:
            yield from self._conflicts_with_workspace(self.workspace_m)
        length_m = self.string.length_m
        beyond = [along_m for along_m in self.objective.along_m if along_m > length_m + 1e-9]
        if beyond:
            what = f"the {self.objective.kind}'s place at {beyond[0]} m lies beyond the string's {length_m} m"
            yield Conflict(what, "objective", "give along_m from the hand, up to string.length_m")
        if len(self.cameras) > 1:
            yield from self._conflicts_of_several_cameras()
        named = {(c.lens, c.plane_photo) for c in self.cameras.values()}
        if self.lab is not None and named != {(LENS, PLANE_PHOTO)}:
            what = f"the lab writes {LENS} and {PLANE_PHOTO}"
            yield Conflict(what, "cameras", "leave lens and plane_photo out")

    def _conflicts_of_several_cameras(self) -> Iterator[Conflict]:
        """Yield what several cameras cannot have: they measure in space, for fits alone."""
        if self.lab is not None:
            yield Conflict("the lab films with one camera", "cameras", "name one")
        if self.target_m is not None:
            what = "several cameras do not see in which direction the hand holds the string"
            yield Conflict(what, "target_m", "leave it out: their throws are fitted and predicted")
        if self.track.background_picture is not None:
            what = "several cameras do not see the same background"
            yield Conflict(what, "track.background_picture", "leave it out: it is learned from each film")
        if taken := [name for name in self.cameras if name in TAKEN or name.startswith(PREFIX)]:
            what = f"{taken[0]} has another meaning in the folders"
            yield Conflict(what, f"cameras.{taken[0]}", "give this camera another name, e.g. left")

    def _conflicts_in_space(self) -> Iterator[Conflict]:
        """Yield the settings that only throws in the plane have, or only those that are filmed."""
        fix = "leave it out, or give a target with x and y"
        given = {
            "method": ("the paper's method works", self.method is not None),
            "objective": ("this objective is defined", self.objective != PointObjective()),
            "workspace_m": ("this box lies", self.workspace_m is not None),
            "start_string": (
                f"start_string {self.start_string!r} is made",
                self.start_string != "ensemble" and self.known_string is None,
            ),
        }
        for field, (what, is_given) in given.items():
            if is_given:
                yield Conflict(f"{what} in the plane, and the target has x, y and z", field, fix)
        of_lab = set() if self.lab is None else {f"lab.{name}" for name in self.lab.model_fields_set}
        filmed = {"align", "cameras", "lab.camera", "track"}
        for field in sorted(filmed & (self.model_fields_set | of_lab)):
            yield Conflict("it is for videos, and a throw in space is measured by motion capture", field, fix)

    def _conflicts_with_workspace(self, box: Box) -> Iterator[Conflict]:
        for value, (low, high), axis in zip(self.target_m or (), (box.x_m, box.y_m), "xy", strict=False):
            if not low <= value <= high:
                what = f"the target's {axis}, {value} m, lies outside workspace_m, {low} to {high} m"
                fix = "move the target, or widen workspace_m if there is free space"
                yield Conflict(what, "target_m", fix)

    @property
    def aims_in_space(self) -> bool:
        """Whether the target has three coordinates."""
        return self.target_m is not None and len(self.target_m) == 3

    @property
    def aim(self) -> Objective | None:
        """The objective of every throw, with the target; None without one."""
        return None if self.target_m is None else self.objective.aimed_at(self.target_m)

    @property
    def lab_captures(self) -> bool:
        """Whether the lab throws in space, where motion capture takes the place of its camera."""
        return self.lab is not None and self.aims_in_space

    @property
    def lab_rehearses(self) -> bool:
        """Whether the lab plays the first motion with an empty clamp before the first throw.

        Only where it is planned for an ensemble on joints that follow as they do: the paper's method knows
        no rehearsal.
        """
        asked = self.lab is not None and self.lab.rehearsal and self.method is None
        return asked and (self.start_string == "ensemble" or self.known_string is not None)

    @property
    def known_string(self) -> str | None:
        """Return the experiment, or the estimate.json, that the string comes from; None: a new string."""
        start = self.start_string
        return str(start["from"]) if isinstance(start, dict) and "from" in start else None

    @property
    def camera_name(self) -> str:
        """Return the name of the one camera; of several, each has settings of its own (`Context.views`)."""
        [name] = self.cameras
        return name

    @property
    def camera(self) -> CameraSettings:
        """Return the set-up of the one camera (see `camera_name`)."""
        return self.cameras[self.camera_name]

    @property
    def tracker_finds_scale(self) -> bool:
        """Whether a tracker of one's own has to find the scale in the first film: no markers show it."""
        return self.track.tracker != CHAIN and not self.camera.has_markers

    @property
    def excluded_reasons(self) -> dict[int, str]:
        """Return why trials do not count, by number."""
        return dict.fromkeys(self.held_out, HELD_OUT) | {each.trial: each.reason for each in self.excluded}

    def excluded_reason(self, trial: int) -> str | None:
        """Return why a trial does not count, or None if it does."""
        return self.excluded_reasons.get(trial)


OBJECTIVES.on_registration(lambda: Experiment.model_rebuild(force=True))
