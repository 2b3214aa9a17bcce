"""The picture of the empty scene, if the experiment gives one."""

import cv2
import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.manifest import VideoFacts
from strandcast.stages.context import Context
from strandcast.stages.photos import given_pictures

GREY = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH


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
