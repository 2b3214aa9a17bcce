"""Pictures that the experiment gives: photos of boards and plane, and of the empty scene."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.manifest import VideoFacts
from strandcast.stages.context import Context
from strandcast.video.isolated import read_photos

GREY = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH


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
            what = f"the link leads to {real}, outside {folders[1]}"
            fix = "copy the picture itself into the experiment's folder"
            raise StrandcastError("SC-F010", what, file=path, fix=fix)
    return read_photos(paths, flags)


def given_background(context: Context, facts: VideoFacts) -> np.ndarray | None:
    """Return the background (height, width) that the experiment gives; None if it is learned from the video.

    Raises
    ------
    StrandcastError
        SC-T030 the picture is missing or unreadable, or its size is not that of the video.
    """
    path, field = context.background_picture, "track.background_picture"
    if path is None:
        return None
    grey = next(given_pictures(context, [path], GREY)) if path.is_file() else None
    if grey is None:
        raise StrandcastError("SC-T030", "there is no picture of the empty scene", file=path, field=field)
    if grey.shape != (facts.height_px, facts.width_px):
        sizes = f"is {grey.shape[1]} x {grey.shape[0]} px, the video {facts.width_px} x {facts.height_px}"
        raise StrandcastError("SC-T030", sizes, file=path, field=field)
    return grey
