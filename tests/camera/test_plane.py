import dataclasses
import re

import cv2
import numpy as np
import pytest

from strandcast.camera.boards import write_charuco
from strandcast.camera.distortion import fit_lens
from strandcast.camera.lens_error import lens_covariance
from strandcast.camera.mapping import metre_to_pixel, pixel_to_metre
from strandcast.camera.marker_pose import marker_pose
from strandcast.camera.markers import detect_markers, marker_detector
from strandcast.camera.plane import _around, _camera, board_markers, plane_from_markers
from strandcast.camera.plane_checks import MarkerLayout, check_markers
from strandcast.camera.plane_error import grid_over, place_sd_m, plane_error
from strandcast.camera.pose import PlacedMarker, PoseFit, fit_pose, posed, project
from strandcast.config.camera import Board
from strandcast.config.load import load_experiment
from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera, Lens

DICTIONARY = "DICT_4X4_50"
MARKERS = [
    PlacedMarker(0, -0.6, 0.35, 0.08),
    PlacedMarker(1, 0.6, 0.35, 0.08, 0.4),
    PlacedMarker(2, 0.6, -0.3, 0.08, -1.0),
    PlacedMarker(3, -0.6, -0.3, 0.08),
    PlacedMarker(4, 0.05, 0.3, 0.08, 3.0),
]
POSE = (0.06, -0.1, 0.03, (0.0, 0.02), 1.9)


@pytest.fixture(scope="module")
def photo(photograph, paint_markers, looking, lens) -> np.ndarray:
    return photograph(*paint_markers(MARKERS, DICTIONARY), lens, *looking(*POSE))


@pytest.fixture
def truth(lens, looking) -> Camera:
    rotation, shift = looking(*POSE)
    return Camera(
        lens=lens,
        rotation=rotation.tolist(),
        translation_m=shift.tolist(),
        plane_rms_px=0.0,
        plane_markers=[],
        string_offset_m=0.0,
        scale_m_per_px=0.0,
        source="given",
    )


def test_the_plane_is_mapped_to_a_tenth_of_a_millimetre(photo, lens, truth):
    found = plane_from_markers(photo, lens, MARKERS, DICTIONARY)
    x, y = np.meshgrid(np.linspace(-0.6, 0.6, 9), np.linspace(-0.3, 0.35, 7))
    places = np.stack([x, y], axis=-1)
    for offset_m, allowed_m in ((0.0, 2e-4), (0.02, 3e-4)):
        back = pixel_to_metre(found, metre_to_pixel(truth, places, offset_m), offset_m)
        assert np.abs(back - places).max() < allowed_m
    assert found.plane_rms_px < 0.3
    assert sorted(fit.marker for fit in found.plane_markers) == [0, 1, 2, 3, 4]
    assert all(len(fit.residuals_px) == 4 for fit in found.plane_markers)
    assert found.scale_m_per_px == pytest.approx(1.9 / 1095, rel=0.02)
    assert -(np.array(found.rotation).T @ found.translation_m)[2] == pytest.approx(
        1.9, abs=0.02
    )  # world z: to us


def test_a_missing_marker_gives_a_warning(photo, lens):
    extra = PlacedMarker(17, 0.0, 0.0, 0.08)
    found = plane_from_markers(photo, lens, [*MARKERS, extra], DICTIONARY)
    assert found.warnings == ["markers [17] of the plane were not detected"]


def test_a_mirrored_picture_is_named(photo, lens):
    with pytest.raises(StrandcastError, match="mirrored"):
        plane_from_markers(np.ascontiguousarray(photo[:, ::-1]), lens, MARKERS, DICTIONARY)


