"""Which reader reads which video."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path

from strandcast.video.files import IMAGES, PHOTRON, check_video_path
from strandcast.video.source import Contents, Source

# Each reader is imported where it is used: the decoding process starts in a third of the time.


def probe(path: str | Path) -> Contents:
    """Return what a video holds, told without decoding it but for its first frame."""
    kind = _kind(path)
    if kind == "pictures":
        from strandcast.video.pictures import probe as probe_pictures

        return probe_pictures(path)
    if kind == "photron":
        from strandcast.video.photron import probe as probe_photron

        return probe_photron(path)
    from strandcast.video.container import probe as probe_container

    return probe_container(path)


def open_source(path: str | Path, threads: int, frames: int | None) -> AbstractContextManager[Source]:
    """Open a video in this process; `threads` 0 is the decoder's choice, `frames` None is all."""
    kind = _kind(path)
    if kind == "pictures":
        from strandcast.video.pictures import open_source as open_pictures

        return open_pictures(path, frames)
    if kind == "photron":
        from strandcast.video.photron import open_source as open_photron

        return open_photron(path, frames)
    from strandcast.video.container import open_source as open_container

    return open_container(path, threads, frames)


def _kind(path: str | Path) -> str:
    file = check_video_path(path)
    if file.is_dir() or file.suffix.lower() in IMAGES[1:]:
        return "pictures"
    return "photron" if file.suffix.lower() in PHOTRON else "container"
