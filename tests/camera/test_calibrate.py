"""The calibration stage with files: photos or a video of the board, the plane's photo, the record."""

import re
import textwrap
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image

from strandcast.camera.boards import write_charuco
from strandcast.camera.flat import flat_camera
from strandcast.camera.frames import choose_frames, corner_sharpness
from strandcast.camera.lens import calibrate_lens
from strandcast.camera.mapping import metre_to_pixel, pixel_to_metre
from strandcast.camera.markers import opencv_board, patterned
from strandcast.camera.plane import board_markers, plane_from_markers
from strandcast.camera.pose import PlacedMarker
from strandcast.camera.printed_board import PrintedBoard
from strandcast.camera.views import find_board
from strandcast.config.camera import Board, CameraSettings
from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera, Lens
from strandcast.records.summary import ExperimentSummary
from strandcast.report.panels.calibration import camera_picture
from strandcast.report.panels.page_data import ExperimentPageData
from strandcast.stages.calibrate import _board_frames, _warn_of_former, plane_markers_of
from strandcast.stages.context import context_of
from strandcast.stages.run import run_stage
from strandcast.workflow.check import check_experiment

BOARD = Board(squares_x=7, squares_y=5, square_m=0.035, marker_m=0.026, dictionary="DICT_5X5_100")
MARKERS = [
    PlacedMarker(0, -0.6, 0.35, 0.08),
    PlacedMarker(1, 0.6, 0.35, 0.08, 0.4),
    PlacedMarker(2, 0.6, -0.3, 0.08, -1.0),
    PlacedMarker(3, -0.6, -0.3, 0.08),
]
# (tilts, turn, place of the board looked at, distance): the board goes through all of the picture.
STATIONS = [
    (0.5, 0.1, 0.0, (0.02, 0.03), 0.42),
    (-0.5, 0.2, 0.1, (0.26, 0.03), 0.42),
    (0.1, 0.6, 0.0, (0.26, 0.15), 0.42),
    (0.1, -0.6, -0.1, (0.02, 0.15), 0.42),
    (0.4, 0.4, 0.3, (0.15, 0.09), 0.36),
    (-0.3, -0.5, 0.0, (0.13, 0.10), 0.36),
]
BLURRED = 3  # every so many frames of the video
EXPERIMENT = """\
string: {length_m: 0.3}
target_m: [0.3, 0.1]
workspace_m: {x_m: [-0.55, 0.55], y_m: [-0.25, 0.3]}
camera:
  string_offset_m: 0.02
  plane:
    size_m: 0.08
    markers:
      - {id: 0, x_m: -0.6, y_m: 0.35}
      - {id: 1, x_m: 0.6, y_m: 0.35, angle_rad: 0.4}
      - {id: 2, x_m: 0.6, y_m: -0.3, angle_rad: -1.0}
      - {id: 3, x_m: -0.6, y_m: -0.3}
"""


@pytest.fixture(scope="module")
def board_seen(tmp_path_factory, photograph, looking, lens):
    """Return a function: (view, seed) -> a photo of the board."""
    [page] = write_charuco(BOARD, tmp_path_factory.mktemp("print") / "board.png", dpi=150)
    texture = cv2.imread(str(page), cv2.IMREAD_GRAYSCALE)
    scale = 150 / 0.0254
    to_texture = np.array([[scale, 0.0, 112.5], [0.0, -scale, texture.shape[0] - 112.5]])

    def photo(view, seed: int = 0) -> np.ndarray:
        return photograph(texture, to_texture, lens, *looking(*view), seed=seed)

    return photo


@pytest.fixture(scope="module")
def plane_photo(photograph, paint_markers, looking, lens) -> np.ndarray:
    return photograph(
        *paint_markers(MARKERS, "DICT_4X4_50"), lens, *looking(0.06, -0.1, 0.03, (0.0, 0.02), 1.9)
    )


@pytest.fixture(scope="module")
def frames(board_seen) -> list[np.ndarray]:
    """Return frames of a board moved from pose to pose; every third frame is blurred."""
    flat = np.array([[*view[:3], *view[3], view[4]] for view in STATIONS])
    found = []
    for k, share in enumerate(np.linspace(0, len(flat) - 1, 18)):
        a, b, c, x, y, far = (np.interp(share, np.arange(len(flat)), column) for column in flat.T)
        grey = board_seen((a, b, c, (x, y), far), k)
        found.append(cv2.blur(grey, (9, 1)) if k % BLURRED == 2 else grey)
    return found