def test_a_mirrored_picture_is_named_where_mirror_images_are_markers_too(
    photograph, paint_markers, looking, lens
):
    ids = [0, 13, 15, 16, 20]
    own = [dataclasses.replace(marker, marker=k) for marker, k in zip(MARKERS, ids, strict=True)]
    picture = photograph(*paint_markers(own, "DICT_ARUCO_ORIGINAL"), lens, *looking(*POSE))
    with pytest.raises(StrandcastError, match=r"mirrored \(found \[0, 16\]"):
        plane_from_markers(np.ascontiguousarray(picture[:, ::-1]), lens, own, "DICT_ARUCO_ORIGINAL")


def test_a_wrong_dictionary_is_named(photo, lens):
    with pytest.raises(
        StrandcastError, match="from DICT_4X4_50 or a larger one of its kind, not from DICT_6X6_50"
    ):
        plane_from_markers(photo, lens, MARKERS, "DICT_6X6_50")


def test_no_markers_and_other_markers_are_named(photo, lens):
    with pytest.raises(StrandcastError, match=r"needed \[0, 1, 2, 3, 4\], found \[\]"):
        plane_from_markers(np.full_like(photo, 128), lens, MARKERS, DICTIONARY)
    others = [dataclasses.replace(marker, marker=marker.marker + 20) for marker in MARKERS]
    with pytest.raises(StrandcastError, match=r"other ids detected: \[0, 1, 2, 3, 4\]"):
        plane_from_markers(photo, lens, others, DICTIONARY)
    with pytest.raises(StrandcastError, match="the plane has 1 markers"):
        plane_from_markers(photo, lens, MARKERS[:1], DICTIONARY)


def test_a_duplicate_marker_is_refused(photograph, paint_markers, looking, lens):
    copy = PlacedMarker(3, 0.1, 0.0, 0.08)
    photo = photograph(*paint_markers([*MARKERS, copy], DICTIONARY), lens, *looking(*POSE))
    problem = refusal(photo, lens, MARKERS)
    assert problem.code == "SC-C021"
    assert "[3] appear twice in the picture" in problem.what
    assert cost_mm(problem) == pytest.approx(1e3 * np.hypot(0.7, 0.3), rel=0.05)


def test_two_inaccurate_markers_give_a_large_standard_error(photo, lens):
    known = {"place_sd_m": 1e-3, "workspace_m": ((-0.8, 0.8), (-0.45, 0.45))}
    found = plane_from_markers(photo, lens, [MARKERS[1], MARKERS[4]], DICTIONARY, **known)
    assert found.plane_error.worst_m > 2e-3
    assert re.search(
        r"reaches [\d.]+ mm in the workspace, mostly from the markers' (corners|positions)",
        found.warnings[-1],
    )


def test_a_misplaced_marker_is_named_with_its_position(photo, lens):
    wrong = [*MARKERS[:2], dataclasses.replace(MARKERS[2], x_m=0.57), *MARKERS[3:]]
    with pytest.raises(
        StrandcastError, match=r"marker 2 is at \(0\.(600|599|601)\d, -0\.(300|299|301)\d\) m.*30\.\d mm"
    ):
        plane_from_markers(photo, lens, wrong, DICTIONARY)


def refusal(photo, lens, markers, **given) -> StrandcastError:
    with pytest.raises(StrandcastError) as caught:
        plane_from_markers(photo, lens, markers, DICTIONARY, file="plane.png", **given)
    assert caught.value.cost
    assert caught.value.fix
    return caught.value


def cost_mm(problem: StrandcastError) -> float:
    """Return the millimetres that an error's cost names."""
    found = re.search(r"([\d.]+) mm", problem.cost)
    return float(found[1]) if found else 1e3  # more than a metre


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (0.9, "measure 80"),
        (1.1, "measure 80"),
        (0.97, "measure 80"),
        (1000.0, "was the size given in millimetres?"),
        (10.0, ""),
    ],
)
def test_a_size_inconsistent_with_the_distances_is_refused(photo, lens, factor, words):
    problem = refusal(photo, lens, [dataclasses.replace(m, size_m=0.08 * factor) for m in MARKERS])
    assert problem.code == "SC-C027"
    assert words in problem.what
    off = abs(factor - 1.0) * 1e3 * np.hypot(1.2, 0.65) / 2  # half the diagonal that the markers span
    assert cost_mm(problem) == pytest.approx(off, rel=0.15)


