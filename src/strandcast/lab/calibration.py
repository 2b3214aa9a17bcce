"""The lab's calibration photos: a ChArUco board from many sides, and the markers in the plane."""

from itertools import product
from pathlib import Path

import cv2
import numpy as np

from strandcast.arm.kinematics import link_points
from strandcast.arm.load import PlanarArm
from strandcast.camera.markers import opencv_board
from strandcast.camera.picture_file import write_picture
from strandcast.config.camera import Board
from strandcast.config.experiment import Experiment
from strandcast.lab.film import noise_powers
from strandcast.lab.paint import PSF_PX, expose
from strandcast.lab.scene import INK, PAPER, WALL, LabScene, canvas_on, paint_arm
from strandcast.lab.view import LabView
from strandcast.seeds import rng

# Chosen, like the photos of a careful user.
PHOTOS = 12
CELL_PX = 24  # a fifth of a chessboard square in the texture
SUPERSAMPLING = 2
BOARD_SHARE = (0.45, 0.75)  # of the picture's width
CENTRE_SHARE = (0.1, 0.9)  # of the picture, for the board's centre
MAX_TILT_RAD = 0.6


def write_lens_photos(experiment: Experiment, name: str, view: LabView, data_dir: Path) -> None:
    """Write ``lens-01.png`` … to the folder of the experiment's ``camera.lens``."""
    random = rng(name, experiment.seed, 0, "lab-lens-photos")
    texture, texels_m, rim = _board_texture(experiment.camera.board)
    height, width = view.height_px, view.width_px
    steps = (np.arange(SUPERSAMPLING) + 0.5) / SUPERSAMPLING - 0.5
    u = (np.arange(width)[:, None] + steps).ravel()
    v = (np.arange(height)[:, None] + steps).ravel()
    rays = view.rays(np.stack(np.meshgrid(u, v), axis=-1)).astype(np.float32)
    texels = np.array([[texels_m, 0.0, rim - 0.5], [0.0, texels_m, rim - 0.5], [0.0, 0.0, 1.0]])
    folder = (data_dir / experiment.camera.lens).parent
    for number in range(1, PHOTOS + 1):
        rotation, translation = _board_pose(experiment.camera.board, view, random)
        board_to_ray = np.column_stack([rotation[:, 0], rotation[:, 1], translation])
        places = cv2.perspectiveTransform(rays, texels @ np.linalg.inv(board_to_ray))
        fine = cv2.remap(
            texture, places[..., 0], places[..., 1], cv2.INTER_LINEAR, None, cv2.BORDER_CONSTANT, WALL
        )
        light = fine.reshape(height, SUPERSAMPLING, width, SUPERSAMPLING).mean(axis=(1, 3), dtype=np.float32)
        light = cv2.GaussianBlur(light, (0, 0), PSF_PX)
        _write(folder / f"lens-{number:02d}.png", light, np.ones_like(light), experiment, random)


def _board_texture(board: Board) -> tuple[np.ndarray, float, int]:
    """Return the printed board with its white rim, texels per metre and the rim's width in texels."""
    square = 5 * CELL_PX
    pattern = opencv_board(board).generateImage((board.squares_x * square, board.squares_y * square))
    rim = square // 3
    printed = np.where(np.pad(pattern, rim, constant_values=255) > 127, PAPER, INK)
    return printed.astype(np.float32), square / board.square_m, rim


def _board_pose(board: Board, view: LabView, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return a pose, board to camera, with most of the board in the picture."""
    size = np.array([board.squares_x, board.squares_y]) * board.square_m
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) * size
    corners3 = np.column_stack([corners, np.zeros(4)])
    focal, middle = view.matrix[0, 0], view.matrix[:2, 2]
    limit = np.array([view.width_px, view.height_px])
    while True:
        turn = np.append(random.uniform(-MAX_TILT_RAD, MAX_TILT_RAD, 2), random.uniform(-0.5, 0.5))
        rotation, _ = cv2.Rodrigues(turn)
        depth = focal * size[0] / (view.width_px * random.uniform(*BOARD_SHARE))
        aim = (random.uniform(*CENTRE_SHARE, 2) * limit - middle) / focal * depth
        translation = np.append(aim, depth) - rotation @ np.append(size / 2, 0.0)
        uv, _ = cv2.projectPoints(corners3, turn, translation, view.matrix, view.distortion)
        inside = ((uv.reshape(4, 2) > 8) & (uv.reshape(4, 2) < limit - 8)).all(axis=1)
        if inside.sum() >= 3:
            return rotation, translation


def write_plane_photo(experiment: Experiment, name: str, scene: LabScene, data_dir: Path) -> None:
    """Write the photo of the markers in the plane, without a string and with the arm away from them."""
    canvas = canvas_on(scene.still)
    paint_arm(canvas, scene, _parked(experiment, scene.arm))
    random = rng(name, experiment.seed, 0, "lab-plane-photo")
    _write(data_dir / experiment.camera.plane_photo, canvas.light, scene.gain, experiment, random)


def _parked(experiment: Experiment, arm: PlanarArm) -> np.ndarray:
    """Return the posture with the largest distance from the markers."""
    markers = np.array([[m.x_m, m.y_m] for m in experiment.camera.plane.markers])
    limits = zip(np.maximum(arm.limits.lower_rad, -3.1), np.minimum(arm.limits.upper_rad, 3.1), strict=True)
    postures = np.array(list(product(*(np.linspace(low, high, 9) for low, high in limits))))
    points = link_points(arm.chain, postures)
    along = np.linspace(0.0, 1.0, 6)[:, None]
    body = (points[:, :-1, None] + along * (points[:, 1:, None] - points[:, :-1, None])).reshape(
        len(postures), -1, 2
    )
    distance_m = np.min([np.linalg.norm(body - marker, axis=2).min(axis=1) for marker in markers], axis=0)
    return np.asarray(postures[np.argmax(distance_m)])


def _write(
    path: Path, light: np.ndarray, gain: np.ndarray, experiment: Experiment, random: np.random.Generator
) -> None:
    assert experiment.lab is not None
    out = np.empty(light.shape, np.uint8)
    noise = random.standard_normal(light.shape, dtype=np.float32)
    expose(light, gain, 1.0, noise, (0, 0), noise_powers(experiment.lab.camera.noise_grey), out)
    write_picture(path, out)
