"""Which files of a project exist: those on disk, and those that a listing of its object storage names.

A job whose files come from object storage finds on disk only those that its rule declares. Which trials were
recorded, and with which files, it knows from the listing. Without one, the disk alone counts. A listing has
paths relative to the working directory, which is where stages and rules look for a project.
"""

import json
import os
from functools import cache
from pathlib import Path
from typing import NamedTuple

LISTING = "STRANDCAST_LISTING"  # names a JSON file: path -> size in bytes


class Listing(NamedTuple):
    """The listed files: sizes by path, and the names in each folder, of files and of folders."""

    size_bytes: dict[str, int]
    names: dict[str, list[str]]


NOTHING = Listing({}, {})


def file_exists(path: Path) -> bool:
    """Return whether a file is on disk or is listed."""
    return path.is_file() or str(path) in _listing().size_bytes


def folder_exists(path: Path) -> bool:
    """Return whether a folder is on disk or has listed files."""
    return path.is_dir() or str(path) in _listing().names


def entries_of(folder: Path) -> list[Path]:
    """Return what lies in a folder, on disk or listed, in no order; nothing if there is no such folder."""
    on_disk = list(folder.iterdir()) if folder.is_dir() else []
    listed = _listing().names.get(str(folder))
    return on_disk if listed is None else list({*on_disk, *(folder / name for name in listed)})


def files_matching(folder: Path, pattern: str) -> list[Path]:
    """Return the files below a folder, on disk or listed, that match a pattern such as ``a/b-*.png``."""
    depth = len(Path(pattern).parts)
    below = (Path(name) for name in _listing().size_bytes if name.startswith(f"{folder}{os.sep}"))
    listed = (path for path in below if len(path.relative_to(folder).parts) == depth and path.match(pattern))
    return sorted({*folder.glob(pattern), *listed})


def size_bytes_of(path: Path) -> int:
    """Return the size of a file on disk or listed [byte]; 0 if there is none."""
    return path.stat().st_size if path.is_file() else _listing().size_bytes.get(str(path), 0)


def write_listing(path: Path, size_bytes: dict[str, int]) -> None:
    """Write a listing, and use it in this process and in those that it starts."""
    path.write_text(json.dumps(size_bytes), encoding="utf-8")
    os.environ[LISTING] = str(path.absolute())


def _listing() -> Listing:
    file = os.environ.get(LISTING)
    return NOTHING if file is None else _read(file)


@cache
def _read(file: str) -> Listing:
    size_bytes = json.loads(Path(file).read_text(encoding="utf-8"))
    names: dict[str, set[str]] = {}
    for path in map(Path, size_bytes):
        for entry in (path, *path.parents):
            if entry.name:
                names.setdefault(str(entry.parent), set()).add(entry.name)
    return Listing(size_bytes, {folder: sorted(found) for folder, found in names.items()})
