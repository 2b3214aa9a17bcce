"""A cable in space is fitted to series of its motion and predicts another one; held at one end or both."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from strandcast.config.estimate import EstimateSettings
from strandcast.core.strings import FORCES
from strandcast.dynamics.batch import HandPath
from strandcast.dynamics.simulate import simulate_batch
from strandcast.dynamics.spatial.clamps import clamp_poses
from strandcast.estimation.cable_series import CableSeries, series_between
from strandcast.estimation.cable_space import space_of_cable
from strandcast.estimation.estimate import FoundString, find_string
from strandcast.estimation.fit_objective import simulate_throw
from strandcast.estimation.optimisers.optimiser import SearchStart
from strandcast.estimation.windows import parts_of_series, parts_to_fit
from strandcast.records.alignment import EndPath

LENGTH_M = 0.8
TIME_S = np.arange(0.0, 1.5, 0.01)
PLACES = np.linspace(0.0, 1.0, 11)
TRUTH = {
    "bending_length": 0.1,
    "damping_s": 0.05,
    "air": 0.1,
    "clamp_stiffness": 1.0,
    "length_change": -0.015,
    "clamp_left_rad": 0.1,
    "clamp_up_rad": -0.15,
    "far_left_rad": 0.05,
    "far_up_rad": 0.1,
    "curl_left_rad": 0.6,
    "curl_up_rad": -0.4,
    "taper": 0.0,
}


def moved(phase: float, origin_m: tuple[float, float, float], direction: tuple[float, float, float]):
    """Poses of a clamp that moves and turns about all axes."""
    away = 0.1 * np.column_stack([np.sin(k * TIME_S + phase) - np.sin(phase) for k in (4.0, 3.0, 5.0)])
    turn = Rotation.from_rotvec(np.outer(0.5 * np.sin(4.0 * TIME_S), [0.3, -0.5, 0.8]))
    return clamp_poses(origin_m + away, turn.apply(direction))


def series(two_ends: bool, phase: float, places=PLACES) -> CableSeries:
    """Return a motion of the true cable from rest, with its markers off by 0.2 mm."""
    pose = moved(phase, (0.0, 0.0, 0.0), (0.5, 0.0, -0.8))
    if two_ends:
        pose = np.hstack([pose, moved(phase + 1.0, (0.5, 0.1, 0.0), (-0.5, 0.1, -0.8))])
    model, space = space_of_cable(LENGTH_M, two_ends)
    strings = space.strings(space.exponents(np.array([TRUTH[name] for name in space.names])))
    points, _ = simulate_batch(model, strings, HandPath(TIME_S, pose), TIME_S)
    markers = CubicSpline(np.linspace(0.0, 1.0, 21), points[0], axis=1)(places)
    noise = np.random.default_rng(int(10 * phase)).normal(0.0, 2e-4, markers.shape)
    return CableSeries(TIME_S, pose, markers + noise, np.asarray(places))


def eased(moving: CableSeries) -> CableSeries:
    """Return the same motion after half a second at rest, in which its first frame is repeated."""
    rest_s = np.arange(-0.5, 0.0, 0.01)

    def held(values):
        return np.concatenate([np.repeat(values[:1], len(rest_s), axis=0), values])

    return CableSeries(np.r_[rest_s, TIME_S], held(moving.pose), held(moving.vertices_m), moving.places)


def fit_cable(fitted: list[CableSeries], model, space, **settings) -> FoundString:
    parts = {"": parts_of_series(fitted, model.points, last=False)}
    settings = EstimateSettings(**settings).in_space(thrown=False)
    return find_string(
        parts, model, space, settings, partial(np.random.default_rng, 1), SearchStart(None, len(fitted))
    )


def missed_m(fit: FoundString, other: CableSeries) -> float:
    predicted_m = other.predicted(fit.objective.model, fit.string)
    return float(np.linalg.norm(predicted_m - other.vertices_m, axis=2).mean())


@pytest.mark.parametrize("two_ends", [False, True], ids=["one end", "two ends"])
def test_a_fitted_cable_predicts_another_motion(two_ends):
    model, space = space_of_cable(LENGTH_M, two_ends)
    fit = fit_cable([series(two_ends, 0.0), series(two_ends, 1.3)], model, space)
    assert fit.log.converged
    assert missed_m(fit, series(two_ends, 2.9)) < 4e-3
    assert len(space.names) <= 10
    found = fit.values()
    assert found["bending_length"] == pytest.approx(TRUTH["bending_length"], rel=0.1)
    assert found["length_change"] == pytest.approx(TRUTH["length_change"], abs=4e-3)


@pytest.mark.parametrize("places", [[1.0], [0.37, 0.96]], ids=["tip", "two markers"])
def test_few_markers_off_the_mass_points_are_enough_from_rest(places):
    model, space = space_of_cable(LENGTH_M, False)
    fitted = [eased(series(False, phase, places)) for phase in (0.0, 1.3)]
    assert not fitted[0].shape_is_seen()
    fit = fit_cable(fitted, model, space)
    assert missed_m(fit, eased(series(False, 2.9, places))) < 6e-3


@pytest.mark.thorough
def test_taper_and_the_place_of_the_only_marker_are_found():
    model, space = space_of_cable(LENGTH_M, False, forces={"taper", "rest_curl", "marker_shift"})
    truth = TRUTH | {"taper": 1.2, "marker_shift": -0.05}
    chi = space.exponents(np.array([truth[name] for name in space.names]))

    def seen(phase: float, places) -> CableSeries:
        bare = eased(series(False, phase, places))
        return replace(bare, vertices_m=bare.predicted(model, space.strings(chi)))

    fit = fit_cable([seen(0.0, [1.0]), seen(1.3, [1.0])], model, space)
    assert fit.values()["taper"] == pytest.approx(1.2, abs=0.5)
    assert fit.values()["marker_shift"] == pytest.approx(-0.05, abs=0.02)
    assert missed_m(fit, seen(2.9, [1.0])) < 5e-3
    # A marker declared farther back by the shift is in the same place.
    there, declared = space.strings(chi).with_values(marker_shift=np.zeros(1)), seen(2.9, [0.95])
    markers = simulate_throw(model, declared.prepared(0, 200, model.points), there)[0][0, :, 1:]
    np.testing.assert_allclose(markers, seen(2.9, [1.0]).vertices_m, atol=1e-9)


def test_the_unknowns_of_a_string_are_read_from_it():
    _, space = space_of_cable(LENGTH_M, True, weight_places_m=[0.3], forces=set(FORCES))
    chi = np.random.default_rng(2).uniform(0.1, 0.9, (3, space.dimension))
    np.testing.assert_allclose(space.chi_of(space.strings(chi)), chi, atol=1e-9)


def test_weights_of_unknown_mass_are_found():
    model, space = space_of_cable(LENGTH_M, False, weight_places_m=[LENGTH_M])
    truth = space.exponents(np.array([TRUTH.get(name, 8.0) for name in space.names]))
    bare = series(False, 0.0)
    loaded = CableSeries(TIME_S, bare.pose, bare.predicted(model, space.strings(truth)), PLACES)
    fit = fit_cable([loaded], model, space, evaluations=150)
    assert fit.values()["weight_1"] == pytest.approx(8.0, rel=0.15)


@pytest.mark.thorough
def test_friction_that_sticks_is_found_and_predicts():
    two_ends, truth = True, TRUTH | {"friction_turn_rad": 1.0, "stick_turn_rad": 0.1}
    plain_model, plain_space = space_of_cable(LENGTH_M, two_ends)
    model, space = space_of_cable(LENGTH_M, two_ends, forces={"friction_stick"})
    chi = space.exponents(np.array([truth[name] for name in space.names]))

    def rubbed(phase: float) -> CableSeries:
        bare = series(two_ends, phase)
        return CableSeries(TIME_S, bare.pose, bare.predicted(model, space.strings(chi)), PLACES)

    fitted, other = [rubbed(0.0), rubbed(1.3)], rubbed(2.9)
    sticks = fit_cable(fitted, model, space)
    assert sticks.values()["friction_turn_rad"] == pytest.approx(1.0, rel=0.3)
    assert sticks.values()["bending_length"] == pytest.approx(TRUTH["bending_length"], rel=0.1)
    assert missed_m(sticks, other) < 0.7 * missed_m(fit_cable(fitted, plain_model, plain_space), other)


@pytest.mark.thorough
def test_ends_that_are_points_do_not_rub():
    model, space = space_of_cable(LENGTH_M, True, pinned=True, forces={"friction_stick"})
    strings = space.strings(np.full(space.dimension, 0.5))
    time_s, ends = np.array([0.0, 0.4]), np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])

    def tip(spun_rad: float):
        turned = Rotation.from_rotvec([0.0, spun_rad, 0.0]).apply([0.0, 0.0, -1.0])
        place = np.repeat(ends[:1], 2, axis=0)
        first = clamp_poses(place, np.array([[0.0, 0.0, -1.0], turned]))
        far = clamp_poses(place + ends[1], np.array([[0.0, 0.0, -1.0]] * 2))
        points, _ = simulate_batch(model, strings, HandPath(time_s, np.hstack([first, far])), time_s)
        return points[0, -1]

    np.testing.assert_allclose(tip(1.0), tip(0.0), atol=1e-9)


def test_vertices_that_jump_or_are_not_seen_do_not_count():
    clean = series(False, 0.0)
    vertices = clean.vertices_m.copy()
    vertices[40, 5] += 0.3
    vertices[60:70, 3] = np.nan
    reliable = CableSeries(TIME_S, clean.pose, vertices, PLACES).reliable
    expected = np.ones_like(reliable)
    expected[39:42, 5] = False
    expected[60:70, 3] = False
    np.testing.assert_array_equal(reliable, expected)


def test_a_moving_start_of_few_markers_has_the_length_of_the_string():
    moving = series(False, 0.0, [1.0]).part(40, 150)
    model, space = space_of_cable(LENGTH_M, False)
    chi = space.exponents(np.array([TRUTH[name] for name in space.names]))
    start = moving.start(0, model.points)
    assert not start.settle
    hand = HandPath(moving.time_s, moving.pose)
    points, _ = simulate_batch(model, space.strings(chi), hand, moving.time_s, start)
    length_m = np.linalg.norm(np.diff(points[0], axis=1), axis=2).sum(axis=1)
    expected_m = LENGTH_M * (1.0 + TRUTH["length_change"])
    np.testing.assert_allclose(length_m, expected_m, rtol=0.02)


def test_a_marker_of_a_fast_string_does_not_jump():
    speed_m_s = np.interp(TIME_S, [0.2, 0.3, 0.6, 0.7], [0.0, 9.0, 9.0, 0.0])
    path = np.cumsum(0.01 * speed_m_s)[:, None, None] * np.ones(3) / np.sqrt(3.0)
    still = clamp_poses(np.zeros_like(path[:, 0]), np.ones_like(path[:, 0]))
    assert CableSeries(TIME_S, still, path, np.ones(1)).reliable.all()
    path[50] += 0.1
    np.testing.assert_array_equal(
        np.flatnonzero(~CableSeries(TIME_S, still, path, np.ones(1)).reliable), [49, 50, 51]
    )


def test_a_prediction_reads_the_start_only():
    model, space = space_of_cable(LENGTH_M, False)
    chi = space.exponents(np.array([TRUTH[name] for name in space.names]))
    whole = series(False, 0.0)
    hidden = whole.vertices_m.copy()
    hidden[12:] = np.nan
    np.testing.assert_array_equal(
        whole.predicted(model, space.strings(chi)),
        CableSeries(TIME_S, whole.pose, hidden, PLACES).predicted(model, space.strings(chi)),
    )


def test_the_start_velocity_is_smoothed_over_a_few_frames():
    clean = series(True, 0.4)
    noise = np.random.default_rng(5).normal(0.0, 1e-3, clean.vertices_m.shape)
    noisy = CableSeries(TIME_S, clean.pose, clean.vertices_m + noise, PLACES)
    off = noisy.start(60, 20).velocity_m_s - clean.start(60, 20).velocity_m_s
    # Two frames 10 ms apart would be off by 0.14 m/s rms in each coordinate.
    assert np.sqrt(np.mean(off[:-1] ** 2)) < 0.03


def test_an_end_that_points_up_does_not_hang_and_a_point_has_no_direction():
    place = np.cumsum(np.full((50, 3), 1e-3), axis=0)
    time_s, up = TIME_S[:50], np.broadcast_to([0.0, 0.0, 1.0], (50, 3))
    seen = place[:, None] - [0.0, 0.0, 0.5]
    aside = np.broadcast_to([0.5, 0.0, 1.0], (50, 3))

    def rolls(*direction):
        return series_between(time_s, [EndPath(place, *direction)], seen, np.ones(1))

    assert list(rolls(up)) == ["transported"]
    assert list(rolls(-up)) == ["transported", "hanging"]
    begins_up = np.concatenate([up[:10], aside[10:]])
    assert list(rolls(begins_up)) == ["transported"]
    assert list(rolls(aside, up)) == ["measured"]
    assert rolls()["measured"].pinned


@pytest.mark.parametrize("wrong", [slice(0, None), slice(60, 100), slice(0, 30)], ids=str)
def test_markers_of_a_body_that_were_taken_for_each_other_are_put_in_order(wrong):
    moving = series(True, 0.0)
    # The string leaves the inner one of two markers, 25 mm apart.
    inner, away = moving.pose[:, 9:12], 0.025 * moving.pose[:, 12:15]
    exchanged = np.zeros((len(TIME_S), 1), dtype=bool)
    exchanged[wrong] = True
    far = EndPath(np.where(exchanged, inner - away, inner), np.where(exchanged, -away, away))
    near = EndPath(moving.pose[:, :3], moving.pose[:, 3:6])
    seen = moving.vertices_m.copy()
    seen[12:] = np.nan  # a prediction has no more

    def pose(end):
        return series_between(TIME_S, [near, end], seen, PLACES)["transported"].pose

    np.testing.assert_allclose(pose(far), pose(EndPath(inner, away)), atol=1e-12)


def resting(seconds: float, moves_s: tuple[float, float], places) -> CableSeries:
    """Return a recording at 25 Hz whose markers rest but for some seconds, with a noise of 1 mm."""
    time_s = np.arange(0.0, seconds, 0.04)
    moves = (time_s > moves_s[0]) & (time_s < moves_s[1])
    sway = 0.2 * np.sin(6.0 * (time_s - moves_s[0])) * moves
    markers = np.stack(
        [np.column_stack([sway * at, 0.0 * sway, -LENGTH_M * at + 0.0 * sway]) for at in places], 1
    )
    markers += np.random.default_rng(3).normal(0.0, 1e-3, markers.shape)
    still = np.zeros((len(time_s), 3))
    return CableSeries(time_s, clamp_poses(still, still - [0.0, 0.0, 1.0]), markers, np.asarray(places))


def test_of_few_markers_each_recording_is_read_where_it_moves_however_many_there_are():
    shares = {}
    for count in (2, 7):
        recordings = [resting(90.0, (50.0 + k, 62.0 + k), [0.5, 1.0]) for k in range(count)]
        read = [np.zeros(len(each.time_s), dtype=bool) for each in recordings]
        for row, first, last in parts_to_fit(recordings):
            read[row][first:last] = True
        for k, (each, frames) in enumerate(zip(recordings, read, strict=True)):
            moves = (each.time_s > 50.0 + k) & (each.time_s < 62.0 + k)
            assert frames[moves].mean() > 0.9
            # It begins at rest.
            assert not moves[np.flatnonzero(frames)[0]]
        shares[count] = [frames.mean() for frames in read]
    assert shares[7] == shares[2][:1] * 7


def test_where_the_shape_is_seen_rest_and_motion_are_both_read():
    one = resting(90.0, (70.0, 80.0), [0.25, 0.5, 0.75, 1.0])
    moves = [
        bool(((one.time_s[first:last] > 70.0) & (one.time_s[first:last] < 80.0)).mean() > 0.5)
        for _, first, last in parts_to_fit([one])
    ]
    assert 3 <= sum(moves) <= 7
