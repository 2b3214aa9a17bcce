"""Selection of frames from a lens video: sharp, each with the board in a different pose."""

from collections.abc import Iterable

import cv2
import numpy as np

from strandcast.camera.markers import eight_bit
from strandcast.camera.views import BoardCorners, board_corners
from strandcast.config.camera import Board
from strandcast.records.camera import BoardView

KEPT = 24  # chosen: frames used in the fit
SHARP_SHARE = 0.7  # chosen: least sharpness relative to the upper quartile
DIRECTIONS = np.array([[1.0, 0.0], [0.0, 1.0], [0.7071, 0.7071], [0.7071, -0.7071]])
WINDOW_PX = 6  # chosen: half the window around a corner


def choose_frames(
    frames: Iterable[tuple[str, np.ndarray]], board: Board, kept: int = KEPT
) -> list[tuple[BoardView, BoardCorners | None]]:
    """Detect the board in every frame and keep a few that are sharp and different from each other.

    `frames` (name, grey picture) are streamed, and no picture is stored. The result has at most `kept` of
    them, in order; all views with their reasons if no frame qualifies.
    """
    views, usable, sharpness = [], [], []
    for name, grey in frames:
        view, corners = board_corners(name, grey, board)
        views.append(view)
        if corners is not None:
            usable.append((view, corners))
            sharpness.append(corner_sharpness(grey, corners.picture_px))
    if not usable:
        return [(view, None) for view in views]
    sharp = np.array(sharpness) >= SHARP_SHARE * np.percentile(sharpness, 75)
    poses = np.array([_pose_of(corners) for _, corners in usable])
    chosen = _most_different(poses, np.flatnonzero(sharp), np.array(sharpness), kept)
    return [usable[k] for k in chosen]


def corner_sharpness(grey: np.ndarray, corners_px: np.ndarray) -> float:
    """Return the edge slope at the corners over the contrast [1/px], median over corners.

    The smallest slope of four directions counts: motion blur smears along one of them.
    """
    picture = eight_bit(grey)
    slopes_px = []
    for u, v in np.rint(corners_px).astype(int):
        window = picture[max(v - WINDOW_PX, 0) : v + WINDOW_PX + 1, max(u - WINDOW_PX, 0) : u + WINDOW_PX + 1]
        smooth = cv2.GaussianBlur(window, (3, 3), 0).astype(float)
        slopes = np.abs(np.tensordot(DIRECTIONS, np.array(np.gradient(smooth)), axes=1))
        contrast = np.percentile(smooth, 95) - np.percentile(smooth, 5)
        slopes_px.append(np.percentile(slopes, 95, axis=(1, 2)).min() / max(contrast, 1.0))
    return float(np.median(slopes_px))


def _pose_of(corners: BoardCorners) -> np.ndarray:
    """Return a feature vector (6,): position, size, roll and both tilts, of similar scale."""
    plane_m, pixels = corners.board_m[:, :2], corners.picture_px
    size_m, size_px = np.ptp(plane_m, axis=0).max(), np.ptp(pixels, axis=0).max()
    centred = (plane_m - plane_m.mean(axis=0)) / size_m
    homography, _ = cv2.findHomography(centred, (pixels - pixels.mean(axis=0)) / size_px)
    if homography is None:
        return np.zeros(6)
    roll = np.arctan2(homography[1, 0], homography[0, 0])
    place = pixels.mean(axis=0) / 500.0
    return np.array([*place, np.log(size_px), 0.5 * roll, 3.0 * homography[2, 0], 3.0 * homography[2, 1]])


def _most_different(poses: np.ndarray, usable: np.ndarray, sharpness: np.ndarray, kept: int) -> list[int]:
    """Return the sharpest usable view and, greedily, those farthest from all chosen ones."""
    chosen = [int(usable[np.argmax(sharpness[usable])])]
    nearest = np.linalg.norm(poses - poses[chosen[0]], axis=1)
    while len(chosen) < min(kept, len(usable)):
        new = int(usable[np.argmax(nearest[usable])])
        if nearest[new] <= 0:
            break
        chosen.append(new)
        nearest = np.minimum(nearest, np.linalg.norm(poses - poses[new], axis=1))
    return sorted(chosen)
