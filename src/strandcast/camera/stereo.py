"""The pose of one camera relative to another, from photos of a ChArUco board that both took at once."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from strandcast.camera.markers import opencv_board
from strandcast.camera.printed_board import identify_board
from strandcast.camera.projection import straightened
from strandcast.camera.views import MIN_CORNERS, find_board
from strandcast.config.camera import Board
from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera

LEAST_PAIRS = 3  # chosen
CRITERIA = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 100, 1e-9)


@dataclass(frozen=True)
class StereoPose:
    """second = rotation · first + translation [m], by so many pairs of photos, with the corners' residual."""

    rotation: np.ndarray
    translation_m: np.ndarray
    pairs: int
    rms_px: float

    def placed(self, first: Camera, second: Camera) -> Camera:
        """Return the second camera, placed by the first one's pose."""
        rotation = self.rotation @ np.array(first.rotation)
        shift_m = self.rotation @ np.array(first.translation_m) + self.translation_m
        return second.model_copy(update={"rotation": rotation.tolist(), "translation_m": shift_m.tolist()})


def stereo_pose(
    photos: Sequence[tuple[np.ndarray, np.ndarray]], board: Board, first: Camera, second: Camera
) -> StereoPose:
    """Fit the pose of the second camera relative to the first; both lenses stay as they are.

    `photos` are grey pictures (height, width) of both cameras at one instant each, three pairs or more. The
    pattern and the first id of the board are as the first camera's show them.

    Raises
    ------
    StrandcastError
        SC-C013 fewer than three pairs show eight common corners of the board; SC-C016,
        SC-C023 as `identify_board`.
    """
    printed = identify_board([("", one) for one, _ in photos], board)
    corners_m = np.asarray(opencv_board(printed.board).getChessboardCorners(), np.float32)
    positive = ([printed.black_on_white(grey) for grey in pair] for pair in photos)
    shared = (_common(one, other, printed.board) for one, other in positive)
    common = [each for each in shared if len(each[0]) >= MIN_CORNERS]
    if len(common) < LEAST_PAIRS:
        raise StrandcastError(
            "SC-C013",
            f"{len(common)} of {len(photos)} pairs of photos show {MIN_CORNERS} corners of the board to both "
            f"cameras; {LEAST_PAIRS} are needed",
            fix="hold the board still where both cameras see it, tilted differently in each pair",
        )
    lenses = [(np.array(each.lens.matrix), np.array(each.lens.distortion)) for each in (first, second)]
    seen = [[straightened(pair[1 + k], *lens) for pair in common] for k, lens in enumerate(lenses)]
    calibrate: Any = cv2.stereoCalibrate  # its stub asks for first values that it does not need
    rms_px, *_, rotation, shift_m, _, _ = calibrate(
        [corners_m[ids] for ids, _, _ in common],
        *([each[0].astype(np.float32) for each in views] for views in seen),
        *(each for views in seen for each in views[0][1:]),
        (first.lens.width_px, first.lens.height_px),
        flags=cv2.CALIB_FIX_INTRINSIC,
        criteria=CRITERIA,
    )
    return StereoPose(np.asarray(rotation), np.asarray(shift_m).reshape(3), len(common), float(rms_px))


def _common(one: np.ndarray, other: np.ndarray, board: Board) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the ids (m,) of the corners that two pictures show, and their pixels (m, 2) in each."""
    (one_ids, one_px), (other_ids, other_px) = find_board(one, board), find_board(other, board)
    ids, mine, its = np.intersect1d(one_ids, other_ids, return_indices=True)
    return ids, one_px[mine].astype(np.float32), other_px[its].astype(np.float32)
