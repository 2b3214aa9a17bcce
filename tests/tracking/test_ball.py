"""A drawn ball whose shadow, texture and light change: the outline stays on it."""

import cv2
import numpy as np
import pytest

from strandcast_pendulum.ball import find_ball, silhouette

CENTRE, RADIUS = np.array([201.3, 118.6]), 22.0
WALL = np.broadcast_to(np.linspace(140.0, 170.0, 400), (300, 400))


def scene(brighter: float = 0.0, shadow: float = 0.0, seed: int = 0) -> np.ndarray:
    """A ball with a half as bright as the wall, its shadow above it, in a room that became brighter."""
    image = WALL.copy()
    if shadow:
        dim = cv2.circle(np.zeros_like(image), [205, 85], 24, shadow, -1)
        image -= cv2.GaussianBlur(dim, (0, 0), 6.0)
    dark, light = 60.0, 158.0
    place = np.rint(CENTRE * 64).astype(int).tolist()
    cv2.circle(image, place, int(RADIUS * 64), light + 14.0, -1, cv2.LINE_AA, 6)
    lower = image.copy()
    cv2.circle(lower, place, int(RADIUS * 64), dark, -1, cv2.LINE_AA, 6)
    image[int(CENTRE[1]) :] = lower[int(CENTRE[1]) :]
    noise = np.random.default_rng(seed).normal(0.0, 1.0, image.shape)
    return np.clip(image + brighter + noise, 0, 255).astype(np.uint8)


@pytest.mark.parametrize(("brighter", "shadow"), [(0.0, 0.0), (25.0, 0.0), (-20.0, 0.0), (0.0, 30.0)])
def test_the_outline_is_found(brighter, shadow):
    wall = np.rint(WALL).astype(np.uint8)
    x, y, radius = find_ball(scene(brighter, shadow), wall)
    assert radius == pytest.approx(RADIUS, abs=0.6)
    np.testing.assert_allclose([x, y], CENTRE, atol=0.4)


def test_the_shadow_pulls_a_silhouette_but_not_the_outline():
    wall = np.rint(WALL).astype(np.uint8)
    _, y, area = silhouette(scene(0.0, 30.0), wall)
    assert area > 1.3 * np.pi * RADIUS**2
    assert y < CENTRE[1] - 4.0


def test_an_empty_scene_has_no_ball():
    wall = np.rint(WALL).astype(np.uint8)
    assert find_ball(wall, wall)[2] == 0.0
