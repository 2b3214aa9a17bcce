"""The string's end and the ball that hangs there, on drawn pictures."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from strandcast.tracking.chain import place_nodes
from strandcast.tracking.follow import fit_string
from strandcast.tracking.picture import Looks, Picture
from strandcast.tracking.pixelmap import tabulate
from strandcast.tracking.tip import ball_centre, end_of_string

SEEN = np.array([np.inf, np.inf])  # before every background


def picture(scene, end_m, ball_px=0.0, arm=False):
    background = np.full((scene.HEIGHT, scene.WIDTH), 180.0, np.float32)
    image = background.copy()
    if arm:
        scene.draw_line(image, scene.to_pixels(np.array([[0.02, -0.3], [0.02, 0.1]])), 12.0, 120.0)
    scene.draw_line(image, scene.to_pixels(np.array([[0.0, 0.1], [0.0, end_m]])), 2.0, 60.0)
    if ball_px:
        centre = scene.to_pixels(np.array([0.0, end_m]))
        cv2.circle(
            image, np.rint(centre * 16).astype(int).tolist(), int(ball_px * 16), 60.0, -1, cv2.LINE_AA, 4
        )
    return cv2.GaussianBlur(image, (0, 0), 0.6), background


@pytest.mark.parametrize("beyond_m", [-0.008, 0.0, 0.006])
def test_end_is_found_along_the_string(scene, beyond_m):
    pixels = tabulate(scene.flat_camera(), 0.0)
    image, background = picture(scene, -0.1 - beyond_m)
    heading = np.full(34, -np.pi / 2)
    nodes = place_nodes(np.array([0.0, 0.1]), heading, 0.2 / 34)
    end_m, half_px = end_of_string(
        image, background, nodes, heading, 100.0, -1.0, SEEN, 0.018, pixels.metre_per_pixel,
        pixels.origin_m, pixels.step_m, pixels.uv,
    )  # fmt: skip
    round_end_m = 1.0 * pixels.metre_per_pixel  # half of the drawn line's width
    assert end_m == pytest.approx(beyond_m + round_end_m, abs=0.0007)
    assert half_px == pytest.approx(1.0, abs=0.6)


def test_a_string_that_goes_on_has_no_end(scene):
    pixels = tabulate(scene.flat_camera(), 0.0)
    image, background = picture(scene, -0.2)
    heading = np.full(34, -np.pi / 2)
    nodes = place_nodes(np.array([0.0, 0.1]), heading, 0.2 / 34)
    end_m, _ = end_of_string(
        image, background, nodes, heading, 100.0, -1.0, SEEN, 0.018, pixels.metre_per_pixel,
        pixels.origin_m, pixels.step_m, pixels.uv,
    )  # fmt: skip
    assert np.isnan(end_m)


def test_an_end_before_what_is_like_the_string_is_not_clear(scene):
    pixels = tabulate(scene.flat_camera(), 0.0)
    image, background = picture(scene, -0.1)
    end_row = round(scene.to_pixels(np.array([0.0, -0.1]))[1])
    image[end_row - 2 :], background[end_row - 2 :] = 60.0, 60.0
    heading = np.full(34, -np.pi / 2)
    nodes = place_nodes(np.array([0.0, 0.1]), heading, 0.2 / 34)
    where = (pixels.metre_per_pixel, pixels.origin_m, pixels.step_m, pixels.uv)
    blind = Looks(half_m=0.001, contrast=100.0, polarity=-1.0, level=60.0).blind
    np.testing.assert_allclose(blind, [-np.inf, 100.0])
    ends = [
        end_of_string(image, background, nodes, heading, 100.0, -1.0, levels, 0.018, *where)[0]
        for levels in (SEEN, blind)
    ]
    assert np.isfinite(ends[0])
    assert np.isnan(ends[1])


@pytest.mark.parametrize("arm", [False, True])
def test_ball_is_found_to_a_tenth_of_a_pixel_even_beside_the_arm(scene, arm):
    pixels = tabulate(scene.flat_camera(), 0.0)
    image, background = picture(scene, -0.1, ball_px=6.0, arm=arm)
    centre = ball_centre(
        image, background, np.array([0.006, -0.094]), 6.0 * pixels.metre_per_pixel, 60.0,
        pixels.metre_per_pixel, pixels.origin_m, pixels.step_m, pixels.uv,
    )  # fmt: skip
    assert np.linalg.norm(centre - [0.0, -0.1]) < 0.25 * pixels.metre_per_pixel


@pytest.mark.parametrize(("hold_tip", "low_m", "high_m"), [(True, 0.0, 0.002), (False, 0.006, 0.02)])
def test_the_visible_end_tells_how_much_string_the_hand_hides(scene, hold_tip, low_m, high_m):
    bulge = np.zeros(34)
    bulge[:10] = np.repeat([0.6, -0.6], 5)
    link_m = 0.2 / 34
    root = np.array([0.0, 0.1])
    nodes = place_nodes(root, bulge - np.pi / 2, link_m)
    image = np.full((scene.HEIGHT, scene.WIDTH), 180.0, np.float32)
    background = image.copy()
    scene.draw_line(image, scene.to_pixels(nodes[10:]), 2.0, 60.0)
    looks = Looks(half_m=scene.SCALE_M, contrast=80.0, tip_excess_m=scene.SCALE_M, polarity=-1.0)
    hides = np.array([0.0, -0.05, 0.1 - nodes[10, 1] - 0.002, 0.05])  # in the hand's frame, x downwards
    seen = Picture(image, background, tabulate(scene.flat_camera(), 0.0), hides)
    hand = np.array([0.0, 0.1, -np.pi / 2])
    start = 0.3 * bulge - np.pi / 2
    fit = fit_string(seen, hand, start, start, link_m, np.full(35, 1.0), looks, hold_tip=hold_tip)
    tip = place_nodes(root, fit.heading, link_m)[-1]
    assert low_m <= np.linalg.norm(tip - nodes[-1]) <= high_m