def test_positions_in_another_unit_are_reported_as_a_wrong_size(photo, lens):
    inches = [dataclasses.replace(m, x_m=m.x_m / 0.0254 * 0.025, y_m=m.y_m / 0.0254 * 0.025) for m in MARKERS]
    assert (
        plane_from_markers(photo, lens, inches, DICTIONARY).warnings[0].startswith("the markers' size fits")
    )
    feet = [dataclasses.replace(m, x_m=m.x_m / 0.3048, y_m=m.y_m / 0.3048) for m in MARKERS]
    assert refusal(photo, lens, feet).code == "SC-C027"


def test_the_size_is_measured_to_one_part_in_a_thousand(photo, lens):
    found = plane_from_markers(photo, lens, MARKERS, DICTIONARY)
    assert found.marker_size_ratio == pytest.approx(1.0, abs=2e-3)
    assert abs(found.marker_size_ratio - 1.0) < 4 * found.marker_size_ratio_se
    assert found.marker_size_ratio_se < 1e-3


def test_one_marker_of_another_size_is_named(photo, lens):
    odd = [dataclasses.replace(m, size_m=0.072) if m.marker == 2 else m for m in MARKERS]
    [warning] = [
        text for text in plane_from_markers(photo, lens, odd, DICTIONARY).warnings if "marker 2" in text
    ]
    assert re.search(
        r"measures (79|80)\.\d mm relative to the others, \+1[01]\.\d%.*: about 0\.\d mm", warning
    )


def test_a_marker_in_front_of_the_plane_is_named(photograph, paint_markers, looking, lens):
    rotation, shift = looking(*POSE)
    others = photograph(
        *paint_markers([m for m in MARKERS if m.marker != 1], DICTIONARY), lens, rotation, shift
    )
    nearer = shift + rotation @ np.array([0.0, 0.0, 0.15])
    lone = photograph(*paint_markers([MARKERS[1]], DICTIONARY), lens, rotation, nearer)
    u, v = others.shape[1] // 2 + 200, others.shape[0] // 2
    both = others.copy()
    both[:v, u:] = lone[:v, u:]
    problem = refusal(both, lens, MARKERS)
    assert problem.code == "SC-C027"
    assert re.search(r"marker 1 measures .* 1[3-7]\d mm in front of their plane", problem.what)


def test_swapped_markers_are_named(photo, lens):
    swapped = [
        dataclasses.replace(MARKERS[2], marker=3),
        dataclasses.replace(MARKERS[3], marker=2),
        *MARKERS[:2],
        MARKERS[4],
    ]
    problem = refusal(photo, lens, swapped)
    assert problem.code == "SC-C027"
    assert "markers 2 and 3 are swapped" in problem.what
    assert cost_mm(problem) > 20


def test_a_rotated_marker_is_named(photo, lens):
    turned = [*MARKERS[:3], dataclasses.replace(MARKERS[3], angle_rad=np.pi / 2), MARKERS[4]]
    problem = refusal(photo, lens, turned)
    assert problem.code == "SC-C027"
    assert "marker 3 is rotated by 270 degrees" in problem.what


def test_y_counted_downwards_is_named(photo, lens):
    down = [dataclasses.replace(m, y_m=-m.y_m, angle_rad=-m.angle_rad) for m in MARKERS]
    problem = refusal(photo, lens, down)
    assert problem.code == "SC-C027"
    assert "y was counted downwards" in problem.what


