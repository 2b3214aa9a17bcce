"""A wide lens: OpenCV's fisheye model, from photos of a board and from other programs' files."""

import cv2
import numpy as np
import pytest

from strandcast.camera.lens import calibrate_lens
from strandcast.camera.lens_file import read_lens
from strandcast.camera.mapping import distort, metre_to_pixel, pixel_to_metre, ray_per_pixel, undistort
from strandcast.camera.plane import plane_from_markers
from strandcast.camera.plane_error import worst_difference_m
from strandcast.camera.stereo import stereo_pose
from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera, Lens, is_fisheye

from .test_lens import BOARD, VIEWS, board_photos
from .test_plane import DICTIONARY, MARKERS
from .test_stereo import BETWEEN, camera_of

BOX = (-0.6, 0.6), (-0.3, 0.35)
POSE = (0.06, -0.1, 0.03, (0.0, 0.02), 0.75)
# 131 degrees across: an action camera in its wide mode.
CLOSE = [(*view[:3], view[3], 0.16) for view in VIEWS] + [
    (0.3, -0.4, 0.2, (0.02, 0.02), 0.17),
    (-0.4, 0.3, -0.2, (0.24, 0.16), 0.17),
    (0.2, 0.4, 0.0, (0.02, 0.16), 0.17),
    (-0.2, -0.5, 0.1, (0.24, 0.02), 0.17),
]


@pytest.fixture(scope="module")
def wide() -> Lens:
    return Lens(
        width_px=1280,
        height_px=720,
        matrix=[[560.0, 0.0, 633.0], [0.0, 557.0, 366.0], [0.0, 0.0, 1.0]],
        distortion=[0.05, -0.012, 0.004, -0.001],
        rms_px=0.0,
    )


@pytest.fixture(scope="module")
def photos(tmp_path_factory, photograph, looking, wide) -> list[tuple[str, np.ndarray]]:
    return board_photos(BOARD, tmp_path_factory.mktemp("print"), photograph, looking, wide, CLOSE)


@pytest.fixture(scope="module")
def found(photos) -> Lens:
    return calibrate_lens(photos, BOARD)[0]  # it is chosen: no polynomial fits


def test_pixels_and_rays_are_those_of_opencv(wide):
    random = np.random.default_rng(1)
    angle, about = np.radians(random.uniform(0.0, 80.0, 500)), random.uniform(0.0, 2.0 * np.pi, 500)
    rays = np.column_stack([np.cos(about), np.sin(about)]) * np.tan(angle)[:, None]
    rays[:2] = [0.0, 0.0], [1e-6, 0.0]
    lens = np.array(wide.matrix), np.array(wide.distortion)
    pixels = cv2.fisheye.distortPoints(rays[None], *lens)[0]
    assert distort(wide, rays) == pytest.approx(pixels, abs=1e-9)
    assert undistort(wide, pixels) == pytest.approx(rays, rel=1e-9, abs=1e-12)
    step = 1e-4 * np.eye(2)
    slopes = [(undistort(wide, pixels + each) - undistort(wide, pixels - each)) / 2e-4 for each in step]
    assert ray_per_pixel(wide, rays) == pytest.approx(np.stack(slopes, -1), rel=1e-5, abs=1e-9)
    assert np.isnan(undistort(wide, np.array([-400.0, -400.0]))).all()  # behind the camera


def test_a_fisheye_lens_is_recovered_where_a_pinhole_fails(photos, found, wide):
    assert (found.model, len(found.distortion)) == ("fisheye", 4)
    assert found.rms_px < 0.25
    truth = {"fx_px": (0, 0), "fy_px": (1, 1), "cx_px": (0, 2), "cy_px": (1, 2)}
    for name, (row, column) in truth.items():
        off = found.matrix[row][column] - wide.matrix[row][column]
        assert abs(off) < 4 * found.standard_errors[name] + 0.5, name
    with pytest.raises(StrandcastError, match="set camera.distortion: fisheye"):
        calibrate_lens(photos, BOARD, "k1k2k3p1p2")


def test_the_plane_is_mapped_through_it(found, wide, photograph, paint_markers, looking):
    rotation, shift_m = looking(*POSE)
    truth = camera_of(wide, rotation, shift_m)
    photo = photograph(*paint_markers(MARKERS, DICTIONARY), wide, rotation, shift_m)
    for lens, allowed_m in ((wide, 1e-4), (found, 3e-4)):
        camera = plane_from_markers(photo, lens, MARKERS, DICTIONARY)
        assert worst_difference_m(camera, truth, BOX) < allowed_m
        assert camera.plane_error is not None
        assert worst_difference_m(camera, truth, BOX) < 4.0 * camera.plane_error.worst_m
    places = np.stack(np.meshgrid(*(np.linspace(*side, 5) for side in BOX)), axis=-1)
    assert pixel_to_metre(truth, metre_to_pixel(truth, places)) == pytest.approx(places, abs=1e-9)


@pytest.mark.thorough
def test_a_second_camera_is_placed_by_boards(tmp_path, photograph, looking, wide):
    poses = [looking(*view[:4], 0.3) for view in VIEWS[:4]]
    seconds = [(BETWEEN[0] @ turn, BETWEEN[0] @ shift + BETWEEN[1]) for turn, shift in poses]
    prints = board_photos(BOARD, tmp_path, photograph, lambda *pose: pose, wide, [*poses, *seconds])
    pictures = [picture for _, picture in prints]
    first, second = (camera_of(wide, np.eye(3), np.zeros(3)) for _ in range(2))
    pose = stereo_pose(list(zip(pictures[:4], pictures[4:], strict=True)), BOARD, first, second)
    assert pose.rms_px < 0.4
    assert np.linalg.norm(cv2.Rodrigues(pose.rotation @ BETWEEN[0].T)[0]) < 3e-3
    assert np.linalg.norm(pose.translation_m - BETWEEN[1]) < 2e-3


@pytest.mark.parametrize(
    ("words", "asked"),
    [("distortion_model: equidistant", False), ("fisheye: true", False), ("camera_name: gopro", True)],
)
def test_another_programs_fisheye_lens_is_read(tmp_path, wide, words, asked):
    path = tmp_path / "lens.yaml"
    matrix = np.ravel(wide.matrix).tolist()
    text = f"image_width: 1280\nimage_height: 720\n{words}\nK: {matrix}\nD: {wide.distortion}\n"
    path.write_text(text, encoding="utf-8")
    lens = read_lens(path, fisheye=asked)
    assert (lens.distortion, lens.matrix) == (wide.distortion, wide.matrix)
    assert is_fisheye(
        Camera.model_validate(camera_of(lens, np.eye(3), np.zeros(3)).model_dump()).lens.distortion
    )
    path.write_text(text.replace("0.05, ", "0.05, 0.0, "), encoding="utf-8")
    with pytest.raises(StrandcastError, match=r"5 distortion coefficients; a fisheye lens has four"):
        read_lens(path, fisheye=asked)
