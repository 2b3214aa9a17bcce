"""What many sightings teach together, and what no single one of them can spoil."""

from __future__ import annotations

import numpy as np
import pytest

from strandcast.tracking.follow import Fit
from strandcast.tracking.looks import Sighting, learn_looks, level_at, levels_at, width_at_half
from strandcast.tracking.picture import Looks, Picture
from strandcast.tracking.pixelmap import tabulate

from . import scene


def sighting(end_m, half_m=0.002, value=0.9, open_share=1.0):
    fit = Fit(np.zeros(50), 0.006, np.ones(51), np.eye(50), np.nan, value, open_share, False, False)
    looks = Looks(half_m=0.001, contrast=60.0, polarity=1.0, noise=2.0, level=140.0)
    return Sighting(0, looks, fit, end_m, half_m, 176.0)


def test_frames_with_a_hidden_or_a_wrong_end_do_not_move_the_length():
    hidden = [sighting(0.02, open_share=0.6)] * 6
    lesson = learn_looks([sighting(0.004)] * 5 + [sighting(0.03), *hidden], 0.3, 0.0015)
    assert lesson.length_m == pytest.approx(0.3 + 0.004 - 0.001)
    assert not lesson.looks.has_ball
    assert lesson.warnings == []
    assert lesson.teachers == 6


def test_a_ball_is_what_most_frames_show():
    seen = [sighting(0.012, half_m=0.011)] * 4
    lesson = learn_looks([*seen, sighting(0.001)], 0.3, 0.0015)
    assert lesson.looks.ball_level == 176.0
    assert lesson.looks.tip_excess_m == pytest.approx(0.011)
    assert lesson.length_m == pytest.approx(0.301)


def test_a_length_that_cannot_be_is_not_taken():
    lesson = learn_looks([sighting(0.03)] * 5, 0.3, 0.0015)
    assert lesson.length_m == 0.3
    assert "+29.0 mm" in lesson.warnings[0]


def test_too_few_clear_ends_are_told():
    lesson = learn_looks([sighting(0.004)] * 2 + [sighting(np.nan)] * 5, 0.3, 0.0015)
    assert lesson.length_m == 0.3
    assert "2 of 7 frames" in lesson.warnings[0]


def test_width_is_read_between_samples():
    triangle = np.maximum(0.0, 10.0 - 2.0 * np.abs(np.arange(-24, 25)))
    assert width_at_half(triangle, 24) == pytest.approx(5.0)


def test_places_out_of_the_picture_are_left_out():
    image = np.full((scene.HEIGHT, scene.WIDTH), 90.0, np.float32)
    picture = Picture(image, image - 20.0, tabulate(scene.flat_camera(), 0.0), np.zeros(4))
    inside, outside = [0.0, 0.0], [[0.0, 9.0], [0.0, -9.0], [9.0, 0.0], [-9.0, 0.0]]
    shown, behind = levels_at(picture, np.array([inside, *outside]))
    assert (shown.tolist(), behind.tolist()) == ([90.0], [70.0])
    assert level_at(picture, np.array(inside)) == 90.0
    assert all(np.isnan(level_at(picture, np.array(place))) for place in outside)
