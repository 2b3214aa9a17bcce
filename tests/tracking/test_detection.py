"""What many detections show together, and what no single one can spoil."""

import numpy as np
import pytest

from strandcast.tracking.chain.appearance import Appearance
from strandcast.tracking.chain.detection import END_WIDTHS, Detection, learn_appearance, visible_length
from strandcast.tracking.chain.fit import FrameFit
from strandcast.tracking.chain.measure import level_at, levels_on, width_at_half
from strandcast.tracking.chain.search_window import HandBox, SearchWindow
from strandcast.tracking.pixel_map import tabulate

from . import scene


def detection(end_m, half_m=0.002, value=0.9, open_share=1.0):
    fit = FrameFit(
        np.zeros(2),
        np.zeros(50),
        0.006,
        np.ones(51),
        np.zeros((51, 2, 2)),
        np.nan,
        value,
        open_share,
        False,
        False,
        0,
    )
    appearance = Appearance(half_m=0.001, contrast=60.0, polarity=1.0, noise=2.0, level=140.0)
    return Detection(0, appearance, fit, end_m, half_m, 176.0, (176.0, 176.0))


def test_a_thin_end_is_no_bead():
    appearance = learn_appearance([detection(0.004)] * 5 + [detection(0.012, half_m=0.011)], 0.0015)
    assert not appearance.has_bead
    assert appearance.tip_excess_m == pytest.approx(END_WIDTHS * 0.002)  # its own width, not the string's


def test_a_bead_is_what_most_frames_show():
    seen = [detection(0.012, half_m=0.011)] * 4
    hidden = [detection(0.001, open_share=0.6)] * 6
    appearance = learn_appearance([*seen, detection(0.001), *hidden], 0.0015)
    assert appearance.bead_level == 176.0
    assert appearance.tip_excess_m == pytest.approx(0.011)


@pytest.mark.parametrize(
    ("beyond_m", "excess_m", "kept_m"), [(0.007, 0.004, 0.007), (0.013, 0.0, 0.013), (0.03, 0.011, 0.0)]
)
def test_a_weight_declared_before_the_end_says_where_the_end_under_it_is(beyond_m, excess_m, kept_m):
    appearance = learn_appearance([detection(0.012, half_m=0.011)] * 4, 0.0015, beyond_m)
    assert appearance.tip_excess_m == pytest.approx(excess_m)
    assert (appearance.bead_m, appearance.beyond_m) == (0.011, kept_m)


def test_few_frames_that_all_show_a_bead_are_enough():
    seen = [detection(0.012, half_m=0.011, open_share=share) for share in (0.92, 0.9, 0.82, 0.47)]
    assert learn_appearance([*seen, detection(np.nan)], 0.0015).has_bead


def test_where_no_end_is_clear_the_tip_is_within_a_width_before_it():
    appearance = learn_appearance([detection(np.nan)] * 5, 0.0015)
    assert appearance.tip_excess_m == END_WIDTHS * appearance.half_m


def test_width_is_interpolated_between_samples():
    triangle = np.maximum(0.0, 10.0 - 2.0 * np.abs(np.arange(-24, 25)))
    assert width_at_half(triangle, 24) == pytest.approx(5.0)


def test_places_outside_the_window_are_left_out():
    image = np.full((scene.HEIGHT, scene.WIDTH), 90, np.uint8)
    window = SearchWindow(image, 0, 0, image - 20, tabulate(scene.flat_camera(), 0.0), HandBox(*np.zeros(7)))
    inside, outside = [0.0, 0.0], [[0.0, 9.0], [0.0, -9.0], [9.0, 0.0], [-9.0, 0.0]]
    shown, behind = levels_on(window, np.array([inside, *outside]))
    assert (shown.tolist(), behind.tolist()) == ([90.0], [70.0])
    assert level_at(window, np.array(inside)) == 90.0
    assert all(np.isnan(level_at(window, np.array(place))) for place in outside)


@pytest.mark.parametrize(
    ("ends_mm", "found_mm"),
    [
        ((2.0, 3.0, 1.0, 2.0), 500.0),  # the visible end is half a width beyond the tip's mass point
        ((16.0, 23.0, -3.0), 500.0),  # two ends on lines of the background, which do not agree
        ((12.0, 12.5, 40.0, 70.0, -30.0, -60.0), 510.2),  # two that agree
        ((62.0, 92.0, 132.0), 500.0),  # nor do these
        ((62.0, 61.0, 63.0, 62.0, 3.0), 560.0),  # a length that was declared wrongly
        ((2.0, np.nan, 30.0), 500.0),  # too few
    ],
)
def test_the_length_is_one_with_which_most_ends_agree(ends_mm: tuple[float, ...], found_mm: float) -> None:
    seen = [detection(1e-3 * end) for end in ends_mm]
    appearance = seen[0].appearance._replace(tip_excess_m=0.002)
    assert 1e3 * visible_length(seen, appearance, 0.5) == pytest.approx(found_mm, abs=1.0)
