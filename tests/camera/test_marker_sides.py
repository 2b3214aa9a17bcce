"""Detected corners of a marker compared with the true ones, in finely drawn pictures with blur and noise."""

from functools import cache

import cv2
import numpy as np
import pytest

from strandcast.camera.marker_sides import refine_square
from strandcast.camera.markers import marker_cells

FINER = 8  # samples a side in each pixel
PICTURE_PX = 100


@cache
def drawn(side_px: int, blur_px: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a picture without noise of marker 3, turned and in perspective, and its true corners (4, 2)."""
    random = np.random.default_rng(seed)
    cells = marker_cells("DICT_4X4_50", 3)
    count, angle = len(cells), random.uniform(-np.pi, np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    to_px = np.eye(3)
    to_px[:2, :2] = turn * side_px / count
    to_px[2, :2] = random.uniform(-0.005, 0.005, 2)
    middle = to_px @ (count / 2, count / 2, 1.0)
    centre = np.eye(3)
    centre[:2, 2] = PICTURE_PX / 2 + random.uniform(-0.5, 0.5, 2) - middle[:2] / middle[2]
    to_px = centre @ to_px
    places = (np.arange(PICTURE_PX * FINER) + 0.5) / FINER - 0.5
    u, v = np.meshgrid(places, places)
    seen = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(to_px).T
    x, y = seen[..., 0] / seen[..., 2], seen[..., 1] / seen[..., 2]
    column, row = (np.clip(np.floor(each).astype(int), 0, count - 1) for each in (x, y))
    paper = (np.minimum(x, y) > -1.5) & (np.maximum(x, y) < count + 1.5)
    black = (np.minimum(x, y) >= 0) & (np.maximum(x, y) < count) & cells[row, column]
    fine = cv2.GaussianBlur(np.where(black, 30.0, np.where(paper, 220.0, 90.0)), (0, 0), blur_px * FINER)
    corners = np.array([[0, 0, 1], [count, 0, 1], [count, count, 1], [0, count, 1]]) @ to_px.T
    shape = (PICTURE_PX, FINER, PICTURE_PX, FINER)
    return fine.reshape(shape).mean(axis=(1, 3)), corners[:, :2] / corners[:, 2:]


def errors_px(side_px: int, blur_px: float, noise: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return errors (N, 4, 2) of the lines' corners and of OpenCV's cornerSubPix, and outward units."""
    ours, theirs, outward = [], [], []
    for seed in range(8):
        clean, true = drawn(side_px, blur_px, seed)
        random = np.random.default_rng(1000 + seed)
        for _ in range(5):
            noisy = np.rint(clean + random.normal(0.0, noise, clean.shape))
            picture = np.clip(noisy, 0, 255).astype(np.uint8)
            rough = true + random.normal(0.0, 0.7, (4, 2))
            ours.append(refine_square(picture, rough, 6) - true)
            corners = rough.astype(np.float32).reshape(-1, 1, 2)
            criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 0.005)
            theirs.append(cv2.cornerSubPix(picture, corners, (3, 3), (-1, -1), criteria).reshape(4, 2) - true)
            away = true - true.mean(axis=0)
            outward.append(away / np.linalg.norm(away, axis=1, keepdims=True))
    return np.array(ours), np.array(theirs), np.array(outward)


@pytest.mark.parametrize(
    ("side_px", "blur_px", "noise", "rms_px", "bias_px"),
    [
        (46, 0.6, 2.0, 0.03, 0.01),
        (46, 0.6, 8.0, 0.07, 0.015),
        (46, 1.2, 2.0, 0.035, 0.01),
        (46, 1.2, 8.0, 0.11, 0.02),
        (28, 0.6, 2.0, 0.035, 0.01),
        (28, 1.2, 2.0, 0.13, 0.06),
    ],
)
def test_corners_from_lines_beat_corners_from_gradients(side_px, blur_px, noise, rms_px, bias_px):
    ours, theirs, outward = errors_px(side_px, blur_px, noise)
    our_rms, their_rms = (np.sqrt((each**2).sum(axis=-1).mean()) for each in (ours, theirs))
    our_bias, their_bias = ((each * outward).sum(axis=-1).mean() for each in (ours, theirs))
    assert our_rms < rms_px
    assert abs(our_bias) < bias_px
    assert our_rms < 0.5 * their_rms
    assert their_bias < -0.1  # it draws the corners of a square inwards
