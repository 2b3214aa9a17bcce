"""Pictures of flat objects through a known lens, by ray casting, with blur and noise."""

from collections.abc import Callable
from functools import lru_cache

import cv2
import numpy as np
import pytest

from strandcast.camera.mapping import undistort
from strandcast.camera.markers import marker_cells, opencv_board
from strandcast.camera.views import BoardCorners
from strandcast.config.camera import Board
from strandcast.records.camera import Lens

OVER = 2  # samples a side in each pixel
Photographer = Callable[..., np.ndarray]


@pytest.fixture(scope="session")
def lens() -> Lens:
    return Lens(
        width_px=960,
        height_px=540,
        matrix=[[1100.0, 0.0, 470.0], [0.0, 1090.0, 280.0], [0.0, 0.0, 1.0]],
        distortion=[-0.12, 0.06, 0.0008, -0.0006, 0.0],
        rms_px=0.0,
    )


@pytest.fixture(scope="session")
def photograph() -> Photographer:
    """Return a function: (texture, metres → texture pixels (2, 3), lens, R, t) -> grey picture."""

    @lru_cache(maxsize=2)
    def seen_through(lens: str) -> np.ndarray:
        known = Lens.model_validate_json(lens)
        u = (np.arange(known.width_px * OVER) + 0.5) / OVER - 0.5
        v = (np.arange(known.height_px * OVER) + 0.5) / OVER - 0.5
        return undistort(known, np.stack(np.meshgrid(u, v), axis=-1))

    def take(
        texture: np.ndarray,
        to_texture: np.ndarray,
        lens: Lens,
        rotation: np.ndarray,
        shift_m: np.ndarray,
        noise: float = 2.0,
        seed: int = 0,
        blur_px: float = 0.6,
    ) -> np.ndarray:
        rays = seen_through(lens.model_dump_json())
        directions = rays @ rotation[:2] + rotation[2]
        eye = -rotation.T @ shift_m
        plane_m = eye[:2] - eye[2] / directions[..., 2:] * directions[..., :2]
        places = (plane_m @ to_texture[:, :2].T + to_texture[:, 2]).astype(np.float32)
        picture = cv2.remap(texture, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderValue=190.0)
        picture = cv2.resize(picture, (lens.width_px, lens.height_px), interpolation=cv2.INTER_AREA).astype(
            float
        )
        picture = cv2.GaussianBlur(picture * 0.7 + 30.0, (0, 0), blur_px)
        picture += np.random.default_rng(seed).normal(0.0, noise, picture.shape)
        return np.clip(np.rint(picture), 0, 255).astype(np.uint8)

    return take


@pytest.fixture(scope="session")
def paint_markers() -> Callable[..., tuple[np.ndarray, np.ndarray]]:
    """Return a function: (markers, dictionary) -> texture of 1 mm pixels, and metres → texture pixels."""

    def paint(
        markers: list, dictionary: str, span_m: float = 1.0, margin_cells: float = 1.5, ground: int = 200
    ) -> tuple[np.ndarray, np.ndarray]:
        scale = 2000.0  # texture pixels per metre
        side = int(2 * span_m * scale)
        texture = np.full((side, side), ground, np.uint8)
        to_texture = np.array([[scale, 0.0, span_m * scale - 0.5], [0.0, -scale, span_m * scale - 0.5]])
        for marker in markers:
            cells = marker_cells(dictionary, marker.marker)
            image = np.where(np.kron(cells, np.ones((20, 20), bool)), 10, 245).astype(np.uint8)
            image = np.pad(image, round(20 * margin_cells), constant_values=245)
            cell_m = marker.size_m / cells.shape[0] / 20.0
            middle = (image.shape[0] - 1) / 2.0
            cosine, sine = np.cos(marker.angle_rad), np.sin(marker.angle_rad)
            turn = np.array([[cosine, sine], [-sine, cosine]]) * cell_m * scale
            place = to_texture[:, :2] @ (marker.x_m, marker.y_m) + to_texture[:, 2]
            warp = np.column_stack([turn, place - turn @ (middle, middle)])
            drawn = cv2.warpAffine(image, warp, (side, side), flags=cv2.INTER_LINEAR, borderValue=0)
            mask = cv2.warpAffine(np.full_like(image, 255), warp, (side, side), flags=cv2.INTER_NEAREST)
            texture = np.where(mask > 0, drawn, texture)
        return texture, to_texture

    return paint


@pytest.fixture(scope="session")
def corner_views() -> Callable[..., list[BoardCorners]]:
    """Return a function: (distortion, seed, views, noise_px) -> a board's corners, without pictures.

    The lens is that of `lens`, the board 7 x 5 squares of 35 mm in random poses; with the rational model's
    eight coefficients it is a wide angle.
    """
    board = Board(squares_x=7, squares_y=5, square_m=0.035, marker_m=0.026, dictionary="DICT_5X5_100")
    board_m = np.asarray(opencv_board(board).getChessboardCorners(), float)
    size = np.array([960, 540])

    def look(distortion: list[float], seed: int, views: int, noise_px: float) -> list[BoardCorners]:
        random = np.random.default_rng(seed)
        focal = 1100.0 if len(distortion) == 5 else 500.0
        matrix = np.array([[focal, 0.0, 470.0], [0.0, focal * 1090 / 1100, 280.0], [0.0, 0.0, 1.0]])
        seen: list[BoardCorners] = []
        while len(seen) < views:
            turn = np.append(random.uniform(-0.6, 0.6, 2), random.uniform(-0.5, 0.5))
            depth = focal * 0.245 / (960 * random.uniform(0.35, 0.6))
            aim = (random.uniform(-0.05, 1.05, 2) * size - matrix[:2, 2]) / focal * depth
            shift = np.append(aim, depth) - cv2.Rodrigues(turn)[0] @ board_m.mean(axis=0)
            pixels, _ = cv2.projectPoints(board_m, turn, shift, matrix, np.array(distortion))
            pixels = pixels.reshape(-1, 2) + random.normal(0, noise_px, (len(board_m), 2))
            inside = ((pixels > 5) & (pixels < size - 5)).all(axis=1)
            if inside.sum() >= 12:
                seen.append(BoardCorners(str(len(seen)), board_m[inside], pixels[inside]))
        return seen

    return look


@pytest.fixture(scope="session")
def looking() -> Callable[..., tuple[np.ndarray, np.ndarray]]:
    """Return a function: (tilts, turn [rad], place looked at, distance [m]) -> R, t, world to camera."""

    def look(
        tilt_x: float, tilt_y: float, turn: float, target_m: tuple[float, float], distance_m: float
    ) -> tuple[np.ndarray, np.ndarray]:
        facing = np.diag([1.0, -1.0, -1.0])
        turned = (
            cv2.Rodrigues(np.array([tilt_x, tilt_y, 0.0]))[0] @ cv2.Rodrigues(np.array([0.0, 0.0, turn]))[0]
        )
        rotation = turned @ facing
        return rotation, np.array([0.0, 0.0, distance_m]) - rotation @ np.array([*target_m, 0.0])

    return look
