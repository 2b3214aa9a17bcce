from __future__ import annotations

import cv2
import numpy as np
import pytest

from strandcast.camera.boards import write_charuco
from strandcast.camera.lens import calibrate_lens
from strandcast.camera.markers import CharucoBoard
from strandcast.errors import StrandcastError
from strandcast.records.camera import Lens

BOARD = CharucoBoard(7, 5, 0.035, 0.026, "DICT_5X5_100")
VIEWS = [
    (0.5, 0.1, 0.0, (0.10, 0.07), 0.45),
    (-0.5, 0.2, 0.1, (0.15, 0.10), 0.45),
    (0.1, 0.6, 0.0, (0.16, 0.07), 0.45),
    (0.1, -0.6, -0.1, (0.08, 0.11), 0.45),
    (0.4, 0.4, 0.3, (0.13, 0.07), 0.45),
    (-0.3, -0.5, 0.0, (0.10, 0.11), 0.45),
]


@pytest.fixture(scope="module")
def photos(tmp_path_factory, photograph, looking, lens) -> list[tuple[str, np.ndarray]]:
    [page] = write_charuco(BOARD, tmp_path_factory.mktemp("print") / "board.png", page="A4", dpi=200)
    texture = cv2.imread(str(page), cv2.IMREAD_GRAYSCALE)
    scale = 200 / 0.0254
    to_texture = np.array([[scale, 0.0, 150.0], [0.0, -scale, texture.shape[0] - 150.0]])
    return [
        (f"lens-{k}.png", photograph(texture, to_texture, lens, *looking(*view), seed=k))
        for k, view in enumerate(VIEWS)
    ]


def test_a_known_lens_is_found_again_within_its_standard_errors(photos, lens):
    found = calibrate_lens(photos, BOARD)
    assert found.rms_px < 0.15
    assert all(view.used and view.corners >= 12 for view in found.views)
    truth = {"fx_px": (0, 0), "fy_px": (1, 1), "cx_px": (0, 2), "cy_px": (1, 2)}
    for name, (row, column) in truth.items():
        off = found.matrix[row][column] - lens.matrix[row][column]
        assert abs(off) < 4 * found.standard_errors[name] + 0.5, name
    assert found.distortion[0] == pytest.approx(lens.distortion[0], abs=0.02)
    assert found.matrix[0][0] == pytest.approx(lens.matrix[0][0], rel=0.003)
    assert (found.width_px, found.height_px) == (960, 540)


def test_residuals_are_kept_and_make_up_the_rms(photos):
    found = calibrate_lens(photos, BOARD)
    all_residuals = np.concatenate([np.array(view.residuals_px) for view in found.views])
    assert all_residuals.shape[1] == 4
    assert np.sqrt((all_residuals[:, 2:] ** 2).sum(axis=1).mean()) == pytest.approx(found.rms_px, rel=1e-3)
    for view in found.views:
        residuals = np.array(view.residuals_px)[:, 2:]
        assert np.sqrt((residuals**2).sum(axis=1).mean()) == pytest.approx(view.rms_px, rel=1e-2)


def test_a_photo_of_a_bent_board_is_left_out_with_the_reason(photos):
    name, picture = photos[2]
    u, v = np.meshgrid(np.arange(960, dtype=np.float32), np.arange(540, dtype=np.float32))
    bent = cv2.remap(picture, u + 6.0 * np.sin(v / 60.0), v + 6.0 * np.sin(u / 50.0), cv2.INTER_LINEAR)
    found = calibrate_lens([*photos[:2], (name, bent), *photos[3:]], BOARD)
    assert [view.used for view in found.views] == [True, True, False, True, True, True]
    assert "where the others have" in found.views[2].reason
    assert found.rms_px < 0.15


def test_a_photo_with_too_few_corners_is_left_out_with_the_reason(photos):
    name, picture = photos[0]
    covered = picture.copy()
    covered[:, 300:] = 128
    found = calibrate_lens([(name, covered), *photos[1:]], BOARD)
    assert not found.views[0].used
    assert "of 24 corners seen, at least 8 are needed" in found.views[0].reason


def test_too_few_photos_sizes_and_boards_are_refused(photos):
    with pytest.raises(StrandcastError, match="2 usable board photos, at least 3"):
        calibrate_lens(photos[:2], BOARD)
    with pytest.raises(StrandcastError, match=r"480 x 270 px, lens-0\.png is 960 x 540 px"):
        calibrate_lens([photos[0], ("small.png", cv2.resize(photos[1][1], (480, 270)))], BOARD)
    with pytest.raises(StrandcastError, match="0 usable board photos"):
        calibrate_lens(photos, CharucoBoard(7, 5, 0.035, 0.026, "DICT_7X7_50"))
    with pytest.raises(StrandcastError, match="no board photos"):
        calibrate_lens([], BOARD)


def test_few_similar_photos_get_a_small_model_and_a_warning(photos):
    found = calibrate_lens(photos[:3], BOARD)
    assert found.model != "full"
    assert any("cover" in warning for warning in found.warnings)


def test_the_real_photos_give_the_published_lens(real_data):
    folder = real_data / "opencv_aruco"
    photos = [
        (f"img_0{k}.jpg", cv2.imread(str(folder / f"img_0{k}.jpg"), cv2.IMREAD_GRAYSCALE)) for k in range(4)
    ]
    found = calibrate_lens(photos, CharucoBoard(5, 7, 0.04, 0.02, "DICT_6X6_250"))
    assert found.rms_px <= 0.2
    assert found.matrix[0][0] == pytest.approx(452.511, rel=0.015)
    assert found.matrix[1][1] == pytest.approx(456.767, rel=0.015)
    assert found.matrix[0][2] == pytest.approx(317.703, abs=2.0)
    assert [view.corners for view in found.views] == [24, 24, 24, 24]
    assert any(
        "focal length" in warning for warning in found.warnings
    )  # four alike views cannot tell it well


def test_record_round_trip(photos, tmp_path):
    found = calibrate_lens(photos, BOARD)
    assert Lens.model_validate_json(found.model_dump_json()) == found
