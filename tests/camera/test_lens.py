import re

import cv2
import numpy as np
import pytest

from strandcast.camera.boards import write_charuco
from strandcast.camera.distortion import MODELS, choose_model, fit_lens, smallest_as_good
from strandcast.camera.lens import calibrate_lens, calibrate_lens_video
from strandcast.camera.lens_error import lens_covariance, repeat_inflation
from strandcast.camera.markers import detect_markers, marker_detector, opencv_board, patterned
from strandcast.camera.printed_board import identify_board
from strandcast.camera.views import BoardCorners, board_corners, pose_groups
from strandcast.config.camera import Board
from strandcast.errors import StrandcastError
from strandcast.records.camera import Lens

BOARD = Board(squares_x=7, squares_y=5, square_m=0.035, marker_m=0.026, dictionary="DICT_5X5_100")
PUBLISHED = Board(squares_x=5, squares_y=7, square_m=0.04, marker_m=0.02, dictionary="DICT_6X6_250")
VIEWS = [
    (0.5, 0.1, 0.0, (0.10, 0.07), 0.45),
    (-0.5, 0.2, 0.1, (0.15, 0.10), 0.45),
    (0.1, 0.6, 0.0, (0.16, 0.07), 0.45),
    (0.1, -0.6, -0.1, (0.08, 0.11), 0.45),
    (0.4, 0.4, 0.3, (0.13, 0.07), 0.45),
    (-0.3, -0.5, 0.0, (0.10, 0.11), 0.45),
]


SIZE = (960, 540)
SQUARES = ("squares_x", "squares_y")
TRUE_K = (-0.12, 0.06, 0.0008, -0.0006, 0.0)


def board_photos(board, folder, photograph, looking, lens, views) -> list[tuple[str, np.ndarray]]:
    """Print a board and photograph it."""
    [page] = write_charuco(board, folder / "board.png", dpi=200)
    texture = cv2.imread(str(page), cv2.IMREAD_GRAYSCALE)
    scale = 200 / 0.0254
    to_texture = np.array([[scale, 0.0, 150.0], [0.0, -scale, texture.shape[0] - 150.0]])
    return [
        (f"lens-{k}.png", photograph(texture, to_texture, lens, *looking(*view), seed=k))
        for k, view in enumerate(views)
    ]


@pytest.fixture(scope="module")
def photos(tmp_path_factory, photograph, looking, lens) -> list[tuple[str, np.ndarray]]:
    return board_photos(BOARD, tmp_path_factory.mktemp("print"), photograph, looking, lens, VIEWS)


def test_a_known_lens_is_recovered_within_its_standard_errors(photos, lens):
    found, _ = calibrate_lens(photos, BOARD)
    assert found.rms_px < 0.15
    assert all(view.used and view.corners >= 12 for view in found.views)
    truth = {"fx_px": (0, 0), "fy_px": (1, 1), "cx_px": (0, 2), "cy_px": (1, 2)}
    for name, (row, column) in truth.items():
        off = found.matrix[row][column] - lens.matrix[row][column]
        assert abs(off) < 4 * found.standard_errors[name] + 0.5, name
    assert found.distortion[0] == pytest.approx(lens.distortion[0], abs=0.02)
    assert found.matrix[0][0] == pytest.approx(lens.matrix[0][0], rel=0.003)
    assert (found.width_px, found.height_px) == (960, 540)


def test_a_video_may_begin_before_its_board_is_in_view(photos):
    empty = [(f"frame {k}", np.full_like(photos[0][1], 120)) for k in range(6)]
    found, printed = calibrate_lens_video([*empty, *photos], BOARD)
    assert printed.is_shown
    assert found.rms_px < 0.15


def test_the_stored_residuals_give_the_rms(photos):
    found, _ = calibrate_lens(photos, BOARD)
    all_residuals = np.concatenate([np.array(view.residuals_px) for view in found.views])
    assert all_residuals.shape[1] == 4
    assert np.sqrt((all_residuals[:, 2:] ** 2).sum(axis=1).mean()) == pytest.approx(found.rms_px, rel=1e-3)
    for view in found.views:
        residuals = np.array(view.residuals_px)[:, 2:]
        assert np.sqrt((residuals**2).sum(axis=1).mean()) == pytest.approx(view.rms_px, rel=1e-2)