def test_a_slightly_misplaced_marker_gives_a_warning_with_the_error(photo, lens):
    misplaced = [*MARKERS[:2], dataclasses.replace(MARKERS[2], x_m=0.598), *MARKERS[3:]]
    found = plane_from_markers(photo, lens, misplaced, DICTIONARY)
    assert len(found.warnings) == 1
    assert re.search(
        r"marker 2 is at .* (1\.[89]|2\.[012]) mm from the given position: about [01]\.\d mm",
        found.warnings[0],
    )
    off = {fit.marker: fit.off_m for fit in found.plane_markers}
    assert off[2][0] == pytest.approx(0.002, abs=4e-4)
    assert found.plane_error.place_sd_m > 2e-4
    assert (
        found.plane_error.worst_m
        > 2 * plane_from_markers(photo, lens, MARKERS, DICTIONARY).plane_error.worst_m
    )


def test_inaccurate_positions_are_refused_or_raise_the_standard_error(photo, lens):
    random = np.random.default_rng(1)
    rough = [
        dataclasses.replace(m, x_m=m.x_m + random.normal(0, 8e-3), y_m=m.y_m + random.normal(0, 8e-3))
        for m in MARKERS
    ]
    problem = refusal(photo, lens, rough)
    assert problem.code == "SC-C027"


@pytest.mark.parametrize(("apart", "refused"), [(1.0, False), (8.0, True)])
def test_an_imprecise_board_is_refused_only_where_it_costs_two_millimetres(lens, looking, apart, refused):
    """The corners are off by 1.5 px rms: 0.5 mm at the string, or 5.5 mm with a board eight times as far."""
    board = Board(
        squares_x=7, squares_y=5, square_m=0.035 * apart, marker_m=0.026 * apart, dictionary="DICT_5X5_100"
    )
    markers = board_markers(board, 0.0, 0.0)
    rotation, shift = looking(0.06, -0.1, 0.03, (0.12 * apart, 0.09 * apart), 0.4 * apart)
    world_m = np.array([marker.corners_m() for marker in markers])
    turn = cv2.Rodrigues(rotation)[0]
    pixels, _ = cv2.projectPoints(
        world_m.reshape(-1, 3), turn, shift, np.array(lens.matrix), np.array(lens.distortion)
    )
    corners_px = pixels.reshape(-1, 4, 2)
    corners_px += np.random.default_rng(0).normal(0.0, 1.5, (len(markers), 1, 2))
    fit = fit_pose(world_m, corners_px, lens)
    camera = _camera(lens, fit, 0.0, board.dictionary)
    layout = MarkerLayout(markers, corners_px, camera, fit, _around(markers), None, on_board=True)
    if refused:
        with pytest.raises(StrandcastError, match=r"SC-C027.*camera\.plane\.board"):
            check_markers(layout)
    else:
        [warning] = [words for words in check_markers(layout)[1] if "residual" in words]
        assert re.search(r"about 0\.\d mm at the string; flatten the board", warning)


def test_a_wrong_marker_size_names_the_setting_of_the_board(photo, lens):
    wrong = [dataclasses.replace(marker, size_m=0.07) for marker in MARKERS]
    for on_board, field in ((False, "camera.plane.size_m"), (True, "camera.plane.board.marker_m")):
        with pytest.raises(StrandcastError, match="SC-C027") as caught:
            plane_from_markers(photo, lens, wrong, DICTIONARY, on_board=on_board)
        assert caught.value.field == field


def test_the_board_in_the_plane_is_the_lens_board_unless_it_says_otherwise(tmp_path):
    text = """
string: {length_m: 0.3}
target_m: [0.5, 0.5]
camera:
  board: {squares_x: 9, square_m: 0.02, marker_m: 0.015}
  plane: {board: {x_m: 0.1, y_m: 0.0, squares_y: 4}}
"""
    (tmp_path / "experiment.yaml").write_text(text)
    placed = load_experiment(tmp_path / "experiment.yaml").camera.plane.board
    assert (placed.squares_x, placed.squares_y, placed.square_m, placed.x_m) == (9, 4, 0.02, 0.1)


