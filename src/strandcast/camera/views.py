"""The board's corners in photos, with subpixel precision, or the reason why there are too few."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from strandcast.camera.markers import eight_bit, opencv_board
from strandcast.config.camera import Board
from strandcast.errors import StrandcastError
from strandcast.records.camera import BoardView

MIN_CORNERS = 8  # chosen: in a photo that is used


@dataclass(frozen=True)
class BoardCorners:
    """The board's corners in one photo: positions on the board (m, 3) [m] and in the picture (m, 2) [px]."""

    name: str
    board_m: np.ndarray
    picture_px: np.ndarray


def find_board(grey: np.ndarray, board: Board) -> tuple[np.ndarray, np.ndarray]:
    """Return the board's corners detected in a picture: ids (m,) and subpixel positions (m, 2)."""
    found, ids, _, _ = cv2.aruco.CharucoDetector(opencv_board(board)).detectBoard(eight_bit(grey))
    if ids is None or len(ids) == 0:
        return np.zeros(0, int), np.zeros((0, 2))
    return np.asarray(ids, int).reshape(-1), np.asarray(found, float).reshape(-1, 2)


def check_sizes(images: Sequence[tuple[str, np.ndarray]]) -> None:
    """Refuse pictures of different sizes (SC-C012), or none (SC-C030)."""
    if not images:
        raise StrandcastError("SC-C030", "there are no board photos")
    first_name, first = images[0]
    for name, grey in images:
        if grey.shape != first.shape:
            sizes = [f"{each.shape[1]} x {each.shape[0]} px" for each in (grey, first)]
            raise StrandcastError("SC-C012", f"is {sizes[0]}, {first_name} is {sizes[1]}", file=name)


def board_corners(name: str, grey: np.ndarray, board: Board) -> tuple[BoardView, BoardCorners | None]:
    """Detect the board in one photo; if there are too few corners, the view gives the reason."""
    places = np.asarray(opencv_board(board).getChessboardCorners(), float)
    ids, picture_px = find_board(grey, board)
    view = BoardView(file=name, corners=len(ids), rms_px=None, used=False)
    if len(ids) < MIN_CORNERS:
        view.reason = f"fewer than {MIN_CORNERS} of the board's {len(places)} corners were detected"
    elif _on_one_line(places[ids]):
        view.reason = "the detected corners lie on one line"
    else:
        return view, BoardCorners(name, places[ids], picture_px)
    return view, None


def _on_one_line(places_m: np.ndarray) -> bool:
    widths = np.linalg.svd(places_m - places_m.mean(axis=0), compute_uv=False)
    return bool(widths[1] < 1e-6 * max(widths[0], 1e-12))
