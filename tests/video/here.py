"""Videos decoded in this process, as their own one decodes them: to start it takes longer than most tests."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from strandcast.video.registry import reader_of
from strandcast.video.source import Contents, Grey, Source, is_copy


def frames_here(path: Path) -> list[tuple[float, np.ndarray]]:
    """Return time [s] and grey image of each frame."""
    with reader_of(path).open_source(path, 1, None) as source:
        return [(time_s, np.array(source.to_grey(raw, None))) for time_s, raw in source.raws]


def probe_here(path: str | Path) -> Contents:
    """Stand in for `strandcast.video.isolated.probe_isolated`."""
    return reader_of(path).probe(path)


class DecodingHere:
    """Stands in for `strandcast.video.isolated.Decoding`."""

    def __init__(self, source: Source) -> None:
        self.source, self.info, self.messages = source, source.info, list[str]()

    def frames(self) -> Iterator[tuple[float, Grey, bool]]:
        """Yield time [s], grey image, and whether it is an exact copy of the previous frame."""
        before = None
        for time_s, raw in self.source.raws:
            grey = self.source.to_grey(raw, None)
            now = np.ascontiguousarray(grey).data.cast("B")
            self.messages[:] = self.source.messages()
            yield time_s, grey, before is not None and is_copy(now, before)
            before = now
        self.messages[:] = self.source.messages()


@contextmanager
def decode_here(path: str | Path, threads: int, frames: int | None) -> Iterator[DecodingHere]:
    """Stand in for `strandcast.video.isolated.decode_isolated`."""
    with reader_of(path).open_source(path, threads, frames) as source:
        yield DecodingHere(source)
