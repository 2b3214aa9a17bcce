"""ArUco and ChArUco patterns by name, and detection of markers with subpixel corners."""

from collections.abc import Collection, Sequence

import cv2
import numpy as np

from strandcast.config.camera import Board
from strandcast.errors import StrandcastError

BLACK_BORDER_CELLS = 1
SIZES = (50, 100, 250, 1000)  # of the dictionaries of a family
# The largest dictionary of each family; smaller ones are its first markers.
FAMILIES = (
    "DICT_4X4_1000",
    "DICT_5X5_1000",
    "DICT_6X6_1000",
    "DICT_7X7_1000",
    "DICT_ARUCO_ORIGINAL",
    "DICT_APRILTAG_16h5",
    "DICT_APRILTAG_25h9",
    "DICT_APRILTAG_36h10",
    "DICT_APRILTAG_36h11",
)


def dictionary_named(name: str) -> cv2.aruco.Dictionary:
    """Return a predefined ArUco dictionary by its OpenCV name, e.g. ``DICT_4X4_50``."""
    key = name if name.startswith("DICT_") else f"DICT_{name}"
    if not hasattr(cv2.aruco, key):
        known = sorted(word for word in vars(cv2.aruco) if word.startswith("DICT_"))
        what, fix = f"there is no ArUco dictionary {name!r}", f"use one of {', '.join(known)}"
        raise StrandcastError("SC-W021", what, field="dictionary", fix=fix)
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, key))


def same_family(one: str, other: str) -> bool:
    """Return whether dictionaries start with the same markers, as ``DICT_4X4_50`` and ``DICT_4X4_250``."""
    return one == other or (one[5].isdigit() and one.rpartition("_")[0] == other.rpartition("_")[0])


def enough(family: str, last_id: int) -> tuple[str, str]:
    """Return the smallest dictionary like a `FAMILIES` one with an id, and words on larger ones."""
    for size in SIZES[:-1] * family.endswith(f"_{SIZES[-1]}"):
        if size > last_id:
            return f"{family.rpartition('_')[0]}_{size}", " or a larger one of its kind"
    return family, ""


class PatternedBoard(Board):
    """A board with its pattern, which photos show."""

    legacy: bool = False  # the layout of OpenCV before 4.6, which differs for even numbers of rows
    first_id: int = 0


def patterned(board: Board) -> PatternedBoard:
    """Return a board with its pattern; one that is only declared has OpenCV's, and ids from 0."""
    if isinstance(board, PatternedBoard):
        return board
    return PatternedBoard(**{name: getattr(board, name) for name in Board.model_fields})


def opencv_board(board: Board) -> cv2.aruco.CharucoBoard:
    """Return the board as OpenCV's object, sizes in metres.

    Raises
    ------
    StrandcastError
        SC-C002 the dictionary has too few markers for the board.
    """
    board, dictionary = patterned(board), dictionary_named(board.dictionary)
    ids = np.arange(board.squares_x * board.squares_y // 2) + board.first_id
    available = len(dictionary.bytesList)
    if ids[-1] >= available:
        what = f"the board has ids up to {ids[-1]} and {board.dictionary} has {available} markers"
        raise StrandcastError("SC-C002", what, field="board", fix="use a larger dictionary or fewer squares")
    made = cv2.aruco.CharucoBoard(
        (board.squares_x, board.squares_y), board.square_m, board.marker_m, dictionary, ids
    )
    made.setLegacyPattern(board.legacy)
    return made


def marker_cells(dictionary: str, marker: int) -> np.ndarray:
    """Return a marker's cells (side, side), True where black, the black border included."""
    found = dictionary_named(dictionary)
    if not 0 <= marker < len(found.bytesList):
        fix = f"use ids from 0 to {len(found.bytesList) - 1}"
        raise StrandcastError("SC-C002", f"{dictionary} has no marker {marker}", field="ids", fix=fix)
    side = found.markerSize + 2 * BLACK_BORDER_CELLS
    return np.asarray(found.generateImageMarker(marker, side, borderBits=BLACK_BORDER_CELLS) == 0)


def marker_detector(dictionary: str) -> cv2.aruco.ArucoDetector:
    """Return a detector with subpixel corners (OpenCV's default is whole pixels)."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    # `refine_square` starts from these. Measured with sides of 24 to 480 px: OpenCV's window of 0.3 cells
    # leaves 0.8 px with small markers, 0.9 cells 2 to 3 px where the white margin is 0.6 cells, and at most
    # 5 px, as often used, 4 px with large markers out of focus.
    parameters.relativeCornerRefinmentWinSize = 0.6
    parameters.cornerRefinementWinSize = 30
    parameters.cornerRefinementMaxIterations = 50
    parameters.cornerRefinementMinAccuracy = 0.005
    return cv2.aruco.ArucoDetector(dictionary_named(dictionary), parameters)


def detect_markers(grey: np.ndarray, detector: cv2.aruco.ArucoDetector) -> tuple[np.ndarray, np.ndarray]:
    """Return the ids (k,) and corners (k, 4, 2) [px] of the markers in a grey picture (height, width).

    Corners are top left, top right, bottom right, bottom left as printed. A detector (`marker_detector`) is
    built once for many frames.
    """
    corners, ids, _ = detector.detectMarkers(eight_bit(grey))
    if ids is None or len(ids) == 0:
        return np.zeros(0, int), np.zeros((0, 4, 2))
    return np.asarray(ids, int).reshape(-1), np.asarray(corners, float).reshape(-1, 4, 2)


def eight_bit(grey: np.ndarray) -> np.ndarray:
    """Return a picture as uint8; a deeper one is stretched from its 0.1 % to its 99.9 % grey level."""
    if grey.dtype == np.uint8:
        return grey
    low, high = np.percentile(grey, (0.1, 99.9))
    scaled = (grey.astype(np.float32) - low) * np.float32(255.0 / max(high - low, 1.0))
    return np.asarray(np.clip(np.rint(scaled), 0, 255).astype(np.uint8))


def corners_of(size_m: float) -> np.ndarray:
    """Return a marker's corners (4, 2) [m] relative to its centre, y up, in detection order."""
    return np.asarray(0.5 * size_m * np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]]))


def marker_side_px(
    pictures: Sequence[np.ndarray], dictionary: str, ids: Collection[int] = ()
) -> float | None:
    """Return the median side of the markers in pictures, of those with the ids if any are given."""
    detector = marker_detector(dictionary)
    found = [detect_markers(np.ascontiguousarray(eight_bit(one)), detector) for one in pictures]
    wanted = [four for one in found for marker, four in zip(*one, strict=True) if not ids or marker in ids]
    squares = np.array(wanted).reshape(-1, 4, 2)
    sides = np.linalg.norm(np.roll(squares, -1, axis=1) - squares, axis=2)
    return float(np.median(sides)) if len(sides) else None
