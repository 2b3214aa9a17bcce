"""Camera movement measured from the scene itself: its size, and silence where the scene does not show it."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from strandcast.camera.flat import flat_camera
from strandcast.camera.movement import find_shift, shift_warnings
from strandcast.tracking.scene_checks import movement_warnings

HEIGHT, WIDTH, ROOM = 240, 320, 30
CAMERA = flat_camera(WIDTH, HEIGHT, 2e-3, (0.0, 0.0))


def wall(texture=8.0):
    """Return a wall that is larger than the picture by `ROOM` pixels on each side."""
    grain = np.random.default_rng(1).standard_normal((HEIGHT + 2 * ROOM, WIDTH + 2 * ROOM))
    smooth = cv2.GaussianBlur(grain, (0, 0), 2.0)
    return 110.0 + texture * smooth / smooth.std()


def filmed(scene, right=0, down=0, seed=0, arm=None):
    """Return a picture in which the scene lies farther right and down by whole pixels."""
    top, left = ROOM - down, ROOM - right
    picture = scene[top : top + HEIGHT, left : left + WIDTH].copy()
    if arm is not None:
        picture[arm] = 30.0
    picture += np.random.default_rng(seed).normal(0.0, 0.5, picture.shape)
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("step", [(0, 0), (1, 0), (4, -3), (-6, 5)])
def test_the_shift_is_measured_behind_a_moving_arm(step):
    before = filmed(wall(), arm=np.s_[80:160, 0:150])
    moved = find_shift(CAMERA, before, filmed(wall(), *step, seed=1, arm=np.s_[80:160, 60:230]))
    assert np.allclose(moved.shift_px, step, atol=0.15)
    assert moved.displacement_px == pytest.approx(np.hypot(*step), abs=0.15)
    assert moved.displacement_m == pytest.approx(2e-3 * moved.displacement_px)


def test_a_scene_without_texture_gives_no_answer():
    assert find_shift(CAMERA, filmed(wall(0.0)), filmed(wall(0.0), seed=1)) is None


def test_a_moved_camera_is_a_warning_with_its_cost():
    [warning] = shift_warnings(CAMERA, filmed(wall()), filmed(wall(), 3, 4, seed=1), 70, "frame 0")
    assert "the camera has moved since frame 0: " in warning
    assert "at frame 70" in warning
    assert float(warning.split(": ")[-1].split()[0]) == pytest.approx(10.0, abs=0.3)  # mm
    assert shift_warnings(CAMERA, filmed(wall()), filmed(wall(), seed=1), 70, "frame 0") == []


@pytest.mark.parametrize(
    ("bumped", "empty_off", "since"),
    [(0, None, None), (2, None, "frame 0"), (0, 0, None), (0, 2, "the picture of the empty scene")],
)
def test_a_film_without_plane_markers_is_compared_with_itself_or_the_empty_scene(bumped, empty_off, since):
    rights = [0] * 6 + [bumped] * 6
    samples = SimpleNamespace(
        indices=list(range(0, 120, 10)),
        pictures=[filmed(wall(), right, seed=seed) for seed, right in enumerate(rights)],
    )
    empty = None if empty_off is None else filmed(wall(), empty_off, seed=99)
    warnings = movement_warnings(CAMERA, samples, empty, "v.mp4")
    assert [f"moved since {since}" in warning for warning in warnings] == ([] if since is None else [True])
