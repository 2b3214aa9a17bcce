"""A lens that another program has calibrated: OpenCV, ROS camera_info, Kalibr, caliscope or anipose."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.config.bounded import BoundError, load_toml, load_yaml, read_bounded
from strandcast.errors import StrandcastError
from strandcast.records.camera import Lens, is_fisheye

MATRIX = (
    *("camera_matrix", "Camera_Matrix", "cameraMatrix", "intrinsic_matrix"),
    *("matrix", "mtx", "K", "k", "M1"),
)
DISTORTION = (
    *("distortion_coefficients", "Distortion_Coefficients", "dist_coeffs", "distCoeffs", "dist_coeff"),
    *("distortions", "distortion", "dist", "D", "d", "D1"),
)
WIDTH, HEIGHT = ("image_width", "image_Width", "width"), ("image_height", "image_Height", "height")
SIZE = ("image_size", "size", "resolution")
KNOWN_MODELS = ("plumb_bob", "rational_polynomial", "radtan", "pinhole", "opencv", "")
FISHEYE_MODELS = ("equidistant", "fisheye", "equi", "kannala_brandt", "opencv_fisheye")
FISHEYE_KEYS = ("fisheye", "fisheye_model")  # anipose's, and that of OpenCV's calibration sample
COEFFICIENTS = 8


def read_lens(path: Path, name: str | None = None, fisheye: bool = False) -> Lens:
    """Return the lens in a calibration file.

    `name` is the camera's section (``cam0``) or its name, where the file has several. With `fisheye`, its
    four coefficients are those of a fisheye lens, though the file does not say so.

    Raises
    ------
    StrandcastError
        SC-C050 it cannot be read; it has no such camera, or several; its model is neither OpenCV's pinhole
        with up to eight coefficients nor its fisheye with four; a value is missing or is no number.
    """
    cameras = _cameras(_read(path))
    if name is not None:
        cameras = {key: camera for key, camera in cameras.items() if name in (key, camera.get("name"))}
    if len(cameras) != 1:
        there = ", ".join(cameras) or "none"
        what = f"has no camera {name!r}" if name else f"has {len(cameras)} cameras ({there})"
        fix = "name one of the file's cameras in camera.lens_name" if cameras or name else None
        raise StrandcastError("SC-C050", what, file=path, field="camera.lens_name", fix=fix)
    [camera] = cameras.values()
    fisheye = _says_fisheye(path, camera) or fisheye
    if all(camera.get(name) is None for name in (*SIZE, *WIDTH, *HEIGHT)):
        lines = "image_width{0}1280 and image_height{0}720".format(" = " if path.suffix == ".toml" else ": ")
        fix = (
            f"add two lines with the width and height [px] of the pictures it was calibrated with, as {lines}"
        )
        raise StrandcastError("SC-C050", "does not give the size of its pictures", file=path, fix=fix)
    try:
        width, height = _size(camera)
        matrix = _matrix(camera)
        distortion = _numbers(_first(camera, (*DISTORTION, "distortion_coeffs"), "the distortion"))
    except (ValueError, TypeError, KeyError) as error:
        what = str(error.args[0]) if error.args else "a value is no number"
        raise StrandcastError("SC-C050", what, file=path) from None
    if fisheye and not is_fisheye(distortion):
        what = f"has {len(distortion)} distortion coefficients; a fisheye lens has four"
        raise StrandcastError("SC-C050", what, file=path, field="camera.distortion", fix="calibrate again")
    if len(distortion) not in (0, 4, 5, 8) and distortion[COEFFICIENTS:].any():
        what = f"has {len(distortion)} distortion coefficients; thin prism and tilt are not supported"
        raise StrandcastError("SC-C050", what, file=path, fix="calibrate with at most eight coefficients")
    kept = np.zeros(5 if not distortion[5:].any() else COEFFICIENTS)
    kept[: min(len(distortion), len(kept))] = distortion[: len(kept)]
    return Lens(
        width_px=width,
        height_px=height,
        matrix=matrix.tolist(),
        distortion=(distortion if fisheye else kept).tolist(),
        rms_px=float(camera.get("avg_reprojection_error", camera.get("error")) or 0.0),
    )


def _read(path: Path) -> dict[str, Any]:
    try:
        text = read_bounded(path)
        if path.suffix.lower() == ".toml":
            return load_toml(text)
        # OpenCV writes directives and tags that are not YAML 1.2; ROS ends each message with ---.
        text = re.sub(r"^%.*$|!!opencv-[\w-]+|!!python/\S+", "", text, flags=re.MULTILINE)
        documents = re.split(r"^---\s*$", text, flags=re.MULTILINE)
        data = load_yaml(next((each for each in documents if each.strip()), ""))
    except (FileNotFoundError, BoundError) as error:
        what = str(error) if isinstance(error, BoundError) else "is not there"
        line = getattr(error, "line", None)
        raise StrandcastError("SC-C050", what, file=path, line=line) from None
    if not isinstance(data, dict):
        raise StrandcastError("SC-C050", "holds no names and values", file=path)
    return data


def _cameras(data: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the cameras of a file by section; the file itself is one if it has a matrix of its own."""
    if any(name in data for name in MATRIX):
        return {str(data.get("camera_name", "camera")): data}
    nested = data.get("cameras") if isinstance(data.get("cameras"), dict) else data
    assert isinstance(nested, dict)
    sections = {str(key): value for key, value in nested.items() if isinstance(value, dict)}
    return {
        key: value
        for key, value in sections.items()
        if "intrinsics" in value or any(name in value for name in MATRIX)
    }