def test_an_oversized_dictionary_gives_a_warning(photo, lens):
    found = plane_from_markers(photo, lens, MARKERS, "DICT_4X4_1000")
    assert any("DICT_4X4_50 has the same markers" in words for words in found.warnings)
    assert plane_from_markers(photo, lens, MARKERS, DICTIONARY).warnings == []
    with pytest.raises(StrandcastError, match="DICT_4X4_50 has no marker 60"):
        plane_from_markers(photo, lens, [*MARKERS, PlacedMarker(60, 0, 0, 0.08)], DICTIONARY)


def test_narrow_margins_of_white_are_named(photograph, paint_markers, looking, lens):
    def warnings(margin_cells: float) -> list[str]:
        painted = paint_markers(MARKERS, DICTIONARY, margin_cells=margin_cells, ground=60)
        picture = photograph(*painted, lens, *looking(*POSE))
        return plane_from_markers(picture, lens, MARKERS, DICTIONARY).warnings

    assert warnings(1.0) == []
    (words,) = warnings(0.75)
    assert re.match(r"markers \[0, 1, 2, 3, 4\] have 0\.[78] cells of white around them", words)
    # The outline of the white is taken for that of a marker.
    assert "another print, less than a cell of white" in " ".join(warnings(0.6))


def test_a_negative_is_named(photo, lens):
    with pytest.raises(StrandcastError, match="is a negative") as caught:
        plane_from_markers(255 - photo, lens, MARKERS, DICTIONARY)
    assert caught.value.code == "SC-C023"


def test_a_board_lying_in_the_plane_gives_the_same_plane(tmp_path, photograph, looking, lens, truth):
    board = Board(squares_x=7, squares_y=5, square_m=0.035, marker_m=0.026, dictionary="DICT_5X5_100")
    [page] = write_charuco(board, tmp_path / "board.png", dpi=200)
    texture = cv2.imread(str(page), cv2.IMREAD_GRAYSCALE)
    scale = 200 / 0.0254
    left_m, low_m = (
        (297 - 245) / 2e3,
        (22 + (210 - 22 - 175) / 2) / 1e3,
    )  # of the pattern on the page
    to_texture = np.array(
        [[scale, 0.0, left_m * scale - 0.5], [0.0, -scale, texture.shape[0] - low_m * scale - 0.5]]
    )
    rotation, shift = looking(0.06, -0.1, 0.03, (0.12, 0.09), 0.5)
    picture = photograph(texture, to_texture, lens, rotation, shift)
    markers = board_markers(board, 0.3, -0.2, np.pi / 2)
    found = plane_from_markers(picture, lens, markers, board.dictionary)
    assert found.warnings == []
    assert len(found.plane_markers) == 17
    near = truth.model_copy(update={"rotation": rotation.tolist(), "translation_m": shift.tolist()})
    places = np.stack(np.meshgrid(np.linspace(0, 0.245, 5), np.linspace(0, 0.175, 4)), axis=-1)
    turned = np.stack([0.3 - places[..., 1], -0.2 + places[..., 0]], axis=-1)
    back = pixel_to_metre(found, metre_to_pixel(near, places))
    assert np.abs(back - turned).max() < 2e-4


def test_a_lens_with_unequal_focal_lengths_is_named(photograph, paint_markers, looking, lens):
    matrix = [[1100.0, 0.0, 470.0], [0.0, 1320.0, 280.0], [0.0, 0.0, 1.0]]
    oblong = lens.model_copy(update={"matrix": matrix})
    pose = looking(0.06, -0.1, 0.03, (0.0, 0.02), 2.3)
    picture = photograph(*paint_markers(MARKERS, DICTIONARY), oblong, *pose)
    found = plane_from_markers(picture, oblong, MARKERS, DICTIONARY)
    [warning] = [text for text in found.warnings if "focal lengths differ" in text]
    assert "fx = 1100.0 and fy = 1320.0 px: its pixels are 1.2 times as wide as high" in warning
    assert found.plane_rms_px < 0.2


