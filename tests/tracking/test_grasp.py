"""Length and grasp from the ways along the string, under noise, outliers and too little variety."""

from __future__ import annotations

import numpy as np
import pytest

from strandcast.tracking.grasp import learn_grasp

LENGTH_M, ASIDE_M = 0.3021, -0.0018


def ways(directions_rad, noise_m=0.0003, seed=1):
    rng = np.random.default_rng(seed)
    return LENGTH_M + ASIDE_M * np.sin(directions_rad) + rng.normal(0, noise_m, len(directions_rad))


def test_both_are_found_where_the_string_leaves_in_all_directions():
    directions = np.linspace(-1.5, 2.0, 400)
    grasp = learn_grasp(0.300, ways(directions), directions)
    assert grasp.length_m == pytest.approx(LENGTH_M, abs=0.0003)
    assert grasp.aside_m == pytest.approx(ASIDE_M, abs=0.0003)
    assert grasp.length_sigma_m < 0.0008
    assert grasp.frames == 400


def test_frames_in_which_the_hidden_string_bends_do_not_shorten_it():
    directions = np.linspace(-1.5, 2.0, 400)
    bent = ways(directions)
    bent[::3] -= 0.003
    grasp = learn_grasp(0.300, bent, directions)
    assert grasp.length_m == pytest.approx(LENGTH_M, abs=0.0006)


def test_what_one_direction_cannot_tell_apart_is_told_as_uncertain():
    directions = np.full(400, 1.2)
    grasp = learn_grasp(0.300, ways(directions), directions)
    assert abs(grasp.length_m - LENGTH_M) < 3 * grasp.length_sigma_m
    assert grasp.length_sigma_m > 0.0009


def test_too_few_frames_leave_the_length_as_given():
    grasp = learn_grasp(0.300, np.array([0.31, 0.31]), np.zeros(2))
    assert (grasp.length_m, grasp.aside_m) == (0.300, 0.0)
