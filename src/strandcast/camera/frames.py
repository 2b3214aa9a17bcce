"""The frames of a lens video worth keeping: sharp, and the board each time in another place or pose."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from strandcast.camera.markers import CharucoBoard, eight_bit
from strandcast.camera.views import BoardCorners, board_corners
from strandcast.records.camera import View

KEPT = 24  # frames that are fitted
SHARP_SHARE = 0.7  # of the sharpest quarter's sharpness, below which a frame is blurred
DIRECTIONS = np.array([[1.0, 0.0], [0.0, 1.0], [0.7071, 0.7071], [0.7071, -0.7071]])
WINDOW_PX = 6  # to either side of a corner


def choose_frames(
    frames: Iterable[tuple[str, np.ndarray]], board: CharucoBoard, least_corners: int, kept: int = KEPT
) -> list[tuple[View, BoardCorners | None]]:
    """Look for the board in every frame given, and keep few that are sharp and unlike each other.

    Parameters
    ----------
    frames
        (name, grey picture), streamed; no picture is kept.
    board
        As printed, its pattern settled.
    least_corners
        Frames with fewer corners are not kept.
    kept
        How many frames at most.

    Returns
    -------
    list
        View and corners of the chosen frames, in order; where none will do, all views with their reasons.
    """
    views, seen, sharpness = [], [], []
    for name, grey in frames:
        view, corners = board_corners(name, grey, board, least_corners)
        views.append(view)
        if corners is not None:
            seen.append((view, corners))
            sharpness.append(corner_sharpness(grey, corners.picture_px))
    if not seen:
        return [(view, None) for view in views]
    sharp = np.array(sharpness) >= SHARP_SHARE * np.percentile(sharpness, 75)
    poses = np.array([_pose_of(corners) for _, corners in seen])
    chosen = _unlike(poses, np.flatnonzero(sharp), np.array(sharpness), kept)
    return [seen[k] for k in chosen]


def corner_sharpness(grey: np.ndarray, corners_px: np.ndarray) -> float:
    """Return how steep the edges at the corners are [1/px]: slope over contrast, median over corners.

    Of four directions the one with the least slope counts: motion smears along one alone.
    """
    picture = eight_bit(grey)
    steep = []
    for u, v in np.rint(corners_px).astype(int):
        window = picture[max(v - WINDOW_PX, 0) : v + WINDOW_PX + 1, max(u - WINDOW_PX, 0) : u + WINDOW_PX + 1]
        smooth = cv2.GaussianBlur(window, (3, 3), 0).astype(float)
        slopes = np.abs(np.tensordot(DIRECTIONS, np.array(np.gradient(smooth)), axes=1))
        contrast = np.percentile(smooth, 95) - np.percentile(smooth, 5)
        steep.append(np.percentile(slopes, 95, axis=(1, 2)).min() / max(contrast, 1.0))
    return float(np.median(steep))


def _pose_of(corners: BoardCorners) -> np.ndarray:
    """Return what tells views apart (6,): place, size, roll and both tilts, each of about the same weight."""
    plane_m, pixels = corners.board_m[:, :2], corners.picture_px
    size_m, size_px = np.ptp(plane_m, axis=0).max(), np.ptp(pixels, axis=0).max()
    centred = (plane_m - plane_m.mean(axis=0)) / size_m
    homography, _ = cv2.findHomography(centred, (pixels - pixels.mean(axis=0)) / size_px)
    if homography is None:
        return np.zeros(6)
    roll = np.arctan2(homography[1, 0], homography[0, 0])
    place = pixels.mean(axis=0) / 500.0
    return np.array([*place, np.log(size_px), 0.5 * roll, 3.0 * homography[2, 0], 3.0 * homography[2, 1]])


def _unlike(poses: np.ndarray, usable: np.ndarray, sharpness: np.ndarray, kept: int) -> list[int]:
    """Return the sharpest usable view and those, one after the other, farthest from all chosen before."""
    chosen = [int(usable[np.argmax(sharpness[usable])])]
    nearest = np.linalg.norm(poses - poses[chosen[0]], axis=1)
    while len(chosen) < min(kept, len(usable)):
        new = int(usable[np.argmax(nearest[usable])])
        if nearest[new] <= 0:
            break
        chosen.append(new)
        nearest = np.minimum(nearest, np.linalg.norm(poses - poses[new], axis=1))
    return sorted(chosen)