def test_the_strings_offset_is_corrected(photo, lens, truth):
    offset = {"string_offset_m": 0.02, "string_offset_sd_m": 1e-3}
    found = plane_from_markers(photo, lens, MARKERS, DICTIONARY, **offset)
    places = np.array([[-0.6, 0.3], [0.6, -0.3]])
    seen = metre_to_pixel(truth, places, 0.02)
    assert np.abs(pixel_to_metre(found, seen, found.string_offset_m) - places).max() < 3e-4
    uncorrected = np.linalg.norm(pixel_to_metre(found, seen) - places, axis=1)
    assert (uncorrected > 4e-3).all()  # 1 % of the distance to the axis
    per_mm = found.plane_error.sources_m["offset"] / 1e-3
    assert per_mm == pytest.approx(uncorrected.max() / 0.02 / np.sqrt(2), rel=0.25)


def test_standard_errors_over_the_workspace_are_right(lens, looking, corner_views):
    """Redraw lens, corners and places many times: a point scatters as much as the record states."""
    rotation, shift = looking(*POSE)
    world_m = np.array([marker.corners_m() for marker in MARKERS])
    random = np.random.default_rng(4)
    box = ((-0.6, 0.6), (-0.3, 0.35))
    places = grid_over(box)
    camera = Camera(
        lens=lens,
        rotation=rotation.tolist(),
        translation_m=shift.tolist(),
        plane_rms_px=0.0,
        plane_markers=[],
        string_offset_m=0.02,
        scale_m_per_px=1.9 / 1095,
        source="given",
    )
    pixels = metre_to_pixel(camera, places, 0.02)
    off, stated = [], []
    for seed in range(24):
        views = corner_views(lens.distortion, seed, views=8, noise_px=0.1)
        fit = fit_lens(views, (960, 540), "k1k2p1p2")
        guessed = lens.model_copy(
            update={
                "matrix": fit.matrix.tolist(),
                "distortion": fit.distortion.tolist(),
                "covariance": lens_covariance(views, fit, (960, 540)).tolist(),
            }
        )
        moved_m = world_m + np.dstack([random.normal(0, 1e-3, (5, 1, 2)), np.zeros((5, 1, 1))])
        corners = project(moved_m, rotation, shift, lens) + random.normal(0, 0.1, (5, 4, 2))
        pose = fit_pose(world_m, corners, guessed)
        mine = posed(camera.model_copy(update={"lens": guessed}), pose)
        off.append(pixel_to_metre(mine, pixels, 0.02) - places)
        stated.append(plane_error(mine, pose, box, place_m=1e-3).sigma_m)
    spread = np.sqrt((np.array(off) ** 2).mean(axis=(0, -1)))
    ratio = spread / np.mean(stated, axis=0)
    assert 0.75 < np.median(ratio) < 1.3
    assert (ratio > 0.5).all()
    assert (ratio < 1.7).all()


def test_the_residuals_give_the_positions_standard_deviation(lens, looking):
    rotation, shift = looking(*POSE)
    world_m = np.array([marker.corners_m() for marker in MARKERS])
    random = np.random.default_rng(2)
    for wanted_m in (0.0, 1e-3):
        found = []
        for _ in range(40):
            moved_m = world_m + np.dstack([random.normal(0, wanted_m, (5, 1, 2)), np.zeros((5, 1, 1))])
            corners = project(moved_m, rotation, shift, lens) + random.normal(0, 0.05, (5, 4, 2))
            found.append(place_sd_m(fit_pose(world_m, corners, lens), 1.9 / 1095))
        assert np.sqrt(np.mean(np.square(found))) == pytest.approx(wanted_m, rel=0.2, abs=1e-4)