def test_a_photo_of_a_bent_board_is_rejected_with_a_reason(photos):
    name, picture = photos[2]
    u, v = np.meshgrid(np.arange(960, dtype=np.float32), np.arange(540, dtype=np.float32))
    bent = cv2.remap(picture, u + 6.0 * np.sin(v / 60.0), v + 6.0 * np.sin(u / 50.0), cv2.INTER_LINEAR)
    found, _ = calibrate_lens([*photos[:2], (name, bent), *photos[3:]], BOARD)
    assert [view.used for view in found.views] == [True, True, False, True, True, True]
    assert "px rms, the others'" in found.views[2].reason
    assert found.rms_px < 0.15


def test_a_photo_with_too_few_corners_is_rejected_with_a_reason(photos):
    name, picture = photos[0]
    covered = picture.copy()
    covered[:, 300:] = 128
    found, _ = calibrate_lens([(name, covered), *photos[1:]], BOARD)
    assert not found.views[0].used
    assert found.views[0].reason == "fewer than 8 of the board's 24 corners were detected"


def test_too_few_photos_sizes_and_boards_are_refused(photos):
    with pytest.raises(StrandcastError, match="2 usable board photos; at least 3"):
        calibrate_lens(photos[:2], BOARD)
    with pytest.raises(StrandcastError, match=r"480 x 270 px, lens-0\.png is 960 x 540 px"):
        calibrate_lens([photos[0], ("small.png", cv2.resize(photos[1][1], (480, 270)))], BOARD)
    with pytest.raises(StrandcastError, match="0 usable board photos") as caught:
        calibrate_lens([(name, np.full_like(picture, 128)) for name, picture in photos], BOARD)
    assert caught.value.what.count("corners were detected") == 1  # not once per photo
    assert "in 6 of 6, fewer than 8" in caught.value.what
    with pytest.raises(StrandcastError, match="no board photos"):
        calibrate_lens([], BOARD)


def test_few_similar_photos_give_a_small_model_and_a_warning(photos):
    found, _ = calibrate_lens(photos[:3], BOARD)
    assert found.model in ("none", "k1", "k1k2")
    assert "only 3 photos of the board" in found.weaknesses[0]
    assert any("cover" in words for words in found.weaknesses)


def test_wrong_board_declarations_are_named(photos):
    with pytest.raises(StrandcastError, match="7 x 5 squares, not 5 x 7") as caught:
        calibrate_lens(
            photos[:3],
            BOARD.model_copy(update={"squares_x": 5, "squares_y": 7}),
        )
    assert caught.value.code == "SC-C016"
    for declared, why in (((6, 4), ": squares are counted, not the corners"), ((6, 5), "$"), ((7, 4), "$")):
        with pytest.raises(StrandcastError) as caught:
            calibrate_lens(photos[:4], BOARD.model_copy(update=dict(zip(SQUARES, declared, strict=True))))
        assert re.search(
            f"the board has 7 x 5 squares, not {declared[0]} x {declared[1]}{why}", caught.value.what
        )
        assert caught.value.fix == "set squares_x: 7 and squares_y: 5"
    with pytest.raises(
        StrandcastError,
        match="from DICT_5X5_50 or a larger one of its kind, not from DICT_7X7_50",
    ) as caught:
        calibrate_lens(
            photos[:3],
            BOARD.model_copy(update={"dictionary": "DICT_7X7_50"}),
        )
    assert caught.value.code == "SC-C016"
    mirrored = [(name, np.ascontiguousarray(picture[:, ::-1])) for name, picture in photos[:3]]
    with pytest.raises(StrandcastError, match="mirrored") as caught:
        calibrate_lens(mirrored, BOARD)
    assert caught.value.code == "SC-C023"


def test_a_row_that_is_declared_and_not_there_is_named(photos):
    with pytest.raises(StrandcastError, match="the board has 7 x 5 squares, not 7 x 6") as caught:
        calibrate_lens(photos, BOARD.model_copy(update={"squares_y": 6}))
    assert caught.value.fix == "set squares_x: 7 and squares_y: 5"


def test_a_row_whose_markers_are_not_detected_is_not_taken_for_absent():
    drawn = opencv_board(BOARD).generateImage((840, 600), marginSize=60)
    drawn[444:] = cv2.GaussianBlur(drawn, (0, 0), 10)[444:]  # the last row, of 96 px
    assert detect_markers(drawn, marker_detector(BOARD.dictionary))[0].max() < 14
    assert identify_board([("blurred.png", drawn)], BOARD).warnings == []


def test_a_board_that_is_cut_off_in_the_only_photo_is_named():
    drawn = opencv_board(BOARD).generateImage((840, 600), marginSize=60)[:, 150:]  # without a column
    swapped = BOARD.model_copy(update={"squares_x": 5, "squares_y": 7})
    with pytest.raises(StrandcastError, match="the board has 7 x 5 squares, not 5 x 7"):
        identify_board([("plane.png", drawn)], swapped)


