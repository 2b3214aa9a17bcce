"""Write a picture file atomically."""

from pathlib import Path

import cv2
import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.files import write_bytes


def write_picture(path: Path, image: np.ndarray, webp_quality: int | None = None) -> None:
    """Write a grey or BGR picture in the format of the path's suffix.

    OpenCV encodes it in memory: its own writer reports a full disk by a return value at most.

    Raises
    ------
    StrandcastError
        SC-V007 the format cannot hold it; SC-R041, SC-W002 see `atomic_write`.
    """
    options = [] if webp_quality is None else [cv2.IMWRITE_WEBP_QUALITY, webp_quality]
    try:
        encoded, data = cv2.imencode(path.suffix, image, options)
    except cv2.error:
        encoded = False
    if not encoded:
        raise StrandcastError(
            "SC-V007",
            f"a picture of {image.shape[1]} x {image.shape[0]} px cannot be encoded as {path.suffix}",
            file=path,
            fix="crop the video; WebP holds 16383 px in width and height",
        )
    write_bytes(path, data.tobytes())