def film(path: Path, pictures: list[np.ndarray]) -> None:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mjpeg", rate=30, options={"qmin": "2", "qmax": "2"})
        stream.width, stream.height, stream.pix_fmt = pictures[0].shape[1], pictures[0].shape[0], "yuvj420p"
        stream.time_base = Fraction(1, 30)
        for index, grey in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(grey, format="gray").reformat(format="yuvj420p")
            frame.pts = index
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


@pytest.fixture
def root(tmp_path, project_root, plane_photo) -> Path:
    """Return a project with an experiment without its lens photos."""
    (tmp_path / "config").symlink_to(project_root / "config")
    folder = tmp_path / "data" / "own"
    (folder / "calibration").mkdir(parents=True)
    (folder / "experiment.yaml").write_text(EXPERIMENT)
    cv2.imwrite(str(folder / "calibration" / "plane.png"), plane_photo)
    return tmp_path


def truth_of(camera: Camera, lens, looking) -> Camera:
    rotation, shift = looking(0.06, -0.1, 0.03, (0.0, 0.02), 1.9)
    pose = {"rotation": rotation.tolist(), "translation_m": shift.tolist(), "lens": lens}
    return camera.model_copy(update=pose)


def test_a_lens_video_needs_no_rate(tmp_path):
    path = tmp_path / "board.tif"
    tifffile.imwrite(path, np.zeros((3, 24, 32), np.uint8), photometric="minisblack")
    assert [name for name, _ in _board_frames(path)] == [f"board.tif frame {k}" for k in range(3)]


@pytest.mark.thorough
def test_a_video_of_the_board_gives_lens_plane_and_picture(root, frames, lens, looking):
    folder, results = root / "data" / "own", root / "results" / "own"
    film(folder / "calibration" / "board.avi", frames)
    text = EXPERIMENT.replace("camera:\n", "camera:\n  lens: calibration/board.avi\n")
    (folder / "experiment.yaml").write_text(text)
    run_stage("calibrate", root, "own")
    camera = Camera.read(results / "cameras" / "main.json")
    assert 8 <= len(camera.lens.views) <= 12  # of 18 the 12 sharp ones, at most
    numbers = [int(view.file.split()[-1]) for view in camera.lens.views]
    assert all(number % BLURRED != 2 for number in numbers)
    assert camera.lens.rms_px < 0.3
    assert camera.lens.matrix[0][0] == pytest.approx(1100.0, rel=0.004)
    x, y = np.meshgrid(camera.plane_error.x_m, camera.plane_error.y_m)
    places = np.stack([x, y], axis=-1)
    back = pixel_to_metre(camera, metre_to_pixel(truth_of(camera, lens, looking), places, 0.02), 0.02)
    off = np.linalg.norm(back - places, axis=-1)
    assert off.max() < 5e-4
    assert (off < 4 * np.array(camera.plane_error.sigma_m)).all()
    assert Image.open(results / "cameras" / "main.webp").size[0] == 1600
    summary = ExperimentSummary(
        experiment="own",
        string_length_m=0.3,
        target_m=[0, 0],
        hit_radius_m=0.02,
        verdict="no hit",
        hit_trial=None,
        trials=[],
        next_motion_sha256=None,
    )
    content = camera_picture(ExperimentPageData(summary, {}, results))
    assert f"±{camera.plane_error.worst_m * 1e3:.2f} mm at worst" in content.finding
    assert "data:image/webp;base64," in content.drawing


@pytest.mark.thorough
def test_photos_are_read_as_the_sensor_has_them(root, board_seen):
    """A phone stores a rotation tag; a rotated picture would not fit the lens."""
    folder = root / "data" / "own" / "calibration"
    for k, view in enumerate(STATIONS):
        exif = Image.Exif()
        exif[0x0112] = 3  # upside down
        Image.fromarray(board_seen(view, k)).save(folder / f"lens-{k}.jpg", quality=95, exif=exif)
    experiment = EXPERIMENT.replace("camera:\n", 'camera:\n  lens: "calibration/lens-*.jpg"\n')
    (folder.parent / "experiment.yaml").write_text(experiment)
    run_stage("calibrate", root, "own")
    lens = Camera.read(root / "results" / "own" / "cameras" / "main.json").lens
    assert lens.matrix[0][2] == pytest.approx(470.0, abs=4)
    assert lens.matrix[1][2] == pytest.approx(280.0, abs=4)