@pytest.mark.parametrize("legacy", [True, False])
@pytest.mark.parametrize(("squares_x", "squares_y"), [(7, 6), (5, 4), (6, 6)])
@pytest.mark.parametrize("cut", ["left", "right", "top", "bottom"])
def test_a_board_that_is_cut_off_has_its_own_pattern(legacy, squares_x, squares_y, cut):
    squares = dict(zip(SQUARES, (squares_x, squares_y), strict=True))
    board = patterned(BOARD).model_copy(update={**squares, "legacy": legacy})
    drawn = opencv_board(board).generateImage((100 * squares_x, 100 * squares_y))
    drawn = cv2.copyMakeBorder(drawn, *[60] * 4, cv2.BORDER_CONSTANT, value=255)
    drawn = cv2.copyMakeBorder(drawn, *[80] * 4, cv2.BORDER_CONSTANT, value=120)  # the table below the paper
    side = {
        "left": np.s_[:, 140 + 80 :],
        "right": np.s_[:, : -140 - 80],
        "top": np.s_[140 + 80 :],
        "bottom": np.s_[: -140 - 80],
    }
    for declared in (
        BOARD.model_copy(update=squares),
        board,
        board.model_copy(update={"legacy": not legacy}),
    ):
        assert identify_board([("plane.png", drawn[side[cut]])], declared).board == board


def test_a_row_too_many_of_which_the_photo_has_a_part_is_named():
    drawn = opencv_board(BOARD).generateImage((840, 600), marginSize=60)  # 60 px of a row's 96
    more = BOARD.model_copy(update={"squares_y": 6})
    with pytest.raises(StrandcastError, match="the board has 7 x 5 squares, not 7 x 6"):
        identify_board([("plane.png", drawn)], more)
    assert identify_board([("plane.png", drawn)], BOARD).is_shown


def test_a_board_whose_first_rows_are_covered_is_not_another_one():
    drawn = opencv_board(BOARD).generateImage((760, 560), marginSize=30)
    drawn[:230] = 120  # the first two rows of five; a board with other ids could end below the picture
    [found] = [identify_board([("plane.png", drawn[:545])], BOARD)]
    assert found.board == patterned(BOARD) or found.is_open


def test_what_is_found_of_the_board_is_the_fix_where_no_photo_can_be_used(photos):
    in_inches = BOARD.model_copy(update={"square_m": 0.035 * 25.4})
    with pytest.raises(StrandcastError, match="0 usable board photos") as caught:
        calibrate_lens(photos[:3], in_inches)
    assert re.search(r"set camera.board.marker_m to .* or square_m to 0\.03[45]", caught.value.fix)


def test_markers_of_another_size_are_named_with_the_right_one(photos):
    found, _ = calibrate_lens(photos, BOARD.model_copy(update={"marker_m": 0.02}))
    assert re.search(r"measure about 2[56]\.\d mm, not 20: .*marker_m to 0\.02[56]\d", found.warnings[0])


def test_a_dictionary_with_too_few_markers_is_named(tmp_path, photograph, looking, lens):
    board = patterned(BOARD).model_copy(update={"first_id": 60})
    pictures = board_photos(board, tmp_path, photograph, looking, lens, VIEWS[:3])
    with pytest.raises(StrandcastError, match="from DICT_5X5_100 or a larger one of its kind, not") as caught:
        calibrate_lens(pictures, BOARD.model_copy(update={"dictionary": "DICT_5X5_50"}))
    assert caught.value.fix == "set camera.board.dictionary to DICT_5X5_100"


def test_a_board_white_on_black_is_taken_with_a_warning(photos):
    found, _ = calibrate_lens([(name, 255 - picture) for name, picture in photos], BOARD)
    assert ["white on black" in words for words in found.warnings] == [True]
    assert found.matrix[0][0] == pytest.approx(calibrate_lens(photos, BOARD)[0].matrix[0][0], rel=1e-3)


@pytest.mark.parametrize("pattern", [{"first_id": 12}, {"squares_y": 4}, {"squares_y": 4, "legacy": True}])
def test_the_boards_pattern_and_first_id_are_found(tmp_path, photograph, looking, lens, pattern):
    board = patterned(BOARD).model_copy(update=pattern)
    pictures = board_photos(board, tmp_path, photograph, looking, lens, VIEWS[:3])
    declared = BOARD.model_copy(update={"squares_y": board.squares_y})
    (right, _), (found, printed) = calibrate_lens(pictures, board), calibrate_lens(pictures, declared)
    assert printed.board == board
    assert found.warnings == []
    assert found.legacy is board.legacy
    assert found.matrix == right.matrix


