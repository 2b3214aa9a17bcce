"""Scores of the tracking benchmark for a perfect track with added errors."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from strandcast.camera.flat import flat_camera
from strandcast.records.camera import Camera
from strandcast_studies.benchmarks.video.score import (
    OCCLUDED,
    TARGETS,
    UNSURE,
    errors_of,
    line,
    score,
    summary,
)
from strandcast_studies.benchmarks.video.truth import ON_THE_STRING_M, Truth, TruthArrays, self_crossings

PIXEL_M = 0.0015
FRAMES, POINTS, LENGTH_M = 60, 10, 0.30
RADIUS_M = 0.02


def camera() -> Camera:
    """Return a camera normal to the plane, 800 x 600 pixels, the world's origin in the middle."""
    return flat_camera(800, 600, PIXEL_M, (399.5, 299.5))


def looped(places_m: np.ndarray) -> np.ndarray:
    """Return a string (N, 2) that runs to the right, around one circle, and on to the right."""
    turn = np.clip((places_m - 0.08) / RADIUS_M, 0.0, 2.0 * np.pi)
    straight = np.minimum(places_m, 0.08) + np.maximum(places_m - 0.08 - 2.0 * np.pi * RADIUS_M, 0.0)
    # Slanted slightly, so that the outgoing branch crosses the incoming one instead of lying on it.
    rise = np.where(turn >= 2.0 * np.pi, -0.1, 0.1) * (straight - 0.08)
    return np.column_stack([straight + RADIUS_M * np.sin(turn), rise + RADIUS_M * (1.0 - np.cos(turn))])


def truth_of(curve, **changes) -> Truth:
    places = np.linspace(0.0, LENGTH_M, 301)
    drift = np.linspace(0.0, 0.05, FRAMES)[:, None, None] * np.array([0.0, 1.0])
    empty = np.zeros(FRAMES)
    arrays = TruthArrays(
        nodes_m=curve(places)[None] + drift,
        places_m=places,
        hand=np.zeros((FRAMES, 3)),
        q_rad=np.zeros((FRAMES, 3)),
        hidden=np.zeros((FRAMES, round(LENGTH_M / ON_THE_STRING_M) + 1), bool),
        blur_px=empty,
        tip_blur_px=empty,
        tip_speed_m_s=empty,
        cnr=np.full(3, 20.0),
        weights_m=np.zeros((0, 2)),
        pipes_m=np.zeros((0, 2)),
        length_m=np.array(LENGTH_M),
    )
    return Truth(replace(arrays, **changes), camera())


@dataclass
class Found:
    points_m: np.ndarray
    sigma_m: np.ndarray
    flags: np.ndarray


def perfect(truth: Truth) -> Found:
    points = np.concatenate([truth.at(np.zeros(1)), truth.points_m(POINTS)], axis=1)
    shape = points.shape[:2]
    return Found(points, np.full(shape, 0.3 * PIXEL_M), np.zeros(shape, np.int32))


@pytest.fixture(scope="module")
def straight() -> Truth:
    return truth_of(lambda places: np.column_stack([places, np.zeros_like(places)]))


@pytest.fixture(scope="module")
def loop() -> Truth:
    return truth_of(looped)


def test_a_perfect_track_is_perfect(straight):
    found = score("v", straight, perfect(straight))
    assert found.across_median_px == pytest.approx(0.0, abs=1e-6)
    assert found.rms_px == pytest.approx(0.0, abs=1e-6)
    assert (found.far_share, found.placed_share, found.unflagged_share) == (0.0, 1.0, 1.0)
    assert found.visible_frames == FRAMES
    assert found.unflagged.within_1 == 1.0


@pytest.mark.parametrize(("shift_px", "along", "across"), [((0.0, 0.3), 0.0, 0.3), ((3.0, 0.0), 3.0, 0.0)])
def test_a_shift_along_is_separated_from_one_across(straight, shift_px, along, across):
    track = perfect(straight)
    track.points_m += np.array(shift_px) * PIXEL_M
    found = score("v", straight, track)
    assert found.along_mean_px == pytest.approx(along, abs=1e-3)
    assert found.across_median_px == pytest.approx(across, abs=1e-3)
    assert found.rms_px == pytest.approx(np.hypot(along, across), abs=1e-3)


def test_the_hand_is_scored_by_itself(straight):
    track = perfect(straight)
    hand = np.zeros((FRAMES, 3))
    hand[:, :2] = track.points_m[:, 0]
    truth = Truth(replace(straight.arrays, hand=hand), straight.camera)
    assert score("v", truth, track).hand_rms_px == pytest.approx(0.0, abs=1e-6)
    track.points_m[:, 0] += np.array([0.0, 0.5]) * PIXEL_M
    found = score("v", truth, track)
    assert found.hand_rms_px == pytest.approx(0.5, abs=1e-3)
    assert found.rms_px == pytest.approx(0.0, abs=1e-6)


def test_errors_are_in_pixels_of_the_plane_and_signed(straight):
    track = perfect(straight)
    track.points_m += np.array([2.0, -1.0]) * PIXEL_M
    errors = errors_of(straight, track)
    np.testing.assert_allclose(errors.along_px, 2.0, atol=1e-3)
    np.testing.assert_allclose(errors.across_px, -1.0, atol=1e-3)


