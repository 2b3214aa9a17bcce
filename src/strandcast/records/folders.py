"""The folders and files of an experiment."""

from __future__ import annotations

import os
import re
import shlex
import sys
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from pathlib import Path

from strandcast.core.registry import installed
from strandcast.core.trial_names import LAST_TRIAL, TRIAL_NAMES, trial_name, trial_number
from strandcast.errors import StrandcastError
from strandcast.records.listing import entries_of, file_exists, folder_exists

# Suffixes of videos, by the module of strandcast.video that reads them.
CONTAINERS = (".mp4", ".avi", ".mkv", ".mov", ".m4v", ".webm", ".cine")
TIFFS = (".tif", ".tiff")
PICTURES = (".png", *TIFFS)  # in a folder
PHOTRON = (".mraw", ".cih", ".cihx")  # raw frames and their headers; the last one present names the video
VIDEO = "video"
LIKE_A_TRIAL = re.compile(r"trial[\W_]?\d+", re.IGNORECASE)  # trial-1, trial_01, Trial-01, trial-0100
# Entry points of packages that read other formats; the name of each is a suffix without its dot.
FRAME_READERS_GROUP = "strandcast.frame_readers"
# Set for the jobs of a workflow: it runs in the root, and holds the lease of the experiment for all of them.
WITHIN_WORKFLOW = "STRANDCAST_WITHIN_WORKFLOW"


def is_project(folder: Path) -> bool:
    """Return whether a folder is a project's root: a Snakefile, its own or a clone's, lies beside config/."""
    snakefiles = (folder / "Snakefile", folder / "workflow" / "Snakefile")
    return (folder / "config").is_dir() and any(path.is_file() for path in snakefiles)


def project_root() -> Path:
    """Return the root of the project that the current folder lies in, as `../..`; outside projects, `.`."""
    if WITHIN_WORKFLOW in os.environ:
        return Path()
    try:
        here = Path.cwd()
    except FileNotFoundError:  # it was removed
        return Path()
    above = [folder for folder in (here, *here.parents) if is_project(folder)]
    return Path(os.path.relpath(above[0], here)) if above else Path()


def parted(name: str) -> tuple[str, str]:
    """Return the names of experiment and camera, `cable` and `left` of ``cable/left``; empty: no camera's."""
    experiment, _, camera = name.partition("/")
    return experiment, camera


@dataclass(frozen=True)
class ExperimentFolder:
    """The folders of one experiment under the project's root, or of one of its cameras: ``cable/left``.

    Such a camera has results of its own, in a folder among the experiment's.
    """

    root: Path
    name: str
    films: tuple[str, ...] = (VIDEO,)  # names of the videos of a trial, without suffix

    @property
    def experiment(self) -> str:
        """Return the experiment's name, without a camera's."""
        return parted(self.name)[0]

    @cached_property  # the engine asks for each file of each trial
    def data(self) -> Path:
        """Return the folder of raw files."""
        return self.root / "data" / self.experiment

    @cached_property
    def results(self) -> Path:
        """Return the folder of results."""
        return self.root / "results" / self.name

    @property
    def rehearsal(self) -> Path:
        """Return the folder of the motion that the arm played without the string."""
        return self.data / "rehearsal"

    @property
    def motions(self) -> Path:
        """Return the folder of the motions that were planned or exported, each under its hash."""
        return self.results / "motions"

    def camera(self, name: str) -> Path:
        """Return the record of a camera."""
        return self.results / "cameras" / f"{name}.json"

    def trial(self, number: int) -> TrialFolder:
        """Return the folders of one trial."""
        return _trial_folder(self, number)

    def recorded_trials(self) -> list[int]:
        """Return the numbers of the trials with a video, or with a track that was measured elsewhere.

        Raises
        ------
        StrandcastError
            SC-R032 a folder is named like a trial, but is none, e.g. trial-1: it would be overlooked.
        """
        if misnamed := self.misnamed_trials():
            raise misnamed[0]
        trials = [self.trial(number) for number in trial_folders(self.data)]
        return [t.number for t in trials if t.videos() or file_exists(t.data / "track.parquet")]

    def misnamed_trials(self) -> list[StrandcastError]:
        """Return a problem for each folder that is named like a trial, but is none, e.g. trial-1."""
        what = f"is no trial's name: trials are named {TRIAL_NAMES}"
        like = (path for path in entries_of(self.data) if LIKE_A_TRIAL.fullmatch(path.name))
        misnamed = sorted(path for path in like if folder_exists(path) and not trial_number(path.name))
        return [StrandcastError("SC-R032", what, file=path, fix=self._renaming(path)) for path in misnamed]

    def _renaming(self, folder: Path) -> str:
        """Return the command that gives a misnamed folder the number in its name, or the next free one."""
        digits = re.findall(r"\d+", folder.name)
        numbers = trial_folders(self.data)
        number = int(digits[0]) if digits and digits[0].isascii() else 0
        if not 1 <= number <= LAST_TRIAL or number in numbers:
            number = max(numbers, default=0) + 1
        if number > LAST_TRIAL:
            return f"move it to a second experiment: more than {LAST_TRIAL} throws need one"
        return "rename it: " + shlex.join(["mv", str(folder), str(self.data / trial_name(number))])

    def thrown_trials(self) -> list[int]:
        """Return the numbers of the trials that have any raw file: their motions are not planned again."""
        return [number for number in trial_folders(self.data) if self.trial(number).raw_files()]

    def all_trials(self) -> list[int]:
        """Return the numbers of the trials that have raw files or results."""
        return sorted({*trial_folders(self.data), *trial_folders(self.results)})

    def reported_trials(self) -> list[int]:
        """Return the numbers of the trials with a page of their own."""
        folders = trial_folders(self.results)
        return [number for number, folder in folders.items() if (folder / "report.html").exists()]


