"""The string's silhouette in one picture: the largest part that differs from the background."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from strandcast.errors import StrandcastError

# All chosen on the mBEST pictures and on drawn strings.
QUIET_PX = 1.0  # standard deviation of the blur that reduces noise before the threshold
NOISE_TIMES = 6.0  # lowest threshold, in standard deviations of the noise
LEAST_CONTRAST = 6.0  # lowest threshold, in grey levels of 255
BACKGROUND_SHARE = 0.25  # median window over the picture's shorter side: too large for a string to fill
THUMB_SIDE = 96  # px, shorter side of the thumbnail on which the median is taken
SHADED = 0.5  # of the threshold: pixels above it that touch the string belong to it
LEAST_AREA_PX = 30  # of a string
PINHOLE_SHARE = 0.25  # of the squared width: a loop of the string encloses more
LEAST_BESIDE_SHARE = 0.02  # of the string's area: smaller separate parts are ignored


@dataclass(frozen=True, eq=False)
class Silhouette:
    """The string's mask and how it was made; contrasts are in grey levels."""

    mask: np.ndarray  # (height, width) bool, one connected part
    contrast: np.ndarray | None  # (height, width) float32 to the background, positive for the string
    polarity: int  # +1 the string is brighter than the background, -1 darker, 0 unknown (a mask was given)
    threshold: float  # contrast after a blur of 1 px from which a pixel is string; 0.5 for a mask
    beside_share: float  # area that differs but does not touch the string, over the string's area


def read_image(path: Path, flags: int = cv2.IMREAD_COLOR) -> np.ndarray:
    """Return an image, colour as BGR; FileNotFoundError if it is missing or not an image."""
    image = cv2.imread(str(path), flags)
    if image is None:
        raise FileNotFoundError(2, "not an image", str(path))
    return np.asarray(image)


def find_silhouette(
    picture: np.ndarray,
    background: np.ndarray | None = None,
    polarity: int = 0,
    threshold: float | None = None,
) -> Silhouette:
    """Find the string: the largest connected part that differs from the background.

    Parameters
    ----------
    picture
        (height, width) grey or (height, width, 3) colour, of 8 bits.
    background
        The same scene without the string; None estimates it by a median over a window larger than the string.
    polarity
        +1 brighter, -1 darker, 0 chooses the sign that has more of the picture's contrast.
    threshold
        Contrast at the edge in grey levels, after the blur; None for Otsu's, at least six times the noise.

    Raises
    ------
    StrandcastError
        SC-T020 nothing differs from the background.
    """
    grey = _grey(picture)
    behind = usual_grey(grey) if background is None else _grey(background)
    difference = grey - behind
    quiet = cv2.GaussianBlur(difference, (0, 0), QUIET_PX)
    some = quiet[::4, ::4]
    noise = 1.48 * float(np.median(np.abs(some - np.median(some))))
    least = max(LEAST_CONTRAST, NOISE_TIMES * noise)
    signs = (1, -1) if polarity == 0 else (polarity,)
    tried = {sign: np.maximum(sign * quiet, 0.0) for sign in signs}
    sign = max(signs, key=lambda s: float(np.square(np.where(tried[s] > least, tried[s], 0.0)).sum()))
    if threshold is None:
        threshold = max(least, _otsu(tried[sign], least))
    mask, beside = largest_part(_above(tried[sign], threshold, max(least, SHADED * threshold)))
    return Silhouette(mask, np.maximum(sign * difference, 0.0), sign, float(threshold), beside)


def given_silhouette(mask: np.ndarray) -> Silhouette:
    """Return the silhouette of a mask (height, width): bool, or 0 where there is no string.

    Raises
    ------
    StrandcastError
        SC-T020 the mask is empty.
    """
    part, beside = largest_part(mask > 0)
    return Silhouette(part, None, 0, 0.5, beside)


def largest_part(mask: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the largest connected part without pinholes, and the area of other parts as a share of its own.

    A highlight may leave a pinhole in the string; the hole inside a loop is wider and is kept.

    Raises
    ------
    StrandcastError
        SC-T020 no part has 30 px² or more.
    """
    left, top, wide, high = cv2.boundingRect(mask.astype(np.uint8))
    inner = np.pad(mask[top : top + high, left : left + wide].astype(np.uint8), 1)
    _, labels, facts, _ = cv2.connectedComponentsWithStats(inner, connectivity=8)
    areas = facts[1:, cv2.CC_STAT_AREA]
    if not len(areas) or areas.max() < LEAST_AREA_PX:
        raise StrandcastError(
            "SC-T020", "no string is visible in the picture", fix="give a background, a threshold or a mask"
        )
    part = (labels == 1 + int(areas.argmax())).astype(np.uint8)
    outlines, nesting = cv2.findContours(part, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    width = 2.0 * float(areas.max()) / sum(len(outline) for outline in outlines)  # of a strip: area / length
    holes = [k for k in range(len(outlines)) if nesting[0, k, 3] >= 0]
    pinholes = [outlines[k] for k in holes if cv2.contourArea(outlines[k]) < PINHOLE_SHARE * width**2]
    cv2.drawContours(part, pinholes, -1, 1, cv2.FILLED)
    others = areas[areas >= LEAST_BESIDE_SHARE * areas.max()]
    whole = np.zeros(mask.shape, dtype=bool)
    whole[top : top + high, left : left + wide] = part[1:-1, 1:-1]
    return whole, float(others.sum() / areas.max() - 1.0)


def usual_grey(grey: np.ndarray) -> np.ndarray:
    """Return the median (height, width) over a window of a quarter of the picture, from a thumbnail."""
    height, width = grey.shape
    scale = min(1.0, THUMB_SIDE / min(height, width))
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    thumb = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    window = 2 * int(0.5 * BACKGROUND_SHARE * min(size)) + 1
    smooth = cv2.medianBlur(np.clip(np.rint(thumb), 0, 255).astype(np.uint8), max(3, window))
    return np.asarray(cv2.resize(smooth, (width, height), interpolation=cv2.INTER_LINEAR), dtype=np.float32)


def _above(contrast: np.ndarray, high: float, low: float) -> np.ndarray:
    """Return the parts above the low threshold that contain a pixel above the high one.

    A single threshold would cut a string where it lies in its own shadow.
    """
    count, labels = cv2.connectedComponents((contrast > low).astype(np.uint8), connectivity=8)
    strong = np.zeros(count, dtype=bool)
    strong[labels[contrast > high]] = True
    strong[0] = False
    return np.asarray(strong[labels])


def _grey(picture: np.ndarray) -> np.ndarray:
    """Return float32 grey levels: the mean of the channels, so that a saturated string keeps its contrast."""
    return np.asarray(picture.mean(axis=2) if picture.ndim == 3 else picture, dtype=np.float32)


def _otsu(contrast: np.ndarray, least: float) -> float:
    """Return Otsu's threshold between the contrast of the string and that of the background."""
    top = float(contrast.max())
    if top <= least:
        return least
    levels = (contrast * (255.0 / top)).astype(np.uint8)
    return float(cv2.threshold(levels, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)[0]) * top / 255.0
