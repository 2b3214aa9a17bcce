"""The board's corners in photos, with subpixel precision, or the reason why there are too few."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from strandcast.camera.markers import (
    FAMILIES,
    detect_markers,
    eight_bit,
    marker_detector,
    opencv_board,
    same_family,
)
from strandcast.config.camera import Board
from strandcast.errors import StrandcastError
from strandcast.records.camera import BoardView

MIN_CORNERS = 8  # chosen: in a photo that is used
TRIED = 4  # chosen: photos examined again if no photo is usable
MAJORITY = 0.5  # chosen: share of corners below which another reading of the board is preferred
RETAKE = "take ten sharp photos of the ChArUco board, tilted, all over the picture"


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
    """Refuse pictures of different sizes (SC-C012), or none (SC-C011)."""
    if not images:
        raise StrandcastError("SC-C011", "there are no board photos", fix=RETAKE)
    first_name, first = images[0]
    for name, grey in images:
        if grey.shape != first.shape:
            sizes = [f"{each.shape[1]} x {each.shape[0]} px" for each in (grey, first)]
            fix = "use photos from the camera and mode used for filming"
            raise StrandcastError("SC-C012", f"is {sizes[0]}, {first_name} is {sizes[1]}", file=name, fix=fix)


def detect_pattern(
    images: Sequence[tuple[str, np.ndarray]], board: Board, field: str = "camera.board"
) -> tuple[Board, list[str]]:
    """Return the board with the pattern that the photos show, and a warning if it is not the declared one.

    `field` is where the experiment declares the board. Boards with an even number of rows start with a white
    square before OpenCV 4.6, with a black one since.
    """
    if board.squares_y % 2:
        return board, []
    other = board.model_copy(update={"legacy": not board.legacy})
    given_count, other_count = (
        sum(len(find_board(grey, each)[0]) for _, grey in images[:TRIED]) for each in (board, other)
    )
    if given_count > MAJORITY * other_count or other_count == 0:
        return board, []
    has = "has" if other.legacy else "does not have"
    hint = f"set {field}.legacy to {str(other.legacy).lower()}"
    return other, [f"the board {has} the legacy pattern (OpenCV before 4.6): {hint}"]


def board_corners(name: str, grey: np.ndarray, board: Board) -> tuple[BoardView, BoardCorners | None]:
    """Detect the board in one photo; if there are too few corners, the view gives the reason."""
    places = np.asarray(opencv_board(board).getChessboardCorners(), float)
    ids, picture_px = find_board(grey, board)
    view = BoardView(file=name, corners=len(ids), rms_px=None, used=False)
    if len(ids) < MIN_CORNERS:
        view.reason = f"only {len(ids)} of {len(places)} corners detected; at least {MIN_CORNERS} are needed"
    elif _on_one_line(places[ids]):
        view.reason = "the detected corners lie on one line"
    else:
        return view, BoardCorners(name, places[ids], picture_px)
    return view, None


def _on_one_line(places_m: np.ndarray) -> bool:
    widths = np.linalg.svd(places_m - places_m.mean(axis=0), compute_uv=False)
    return bool(widths[1] < 1e-6 * max(widths[0], 1e-12))


def explain_missing_board(images: Sequence[tuple[str, np.ndarray]], board: Board) -> None:
    """Refuse the board's declaration if another one matches the photos."""
    turned = board.model_copy(update={"squares_x": board.squares_y, "squares_y": board.squares_x})
    if turned != board and _matches(images, turned):
        x, y = turned.squares_x, turned.squares_y
        what = f"the board has {x} x {y} squares, not {board.squares_x} x {board.squares_y}"
        fix = f"set squares_x: {x} and squares_y: {y}"
        raise StrandcastError("SC-C016", what, field="camera.board", fix=fix)
    flipped = [(name, np.ascontiguousarray(grey[:, ::-1])) for name, grey in images[:TRIED]]
    if _matches(flipped, board):
        fix = "turn mirroring off in the camera's software, or remove the mirror"
        raise StrandcastError("SC-C023", "the board photos are mirrored", file=images[0][0], fix=fix)
    for name in FAMILIES:
        if not same_family(name, board.dictionary) and _markers_match(images, name, board):
            what = f"the board's markers are from {name} or a subset of it, not from {board.dictionary}"
            field = "camera.board.dictionary"
            raise StrandcastError("SC-C017", what, field=field, fix="correct the dictionary")


def _matches(images: Sequence[tuple[str, np.ndarray]], board: Board) -> bool:
    """Return whether most of the first photos show most of this board."""
    corners = (board.squares_x - 1) * (board.squares_y - 1)
    shown = [
        len(find_board(grey, detect_pattern([(name, grey)], board)[0])[0]) for name, grey in images[:TRIED]
    ]
    return float(np.median(shown)) > MAJORITY * corners


def _markers_match(images: Sequence[tuple[str, np.ndarray]], dictionary: str, board: Board) -> bool:
    detector = marker_detector(dictionary)
    wanted = board.squares_x * board.squares_y // 2
    shown = [
        sum(marker < wanted for marker in set(detect_markers(grey, detector)[0].tolist()))
        for _, grey in images[:TRIED]
    ]
    return float(np.median(shown)) > MAJORITY * wanted