def write_lens(path: Path, lens: Lens) -> None:
    """Write the lens as a file of OpenCV's."""
    path.write_text(
        f"image_width: {lens.width_px}\nimage_height: {lens.height_px}\n"
        f"camera_matrix: {np.ravel(lens.matrix).tolist()}\n"
        f"distortion_coefficients: {list(lens.distortion)}\n"
    )


def test_a_distance_of_the_string_that_is_not_given_is_asked_for(root, lens):
    folder = root / "data" / "own"
    write_lens(folder / "lens.yaml", lens)
    given = EXPERIMENT.replace("camera:\n", "camera:\n  lens: lens.yaml\n")
    for line, asked in (("", 1), ("  string_offset_m: 0.0\n", 0)):
        (folder / "experiment.yaml").write_text(given.replace("  string_offset_m: 0.02\n", line))
        run_stage("calibrate", root, "own")
        warnings = Camera.read(root / "results/own/cameras/main.json").warnings
        assert ["string_offset_m is not given" in text for text in warnings].count(True) == asked
        # 0.7 m from the camera's axis at 1.9 m: 10 mm in front are 3.7 mm beside
        assert all(2.0 < float(re.search(r"up to ([\d.]+) mm", text)[1]) < 4.5 for text in warnings)


def test_a_legacy_board_white_on_black_in_the_plane_is_recognised_and_the_warnings_printed(
    root, tmp_path, photograph, looking, lens, capsys
):
    legacy = patterned(BOARD).model_copy(update={"squares_y": 4, "legacy": True})
    [page] = write_charuco(legacy, tmp_path / "board.png", dpi=200)
    texture = cv2.imread(str(page), cv2.IMREAD_GRAYSCALE)
    scale, left_m, low_m = 200 / 0.0254, (297 - 245) / 2e3, (22 + (210 - 22 - 140) / 2) / 1e3
    to_texture = np.array(
        [[scale, 0.0, left_m * scale - 0.5], [0.0, -scale, texture.shape[0] - low_m * scale - 0.5]]
    )
    pose = looking(0.06, -0.1, 0.03, (0.12, 0.07), 0.5)
    folder = root / "data" / "own"
    negative = 255 - photograph(texture, to_texture, lens, *pose)
    cv2.imwrite(str(folder / "calibration" / "plane.png"), negative)
    write_lens(folder / "lens.yaml", lens)
    board = "squares_x: 7, squares_y: 4, square_m: 0.035, marker_m: 0.026, dictionary: DICT_5X5_100"
    (folder / "experiment.yaml").write_text(
        "string: {length_m: 0.1}\ntarget_m: [0.1, 0.1]\ncamera:\n  lens: lens.yaml\n"
        f"  plane: {{board: {{{board}, x_m: 0.0, y_m: 0.0}}}}\n"
    )
    run_stage("calibrate", root, "own")
    camera = Camera.read(root / "results" / "own" / "cameras" / "main.json")
    assert camera.plane_rms_px < 0.2
    assert "white on black" in camera.warnings[0]
    assert f"warning: {camera.warnings[0]}" in capsys.readouterr().err
    assert [fact for fact in check_experiment(root, "own").facts if "white on black" in fact]
    places = np.array([[0.0, 0.0], [0.245, 0.14]])
    truth = camera.model_copy(
        update={"rotation": pose[0].tolist(), "translation_m": pose[1].tolist(), "lens": lens}
    )
    assert np.abs(pixel_to_metre(camera, metre_to_pixel(truth, places)) - places).max() < 3e-4


