import re

import cv2
import numpy as np
import pytest
from PIL import Image

from strandcast.camera.boards import RULER_MM, write_charuco, write_markers
from strandcast.camera.markers import detect_markers, marker_detector, opencv_board, patterned
from strandcast.camera.views import find_board
from strandcast.config.camera import Board
from strandcast.errors import StrandcastError

DPI = 300
PRINTED = Board(squares_x=5, squares_y=8, square_m=0.030, marker_m=0.022, dictionary="DICT_5X5_100")


@pytest.mark.parametrize("legacy", [False, True])
def test_a_printed_charuco_board_has_its_true_size(tmp_path, legacy):
    board = patterned(PRINTED).model_copy(update={"legacy": legacy})
    [path] = write_charuco(board, tmp_path / "board.png", dpi=DPI)
    assert Image.open(path).info["dpi"] == pytest.approx((DPI, DPI), rel=1e-3)
    ids, corners_px = find_board(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), board)
    assert len(ids) == 4 * 7
    places_mm = np.asarray(opencv_board(board).getChessboardCorners())[ids, :2] * 1e3
    affine, *_ = np.linalg.lstsq(
        np.column_stack([places_mm, np.ones(len(ids))]), corners_px * 25.4 / DPI, rcond=None
    )
    np.testing.assert_allclose(affine[:2], np.eye(2), atol=2e-4)


def test_the_other_pattern_is_not_detected(tmp_path):
    legacy = patterned(PRINTED).model_copy(update={"legacy": True})
    [path] = write_charuco(legacy, tmp_path / "board.png", dpi=DPI)
    assert len(find_board(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), PRINTED)[0]) == 0


def test_printed_markers_are_complete_and_of_true_size(tmp_path):
    wanted = [3, 0, 12, 7, 21]
    paths = write_markers(wanted, 0.080, "DICT_4X4_50", tmp_path / "m.png", dpi=DPI)
    assert [path.name for path in paths] == ["m-1.png", "m-2.png", "m-3.png"]
    found, sides_mm = [], []
    for path in paths:
        ids, corners = detect_markers(
            cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), marker_detector("DICT_4X4_50")
        )
        found += ids.tolist()
        sides_mm += (
            (np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2) * 25.4 / DPI).ravel().tolist()
        )
    assert sorted(found) == sorted(wanted)
    np.testing.assert_allclose(sides_mm, 80.0, atol=0.05)


def test_the_ruler_has_the_stated_length(tmp_path):
    [path] = write_markers([1], 0.05, "DICT_4X4_50", tmp_path / "m.png", dpi=300)
    page = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    lowest = page.shape[0] - round(11.0 / 25.4 * 300)
    row = page[lowest - 3 : lowest + 4].min(axis=0)
    dark = np.flatnonzero(row < 128)
    assert (dark[-1] - dark[0] + 1) * 25.4 / 300 == pytest.approx(RULER_MM, abs=0.25)


def test_pdf_is_a4_vector_and_the_same_bytes_twice(tmp_path):
    board = Board(squares_x=7, squares_y=5, square_m=0.035, marker_m=0.026, dictionary="DICT_5X5_100")
    first = write_charuco(board, tmp_path / "a.pdf")[0].read_bytes()
    second = write_charuco(board, tmp_path / "b.pdf")[0].read_bytes()
    assert first == second
    assert b"/Subtype /Image" not in first
    box = [float(word) for word in re.search(rb"/MediaBox \[ ([^]]+) ?\]", first).group(1).split()]
    np.testing.assert_allclose(np.array(box[2:]) * 25.4 / 72, (297, 210), atol=0.1)


def test_patterns_that_do_not_fit_and_unknown_names_are_refused(tmp_path):
    big = Board(squares_x=7, squares_y=5, square_m=0.06, marker_m=0.04, dictionary="DICT_5X5_100")
    write_charuco(big, tmp_path / "a.pdf")
    with pytest.raises(StrandcastError, match="does not fit A4"):
        write_markers([1], 0.2, "DICT_4X4_50", tmp_path / "m.pdf")
    with pytest.raises(StrandcastError, match="no marker 50"):
        write_markers([50], 0.05, "DICT_4X4_50", tmp_path / "m.pdf")
    with pytest.raises(StrandcastError, match="no ArUco dictionary 'DICT_9X9'"):
        write_markers([1], 0.05, "DICT_9X9", tmp_path / "m.pdf")
    with pytest.raises(StrandcastError, match=r"\.pdf or \.png"):
        write_markers([1], 0.05, "DICT_4X4_50", tmp_path / "m.svg")


def test_a_board_with_more_markers_than_its_dictionary_is_refused():
    board = Board(squares_x=12, squares_y=10, dictionary="DICT_4X4_50")
    with pytest.raises(StrandcastError, match="has ids up to 59 and DICT_4X4_50 has 50 markers") as caught:
        opencv_board(board)
    assert caught.value.code == "SC-C002"
