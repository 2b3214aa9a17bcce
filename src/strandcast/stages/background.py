"""The empty scene, where the experiment gives a picture of it."""

from __future__ import annotations

import cv2
import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.manifest import VideoFacts
from strandcast.stages.context import Context


def given_background(context: Context, facts: VideoFacts) -> np.ndarray | None:
    """Return the background (height, width) that the experiment gives, None where the video is to tell it.

    Raises
    ------
    StrandcastError
        SC-T030 the picture is not there, or is none; SC-T031 it is of another size than the video.
    """
    name = context.settings.track.background_picture
    if name is None:
        return None
    path, field = context.folder.data / name, "track.background_picture"
    grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH) if path.is_file() else None
    if grey is None:
        raise StrandcastError(
            "SC-T030", "there is no picture of the empty scene", file=path, field=field,
            fix="put it there, or leave the setting out: the video then tells the background")  # fmt: skip
    if grey.shape != (facts.height_px, facts.width_px):
        sizes = f"is {grey.shape[1]} x {grey.shape[0]} px, the video {facts.width_px} x {facts.height_px}"
        raise StrandcastError(
            "SC-T031", sizes, file=path, field=field, fix="take it with the same camera, and do not crop it"
        )
    return np.asarray(grey)
