"""Films of a simulated cord, drawn anti-aliased in grey on a wall, and where it is in every frame."""

from pathlib import Path

import cv2
import numpy as np
from tests.tracking.scene import draw_line, draw_marker, write_video

import strandcast

WIDTH, HEIGHT, SCALE_M = 480, 360, 0.002
RATE_HZ, LEAD_S = 120, 0.75
LENGTH_M = 0.5
MARKER_PX, MARKER_ABOVE_PX = 36.0, 32.0


def wall(seed: int, level: float = 170.0) -> np.ndarray:
    """Return a wall (H, W) with stains of several sizes."""
    random, size = np.random.default_rng(seed), (WIDTH, HEIGHT)
    stains = [
        cv2.resize(random.standard_normal((n, n)), size, interpolation=cv2.INTER_CUBIC) for n in (6, 40)
    ]
    return np.asarray(level + 8.0 * sum(stains), dtype=np.float32)


def cord(moving: bool, frames: int, far: bool = False) -> np.ndarray:
    """Return the cord's places (F, 61, 2) px, held at an end that moves, or stays after it was shaken."""
    lead = 0 if moving else round(LEAD_S * RATE_HZ)
    time_s = np.arange(lead + frames) / RATE_HZ
    place_m = np.zeros((len(time_s), 2))
    if moving:
        place_m[:, 0] = 0.08 * np.sin(2 * np.pi * 1.3 * time_s)
    else:
        place_m[:lead, 0] = 0.12 * np.sin(2 * np.pi / LEAD_S * time_s[:lead])
    known = {}
    if far:
        known["far_place_m"] = np.column_stack([0.3 + 0.04 * np.sin(2 * np.pi * 1.4 * time_s), 0.0 * time_s])
    points_m = strandcast.simulate(time_s, place_m, length_m=LENGTH_M, points=60, **known)[lead:]
    return np.stack([0.4 * WIDTH + points_m[..., 0] / SCALE_M, 80.0 - points_m[..., 1] / SCALE_M], axis=-1)


def film(
    path: Path, cord_px: np.ndarray, level: float = 40.0, marker: int | None = None, blobs: bool = False
) -> None:
    """Film the cord; a marker or dark blobs hold it."""
    behind, random = wall(3), np.random.default_rng(4)

    def pictures():
        for places in cord_px:
            picture = behind.copy()
            draw_line(picture, places, 2.5, level)
            if marker is not None:
                square = MARKER_PX * np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
                draw_marker(picture, places[0] - (0.0, MARKER_ABOVE_PX) + square, marker)
            for end in (0, -1) if blobs else ():
                cv2.circle(picture, np.rint(places[end]).astype(int).tolist(), 9, 70.0, -1)
            picture += random.normal(0.0, 2.0, picture.shape)
            yield np.clip(np.rint(picture), 0, 255).astype(np.uint8)

    write_video(path, pictures(), RATE_HZ)


def off_px(points_px: np.ndarray, cord_px: np.ndarray) -> np.ndarray:
    """Return how far points (F, n + 1, 2) are from the cord's places at the same shares of its length."""
    chosen = np.linspace(0, cord_px.shape[1] - 1, points_px.shape[1]).astype(int)
    return np.asarray(np.linalg.norm(points_px - cord_px[:, chosen], axis=2))
