"""What counts as string: thin, changed, of the right polarity; and where its centre line is."""

import numpy as np
import pytest

from strandcast.tracking.chain.profiles import best_path, line_centre, line_score, sample_across
from strandcast.tracking.chain.search_window import HandBox, SearchWindow, inside_box
from strandcast.tracking.pixel_map import tabulate, to_pixel

HALF = 24


def profile(scene, image, background, x_m=0.0, polarity=0.0):
    plane = tabulate(scene.flat_camera(), 0.0)
    pair = [np.rint(one).astype(np.uint8) for one in (image, background)]
    window = SearchWindow(pair[0], 0, 0, pair[1], plane, HandBox(*np.zeros(7)))
    nodes = np.array([[x_m, 0.05], [x_m, 0.0], [x_m, -0.05]])
    normals = np.tile([1.0, 0.0], (3, 1))
    level, difference = sample_across(window, nodes, normals, 0.5 * plane.metre_per_pixel, HALF, 1, polarity)
    return line_score(level, difference, np.full(3, 2), polarity)


def plain(scene, level=180.0):
    return np.full((scene.HEIGHT, scene.WIDTH), level, np.float32)


def test_map_agrees_with_the_camera_to_a_hundredth_of_a_pixel(scene):
    from strandcast.camera.mapping import metre_to_pixel

    camera = scene.flat_camera(k1=-0.12)
    pixels = tabulate(camera, 0.01)
    rng = np.random.default_rng(0)
    places = rng.uniform([-0.5, -0.4], [0.5, 0.4], (200, 2))
    exact = metre_to_pixel(camera, places, 0.01)
    ours = np.array([to_pixel(x, y, pixels) for x, y in places])
    assert np.abs(ours - exact).max() < 0.01


@pytest.mark.parametrize("offset_px", [-3.3, 0.0, 0.4, 5.25])
def test_line_is_found_to_a_tenth_of_a_pixel(scene, offset_px):
    background = plain(scene)
    image = background.copy()
    x_m = offset_px * scene.SCALE_M
    scene.draw_line(image, scene.to_pixels(np.array([[x_m, -0.2], [x_m, 0.2]])), 2.0, 60.0)
    score = profile(scene, image, background)
    path = best_path(score / 60.0, 0.001, 14)
    centre = line_centre(score, path, np.full(3, 2))
    assert 0.5 * (centre[1] - HALF) == pytest.approx(offset_px, abs=0.1)


def test_a_broad_object_is_no_line_but_a_line_in_front_of_it_is(scene):
    background = plain(scene)
    arm = background.copy()
    scene.draw_line(arm, scene.to_pixels(np.array([[0.0, -0.2], [0.0, 0.2]])), 40.0, 120.0)
    score = profile(scene, arm, background)
    assert score.max() < 3.0
    scene.draw_line(arm, scene.to_pixels(np.array([[0.0, -0.2], [0.0, 0.2]])), 2.0, 60.0)
    score = profile(scene, arm, background)
    assert score[1, HALF] > 30.0


def test_a_line_of_the_background_is_no_string(scene):
    background = plain(scene)
    scene.draw_line(background, scene.to_pixels(np.array([[0.0, -0.2], [0.0, 0.2]])), 2.0, 60.0)
    score = profile(scene, background, background)
    assert score.max() < 1e-9


def test_polarity_excludes_changes_of_the_other_sign(scene):
    background = plain(scene)
    image = background.copy()
    scene.draw_line(image, scene.to_pixels(np.array([[0.0, -0.2], [0.0, 0.2]])), 2.0, 60.0)
    assert profile(scene, image, background, polarity=-1.0).max() > 50.0
    assert profile(scene, image, background, polarity=1.0).max() <= 0.0


def test_path_prefers_smooth_to_bright():
    score = np.zeros((30, 41))
    score[:, 20] = 0.8
    score[12, 35] = 1.0
    np.testing.assert_array_equal(best_path(score, 0.05, 6), np.full(30, 20))


def test_box_turns_with_the_hand():
    box = HandBox(1.0, 2.0, np.pi / 2, -0.1, -0.02, 0.0, 0.02)
    assert inside_box(1.0, 1.95, box)
    assert not inside_box(0.95, 2.0, box)
    assert not inside_box(1.0, 2.01, box)