def _says_fisheye(path: Path, camera: dict[str, Any]) -> bool:
    given = [str(camera.get(key) or "").lower() for key in ("camera_model", "distortion_model")]
    unknown = [model for model in given if model not in (*KNOWN_MODELS, *FISHEYE_MODELS)]
    if unknown:
        what = (
            f"its lens model is {unknown[0]!r}; OpenCV's pinhole and its fisheye (equidistant) are supported"
        )
        fix = "calibrate with plumb_bob or equidistant (ROS), radtan or equidistant (Kalibr), or with OpenCV"
        raise StrandcastError("SC-C050", what, file=path, fix=fix)
    return any(camera.get(key) for key in FISHEYE_KEYS) or any(model in FISHEYE_MODELS for model in given)


def _first(camera: dict[str, Any], names: tuple[str, ...], what: str) -> Any:
    for name in names:
        if camera.get(name) is not None:
            return camera[name]
    raise KeyError(f"{what} is missing: no {', '.join(names[:3])} …")


def _size(camera: dict[str, Any]) -> tuple[int, int]:
    size = next((camera[name] for name in SIZE if camera.get(name) is not None), None)
    if size is None:
        size = [_first(camera, names, "the picture's size") for names in (WIDTH, HEIGHT)]
    width, height = _numbers(size).tolist()
    if not (width == round(width) and height == round(height) and min(width, height) > 0):
        raise ValueError(f"the picture's size is {width} x {height}")
    return round(width), round(height)


def _matrix(camera: dict[str, Any]) -> np.ndarray:
    if "intrinsics" in camera:  # Kalibr's pinhole
        fx, fy, cx, cy = _numbers(camera["intrinsics"])
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    matrix = _numbers(_first(camera, MATRIX, "the matrix")).reshape(3, 3)
    if not (matrix[0, 0] > 0 and matrix[1, 1] > 0 and matrix[2].tolist() == [0.0, 0.0, 1.0]):
        raise ValueError(f"the matrix is no pinhole's: {matrix.tolist()}")
    return matrix


def _numbers(value: Any) -> np.ndarray:
    """Return a list, a list of lists, or OpenCV's and ROS' {rows, cols, data} as finite numbers (n,)."""
    numbers = np.array(value["data"] if isinstance(value, dict) else value, float).reshape(-1)
    if not np.isfinite(numbers).all():
        raise ValueError("a value is not a finite number")
    return numbers
