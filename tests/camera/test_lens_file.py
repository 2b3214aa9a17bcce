"""Lenses that other programs calibrated, in the forms that they write, and through the stage."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from ruamel.yaml import YAML
from tests.faults.small import SETTINGS

from strandcast.camera.lens_file import read_lens
from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera
from strandcast.stages.run import run_stage

MATRIX = np.array([[1201.5, 0.0, 641.25], [0.0, 1199.75, 358.5], [0.0, 0.0, 1.0]])
DISTORTION = np.array([-0.12, 0.03, 0.0011, -0.0007, 0.002])
FLAT = ", ".join(map(repr, MATRIX.ravel().tolist()))
ROWS = [[float(x) for x in row] for row in MATRIX]

ROS = f"""\
image_width: 1280
image_height: 720
camera_name: narrow
camera_matrix:
  rows: 3
  cols: 3
  data: [{FLAT}]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: {DISTORTION.tolist()}
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [1180.0, 0, 641.0, 0, 0, 1180.0, 358.0, 0, 0, 0, 1, 0]
"""
KALIBR = f"""\
cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: {DISTORTION[:4].tolist()}
  distortion_model: radtan
  intrinsics: [1201.5, 1199.75, 641.25, 358.5]
  resolution: [1280, 720]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, 0.1]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [0.1, 0.1, 0.1, 0.1]
  distortion_model: equidistant
  intrinsics: [700.0, 700.0, 640.0, 360.0]
  resolution: [1280, 720]
  rostopic: /cam1/image_raw
"""
ANIPOSE = f"""\
[cam_0]
name = "side"
size = [ 1280, 720,]
matrix = {ROWS}
distortions = {DISTORTION.tolist()}
rotation = [ 0.0, 0.0, 0.0,]
translation = [ 0.0, 0.0, 0.0,]

[cam_1]
name = "front"
size = [ 640, 480,]
matrix = [ [ 500.0, 0.0, 320.0,], [ 0.0, 500.0, 240.0,], [ 0.0, 0.0, 1.0,],]
distortions = [ 0.0, 0.0, 0.0, 0.0, 0.0,]
rotation = [ 0.0, 1.0, 0.0,]
translation = [ 0.1, 0.0, 0.0,]

[metadata]
adjusted = false
error = 0.41
"""
MESSAGE = f"""\
header:
  seq: 0
  frame_id: side
height: 720
width: 1280
distortion_model: plumb_bob
D: {DISTORTION.tolist()}
K: [{FLAT}]
"""
OPENCV_5 = f"""\
%YAML:1.0
---
image_width: 1280
image_height: 720
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ {FLAT} ]
distortion_coefficients: !!opencv-nd-matrix
   sizes: [ 5 ]
   dt: d
   data: {DISTORTION.tolist()}
"""
CALISCOPE = f"""\
[cameras.0]
port = 0
size = [1280, 720]
rotation_count = 0
ignore = true

[cameras.1]
port = 1
size = [1280, 720]
rotation_count = 0
error = 0.31
matrix = {ROWS}
distortions = {DISTORTION.tolist()}
exposure = -4
grid_count = 27
ignore = false
verified_resolutions = []
"""


def write_opencv(path: Path, matrix: np.ndarray, distortion: np.ndarray, size: tuple[int, int]) -> Path:
    """Write a calibration as OpenCV's own calibration sample does."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in (("image_width", size[0]), ("image_height", size[1])):
        storage.write(name, value)
    storage.write("camera_matrix", matrix)
    storage.write("distortion_coefficients", distortion.reshape(-1, 1))
    storage.write("avg_reprojection_error", 0.25)
    storage.release()
    return path


def test_a_file_without_the_size_says_which_lines_to_add(tmp_path) -> None:
    path = tmp_path / "calibration_matrix.yaml"
    path.write_text(f"camera_matrix: {ROWS}\ndist_coeff: [{DISTORTION.tolist()}]\n")
    with pytest.raises(StrandcastError, match="image_width: 1280 and image_height: 720") as caught:
        read_lens(path)
    assert caught.value.code == "SC-C050"
    path.write_text(path.read_text() + "image_width: 1280\nimage_height: 720\n")
    assert read_lens(path).distortion == DISTORTION.tolist()


