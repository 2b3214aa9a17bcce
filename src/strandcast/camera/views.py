"""The board's corners in photos: found sub-pixel, of the right pattern, or the reason why not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from strandcast.camera.markers import (
    FAMILIES,
    CharucoBoard,
    detect_markers,
    eight_bit,
    marker_detector,
    opencv_board,
    same_family,
)
from strandcast.errors import StrandcastError
from strandcast.records.camera import View

TRIED = 4  # photos that are looked at again when something is wrong with all of them
PLAINLY = 0.5  # of the other reading's corners: fewer than that, and the other reading is meant
TAKE = "take ten photos of the ChArUco board, sharp, tilted, over the whole picture"


@dataclass(frozen=True)
class BoardCorners:
    """The board's corners in one photo: places on the board (m, 3) [m] and in the picture (m, 2) [px]."""

    name: str
    board_m: np.ndarray
    picture_px: np.ndarray


def find_board(grey: np.ndarray, board: CharucoBoard) -> tuple[np.ndarray, np.ndarray]:
    """Return the board's corners seen in a picture: ids (m,) and pixels (m, 2), sub-pixel."""
    found, ids, _, _ = cv2.aruco.CharucoDetector(opencv_board(board)).detectBoard(eight_bit(grey))
    if ids is None or len(ids) == 0:
        return np.zeros(0, int), np.zeros((0, 2))
    return np.asarray(ids, int).reshape(-1), np.asarray(found, float).reshape(-1, 2)


def common_size(images: Sequence[tuple[str, np.ndarray]]) -> tuple[int, int]:
    """Return width and height [px] of all pictures, or refuse pictures of unlike sizes."""
    if not images:
        raise StrandcastError("SC-C011", "there are no board photos", fix=TAKE)
    first_name, first = images[0]
    for name, grey in images:
        if grey.shape != first.shape:
            raise StrandcastError(
                "SC-C012",
                f"is {_size_words(grey)}, {first_name} is {_size_words(first)}",
                file=name,
                fix="calibrate with photos from the one camera and mode that films the throw",
            )
    return first.shape[1], first.shape[0]


def _size_words(grey: np.ndarray) -> str:
    return f"{grey.shape[1]} x {grey.shape[0]} px"


def settle_pattern(
    images: Sequence[tuple[str, np.ndarray]], board: CharucoBoard
) -> tuple[CharucoBoard, list[str]]:
    """Return the board with the pattern that the photos show, and a warning where it is not the one given.

    Boards with even rows printed by OpenCV before 4.6 begin with a white square, later ones with a black.
    """
    if board.rows % 2:
        return board, []
    other = replace(board, legacy=not board.legacy)
    given_count, other_count = (_corners_within(images, each) for each in (board, other))
    if given_count > PLAINLY * other_count or other_count == 0:
        return board, []
    name = "of the legacy pattern (OpenCV before 4.6)" if other.legacy else "not of the legacy pattern"
    return other, [f"the board is {name}: set camera.board.legacy to {str(other.legacy).lower()}"]


def _corners_within(images: Sequence[tuple[str, np.ndarray]], board: CharucoBoard) -> int:
    """Return how many corners the first few photos show, read as this board."""
    return sum(len(find_board(grey, board)[0]) for _, grey in images[:TRIED])


def board_corners(
    name: str, grey: np.ndarray, board: CharucoBoard, least: int
) -> tuple[View, BoardCorners | None]:
    """Find the board in one photo; the view tells why where too little of it is seen."""
    places = np.asarray(opencv_board(board).getChessboardCorners(), float)
    ids, picture_px = find_board(grey, board)
    view = View(file=name, corners=len(ids), rms_px=None, used=False)
    if len(ids) < least:
        view.reason = f"only {len(ids)} of {len(places)} corners seen, at least {least} are needed"
    elif _on_one_line(places[ids]):
        view.reason = "the corners seen lie on one line"
    else:
        return view, BoardCorners(name, places[ids], picture_px)
    return view, None


def _on_one_line(places_m: np.ndarray) -> bool:
    spread = np.linalg.svd(places_m - places_m.mean(axis=0), compute_uv=False)
    return bool(spread[1] < 1e-6 * max(spread[0], 1e-12))


def refuse_unseen(images: Sequence[tuple[str, np.ndarray]], board: CharucoBoard) -> None:
    """Raise what is wrong with the board's description, where another one finds it in the photos."""
    turned = replace(board, columns=board.rows, rows=board.columns)
    if turned != board and _seen_as(images, turned):
        raise StrandcastError(
            "SC-C016",
            f"the board has {turned.columns} x {turned.rows} squares, not {board.columns} x {board.rows}",
            field="camera.board",
            fix=f"set squares_x: {turned.columns} and squares_y: {turned.rows}",
        )
    flipped = [(name, np.ascontiguousarray(grey[:, ::-1])) for name, grey in images[:TRIED]]
    if _seen_as(flipped, board):
        raise StrandcastError(
            "SC-C023",
            "the board photos are mirrored: their mirror images show the board",
            file=images[0][0],
            fix="turn mirroring off in the camera's software, or take the mirror away",
        )
    for name in FAMILIES:
        if not same_family(name, board.dictionary) and _markers_seen(images, name, board):
            raise StrandcastError(
                "SC-C017",
                f"the board's markers are of {name} or a part of it, not of {board.dictionary}",
                field="camera.board.dictionary",
                fix="correct the dictionary",
            )


def _seen_as(images: Sequence[tuple[str, np.ndarray]], board: CharucoBoard) -> bool:
    """Tell whether most of the first photos show most of this board."""
    corners = (board.columns - 1) * (board.rows - 1)
    shown = [
        len(find_board(grey, settle_pattern([(name, grey)], board)[0])[0]) for name, grey in images[:TRIED]
    ]
    return float(np.median(shown)) > PLAINLY * corners


def _markers_seen(images: Sequence[tuple[str, np.ndarray]], dictionary: str, board: CharucoBoard) -> bool:
    detector = marker_detector(dictionary)
    wanted = board.columns * board.rows // 2
    shown = [
        sum(marker < wanted for marker in set(detect_markers(grey, detector)[0].tolist()))
        for _, grey in images[:TRIED]
    ]
    return float(np.median(shown)) > PLAINLY * wanted
