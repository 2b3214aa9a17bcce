"""What many sightings teach together, and what no single one of them can spoil."""

from __future__ import annotations

import numpy as np
import pytest

from strandcast.tracking.fit import Fit
from strandcast.tracking.looks import Sighting, learn_looks, level_at, levels_on, width_at_half
from strandcast.tracking.picture import Looks, Picture
from strandcast.tracking.pixelmap import tabulate

from . import scene


def sighting(end_m, half_m=0.002, value=0.9, open_share=1.0):
    fit = Fit(
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
    looks = Looks(half_m=0.001, contrast=60.0, polarity=1.0, noise=2.0, level=140.0)
    return Sighting(0, looks, fit, end_m, half_m, 176.0)


def test_a_thin_end_is_no_ball():
    looks = learn_looks([sighting(0.004)] * 5 + [sighting(0.012, half_m=0.011)], 0.0015)
    assert not looks.has_ball
    assert looks.tip_excess_m == pytest.approx(0.001)


def test_a_ball_is_what_most_frames_show():
    seen = [sighting(0.012, half_m=0.011)] * 4
    hidden = [sighting(0.001, open_share=0.6)] * 6
    looks = learn_looks([*seen, sighting(0.001), *hidden], 0.0015)
    assert looks.ball_level == 176.0
    assert looks.tip_excess_m == pytest.approx(0.011)


def test_where_no_end_is_clear_the_tip_is_half_a_width_before_it():
    looks = learn_looks([sighting(np.nan)] * 5, 0.0015)
    assert looks.tip_excess_m == looks.half_m


def test_width_is_read_between_samples():
    triangle = np.maximum(0.0, 10.0 - 2.0 * np.abs(np.arange(-24, 25)))
    assert width_at_half(triangle, 24) == pytest.approx(5.0)


def test_places_out_of_the_picture_are_left_out():
    image = np.full((scene.HEIGHT, scene.WIDTH), 90, np.uint8)
    picture = Picture(image, 0, 0, image - 20, tabulate(scene.flat_camera(), 0.0), np.zeros(7))
    inside, outside = [0.0, 0.0], [[0.0, 9.0], [0.0, -9.0], [9.0, 0.0], [-9.0, 0.0]]
    shown, behind = levels_on(picture, np.array([inside, *outside]))
    assert (shown.tolist(), behind.tolist()) == ([90.0], [70.0])
    assert level_at(picture, np.array(inside)) == 90.0
    assert all(np.isnan(level_at(picture, np.array(place))) for place in outside)
