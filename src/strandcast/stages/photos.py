"""Pictures that the experiment gives: photos of boards and plane, and of the empty scene."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.stages.context import Context
from strandcast.video.isolated import read_photos


def given_pictures(context: Context, paths: Sequence[Path], flags: int) -> Iterator[np.ndarray | None]:
    """Yield the experiment's pictures; None: not a picture.

    Raises
    ------
    StrandcastError
        SC-F010 a link leads out of the data; otherwise as `read_photos`.
    """
    folders = context.folder.data, context.folder.root / "data"
    for path in paths:
        real = path.resolve()
        if not any(real.is_relative_to(folder.resolve()) for folder in folders):
            raise StrandcastError(
                "SC-F010",
                f"the link leads to {real}, outside {folders[1]}",
                file=path,
                fix="copy the picture itself into the experiment's folder",
            )
    return read_photos(paths, flags)
