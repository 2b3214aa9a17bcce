"""The string in single frames of a film, before it is known where it is held."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from skimage.filters import apply_hysteresis_threshold, threshold_otsu
from skimage.graph import MCP
from skimage.measure import label
from skimage.morphology import skeletonize

from strandcast.camera.markers import detect_markers, marker_detector

# All chosen on drawn films (docs/how-to/track-a-film.md).
THIN_SHARE = 0.02  # of the picture's height: wider things are no string
FLOOR, LEAST_LINE = 3.0, 6.0  # grey levels: of what compression leaves, and of a line that is a string
FAINT_SHARE = 0.5  # of the level that separates string and background, down to which a line goes on
LEAST_PATH_PX = 30
SPUR_PX = 8  # at each end of a path, where thinning may bend it towards a corner
STAIRS_PX = 4  # a path of pixels has stairs, which make it longer than the line
LONGEST_ADDED = 0.25  # of the path, by which it is followed to each end
TURNS = (-0.3, -0.15, 0.0, 0.15, 0.3)  # rad, from one pixel to the next
LONG_SHARE = 95  # percentile of the frames' lengths: where a string crosses itself, its path is cut short
SPREAD_SHARE = 0.005  # of the picture's diagonal, within which ends of the string are at one place
AGREED_SHARE = 0.7  # of the frames, that must show an end of the string at one place
RESTING_SHARE = 0.4  # of the frames: less than half, since a median keeps what half of them show
RIM = 1.5  # a marker with its white rim, over the marker


@dataclass(frozen=True, eq=False)
class SeenString:
    """What single frames show of the string without knowing where it is held."""

    shown: np.ndarray  # (K,) which of the pictures show it
    ends_px: np.ndarray  # (K, 2, 2) both ends of its path there
    length_px: float
    middle_px: np.ndarray  # (2,) of all its pixels
    resting: np.ndarray  # (H, W) where it is in most of them, as beside an end that is held still


def seen_string(
    pictures: Sequence[np.ndarray],
    background: np.ndarray,
    polarity: float | None = None,
    near_px: tuple[float, float] | None = None,
) -> SeenString | None:
    """Return the longest thin path that differs from the empty scene in each picture; None without any.

    With a polarity (1 bright, -1 dark) only such lines; with a place, the path that comes nearest to it.
    """
    found = {}
    for k, picture in enumerate(pictures):
        path = longest_path(line_mask(picture, background, polarity), near_px)
        if path is not None:
            found[k] = to_the_ends(path, picture)
    if not found:
        return None
    lengths = [float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) for path in found.values()]
    ends = np.array([(path[0], path[-1]) for path in found.values()])
    middle = np.concatenate(list(found.values())).mean(axis=0)
    there = np.zeros(background.shape, np.float32)
    for path in found.values():
        drawn = np.zeros(background.shape, np.uint8)
        cv2.polylines(drawn, [np.rint(path).astype(np.int32)], False, 1, thin_px(len(background)))
        there += drawn
    resting = there > RESTING_SHARE * len(found)
    length_px = float(np.percentile(lengths, LONG_SHARE))
    return SeenString(np.array(list(found)), ends, length_px, middle, resting)


def eight_bit_of(pictures: list[np.ndarray]) -> list[np.ndarray]:
    """Return pictures in 8 bits, with the same factor for all: files of 16 bits often use 10 or 12."""
    if pictures[0].dtype == np.uint8:
        return pictures
    unused = max(0, max(int(one.max()) for one in pictures).bit_length() - 8)
    return [(one >> unused).astype(np.uint8) for one in pictures]


def thin_px(height_px: int) -> int:
    """Return the width of the widest string, an odd number of pixels."""
    return 2 * max(3, round(0.5 * THIN_SHARE * height_px)) + 1


def thin_lines(levels: np.ndarray) -> np.ndarray:
    """Return how much thin lines (H, W) are above what is around them."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (thin_px(len(levels)),) * 2)
    smooth = cv2.GaussianBlur(levels, (0, 0), 1.0)
    return np.asarray(cv2.morphologyEx(smooth, cv2.MORPH_TOPHAT, kernel))


def line_mask(picture: np.ndarray, background: np.ndarray, polarity: float | None) -> np.ndarray:
    """Return where (H, W) a picture shows a thin line, dark or bright, that the empty scene does not."""
    change = picture.astype(np.float32) - background
    line = (
        np.maximum(thin_lines(change), thin_lines(-change))
        if polarity is None
        else thin_lines(polarity * change)
    )
    clear = line[line > FLOOR]
    high = max(LEAST_LINE, float(threshold_otsu(clear))) if len(clear) else LEAST_LINE
    return np.asarray(apply_hysteresis_threshold(line, FAINT_SHARE * high, high))