def test_a_partly_covered_board_gives_its_visible_corners(photos):
    whole, _ = calibrate_lens(photos, BOARD)
    covered = [(name, picture.copy()) for name, picture in photos]
    for k, (_, picture) in enumerate(covered):
        cv2.circle(picture, (300 + 60 * k, 270), 70, 90, -1)
    found, _ = calibrate_lens(covered, BOARD)
    assert sum(view.corners for view in found.views) < sum(view.corners for view in whole.views) - 10
    assert found.rms_px < 0.15
    error = found.standard_errors["fx_px"]
    assert abs(found.matrix[0][0] - whole.matrix[0][0]) < 4 * error


def test_standard_errors_are_right(corner_views):
    off = []
    for seed in range(30):
        fit = fit_lens(corner_views(TRUE_K, seed, views=8, noise_px=0.1), SIZE, "k1k2p1p2")
        estimate = np.array([fit.matrix[0, 0], fit.matrix[1, 1], *fit.matrix[:2, 2], *fit.distortion[:4]])
        truth = np.array([1100.0, 1090.0, 470.0, 280.0, *TRUE_K[:4]])
        off.append((estimate - truth) / fit.standard_errors[:8])
    spread = np.sqrt((np.array(off) ** 2).mean(axis=0))
    assert (spread > 0.65).all()
    assert (spread < 1.4).all()


def test_repeated_photos_of_one_pose_count_once(corner_views):
    distinct = corner_views(TRUE_K, 0, views=6, noise_px=0.1)
    random = np.random.default_rng(1)
    repeated = [
        BoardCorners(f"{view.name}-{k}", view.board_m, view.picture_px + random.normal(0.0, 0.1, (1, 2)))
        for k in range(4)
        for view in distinct
    ]
    assert pose_groups(distinct).tolist() == list(range(6))
    groups = pose_groups(repeated)
    assert groups.tolist() == list(range(6)) * 4
    once, four = (fit_lens(views, SIZE, "k1k2") for views in (distinct, repeated))
    np.testing.assert_array_equal(repeat_inflation(distinct, once, pose_groups(distinct)), np.ones(9))
    factors = repeat_inflation(repeated, four, groups)
    np.testing.assert_allclose(factors[:6], 2.0, rtol=1e-6)  # the root of four photos a pose
    assert (factors[6:] == 1.0).all()  # fixed coefficients
    apart, together = (
        np.sqrt(np.diag(lens_covariance(repeated, four, SIZE, by)))[:4] for by in (None, groups)
    )
    np.testing.assert_allclose(together / apart, 2.0, rtol=0.1)


def test_photos_that_do_not_determine_the_focal_length_are_refused(photos):
    repeats = [(f"{k}.png", photos[k % 2][1]) for k in range(6)]
    with pytest.raises(StrandcastError, match="6 usable board photos show 2 distinct poses") as caught:
        calibrate_lens(repeats, BOARD)
    assert caught.value.code == "SC-C013"
    assert "camera.lens" in caught.value.fix
    moved = [(f"{k}.png", np.roll(photos[0][1], (0, 40 * k), (0, 1))) for k in range(-2, 3)]
    with pytest.raises(StrandcastError, match=r"differ by \d\.\d degrees; at least 3") as caught:
        calibrate_lens(moved, BOARD, "none")
    assert caught.value.code == "SC-C013"


def test_the_covariance_is_opencvs_for_sufficient_photos(corner_views):
    seen = corner_views(TRUE_K, 0, views=12, noise_px=0.1)
    fit = fit_lens(seen, SIZE, "k1k2p1p2")
    ours = np.sqrt(np.diag(lens_covariance(seen, fit, SIZE)))[:8]
    np.testing.assert_allclose(ours, fit.standard_errors[:8], rtol=0.03)


def test_unfitted_coefficients_have_nonzero_variance(corner_views):
    seen = corner_views((0.0,) * 5, 0, views=6, noise_px=0.1)
    fit = fit_lens(seen, SIZE, "none")
    errors = np.sqrt(np.diag(lens_covariance(seen, fit, SIZE)))
    assert fit.standard_errors[4] == 0.0
    assert 1e-3 < errors[4] < 0.1
    assert errors[8] == 0.0  # k3 was neither fitted nor is it usual