def test_the_plane_has_the_lens_boards_pattern_where_it_is_cut_off():
    declared = BOARD.model_copy(update={"squares_y": 6})
    printed = patterned(declared).model_copy(update={"first_id": 12})
    drawn = opencv_board(printed).generateImage((760, 660), marginSize=30)
    cut = drawn[30:500]  # without the last row, below which the world begins, and what is above the first
    plane = {"board": {**declared.model_dump(), "x_m": 0.0, "y_m": 0.0}}
    settings = CameraSettings(board=declared, plane=plane)
    with pytest.raises(StrandcastError, match="is cut off in the photo, and may have other ids"):
        plane_markers_of(settings, cut, "plane.png")
    of_lens = PrintedBoard(printed, [], is_shown=True)
    known, *_, none = plane_markers_of(settings, cut, "plane.png", of_lens)
    assert none == []
    assert known == board_markers(printed, 0.0, 0.0)
    assert [each.marker for each in known] == [*range(12, 12 + 21)]
    other = PrintedBoard(patterned(declared), [], is_shown=True)
    with pytest.raises(StrandcastError, match="may have other ids"):  # than another print of the same board
        plane_markers_of(settings, cut, "plane.png", other)


def test_missing_files_are_named(root):
    with pytest.raises(StrandcastError, match=r"no photo or video of the lens board; there: plane\.png"):
        run_stage("calibrate", root, "own")
    (root / "data" / "own" / "experiment.yaml").write_text(
        textwrap.dedent(EXPERIMENT).replace("camera:\n", "camera:\n  lens: calibration/board.avi\n")
    )
    with pytest.raises(StrandcastError, match=r"board\.avi: camera\.lens: there is no video"):
        run_stage("calibrate", root, "own")


@pytest.mark.thorough
def test_sharp_and_different_frames_are_chosen(frames):
    for sharp, smeared in ((frames[1], frames[2]), (frames[4], frames[5])):
        corners = find_board(sharp, BOARD)[1], find_board(smeared, BOARD)[1]
        assert corner_sharpness(smeared, corners[1]) < 0.6 * corner_sharpness(sharp, corners[0])
    chosen = choose_frames(((str(k), grey) for k, grey in enumerate(frames)), BOARD, kept=5)
    numbers = [int(view.file) for view, _ in chosen]
    assert len(numbers) == 5
    assert all(number % BLURRED != 2 for number in numbers)
    assert min(np.diff(numbers)) >= 2
    none = choose_frames([("a", np.full_like(frames[0], 90))], BOARD)
    assert none[0][1] is None
    assert "fewer than 8 of the board's 24 corners" in none[0][0].reason


@pytest.mark.parametrize(
    ("views", "words"),
    [
        ([STATIONS[0], STATIONS[2], STATIONS[5]], "only 3 photos of the board"),
        pytest.param(
            [(0.02 * k, 0.0, 0.2 * k, (0.04 * k, 0.03 * k), 0.42 + 0.02 * k) for k in range(7)],
            "tilts differ by",
            marks=pytest.mark.thorough,
        ),
        pytest.param(
            [(*view[:3], (view[3][0] * 2 - 0.14, view[3][1] * 2 - 0.1), 1.5) for view in STATIONS],
            "of the picture's width",
            marks=pytest.mark.thorough,
        ),
    ],
)
def test_weak_photos_give_a_warning_with_the_error_at_the_string(board_seen, plane_photo, views, words):
    found, _ = calibrate_lens([(str(k), board_seen(view, k)) for k, view in enumerate(views)], BOARD)
    assert any(words in weakness for weakness in found.weaknesses)
    offset, box_m = {"string_offset_m": 0.02, "string_offset_sd_m": 1e-3}, ((-0.55, 0.55), (-0.25, 0.3))
    try:
        camera = plane_from_markers(plane_photo, found, MARKERS, "DICT_4X4_50", **offset, workspace_m=box_m)
    except StrandcastError as problem:
        assert problem.code == "SC-C013"
        assert words in problem.what
        assert "mm (standard error) at the string" in problem.cost
    else:
        [warning] = [text for text in camera.warnings if words in text]
        assert "mm (standard error) at the string" in warning
        assert camera.plane_error.sources_m["lens"] > 1e-4


def test_a_record_under_its_former_name_gives_a_warning(tmp_path, capsys):
    folder = tmp_path / "data" / "own"
    folder.mkdir(parents=True)
    (folder / "experiment.yaml").write_text("string: {length_m: 0.3}\ntarget_m: [0.5, 0.5]\n")
    context = context_of(tmp_path, "own")
    former = context.folder.results / "camera.json"
    flat_camera(64, 48, 0.001, (32.0, 24.0)).write(former)
    _warn_of_former(context)
    assert "camera.json is not read; the camera's record is now" in capsys.readouterr().err
