"""Where every file of an experiment lies (DESIGN §3)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from strandcast.errors import StrandcastError

VIDEO_SUFFIXES = (".mp4", ".avi", ".mkv", ".mov", ".m4v", ".webm", ".cine", ".tif", ".tiff")
# Photron's pair: the header stands for both.
HEADERS, RAW = (".cihx", ".cih"), ".mraw"
PICTURES = (".png", ".tif", ".tiff")  # in a folder named video


@dataclass(frozen=True)
class ExperimentFolder:
    """The folders of one experiment under the project's root."""

    root: Path
    name: str

    @property
    def data(self) -> Path:
        """Return the folder of raw files."""
        return self.root / "data" / self.name

    @property
    def results(self) -> Path:
        """Return the folder of everything made from them."""
        return self.root / "results" / self.name

    def trial(self, number: int) -> TrialFolder:
        """Return the folders of one trial."""
        return TrialFolder(self.data / trial_name(number), self.results / trial_name(number), number)

    def recorded_trials(self) -> list[int]:
        """Return the numbers of the trials that have a folder of raw files."""
        names = (path.name.removeprefix("trial-") for path in self.data.glob("trial-[0-9][0-9]"))
        return sorted(int(name) for name in names)


@dataclass(frozen=True)
class TrialFolder:
    """The raw files and the results of one trial."""

    data: Path
    results: Path
    number: int

    @property
    def played_motion(self) -> Path | None:
        """Return the motion that was played, if there is one."""
        path = self.data / "motion.json"
        return path if path.is_file() else None

    def video(self) -> Path:
        """Return the one video among the raw files: a file, or a folder of pictures."""
        there = sorted(self.data.glob("video*")) if self.data.is_dir() else []
        found = [path for path in there if path.stem == "video" and path.suffix.lower() in VIDEO_SUFFIXES]
        pair = [path for path in there if path.stem == "video" and path.suffix.lower() in (*HEADERS, RAW)]
        found += sorted(pair, key=lambda path: (*HEADERS, RAW)[::-1].index(path.suffix.lower()))[-1:]
        found += [path for path in there if path.name == "video" and path.is_dir()]
        if len(found) != 1:
            raise _not_one(self.data, found)
        return found[0]

    def has_video(self) -> bool:
        """Tell whether there is a video among the raw files, or several."""
        there = self.data.glob("video*") if self.data.is_dir() else ()
        known = (*VIDEO_SUFFIXES, *HEADERS, RAW)
        return any(path.stem == "video" and (path.suffix.lower() in known or path.is_dir()) for path in there)

    def video_files(self) -> list[Path]:
        """Return all files that the video consists of."""
        video = self.video()
        if video.is_dir():
            return sorted(path for path in video.iterdir() if path.suffix.lower() in PICTURES)
        if video.suffix.lower() not in (*HEADERS, RAW):
            return [video]
        parts = (path for path in self.data.glob("video.*") if path.suffix.lower() in (*HEADERS, RAW))
        return sorted(parts)


def _not_one(folder: Path, found: list[Path]) -> StrandcastError:
    names = ", ".join(path.name for path in found) or "none"
    others = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []
    there = f"; in the folder: {', '.join(others[:8]) or 'nothing'}" if not found else ""
    return StrandcastError(
        "SC-V020",
        f"wanted one video.* file ({', '.join((*VIDEO_SUFFIXES, HEADERS[0], RAW))}) or a folder video of "
        f"pictures, found {names}{there}",
        file=folder,
        fix="name the recording video.mp4 (or .avi, .mkv, .mov ...) and keep no other beside it",
    )


def trial_name(number: int) -> str:
    """Return the folder name of a trial, e.g. trial-01."""
    return f"trial-{number:02d}"
