"""Pictures of the worst frames: the truth and the track drawn over a part of the frame, enlarged."""

from pathlib import Path

import cv2
import numpy as np

from strandcast.video.reader import open_video
from strandcast_studies.benchmarks.video.score import Errors, ScoredTrack
from strandcast_studies.benchmarks.video.truth import ON_THE_STRING_M, Truth

TIMES, MARGIN_PX, LEAST_PX = 4, 24, 120
REACH = 3  # mass points shown on both sides of the wrong ones
SHIFT = 4  # bits of a pixel's fraction, as OpenCV draws
# Okabe and Ito's colours, BGR: distinguishable with any colour vision.
TRUE, FOUND, DOUBTFUL, HIDDEN = (115, 158, 0), (0, 94, 213), (0, 159, 230), (178, 114, 0)
WEBP_QUALITY = 80


def picture(video: Path, truth: Truth, track: ScoredTrack, errors: Errors, frame: int) -> np.ndarray:
    """Return a frame's part around its worst points, (h, w, 3) BGR."""
    grey = frame_of(video, frame)
    count = track.points_m.shape[1] - 1
    true = truth.pixels(truth.points_m(count)[frame])
    found = truth.pixels(track.points_m[frame, 1:])
    left, top, right, bottom = _box(true, found, errors, frame, grey.shape)
    big = cv2.resize(grey[top:bottom, left:right], None, fx=TIMES, fy=TIMES, interpolation=cv2.INTER_CUBIC)
    out = cv2.cvtColor(big, cv2.COLOR_GRAY2BGR)
    corner = np.array([left, top])
    dense = np.arange(0.0, float(truth.arrays.length_m), ON_THE_STRING_M)
    curve = truth.pixels(truth.at(dense)[frame])
    cv2.polylines(out, [_fine(curve, corner)], False, TRUE, 1, cv2.LINE_AA, SHIFT)
    for k, (at, visible) in enumerate(zip(true, errors.visible[frame], strict=True)):
        _ring(out, at, corner, TRUE if visible else HIDDEN, 5)
        if errors.placed[frame, k]:
            colour = DOUBTFUL if errors.flagged[frame, k] else FOUND
            _ring(out, found[k], corner, colour, 3)
            way = _fine(np.stack([at, found[k]]), corner)
            cv2.polylines(out, [way], False, colour, 1, cv2.LINE_AA, SHIFT)
    return np.asarray(out)


def frame_of(video: Path, frame: int) -> np.ndarray:
    """Return one frame (H, W) uint8."""
    with open_video(video) as opened:
        for index, _, grey in opened:
            if index == frame:
                return np.array(grey)
    raise IndexError(frame)


def _box(
    true: np.ndarray, found: np.ndarray, errors: Errors, frame: int, shape: tuple[int, ...]
) -> tuple[int, int, int, int]:
    """Return left, top, right and bottom of the part with the worst points and their neighbours."""
    off = np.where(errors.visible[frame], np.nan_to_num(errors.overall_px[frame], nan=99.0), 0.0)
    chosen = np.flatnonzero(off > max(0.5 * off.max(), 1.0))
    near = np.arange(max(0, chosen.min(initial=0) - REACH), min(len(off), chosen.max(initial=0) + REACH + 1))
    places = np.vstack([true[near], found[near][np.isfinite(found[near]).all(axis=1)]])
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    half = np.maximum(0.5 * np.ptp(places, axis=0) + MARGIN_PX, LEAST_PX / 2)
    limit = np.array(shape[::-1])
    low = np.clip(middle - half, 0, limit - LEAST_PX).astype(int)
    high = np.clip(middle + half, low + LEAST_PX, limit).astype(int)
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def _fine(places: np.ndarray, corner: np.ndarray) -> np.ndarray:
    """Return places (..., 2) px of the frame as OpenCV's fixed-point pixels of the enlarged part."""
    return np.asarray(np.rint(((places - corner + 0.5) * TIMES - 0.5) * (1 << SHIFT)).astype(np.int32))


def _ring(out: np.ndarray, at: np.ndarray, corner: np.ndarray, colour: tuple[int, int, int], px: int) -> None:
    x, y = _fine(at, corner).tolist()
    cv2.circle(out, (x, y), px << SHIFT, colour, 1, cv2.LINE_AA, SHIFT)
