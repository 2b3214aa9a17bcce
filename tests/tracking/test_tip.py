"""The string's end and the beads on it, in drawn images."""

import cv2
import numpy as np
import pytest

from strandcast.tracking.chain.appearance import Appearance
from strandcast.tracking.chain.bead_search import Beads, bead_centre, pin_beads
from strandcast.tracking.chain.fit import NARROW_PX, ChainModel, PredictedChain, fit_frame
from strandcast.tracking.chain.links import place_nodes
from strandcast.tracking.chain.search_window import HandBox, SearchWindow
from strandcast.tracking.chain.tip import end_of_string
from strandcast.tracking.pixel_map import tabulate

DARK = Appearance(half_m=0.0015, contrast=100.0, polarity=-1.0)
NO_HAND = HandBox(0.0, 0.1, -np.pi / 2, -0.001, -0.001, 0.0, 0.001)


def seen(scene, image, background, box=NO_HAND) -> SearchWindow:
    pair = [np.clip(np.rint(one), 0, 255).astype(np.uint8) for one in (image, background)]
    return SearchWindow(pair[0], 0, 0, pair[1], tabulate(scene.flat_camera(), 0.0), box)


def drawn(scene, end_m, ball_px=0.0, arm=False, bare_m=0.0):
    background = np.full((scene.HEIGHT, scene.WIDTH), 180.0, np.float32)
    image = background.copy()
    if arm:
        scene.draw_line(image, scene.to_pixels(np.array([[0.02, -0.3], [0.02, 0.1]])), 12.0, 120.0)
    scene.draw_line(image, scene.to_pixels(np.array([[0.0, 0.1], [0.0, end_m]])), 2.0, 60.0)
    if ball_px:
        centre = scene.to_pixels(np.array([0.0, end_m + bare_m]))
        cv2.circle(
            image, np.rint(centre * 16).astype(int).tolist(), int(ball_px * 16), 60.0, -1, cv2.LINE_AA, 4
        )
    return cv2.GaussianBlur(image, (0, 0), 0.6), background


def straight():
    heading = np.full(34, -np.pi / 2)
    return place_nodes(np.array([0.0, 0.1]), heading, 0.2 / 34), heading


@pytest.mark.parametrize("beyond_m", [-0.008, 0.0, 0.006])
def test_end_is_found_along_the_string(scene, beyond_m):
    window = seen(scene, *drawn(scene, -0.1 - beyond_m))
    end_m, half_px = end_of_string(window, *straight(), DARK, 0.018)
    round_end_m = 1.0 * window.plane.metre_per_pixel  # half of the drawn line's width
    assert end_m == pytest.approx(beyond_m + round_end_m, abs=0.0007)
    assert half_px == pytest.approx(1.0, abs=0.6)


@pytest.mark.parametrize(("bare_m", "half_px"), [(0.0, 6.0), (0.005, 6.0), (0.014, 1.0), (0.020, 1.0)])
def test_a_bead_with_bare_string_beyond_it_is_not_at_the_tip(scene, bare_m, half_px):
    # A bead of 9 mm: its edge is before the string's end from 9 mm on.
    window = seen(scene, *drawn(scene, -0.1, ball_px=6.0, bare_m=bare_m))
    end_m, found_px = end_of_string(window, *straight(), DARK, 0.03)
    assert found_px == pytest.approx(half_px, abs=0.8)
    assert end_m == pytest.approx(max(0.0, 0.009 - bare_m), abs=0.002)


@pytest.mark.parametrize("sides", [(140.0, 140.0), (140.0, 95.0), (95.0, 140.0)])
def test_a_bead_paler_than_the_string_is_seen_whole_whichever_side_is_dark(scene, sides):
    """As a nut under a lamp: the string changes the picture by 120 grey levels, each side by 40 or 85."""
    image, background = drawn(scene, -0.1)
    middle = scene.to_pixels(np.array([0.0, -0.106]))
    rows, columns = np.mgrid[: scene.HEIGHT, : scene.WIDTH]
    inside = np.hypot(columns - middle[0], rows - middle[1]) < 6.0
    for level, side in zip(sides, (rows < middle[1], rows >= middle[1]), strict=True):
        image[inside & side] = level
    window = seen(scene, cv2.GaussianBlur(image, (0, 0), 0.6), background)
    scale = window.plane.metre_per_pixel
    end_m, half_px = end_of_string(window, *straight(), DARK, 0.03)
    assert half_px == pytest.approx(6.0, abs=0.8)
    assert end_m == pytest.approx(0.006 + 6.0 * scale, abs=1.2 * scale)
    bead = Beads(*np.array([[0.206], [6.0 * scale], [min(sides)], [max(sides)]]))
    centre = bead_centre(window, np.array([0.0, -0.1 - end_m + half_px * scale]), bead, 0)
    assert np.linalg.norm(centre - [0.0, -0.106]) < 1.0 * scale