@pytest.mark.parametrize(
    ("distortion", "models"),
    [
        pytest.param((0.0, 0.0, 0.0, 0.0, 0.0), {"none"}, marks=pytest.mark.thorough),
        pytest.param((-0.15, 0.0, 0.0, 0.0, 0.0), {"k1"}, marks=pytest.mark.thorough),
        pytest.param((-0.3, 0.15, 0.0, 0.0, 0.0), {"k1k2"}, marks=pytest.mark.thorough),
        ((-0.15, 0.08, 0.004, -0.004, 0.0), {"k1k2p1p2"}),
        ((0.3, 0.05, 0.0, 0.0, 0.0, 0.7, 0.1, 0.0), {"rational"}),
    ],
)
def test_the_model_is_the_smallest_that_predicts_unseen_photos(corner_views, distortion, models):
    chosen = []
    for seed in range(3):
        seen = corner_views(distortion, seed, views=12, noise_px=0.05)
        name, trials = choose_model(seen, SIZE, list(MODELS))
        chosen.append(name)
        held_out = {trial.model: trial.held_out_px for trial in trials if trial.held_out_px is not None}
        assert held_out[name] < 0.08
        assert held_out[name] < 1.05 * min(held_out.values())
    assert sum(name in models for name in chosen) >= 2, chosen


def test_a_larger_model_must_be_better_in_most_photos():
    random = np.random.default_rng(0)
    usual = random.lognormal(-5.0, 1.5, 12)  # photos differ much more than models do
    level = {"none": 1.5 * usual, "k1": usual, "k1k2": 0.985 * usual}
    assert smallest_as_good(level) == "k1"  # 0.7 % of the residual is not worth a coefficient
    assert smallest_as_good(level | {"k1k2": 0.9 * usual}) == "k1k2"
    one = np.where(usual == usual.max(), 0.2, 1.01) * usual
    assert one.mean() < 0.8 * usual.mean()
    assert smallest_as_good(level | {"k1k2": one}) == "k1"  # much better in the mean, by one photo
    assert smallest_as_good(level | {"rational": 0.95 * usual}) == "k1"
    assert smallest_as_good(level | {"rational": 0.85 * usual}) == "rational"


def test_the_real_photos_give_the_published_lens_within_the_standard_errors(real_data):
    folder = real_data / "opencv_aruco"
    photos = [
        (f"img_0{k}.jpg", cv2.imread(str(folder / f"img_0{k}.jpg"), cv2.IMREAD_GRAYSCALE)) for k in range(4)
    ]
    found, _ = calibrate_lens(photos, PUBLISHED)
    assert found.rms_px <= 0.2
    published = {"fx_px": 452.511, "fy_px": 456.767, "cx_px": 317.703, "cy_px": 277.752}
    for (row, column), (name, value) in zip(((0, 0), (1, 1), (0, 2), (1, 2)), published.items(), strict=True):
        assert abs(found.matrix[row][column] - value) < 2 * found.standard_errors[name], name
    assert [view.corners for view in found.views] == [24, 24, 24, 24]
    assert any("tilts differ by" in words for words in found.weaknesses)
    assert any("focal length" in words for words in found.weaknesses)
    held_out = {trial.model: trial.held_out_px for trial in found.models}
    assert held_out[found.model] <= 1.01 * min(held_out.values())


def test_the_published_model_gives_the_published_numbers(real_data):
    folder = real_data / "opencv_aruco"
    photos = [
        (f"img_0{k}.jpg", cv2.imread(str(folder / f"img_0{k}.jpg"), cv2.IMREAD_GRAYSCALE)) for k in range(4)
    ]
    found, _ = calibrate_lens(
        photos,
        PUBLISHED,
        model="k1k2k3p1p2",
    )
    assert found.matrix[0][0] == pytest.approx(452.511, rel=0.015)
    assert found.matrix[1][1] == pytest.approx(456.767, rel=0.015)
    assert found.matrix[0][2] == pytest.approx(317.703, abs=2.0)
    assert found.rms_px == pytest.approx(0.182, abs=0.01)


def test_a_real_board_that_is_partly_covered(real_data):
    picture = cv2.imread(str(real_data / "opencv_aruco" / "chocclusion_original.jpg"), cv2.IMREAD_GRAYSCALE)
    board = PUBLISHED
    view, corners = board_corners("chocclusion.jpg", picture, board)
    assert 12 <= view.corners < 24
    homography, _ = cv2.findHomography(corners.board_m[:, :2], corners.picture_px)
    back = cv2.perspectiveTransform(corners.board_m[:, None, :2], homography).reshape(-1, 2)
    assert np.linalg.norm(back - corners.picture_px, axis=1).max() < 1.0


def test_record_round_trip(photos, tmp_path):
    found, _ = calibrate_lens(photos, BOARD)
    assert Lens.model_validate_json(found.model_dump_json()) == found