def test_the_corners_noise_is_not_taken_for_scatter_of_the_positions():
    """Noise of 0.5 px per corner leaves 0.25 px in the mean of a marker's four."""
    noise_px = 0.5 * np.sqrt(0.75) * np.array([1.0, -1.0, 1.0, -1.0])  # three degrees of freedom of four
    residuals_px = np.zeros((5, 4, 2)) + noise_px[:, None] + np.array([0.5, 0.0])
    fit = PoseFit(*[np.empty(0)] * 3, residuals_px, 0.0)
    assert fit.corner_sigma_px() == pytest.approx(0.5)
    # Five centres 0.5 px off, four degrees of freedom: 5 · 0.5² / 4 - 0.25² = 0.5².
    assert place_sd_m(fit, 0.002) == pytest.approx(0.001)


def test_a_weak_lens_gives_a_warning_with_the_error_at_the_string(photo, lens):
    def weak(sigma_k1: float) -> Lens:
        covariance = np.diag([1.0, 1.0, 1.0, 1.0, sigma_k1**2, 1e-4, 1e-8, 1e-8, 0.0])
        return lens.model_copy(
            update={"covariance": covariance.tolist(), "weaknesses": ["only 3 photos of the board"]}
        )

    known = {"workspace_m": ((-0.8, 0.8), (-0.45, 0.45))}
    found = plane_from_markers(photo, weak(0.02), MARKERS, DICTIONARY, **known)
    assert re.search(r"the lens costs up to [\d.]+ mm .*only 3 photos of the board", found.warnings[0])
    problem = refusal(photo, weak(0.3), MARKERS, **known)
    assert problem.code == "SC-C013"
    assert "only 3 photos" in problem.what
    assert cost_mm(problem) > 5


def test_a_wrong_size_is_named(photo, lens):
    wrong = [dataclasses.replace(marker, size_m=0.072) for marker in MARKERS]
    with pytest.raises(
        StrandcastError, match=r"measure (79\.\d+|80(\.\d+)?) mm .* \+1[01]\.\d% from the given size"
    ):
        plane_from_markers(photo, lens, wrong, DICTIONARY)


def test_a_picture_of_another_size_is_refused(photo, lens):
    with pytest.raises(StrandcastError, match="480 x 270 px; the lens was calibrated at 960 x 540"):
        plane_from_markers(cv2.resize(photo, (480, 270)), lens, MARKERS, DICTIONARY)


def test_twelve_bits_give_the_plane_of_eight(photo, lens):
    eight = plane_from_markers(photo, lens, MARKERS, DICTIONARY)
    twelve = plane_from_markers(photo.astype(np.uint16) * 16, lens, MARKERS, DICTIONARY)
    np.testing.assert_allclose(twelve.translation_m, eight.translation_m, atol=1e-3)


def test_pose_of_a_marker_in_front_of_the_plane(photograph, paint_markers, looking, lens, truth):
    hand = PlacedMarker(40, 0.21, -0.07, 0.05, 0.7)
    rotation, shift = looking(*POSE)
    nearer = shift + rotation @ np.array([0.0, 0.0, 0.02])  # the picture of the plane 20 mm in front
    photo = photograph(*paint_markers([hand], DICTIONARY), lens, rotation, nearer)
    ids, corners = detect_markers(photo, marker_detector(DICTIONARY))
    assert ids.tolist() == [40]
    pose, sigma_m = marker_pose(truth, corners, hand.size_m, 0.02)
    np.testing.assert_allclose(pose[0, :2], (0.21, -0.07), atol=2e-4)
    assert pose[0, 2] == pytest.approx(0.7, abs=5e-3)
    assert 1e-5 < sigma_m[0] < 5e-4
    behind, _ = marker_pose(truth, corners, hand.size_m, 0.0)
    assert np.linalg.norm(behind[0, :2] - pose[0, :2]) > 1e-3  # the offset matters
