"""One picture as ``cv2.imread`` reads it, within a limit of pixels; runs in the decoding process."""

import os
from contextlib import suppress

import numpy as np
from PIL import Image

from strandcast.errors import StrandcastError
from strandcast.video.source import MAX_PIXELS

os.environ["OPENCV_IO_MAX_IMAGE_PIXELS"] = str(MAX_PIXELS)  # OpenCV reads it when it is imported

import cv2

# Formats whose size Pillow reads from the header, for the message; OpenCV has the last word.
FORMATS = ["PNG", "JPEG", "TIFF", "BMP", "WEBP", "PPM", "JPEG2000", "GIF"]


def decode_photo(path: str, flags: int) -> np.ndarray | None:
    """Return a picture, or None if OpenCV cannot read it or it is cut.

    Raises
    ------
    StrandcastError
        SC-V007 it is too large.
    MemoryError
        Decoding it takes too much memory.
    """
    size = _size(path)
    if size is not None and size[0] * size[1] > MAX_PIXELS:
        raise _too_large(path, f"{size[0]} x {size[1]} pixels")
    if _is_cut_jpeg(path):
        return None
    try:
        return cv2.imread(path, flags)
    except cv2.error as error:
        if error.code == cv2.Error.StsNoMem:
            raise MemoryError from None
        if "CV_IO_MAX_IMAGE" in str(error):
            raise _too_large(path, f"more than {MAX_PIXELS} pixels") from None
        return None


def _size(path: str) -> tuple[int, int] | None:
    Image.MAX_IMAGE_PIXELS = None  # the limit is checked here
    with (
        suppress(Exception),
        Image.open(path, formats=FORMATS) as picture,
    ):  # headers raise errors of any kind
        return picture.size
    return None


def _is_cut_jpeg(path: str) -> bool:
    """Return whether a JPEG ends before its picture does: OpenCV would fill the rest with grey."""
    try:
        with Image.open(path, formats=["JPEG"]) as picture:
            picture.draft("L", (picture.width // 8, picture.height // 8))  # the fastest pass over all of it
            picture.load()
    except OSError as error:
        return "truncated" in str(error)
    except Exception:  # headers raise errors of any kind; OpenCV has the last word
        return False
    return False


def _too_large(path: str, size: str) -> StrandcastError:
    what = f"the picture has {size}; strandcast decodes at most {MAX_PIXELS}, as in a video's frame"
    return StrandcastError("SC-V007", what, file=path, fix="take it with the video's resolution")
