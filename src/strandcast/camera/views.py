"""The board's corners in photos, or the reason why there are too few; the photos grouped by pose."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from strandcast.camera.markers import eight_bit, opencv_board
from strandcast.config.camera import Board
from strandcast.errors import StrandcastError
from strandcast.records.camera import BoardView

MIN_CORNERS = 8  # chosen: in a photo that is used
# Chosen: rms displacement of the shared corners, relative to the board's extent in the picture, up to which
# two photos show one pose. A board on a stand stays within 0.1 %; a tilt by 5 degrees moves its corners by
# about 1 %, but a tilt also moves the board's centre, so that 1 % separates deliberate poses.
SAME_POSE = 0.01
LEAST_SHARED = 4  # corners that both photos must show to be compared


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


def pose_groups(views: Sequence[BoardCorners]) -> np.ndarray:
    """Return the number of the distinct pose of each photo (n,), counted from 0 in the photos' order.

    Repeated photos of one pose share its errors and count once. A photo belongs to the first earlier photo,
    itself the first of its pose, that it repeats: a slow film of a moving board is not chained into one pose.
    """
    groups = np.empty(len(views), int)
    first: list[BoardCorners] = []
    for place, view in enumerate(views):
        repeated = (number for number, other in enumerate(first) if _same_pose(view, other))
        groups[place] = next(repeated, len(first))
        if groups[place] == len(first):
            first.append(view)
    return groups


def _same_pose(one: BoardCorners, other: BoardCorners) -> bool:
    """Return whether the corners shown in both photos are at the same places in the picture."""
    same = np.linalg.norm(one.board_m[:, None] - other.board_m[None], axis=2) < 1e-9
    mine, theirs = np.nonzero(same)
    if len(mine) < LEAST_SHARED:
        return False
    moved_px = one.picture_px[mine] - other.picture_px[theirs]
    extent_px = np.linalg.norm(np.ptp(one.picture_px, axis=0))
    return bool(np.sqrt((moved_px**2).sum(axis=1).mean()) < SAME_POSE * extent_px)