def test_a_string_that_goes_on_has_no_end(scene):
    assert np.isnan(end_of_string(seen(scene, *drawn(scene, -0.2)), *straight(), DARK, 0.018)[0])


def test_an_end_in_front_of_a_similar_background_is_not_clear(scene):
    image, background = drawn(scene, -0.1)
    end_row = round(scene.to_pixels(np.array([0.0, -0.1]))[1])
    image[end_row - 2 :], background[end_row - 2 :] = 60.0, 60.0
    window = seen(scene, image, background)
    ends = [
        end_of_string(window, *straight(), appearance, 0.018)[0]
        for appearance in (DARK, DARK._replace(level=60.0))
    ]
    assert np.isfinite(ends[0])
    assert np.isnan(ends[1])


def test_a_string_in_front_of_a_greyer_patch_does_not_end_there(scene):
    image, background = drawn(scene, -0.1)
    rows = slice(*(round(scene.to_pixels(np.array([0.0, y]))[1]) for y in (-0.085, -0.097)))
    for one in (image, background):
        part = one[rows]
        part[part > 130] = 125.0  # half of the string's depth is left before it
    window = seen(scene, image, background)
    end_m, _ = end_of_string(window, *straight(), DARK._replace(level=60.0), 0.03)
    assert end_m == pytest.approx(window.plane.metre_per_pixel, abs=0.0012)


@pytest.mark.parametrize("arm", [False, True])
def test_ball_is_found_to_a_tenth_of_a_pixel_even_beside_the_arm(scene, arm):
    window = seen(scene, *drawn(scene, -0.1, ball_px=6.0, arm=arm))
    scale = window.plane.metre_per_pixel
    bead = Beads(np.array([0.2]), np.array([6.0 * scale]), np.array([60.0]), np.array([60.0]))
    centre = bead_centre(window, np.array([0.006, -0.094]), bead, 0)
    assert np.linalg.norm(centre - [0.0, -0.1]) < 0.25 * scale


def test_balls_that_are_not_there_give_no_pins(scene):
    window = seen(scene, *drawn(scene, -0.1, ball_px=6.0))
    radius_m = 6.0 * window.plane.metre_per_pixel
    beads = Beads(np.array([0.06, 0.2]), np.full(2, radius_m), np.full(2, 60.0), np.full(2, 60.0))
    unknown = np.full((2, 2), np.nan)
    pins = pin_beads(window, *straight(), beads, unknown)
    assert pins.place_m.tolist() == [0.2]
    np.testing.assert_allclose(pins.point_m[0], [0.0, -0.1], atol=0.0004)
    off_chain = place_nodes(np.array([0.05, 0.1]), straight()[1], 0.2 / 34)
    assert len(pin_beads(window, off_chain, straight()[1], beads, unknown).place_m) == 0
    known = np.array([[np.nan, np.nan], [0.002, -0.1]])
    assert len(pin_beads(window, off_chain, straight()[1], beads, known).place_m) == 1


@pytest.mark.parametrize(("hold_tip", "low_m", "high_m"), [(True, 0.0, 0.0022), (False, 0.0028, 0.02)])
def test_the_visible_end_shows_how_much_string_the_hand_hides(scene, hold_tip, low_m, high_m):
    bulge = np.zeros(34)
    bulge[:10] = np.repeat([0.6, -0.6], 5)
    link_m = 0.2 / 34
    root = np.array([0.0, 0.1])
    nodes = place_nodes(root, bulge - np.pi / 2, link_m)
    image = np.full((scene.HEIGHT, scene.WIDTH), 180.0, np.float32)
    background = image.copy()
    scene.draw_line(image, scene.to_pixels(nodes[10:]), 2.0, 60.0)
    appearance = Appearance(half_m=scene.SCALE_M, contrast=80.0, tip_excess_m=scene.SCALE_M, polarity=-1.0)
    hides = HandBox(0.0, 0.1, -np.pi / 2, 0.0, -0.05, 0.1 - nodes[10, 1] - 0.002, 0.05)
    start = 0.3 * bulge - np.pi / 2
    no_beads = Beads(np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0))
    expected = PredictedChain(root, start, start, np.full(35, 1.0), np.zeros((0, 2)))
    string = ChainModel(link_m, appearance, no_beads)
    fit = fit_frame(seen(scene, image, background, hides), string, expected, NARROW_PX, hold_tip)
    assert low_m <= np.linalg.norm(fit.nodes()[-1] - nodes[-1]) <= high_m
