"""Length and lateral offset from paths along the string, under noise, outliers and too little variety."""

import numpy as np
import pytest

from strandcast.tracking.chain.clamp_fit import fit_clamp

LENGTH_M, LATERAL_OFFSET_M = 0.3021, -0.0018


def paths(directions_rad, noise_m=0.0003, seed=1):
    rng = np.random.default_rng(seed)
    return LENGTH_M + LATERAL_OFFSET_M * np.sin(directions_rad) + rng.normal(0, noise_m, len(directions_rad))


def test_both_are_found_where_the_string_leaves_in_all_directions():
    directions = np.linspace(-1.5, 2.0, 400)
    clamp_fit = fit_clamp(0.300, paths(directions), directions)
    assert clamp_fit.length_m == pytest.approx(LENGTH_M, abs=0.0003)
    assert clamp_fit.lateral_offset_m == pytest.approx(LATERAL_OFFSET_M, abs=0.0003)
    assert clamp_fit.length_sigma_m < 0.0008
    assert clamp_fit.frames == 400


def test_frames_in_which_the_hidden_string_bends_do_not_shorten_it():
    directions = np.linspace(-1.5, 2.0, 400)
    bent = paths(directions)
    bent[::3] -= 0.003
    clamp_fit = fit_clamp(0.300, bent, directions)
    assert clamp_fit.length_m == pytest.approx(LENGTH_M, abs=0.0006)


def test_what_one_direction_cannot_separate_is_reported_as_uncertain():
    directions = np.full(400, 1.2)
    clamp_fit = fit_clamp(0.300, paths(directions), directions)
    assert abs(clamp_fit.length_m - LENGTH_M) < 3 * clamp_fit.length_sigma_m
    assert clamp_fit.length_sigma_m > 0.0009


def test_too_few_frames_leave_the_length_as_given():
    clamp_fit = fit_clamp(0.300, np.array([0.31, 0.31]), np.zeros(2))
    assert (clamp_fit.length_m, clamp_fit.lateral_offset_m) == (0.300, 0.0)
