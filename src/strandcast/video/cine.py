"""Time stamps in a Phantom camera's cine file, which FFmpeg does not read.

Source: Vision Research, *Cine file format*: CINEFILEHEADER, SETUP and the tagged blocks between them and the
images; block 1002 holds one TIME64 (fraction in 2^-32 s, then seconds) per image.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import IO, TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np  # imported on use: the process that decodes other videos does without

IMAGE_TIMES = 1002
LONGEST_SPAN = 2.0  # of time stamps, relative to their median step times the images
COUNT_AT, SETUP_AT = 0x14, 0x1C  # in the header: number of images; positions of setup and image table
LENGTH_AT, FLIPS_AT = 142, 756  # in the setup: its length; bFlipH, then bFlipV


def cine_times_ns(path: str | Path) -> list[int] | None:
    """Return the time of each image [ns] from the first; None if the camera wrote none."""
    import numpy as np

    with Path(path).open("rb") as file:
        try:
            stamps = _image_times(file)
        except struct.error:  # the file ends before the header does
            return None
    if stamps is None or len(stamps) == 0:
        return None
    seconds = stamps[:, 1].astype(np.int64) - int(stamps[0, 1])
    # The lowest two bits of a fraction are flags.
    fraction = (stamps[:, 0] & ~np.uint32(3)).astype(np.float64) / 2.0**32
    times = seconds * 10**9 + np.rint(fraction * 1e9).astype(np.int64)
    return [int(time) for time in times - times[0]]


def clock_of_images_ns(path: str | Path, images: int) -> tuple[list[int] | None, str | None]:
    """Return `cine_times_ns` if they are a clock of that many images, or None; and a note if they jump."""
    import numpy as np

    times = cine_times_ns(path)
    if times is None or len(times) != images or images < 2:
        return None, None
    steps = np.diff(times)
    if steps.min() > 0 and steps.sum() <= LONGEST_SPAN * len(steps) * np.median(steps):
        return times, None
    worst = int(np.abs(steps - np.median(steps)).argmax())
    return None, (
        f"the camera's time stamps jump by {steps[worst] / 1e9:.4g} s after frame {worst}: "
        "its nominal rate is used"
    )


def cine_flips(path: str | Path) -> list[str]:
    """Return a note for each flip that a cine file requests; FFmpeg applies the vertical one only."""
    with Path(path).open("rb") as file:
        try:
            across, upside = _read(file, _read(file, SETUP_AT, "<I")[0] + FLIPS_AT, "<II")
        except struct.error:
            return []
    notes = ["its header requests a horizontal flip (bFlipH), which is not applied"] if across else []
    return notes + (["its header requests a vertical flip (bFlipV), which is applied"] if upside else [])


def _image_times(file: IO[bytes]) -> np.ndarray | None:
    """Return the TIME64 of all images, (N, 2) uint32, from their tagged block."""
    import numpy as np

    count = _read(file, COUNT_AT, "<I")[0]
    setup, images = _read(file, SETUP_AT, "<II")
    place = setup + _read(file, setup + LENGTH_AT, "<H")[0]
    while place + 8 <= images:
        size, kind = _read(file, place, "<IH")
        if size < 8:
            return None
        if kind == IMAGE_TIMES:
            file.seek(place + 8)
            stamps = file.read(min(size - 8, 8 * count))
            return np.frombuffer(stamps, "<u4", 2 * (len(stamps) // 8)).reshape(-1, 2)
        place += size
    return None


def _read(file: IO[bytes], place: int, layout: str) -> tuple[int, ...]:
    file.seek(place)
    return struct.unpack(layout, file.read(struct.calcsize(layout)))