@pytest.mark.parametrize(
    ("text", "suffix", "name"),
    [
        (ROS, "yaml", None),
        (KALIBR, "yaml", "cam0"),
        (ANIPOSE, "toml", "side"),
        (ANIPOSE, "toml", "cam_0"),
        (CALISCOPE, "toml", None),
        (CALISCOPE, "toml", "1"),
        (None, "yml", None),
        (MESSAGE + "---\n" + MESSAGE + "---\n", "yaml", None),
        (MESSAGE.replace("D:", "d:").replace("K:", "k:") + "---\n", "yaml", None),
        (OPENCV_5, "yaml", None),
    ],
    ids=[
        "ros",
        "kalibr",
        "anipose by name",
        "anipose by section",
        "caliscope",
        "caliscope by section",
        "opencv",
        "ros 1 messages",
        "ros 2 message",
        "opencv 5",
    ],
)
def test_a_lens_is_read_as_its_program_wrote_it(tmp_path, text, suffix, name) -> None:
    path = tmp_path / f"camera.{suffix}"
    if text is None:
        write_opencv(path, MATRIX, DISTORTION, (1280, 720))
    else:
        path.write_text(text)
    lens = read_lens(path, name)
    assert (lens.width_px, lens.height_px) == (1280, 720)
    assert lens.matrix == MATRIX.tolist()
    assert lens.distortion == ([*DISTORTION[:4], 0.0] if text == KALIBR else DISTORTION.tolist())
    assert lens.model == "given"


@pytest.mark.parametrize(
    ("words", "text", "name"),
    [
        ("expected ','", "a: [1", None),
        ("has 0 cameras", "{}", None),
        ("2 cameras", KALIBR, None),
        ("no camera 'cam7'", KALIBR, "cam7"),
        ("lens model is 'fov'", KALIBR.replace("equidistant", "fov"), "cam1"),
        ("lens model is 'omni'", KALIBR.replace("pinhole", "omni"), "cam0"),
        ("5 distortion coefficients", ROS.replace("plumb_bob", "equidistant"), None),
        ("5 distortion coefficients", f"fisheye_model: 1\n{ROS}", None),
        ("size is missing", ROS.replace("image_width: 1280\n", ""), None),
        ("number", ROS.replace("1201.5", ".nan"), None),
        ("(3,3)", ROS.replace("0.0, 0.0, 1.0]", "0.0, 1.0]"), None),
    ],
)
def test_what_is_no_known_lens_is_refused(tmp_path, words, text, name) -> None:
    (tmp_path / "camera.yaml").write_text(text)
    with pytest.raises(StrandcastError) as refused:
        read_lens(tmp_path / "camera.yaml", name)
    assert refused.value.code == "SC-C050"
    assert words in refused.value.what
    assert refused.value.fix


@pytest.mark.thorough
def test_a_known_lens_needs_no_board(tmp_path, project_root) -> None:
    shutil.copytree(project_root / "config" / "arms", tmp_path / "config" / "arms")
    settings = YAML(typ="safe").load(SETTINGS)
    for name, stages in (("lab", ("lab_calibrate", "calibrate")), ("own", ("calibrate",))):
        folder = tmp_path / "data" / name
        (folder / "calibration").mkdir(parents=True)
        if name == "own":
            by_board = Camera.read(tmp_path / "results" / "lab" / "cameras" / "main.json")
            lens = by_board.lens
            matrix, distortion = np.array(lens.matrix), np.array(lens.distortion)
            size = lens.width_px, lens.height_px
            write_opencv(folder / "calibration" / "camera.yml", matrix, distortion, size)
            shutil.copy(tmp_path / "data" / "lab" / "calibration" / "plane.png", folder / "calibration")
            settings.pop("lab")
            settings["camera"]["lens"] = "calibration/camera.yml"
        with (folder / "experiment.yaml").open("w") as file:
            YAML().dump(settings, file)
        for stage in stages:
            run_stage(stage, tmp_path, name)
    given = Camera.read(tmp_path / "results" / "own" / "cameras" / "main.json")
    assert np.allclose(given.translation_m, by_board.translation_m, atol=1e-9)
    assert np.allclose(given.rotation, by_board.rotation, atol=1e-9)
    assert given.lens.model == "given"
