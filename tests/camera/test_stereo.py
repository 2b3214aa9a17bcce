"""The pose of a camera relative to another, from a board that both photographed at once."""

import cv2
import numpy as np
import pytest

from strandcast.camera.boards import write_charuco
from strandcast.camera.stereo import stereo_pose
from strandcast.config.camera import Board
from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera

from .test_lens import BOARD, VIEWS

BETWEEN = cv2.Rodrigues(np.array([0.05, -0.5, 0.02]))[0], np.array([0.22, -0.02, 0.05])


def camera_of(lens, rotation, shift_m) -> Camera:
    return Camera(
        lens=lens,
        rotation=np.asarray(rotation).tolist(),
        translation_m=np.asarray(shift_m).tolist(),
        plane_rms_px=0.1,
        plane_markers=[],
        string_offset_m=0.0,
        scale_m_per_px=0.001,
        source="given",
    )


@pytest.fixture(scope="module")
def pairs(tmp_path_factory, photograph, looking, lens):
    """The printed board in both cameras' pictures."""
    [page] = write_charuco(BOARD, tmp_path_factory.mktemp("print") / "board.png", dpi=200)
    texture = cv2.imread(str(page), cv2.IMREAD_GRAYSCALE)
    scale = 200 / 0.0254
    to_texture = np.array([[scale, 0.0, 150.0], [0.0, -scale, texture.shape[0] - 150.0]])
    pictures = []
    for k, view in enumerate(VIEWS[:5]):
        rotation, shift_m = looking(*view)
        second = BETWEEN[0] @ rotation, BETWEEN[0] @ shift_m + BETWEEN[1]
        poses = (rotation, shift_m), second
        pictures.append(
            tuple(
                photograph(texture, to_texture, lens, *pose, seed=2 * k + i) for i, pose in enumerate(poses)
            )
        )
    return pictures


def test_boards_place_the_second_camera_by_the_first(pairs, looking, lens):
    first = camera_of(lens, *looking(0.1, -0.1, 0.0, (0.0, 0.0), 2.0))
    second = camera_of(lens, np.eye(3), np.zeros(3))
    pose = stereo_pose(pairs, BOARD, first, second)
    assert pose.pairs >= 3
    assert pose.rms_px < 0.4
    turn = cv2.Rodrigues(pose.rotation @ BETWEEN[0].T)[0]
    assert np.linalg.norm(turn) < 2e-3
    assert np.linalg.norm(pose.translation_m - BETWEEN[1]) < 1.5e-3
    placed = pose.placed(first, second)
    point_m = np.array([0.1, -0.2, 0.05])
    in_first = np.array(first.rotation) @ point_m + first.translation_m
    in_second = np.array(placed.rotation) @ point_m + placed.translation_m
    assert in_second == pytest.approx(BETWEEN[0] @ in_first + BETWEEN[1], abs=6e-3)
    swapped = stereo_pose([(b, a) for a, b in pairs], BOARD, second, first)
    assert np.linalg.norm(swapped.rotation @ pose.rotation - np.eye(3)) < 2e-3


def test_too_few_common_photos_are_refused(pairs, lens):
    camera = camera_of(lens, np.eye(3), np.zeros(3))
    blank = [(one, np.full_like(other, 128)) for one, other in pairs]
    for photos in ([], pairs[:2], blank):
        with pytest.raises(StrandcastError, match="SC-C013"):
            stereo_pose(photos, BOARD, camera, camera)
    with pytest.raises(StrandcastError, match="SC-C016.*7 x 5 squares, not 4 x 3"):
        stereo_pose(pairs, Board(squares_x=4, squares_y=3), camera, camera)
