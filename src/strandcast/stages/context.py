"""The experiment that a stage works on: its settings and its folders."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from strandcast.config.experiment import Experiment
from strandcast.config.find import find_arm, find_experiment
from strandcast.config.load import load_experiment
from strandcast.core.strings import PARAMETERS, SPATIAL_RANGES
from strandcast.errors import StrandcastError
from strandcast.records.folders import VIDEO, ExperimentFolder, parted
from strandcast.records.manifest import Manifest


@dataclass(frozen=True)
class Context:
    """One experiment: its name, its settings and the file they come from, its folders."""

    name: str
    settings: Experiment
    file: Path
    folder: ExperimentFolder

    @cached_property  # the engine asks for every job
    def arm_file(self) -> Path:
        """Return the arm's file."""
        return find_arm(self.settings, self.file, self.folder.root)

    @cached_property
    def views(self) -> dict[str, "Context"]:
        """Return each of several cameras, by name, as an experiment of one camera with results of its own."""
        cameras = self.settings.cameras
        return {name: self._view(name) for name in cameras} if len(cameras) > 1 else {}

    @property
    def by_camera(self) -> list["Context"]:
        """Return an experiment of one camera for each camera: itself, where it has one."""
        return [*self.views.values()] or [self]

    def _view(self, camera: str) -> "Context":
        one = self.settings.model_copy(update={"cameras": {camera: self.settings.cameras[camera]}})
        name = f"{self.name}/{camera}"
        return Context(name, one, self.file, ExperimentFolder(self.folder.root, name, (camera,)))

    @property
    def background_picture(self) -> Path | None:
        """Return the picture of the empty scene, None if it is learned from the video."""
        name = self.settings.track.background_picture
        return None if name is None else self.folder.data / name

    def counted(self, trials: Iterable[int]) -> list[int]:
        """Return those of the trials that are not excluded."""
        return [number for number in trials if self.settings.excluded_reason(number) is None]

    def is_last(self, trial: int, hit: bool) -> bool:
        """Return whether the lab throws no more after a trial that hit or not."""
        enough = hit and trial >= self.settings.min_trials and bool(self.counted([trial]))
        return enough or trial >= self.settings.max_trials


def context_of(root: Path, name: str) -> Context:
    """Find and read an experiment."""
    file = find_experiment(name, root)
    settings = load_experiment(file)
    films = (VIDEO,) if len(settings.cameras) == 1 else tuple(settings.cameras)
    return Context(name, settings, file, ExperimentFolder(root, name, films))


def context_named(root: Path, name: str) -> Context:
    """Find and read an experiment, or one of its several cameras: ``cable/left``.

    Raises
    ------
    StrandcastError
        SC-F003 the experiment has no such camera.
    """
    experiment, camera = parted(name)
    whole = context_of(root, experiment)
    if camera and camera not in whole.views:
        raise _asking_for_camera(whole, f"{name!r} is none of its cameras")
    return whole.views[camera] if camera else whole


def context_of_camera(root: Path, name: str) -> Context:
    """Find and read an experiment of one camera, or one of several cameras: ``cable/left``.

    Raises
    ------
    StrandcastError
        SC-F003 the name leaves open which camera is meant.
    """
    context = context_named(root, name)
    if context.views:
        raise _asking_for_camera(context, f"{name} has several cameras")
    return context


def _asking_for_camera(whole: Context, what: str) -> StrandcastError:
    known = ", ".join(each.name for each in whole.by_camera)
    return StrandcastError("SC-F003", what, file=whole.file, field="cameras", fix=f"name one of {known}")


@contextmanager
def about_settings(context: Context) -> Iterator[None]:
    """Let an error that names no file be about a request in the experiment's file."""
    try:
        yield
    except StrandcastError as error:
        error.file = error.file or str(context.file)
        raise


def refuse_replacing(path: Path, replace: bool) -> None:
    """Refuse to overwrite an earlier import, unless asked to."""
    if path.is_file() and not replace:
        raise StrandcastError(
            "SC-I022", "has been imported already", file=path, fix="import as another trial, or add --replace"
        )


def refuse_other_target(context: Context, in_space: bool) -> None:
    """Refuse a track in space for an experiment that aims at a target in the plane, and the reverse."""
    settings = context.settings
    if settings.target_m is not None and settings.aims_in_space != in_space:
        track, target = ("space", "a plane") if in_space else ("a plane", "space")
        raise StrandcastError(
            "SC-I046",
            f"the track is in {track}, and the target in {target}",
            file=context.file,
            field="target_m",
            fix="give the target x, y and z in space, x and y in a plane; or leave it out: then captures are "
            "fitted and predicted, and nothing is planned",
        )


def refuse_settings_of_others(context: Context, *, in_space: bool) -> None:
    """Refuse what only filmed throws have for a string in space, and ranges of other parameters (SC-E008)."""
    settings, known = context.settings.estimate, tuple(SPATIAL_RANGES if in_space else PARAMETERS)
    ranges = settings.ranges if isinstance(settings.ranges, dict) else {}
    wrong = {
        "method": in_space and context.settings.method is not None,
        "estimate.camera_offset_sd_m": in_space and settings.camera_offset_sd_m is not None,
        "estimate.ranges": not set(ranges) <= set(known),
    }
    for field in [field for field, is_wrong in wrong.items() if is_wrong]:
        what = f"{field} does not apply to a string in {'space' if in_space else 'the plane'}"
        fix = f"give ranges of {', '.join(known)}" if field == "estimate.ranges" else None
        raise StrandcastError("SC-E008", what, file=context.file, field=field, fix=fix)


def aimed_at(context: Context, manifest: Manifest) -> NDArray[np.float64] | None:
    """Return the place [m] at which a film's throw aimed, or else the experiment's target."""
    target_m = manifest.target_m or context.settings.target_m
    return None if target_m is None else np.array(target_m)


def free_length_m(context: Context, clamped_length_m: float) -> float:
    """Return the length of the string beyond the clamp [m]."""
    return context.settings.string.length_m - clamped_length_m


def refuse_unknown_trial(context: Context, trial: int) -> None:
    """Refuse a trial that has neither raw files nor a verdict.

    Raises
    ------
    StrandcastError
        SC-W021 there is no such trial.
    """
    folder, known = context.folder, context.folder.thrown_trials()
    if trial not in known and not (folder.trial(trial).results / "verdict.json").is_file():
        there = f"thrown so far: {', '.join(map(str, known))}" if known else "nothing was thrown yet"
        what = f"there is no trial {trial}"
        fix = f"give a trial that exists; {there}"
        raise StrandcastError("SC-W021", what, file=folder.data, fix=fix)