def test_along_is_along_wherever_the_string_points():
    slanted = truth_of(lambda places: places[:, None] * np.array([0.6, -0.8]))
    track = perfect(slanted)
    track.points_m += (2.0 * np.array([0.6, -0.8]) + 0.5 * np.array([0.8, 0.6])) * PIXEL_M
    errors = errors_of(slanted, track)
    np.testing.assert_allclose(errors.along_px, 2.0, atol=1e-3)
    np.testing.assert_allclose(errors.across_px, 0.5, atol=1e-3)


def test_sigmas_are_compared_with_errors(straight):
    random = np.random.default_rng(1)
    track = perfect(straight)
    track.points_m += random.normal(0.0, 0.3 * PIXEL_M, track.points_m.shape)
    honest = score("v", straight, track).unflagged
    assert honest.rms == pytest.approx(1.0, abs=0.06)
    assert (honest.within_1, honest.within_2) == (
        pytest.approx(0.683, abs=0.03),
        pytest.approx(0.954, abs=0.02),
    )
    track.sigma_m *= 3.0
    assert score("v", straight, track).unflagged.rms == pytest.approx(honest.rms / 3.0)


def test_sigmas_of_their_own_axes_are_taken(straight):
    track = perfect(straight)
    track.points_m += np.array([1.0, 0.1]) * PIXEL_M
    track.sigma_along_m, track.sigma_across_m = track.sigma_m / 0.3, track.sigma_m / 3.0
    found = score("v", straight, track).unflagged
    assert (found.rms_along, found.rms_across) == (
        pytest.approx(1.0, rel=1e-3),
        pytest.approx(1.0, rel=1e-3),
    )


def test_frames_far_off_and_their_flags_are_counted(straight):
    track = perfect(straight)
    track.points_m[:6, 4] += np.array([0.0, 8.0]) * PIXEL_M
    track.flags[:3, 4] = UNSURE
    track.points_m[6:9, 7] = np.nan
    found = score("v", straight, track)
    assert found.far_share == pytest.approx(9 / FRAMES)
    assert found.misplaced_share == pytest.approx(6 / FRAMES)
    assert found.far_flagged_share == pytest.approx(6 / 9)
    assert found.silent_frames == 3
    assert found.placed_share == pytest.approx(1.0 - 3 / (FRAMES * POINTS))


def test_a_flag_on_another_point_does_not_count(straight):
    track = perfect(straight)
    track.points_m[0, 4] += np.array([0.0, 8.0]) * PIXEL_M
    track.flags[0, 9] = OCCLUDED
    assert score("v", straight, track).far_flagged_share == 0.0


def test_hidden_points_are_not_scored(straight):
    hidden = straight.arrays.hidden.copy()
    hidden[:, -20:] = True
    truth = Truth(replace(straight.arrays, hidden=hidden), straight.camera)
    track = perfect(truth)
    track.points_m[:, -1] += 0.1
    found = score("v", truth, track)
    assert found.rms_px == pytest.approx(0.0, abs=1e-6)
    assert np.isnan(found.tip_rms_px)
    assert found.visible_frames == FRAMES


def test_crossings_are_found_where_they_are(loop):
    ring = 2.0 * np.pi * RADIUS_M
    assert len(loop.crossings) == FRAMES
    assert loop.crossings[0].first_m == pytest.approx(0.08, abs=0.006)
    assert loop.crossings[0].second_m - loop.crossings[0].first_m == pytest.approx(ring, abs=0.012)
    cross = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, -1.0]])
    places = np.array([0.0, 2.0, 3.0, 4.0, 6.0])
    assert self_crossings(cross, places) == [(1.0, 5.0)]


def test_a_loop_in_the_wrong_direction_is_detected(loop):
    track = perfect(loop)
    clean = score("v", loop, track)
    assert (clean.crossing_frames, clean.wrong_order_frames) == (FRAMES, 0)
    first, second = loop.crossings[0].first_m, loop.crossings[0].second_m
    shares = loop.shares_m(POINTS)
    inside = np.flatnonzero((shares > first) & (shares < second))
    mirrored = loop.at(first + second - shares[inside])
    track.points_m[:, 1 + inside] = mirrored
    wrong = score("v", loop, track)
    assert (wrong.wrong_order_frames, wrong.wrong_order_unflagged) == (FRAMES, FRAMES)
    track.flags[:40, 1 + inside] = UNSURE
    assert score("v", loop, track).wrong_order_unflagged == FRAMES - 40


def test_sliding_along_the_string_is_not_a_wrong_order(loop):
    track = perfect(loop)
    shares = np.minimum(loop.shares_m(POINTS) + 14.0 * PIXEL_M, LENGTH_M)
    track.points_m[:, 1:] = loop.at(shares)
    found = score("v", loop, track)
    assert found.far_share == 1.0
    assert found.wrong_order_frames == 0


def test_a_good_track_meets_the_targets_and_a_bad_one_does_not(straight):
    track = perfect(straight)
    track.points_m += np.random.default_rng(2).normal(0.0, 0.05 * PIXEL_M, track.points_m.shape)
    track.sigma_m[:] = 0.05 * PIXEL_M
    good = score("good", straight, track)
    assert all(target.met(good) for target in TARGETS)
    track.points_m += np.array([9.0, 0.3]) * PIXEL_M
    bad = score("bad", straight, track)
    missed = {target.name for target in TARGETS if not target.met(bad)}
    assert len(missed) == len(TARGETS) - 1  # the string does not cross itself here
    assert "1/2" in summary([good, bad])
    assert line(good).startswith("good")