@lru_cache(maxsize=4096)
def _trial_folder(experiment: ExperimentFolder, number: int) -> TrialFolder:
    name = trial_name(number)
    return TrialFolder(experiment.data / name, experiment.results / name, number, experiment.films)


@dataclass(frozen=True)
class TrialFolder:
    """The raw files and the results of one trial."""

    data: Path
    results: Path
    number: int
    films: tuple[str, ...] = (VIDEO,)

    def video(self) -> Path:
        """Return the one video among the raw files: a file, or a folder of pictures."""
        found = self.videos()
        if len(found) == 1:
            return found[0]
        names = ", ".join(path.name for path in found) or "none"
        others = sorted(path.name for path in entries_of(self.data))
        inside = "" if found else f"; in the folder: {', '.join(others[:8]) or 'nothing'}"
        film, suffixes = self.films[0], ", ".join((*video_suffixes(), PHOTRON[-1], PHOTRON[0]))
        raise StrandcastError(
            "SC-V020",
            f"expected one {film}.* file ({suffixes}) or a folder {film} of pictures, found {names}{inside}",
            file=self.data,
        )

    def videos(self) -> list[Path]:
        """Return the videos among the raw files, each a file or a folder of pictures: one for each film."""
        return [video for film in self.films for video in self._videos_named(film)]

    def _videos_named(self, film: str) -> list[Path]:
        there = [path for path in self.raw_files() if path.stem.lower() == film]
        found = [path for path in there if path.suffix.lower() in video_suffixes()]
        photron = [path for path in there if path.suffix.lower() in PHOTRON]
        found += sorted(photron, key=lambda path: PHOTRON.index(path.suffix.lower()))[-1:]
        return found + [path for path in there if not path.suffix and folder_exists(path)]

    def other_films(self) -> list[str]:
        """Return the names of other films among the raw files, which are not read."""
        films = [path for path in self.raw_files() if path.suffix.lower() in video_suffixes()]
        return [path.name for path in films if path.stem.lower() not in self.films]

    def raw_files(self) -> list[Path]:
        """Return what lies in the folder of raw files: a real trial that has any was thrown."""
        return sorted(path for path in entries_of(self.data) if not path.name.startswith("."))

    def video_files(self) -> list[Path]:
        """Return all files that the video consists of; of several videos, those of all."""
        return [file for video in self.videos() or [self.video()] for file in files_of_video(video)]


def files_of_video(video: Path) -> list[Path]:
    """Return the files of a video: itself, Photron's files of its name, or the pictures of a folder."""
    if folder_exists(video):
        pictures = (path for path in entries_of(video) if path.suffix.lower() in PICTURES)
        return sorted(path for path in pictures if not path.name.startswith("."))
    if video.suffix.lower() not in PHOTRON:
        return [video]
    same_name = (path for path in entries_of(video.parent) if path.stem == video.stem)
    return sorted(path for path in same_name if path.suffix.lower() in PHOTRON)


def video_suffixes() -> tuple[str, ...]:
    """Return the suffixes of video files: built-in ones, then those of installed frame readers."""
    return _video_suffixes(tuple(sys.path))


@cache  # the engine asks for every trial, and reading what is installed takes 20 ms
def _video_suffixes(packages: tuple[str, ...]) -> tuple[str, ...]:
    """Return the suffixes of video files with the packages in some folders, those of `sys.path`."""
    others = (f".{name}" for name in installed(FRAME_READERS_GROUP))
    built_in = (*CONTAINERS, *TIFFS)
    return (*built_in, *(suffix for suffix in others if suffix not in built_in))


def own_experiments(root: Path) -> list[str]:
    """Return the experiments under data/."""
    return sorted(path.parent.name for path in root.glob("data/*/experiment.yaml"))


def known_experiments(root: Path) -> list[str]:
    """Return the experiments under data/ and those that ship with the project."""
    return sorted({*own_experiments(root), *(path.stem for path in root.glob("config/experiments/*.yaml"))})


def trial_folders(parent: Path) -> dict[int, Path]:
    """Return the folders of trials in a folder by number, in the order of the numbers."""
    numbered = ((trial_number(path.name), path) for path in entries_of(parent))
    return dict(sorted((number, path) for number, path in numbered if number and folder_exists(path)))
