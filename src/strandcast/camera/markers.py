"""The ArUco and ChArUco patterns by name, and the finding of markers with sub-pixel corners."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from strandcast.errors import StrandcastError

BLACK_BORDER_CELLS = 1
# The largest dictionary of each family: the smaller ones are its first markers.
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


@dataclass(frozen=True)
class CharucoBoard:
    """A chessboard with ArUco markers in its white squares; `legacy` is the pattern before OpenCV 4.6."""

    columns: int
    rows: int
    square_m: float
    marker_m: float
    dictionary: str
    legacy: bool = False


def dictionary_named(name: str) -> cv2.aruco.Dictionary:
    """Return a predefined ArUco dictionary by its OpenCV name, e.g. ``DICT_4X4_50``."""
    key = name if name.startswith("DICT_") else f"DICT_{name}"
    if not hasattr(cv2.aruco, key):
        known = sorted(word for word in vars(cv2.aruco) if word.startswith("DICT_"))
        raise StrandcastError(
            "SC-C001",
            f"there is no ArUco dictionary {name!r}",
            field="dictionary",
            fix=f"use one of {', '.join(known)}",
        )
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, key))


def same_family(one: str, other: str) -> bool:
    """Tell whether two dictionaries begin with the same markers, as ``DICT_4X4_50`` and ``DICT_4X4_250``."""
    return one == other or (one[5].isdigit() and one.rpartition("_")[0] == other.rpartition("_")[0])


def opencv_board(board: CharucoBoard) -> cv2.aruco.CharucoBoard:
    """Return the board as OpenCV's object, sizes in metres.

    Raises
    ------
    StrandcastError
        Fewer than three squares a side, or a marker that does not fit its square.
    """
    if board.columns < 3 or board.rows < 3 or not 0 < board.marker_m < board.square_m:
        raise StrandcastError(
            "SC-C002",
            f"a ChArUco board of {board.columns} x {board.rows} squares of {board.square_m} m "
            f"with markers of {board.marker_m} m cannot be made",
            field="board",
            fix="give at least 3 x 3 squares, and markers smaller than the squares",
        )
    dictionary = dictionary_named(board.dictionary)
    needed, known = board.columns * board.rows // 2, len(dictionary.bytesList)
    if needed > known:
        raise StrandcastError(
            "SC-C002",
            f"the board needs {needed} markers and {board.dictionary} has {known}",
            field="board",
            fix="use a larger dictionary or fewer squares",
        )
    made = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square_m, board.marker_m, dictionary)
    made.setLegacyPattern(board.legacy)
    return made


def marker_cells(dictionary: str, marker: int) -> np.ndarray:
    """Return a marker's cells (side, side), True where black, the black border included."""
    found = dictionary_named(dictionary)
    if not 0 <= marker < len(found.bytesList):
        raise StrandcastError(
            "SC-C003",
            f"{dictionary} has no marker {marker}",
            field="ids",
            fix=f"use ids from 0 to {len(found.bytesList) - 1}",
        )
    side = found.markerSize + 2 * BLACK_BORDER_CELLS
    return found.generateImageMarker(marker, side, borderBits=BLACK_BORDER_CELLS) == 0


def marker_detector(dictionary: str) -> cv2.aruco.ArucoDetector:
    """Return a detector with sub-pixel corners (OpenCV's default leaves them at whole pixels)."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    # OpenCV's window of 0.3 cells leaves 0.7 px of error on small markers; 0.9 cells leave 0.2 px.
    parameters.relativeCornerRefinmentWinSize = 0.9
    parameters.cornerRefinementWinSize = 5
    parameters.cornerRefinementMaxIterations = 50
    parameters.cornerRefinementMinAccuracy = 0.005
    return cv2.aruco.ArucoDetector(dictionary_named(dictionary), parameters)


def detect_markers(grey: np.ndarray, detector: cv2.aruco.ArucoDetector) -> tuple[np.ndarray, np.ndarray]:
    """Find markers in a picture.

    Parameters
    ----------
    grey
        (height, width), uint8; uint16 is scaled to its own full range.
    detector
        From `marker_detector`; kept by callers that look at many frames.

    Returns
    -------
    ids : ndarray (found,)
    corners : ndarray (found, 4, 2)
        Pixels; top left, top right, bottom right, bottom left as printed.
    """
    corners, ids, _ = detector.detectMarkers(eight_bit(grey))
    if ids is None or len(ids) == 0:
        return np.zeros(0, int), np.zeros((0, 4, 2))
    return np.asarray(ids, int).reshape(-1), np.asarray(corners, float).reshape(-1, 4, 2)


def eight_bit(grey: np.ndarray) -> np.ndarray:
    """Return a picture as uint8; deeper ones are stretched from their 0.1 % to their 99.9 % level."""
    if grey.dtype == np.uint8:
        return grey
    low, high = np.percentile(grey, (0.1, 99.9))
    scaled = (grey.astype(np.float32) - low) * np.float32(255.0 / max(high - low, 1.0))
    return np.clip(np.rint(scaled), 0, 255).astype(np.uint8)


def corners_of(size_m: float) -> np.ndarray:
    """Return a marker's corners (4, 2) [m] about its centre, y up, in the order of detection."""
    return 0.5 * size_m * np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