def longest_path(mask: np.ndarray, near_px: tuple[float, float] | None = None) -> np.ndarray | None:
    """Return the longest path (K, 2) px of a mask's skeleton from end to end; None if all are short.

    With a place, the path of the part that comes nearest to it.
    """
    parts = label(skeletonize(mask), connectivity=2)
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    largest = int(np.argmax(sizes))
    if near_px is not None:
        v, u = np.nonzero(sizes[parts] >= LEAST_PATH_PX)
        if len(u):
            nearest = int(np.argmin((u - near_px[0]) ** 2 + (v - near_px[1]) ** 2))
            largest = int(parts[v[nearest], u[nearest]])
    if sizes[largest] < LEAST_PATH_PX:
        return None
    low, high = (edge(np.argwhere(parts == largest), axis=0) for edge in (np.min, np.max))
    part = parts[low[0] : high[0] + 1, low[1] : high[1] + 1] == largest
    end = tuple(np.argwhere(part)[0])
    for _ in range(2):  # the pixel farthest from any pixel is an end; the farthest from that is the other
        routes = MCP(np.where(part, 1.0, -1.0))
        cost, _ = routes.find_costs([end])
        end = np.unravel_index(np.argmax(np.where(part & np.isfinite(cost), cost, -1.0)), part.shape)
    path: np.ndarray = np.asarray(routes.traceback(end))[:, ::-1] + low[::-1]
    return path if len(path) >= LEAST_PATH_PX else None


def to_the_ends(path: np.ndarray, picture: np.ndarray) -> np.ndarray:
    """Return every fourth place of a path of pixels, since stairs are longer than a line, up to both ends.

    A string hardly moves near a held end, where it differs from the empty scene by nothing: there the line is
    followed in the picture itself, until it is half as clear as usual.
    """
    levels = picture.astype(np.float32)
    line = max((thin_lines(levels), thin_lines(-levels)), key=lambda one: one[path[:, 1], path[:, 0]].mean())
    least = 0.5 * float(np.median(line[path[:, 1], path[:, 0]]))
    coarse = path[SPUR_PX:-SPUR_PX:STAIRS_PX].astype(float)
    ends = []
    for place, inside in ((coarse[0], coarse[2]), (coarse[-1], coarse[-3])):
        angle, added = np.arctan2(*(place - inside)[::-1]), [place]
        for _ in range(SPUR_PX + round(LONGEST_ADDED * len(path))):
            turned = angle + np.array(TURNS)
            steps = added[-1] + np.stack([np.cos(turned), np.sin(turned)], axis=1)
            level = cv2.remap(line, steps[None].astype(np.float32), None, cv2.INTER_LINEAR)[0]
            best = int(np.argmax(level))
            if level[best] < least:
                break
            angle, added = turned[best], [*added, steps[best]]
        ends.append(np.array(added[1:]).reshape(-1, 2))
    return np.vstack([ends[0][::-1], coarse, ends[1]])


def agreed_ends(ends_px: np.ndarray, spread_px: float) -> list[np.ndarray]:
    """Return the places (2,), at most two, where nearly all frames show an end of the string (K, 2, 2)."""
    left, found = ends_px.reshape(-1, 2), []
    for _ in range(2):
        near = np.linalg.norm(left[:, None] - left, axis=2) < spread_px
        best = near[int(np.argmax(near.sum(axis=1)))] if len(left) else np.zeros(0, bool)
        if best.sum() < AGREED_SHARE * len(ends_px):
            break
        found.append(np.median(left[best], axis=0))
        left = left[~best]
    return found


def without_markers(picture: np.ndarray, background: np.ndarray, dictionary: str) -> np.ndarray:
    """Return a picture with the empty scene in place of its markers, which are full of lines."""
    _, corners = detect_markers(np.ascontiguousarray(picture), marker_detector(dictionary))
    covered = np.zeros(picture.shape, np.uint8)
    for four in corners:
        middle = four.mean(axis=0)
        cv2.fillConvexPoly(covered, np.rint(middle + RIM * (four - middle)).astype(np.int32), 1)
    return np.where(covered > 0, background, picture)


def without_resting_string(background: np.ndarray, seen: SeenString) -> np.ndarray:
    """Return the empty scene without the string where it rests, filled from beside it."""
    if not seen.resting.any():
        return background
    filled = cv2.inpaint(background.astype(np.float32), seen.resting.astype(np.uint8), 3.0, cv2.INPAINT_NS)
    return np.where(seen.resting, np.rint(filled), background).astype(background.dtype)
