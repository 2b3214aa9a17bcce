"""The folder into which a camera's computer writes films: what is new in it and complete."""

import os
import shutil
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from strandcast.errors import StrandcastError
from strandcast.records.folders import CONTAINERS, PHOTRON, PICTURES, files_of_video
from strandcast.video.reader import open_video
from strandcast.workflow.display import printable

STEADY_S = 1.0  # a file that has not changed for so long, and opens, is complete; chosen
PICTURE_FOLDER = "/"  # stands for the suffix of a folder of pictures
UNFINISHED = ("SC-V005", "SC-V022")


class Unusable(Exception):
    """Why a throw cannot be used, or must not be made, in one sentence."""


def listing(folder: Path) -> dict[str, Any]:
    """Return what lies in a folder in which nothing changes: `device`, and `files` by name, for JSON.

    Raises
    ------
    Unusable
        It cannot be read, or a file changes within a second.
    """
    before = facts_of(folder)
    time.sleep(STEADY_S)
    now = facts_of(folder)
    if before is None or now is None:
        raise Unusable(f"{folder} cannot be read")
    changing = sorted({path.name for path, facts in now.items() if before.get(path) != facts})
    if changing:
        raise Unusable(f"{', '.join(changing)} in {folder} still changes: wait for it")
    files = {printable(path.name): facts for path, facts in now.items()}
    return {"device": folder.stat().st_dev, "files": files}


def new_files(folder: Path, before: dict[str, Any], suffixes: tuple[str, ...]) -> list[Path]:
    """Return the files of some kinds that have come into a folder since a `listing` of it.

    Nothing as long as one of them changes or does not open, as it may be the one; and nothing where another
    device lies there than before, as a network folder that is away leaves its empty place. One that was
    mounted again is another device with the same files.
    """
    found = facts_of(folder)
    if not found:
        return []
    is_back = bool(before["files"]) and before["files"].keys() <= {printable(path.name) for path in found}
    if folder.stat().st_dev != before["device"] and not is_back:
        return []
    new = {
        path: facts
        for path, facts in found.items()
        if before["files"].get(printable(path.name)) != facts
        and (PICTURE_FOLDER if path.is_dir() else path.suffix.lower()) in suffixes
    }
    return sorted(new) if new and are_complete(folder, new) else []


def are_complete(folder: Path, files: dict[Path, list[int]]) -> bool:
    """Return whether some files of a folder stay as they are for a second, and open."""
    time.sleep(STEADY_S)
    now = facts_of(folder) or {}
    return all(now.get(path) == facts and _opens(path) for path, facts in files.items())


def facts_of(folder: Path) -> dict[Path, list[int]] | None:
    """Return number, size [byte] and time [ns] of each file in a folder; of pictures in a folder, of all.

    None: the folder cannot be read.
    """
    found: dict[Path, list[int]] = {}
    try:
        paths = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    except OSError:
        return None
    for path in paths:
        with suppress(OSError):  # a dangling link, or somebody else's folder
            each_of = path.iterdir() if path.is_dir() else ()
            inside = [each for each in each_of if each.suffix.lower() in PICTURES]
            facts = [each.stat() for each in (inside if path.is_dir() else (path,))]
            if facts:
                size, changed = sum(each.st_size for each in facts), max(each.st_mtime_ns for each in facts)
                found[path] = [len(facts), size, changed]
    return found


def copy_film(film: Path, folder: Path) -> None:
    """Copy a film, with all files that belong to it, into a trial's folder; its last file appears last."""
    part = folder / ".film.part"
    if film.is_dir():
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        for picture in files_of_video(film):
            _copy(picture, part / picture.name)
        part.rename(folder / "video")
        return
    # A Photron's header is copied last: without it, its frames are no film.
    for file in sorted(files_of_video(film), key=lambda file: file.suffix.lower() != PHOTRON[0]):
        _copy(file, part)
        part.replace(folder / f"video{file.suffix.lower()}")


def _copy(file: Path, copy: Path) -> None:
    """Copy a file, and have it on the disk before it gets its name."""
    shutil.copyfile(file, copy)
    with copy.open("rb") as copied:
        os.fsync(copied)


def _opens(path: Path) -> bool:
    """Return whether a file is more than the beginning of a film."""
    if path.suffix.lower() in (*CONTAINERS, *PHOTRON):
        try:
            with open_video(path):
                pass
        except StrandcastError as error:
            return error.code not in UNFINISHED
    return True
