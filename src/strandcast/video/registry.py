"""Selection of the reader of a video: a built-in one, or one that another package provides."""

from contextlib import AbstractContextManager
from pathlib import Path
from typing import Protocol

from strandcast.core.registry import Registry
from strandcast.records.folders import CONTAINERS, FRAME_READERS_GROUP, PHOTRON, TIFFS
from strandcast.video.files import check_video_path
from strandcast.video.source import Contents, Source


class FrameReader(Protocol):
    """Reads one format of video; a module with these two functions is a reader."""

    def probe(self, path: str | Path) -> Contents:
        """Return a video's contents; at most its first frame is decoded."""

    def open_source(
        self, path: str | Path, threads: int, frames: int | None
    ) -> AbstractContextManager[Source]:
        """Open a video for one sequential pass; `threads` 0: the decoder's choice, `frames` None: all."""


# By suffix without its dot; entry points only, because the decoding process does not know registered ones.
FRAME_READERS: Registry[FrameReader] = Registry("frame reader", FRAME_READERS_GROUP)


def reader_of(path: str | Path) -> FrameReader:
    """Return the reader of a video.

    A package provides a reader as an entry point of the group ``strandcast.frame_readers``. The entry's name
    is the suffix, in lower case and without the dot. Built-in suffixes cannot be replaced.

    Raises
    ------
    StrandcastError
        SC-V002, SC-V005 it is not a video file; SC-W013 the installed reader cannot be imported.
    """
    # Readers are imported on use, and entry points searched for unknown suffixes only: the decoding process
    # then starts in a third of the time.
    file = check_video_path(path)
    suffix = file.suffix.lower()
    if file.is_dir() or suffix in TIFFS:
        from strandcast.video import pictures

        return pictures
    if suffix in PHOTRON:
        from strandcast.video import photron

        return photron
    installed = None if suffix in CONTAINERS else FRAME_READERS.find(suffix[1:])
    if installed is not None:
        return installed
    from strandcast.video import container

    return container
