"""The whole tracker on a filmed swing: numbers that would change if any part were wrong."""

import dataclasses

import numpy as np
import pytest

from strandcast.config.string import String, Weight
from strandcast.errors import StrandcastError
from strandcast.tracking.chain.point_uncertainty import hidden_reach_m
from strandcast.tracking.scene_checks import RULER_M, exposure_warnings
from strandcast.video.ingest import inspect_video

POINTS = 10


@pytest.fixture(scope="module")
def tracked(scene, filmed):
    return scene.track(filmed[0])


@pytest.fixture(scope="module")
def off(tracked, filmed):
    truth = filmed[2][:, np.linspace(0, filmed[2].shape[1] - 1, POINTS + 1).astype(int)]
    return np.linalg.norm(tracked.points_m - truth, axis=2)


def test_points_are_within_a_millimetre(off):
    assert np.isfinite(off).all()
    assert np.sqrt((off[:, 1:] ** 2).mean()) < 1.0e-3
    assert np.sqrt((off[:, -1] ** 2).mean()) < 1.5e-3
    assert off[:, 1:].max() < 5e-3


def test_hand_is_the_markers(off):
    assert np.sqrt((off[:, 0] ** 2).mean()) < 2.5e-4


def test_sigma_matches_the_error(tracked, off):
    z = off[:, 1:] / (np.sqrt(2) * tracked.sigma_m[:, 1:])
    assert 0.4 < np.sqrt((z**2).mean()) < 2.0


def test_counts_and_choices_are_recorded(tracked, filmed):
    assert tracked.decoded_frames == len(filmed[1])
    assert tracked.choices["polarity"] == -1.0
    assert tracked.choices["bead_at_tip"] is False
    assert tracked.choices["length_m"] == pytest.approx(0.3, abs=0.002)
    assert tracked.warnings == ()


def test_markers_table_has_each_detection(tracked):
    assert len(tracked.markers["frame"]) == tracked.decoded_frames
    assert set(tracked.markers["marker"]) == {7}
    assert np.isfinite(tracked.markers["angle_rad"]).all()


def test_strobe_shows_the_throw(tracked, scene):
    assert tracked.strobe.shape == (scene.HEIGHT, scene.WIDTH, 3)
    coloured = np.ptp(tracked.strobe.astype(int), axis=2) > 60
    assert 1000 < coloured.sum() < 0.1 * coloured.size


@pytest.mark.thorough
def test_tracking_twice_gives_the_same(tracked, scene, filmed):
    again = scene.track(filmed[0])
    np.testing.assert_array_equal(again.points_m, tracked.points_m)
    np.testing.assert_array_equal(again.sigma_m, tracked.sigma_m)


def test_a_bead_at_the_tip_is_detected_and_tracked(scene, tmp_path):
    _, curves = scene.film(tmp_path / "v.mkv", frames=70, tip_radius_px=6.0)
    tracked = scene.track(tmp_path / "v.mkv")
    assert tracked.choices["bead_at_tip"] is True
    assert tracked.choices["tip_excess_m"] == pytest.approx(6.0 * scene.SCALE_M, abs=0.0015)
    assert np.sqrt(((tracked.points_m[:, -1] - curves[:, -1]) ** 2).sum(axis=1).mean()) < 1.0e-3
    assert tracked.tip_sigma_m == pytest.approx(
        0.5 * 0.009 / np.sqrt(2), abs=5e-4
    )  # where in it the string ends
    # Declared, with 7 mm of string beyond its middle, which it hides.
    string = String(length_m=0.307, points=10, weights=[Weight(place_m=0.3)])
    known = scene.track(tmp_path / "v.mkv", length_m=0.307, string=string)
    along = curves[:, -1] - curves[:, -2]
    end_m = curves[:, -1] + 0.007 * along / np.linalg.norm(along, axis=1, keepdims=True)
    assert np.sqrt(((known.points_m[:, -1] - end_m) ** 2).sum(axis=1).mean()) < 1.5e-3
    assert known.tip_sigma_m == pytest.approx(RULER_M / np.sqrt(2))


def refusal(scene, path, **changes) -> StrandcastError:
    with pytest.raises(StrandcastError) as caught:
        scene.track(path, **changes)
    return caught.value


def test_a_wrong_count_is_refused(scene, filmed):
    facts = inspect_video(filmed[0])
    more = facts.model_copy(
        update={"packets": facts.packets + 1, "time_stamps": [*facts.time_stamps, facts.time_stamps[-1] + 2]}
    )
    assert refusal(scene, filmed[0], facts=more).code == "SC-V005"


def test_another_size_is_refused(scene, filmed):
    facts = inspect_video(filmed[0]).model_copy(update={"width_px": 640})
    assert refusal(scene, filmed[0], facts=facts).code == "SC-C012"


def test_a_missing_marker_is_named(scene, tmp_path):
    scene.film(tmp_path / "v.mkv", frames=3)
    other = dataclasses.replace(scene.HAND_MARKER, id=33)
    error = refusal(scene, tmp_path / "v.mkv", markers=(other,))
    assert error.code == "SC-A004"
    assert "33" in error.what


def test_an_assumed_exposure_is_named_where_the_string_is_fast():
    time_s = np.arange(10) / 250.0
    points = np.zeros((10, 3, 2))
    points[:, 2, 0] = 5.0 * time_s  # the tip, at 5 m/s: 20 mm a frame
    [warning] = exposure_warnings(points, time_s, 0.8e-3, 2e-3)
    assert "0.8 ms is assumed" in warning
    assert "(5.0 m/s) over 2.0 px; the true blur may reach 10.0 px" in warning
    assert exposure_warnings(0.2 * points, time_s, 0.8e-3, 2e-3) == []  # 2 px a frame
    assert exposure_warnings(np.full_like(points, np.nan), time_s, 0.8e-3, 2e-3) == []


def test_a_hidden_place_is_within_reach_of_the_visible_string():
    root, taut = np.zeros(2), np.column_stack([np.arange(1.0, 7.0), np.zeros(6)])
    seen = np.array([True, False, False, False, True, False])
    np.testing.assert_allclose(hidden_reach_m(taut, root, seen, 1.0), [0, 0, 0, 0, 0, 1], atol=1e-7)
    slack = np.where(np.arange(6)[:, None] >= 4, taut - [2.0, 0.0], taut)  # 4 of string over a distance of 2
    np.testing.assert_allclose(hidden_reach_m(slack, root, seen, 1.0), [0, 1, 3**0.5, 1, 0, 1], atol=1e-7)
    hidden_start = np.array([False, False, True, True, True, True])
    np.testing.assert_allclose(hidden_reach_m(taut, root, hidden_start, 1.0)[:2], 0.0, atol=1e-7)


def test_the_hint_is_the_string_beyond_the_clamp(scene, filmed):
    given = scene.tracker_input(filmed[0], free_length_m=0.29)
    assert dataclasses.asdict(given.hint) == {
        "length_m": 0.29,
        "points": POINTS,
        "thickness_m": None,
        "beyond_m": np.inf,
    }


def test_the_picture_holds_the_closest_approach(scene, filmed):
    at = 37  # not one of the sampled frames
    target_m = filmed[2][at, -1]
    tracked = scene.track(filmed[0], target_m=target_m)
    shown = [int(frame) for frame in str(tracked.choices["strobe_frames"]).split()]
    off_m = np.linalg.norm(tracked.points_m[:, -1] - target_m, axis=1)
    assert int(off_m.argmin()) in shown
