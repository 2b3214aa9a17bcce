"""The whole tracker on a filmed swing: figures that would move if any of its parts were wrong."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from strandcast.errors import StrandcastError
from strandcast.tracking.hand import HandMarker
from strandcast.tracking.judge import in_long_gap
from strandcast.tracking.track import StringHint, track_video
from strandcast.video.ingest import inspect_video

POINTS = 10


@pytest.fixture(scope="module")
def tracked(scene, filmed):
    path, _, _ = filmed
    marker = HandMarker(7, scene.MARKER_M, scene.MARKER_PLACE_M)
    return track_video(path, inspect_video(path), scene.flat_camera(), StringHint(0.3, POINTS), [marker])


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


def test_sigma_is_honest(tracked, off):
    z = off[:, 1:] / (np.sqrt(2) * tracked.sigma_m[:, 1:])
    assert 0.4 < np.sqrt((z**2).mean()) < 2.0


def test_counts_and_choices_are_written_down(tracked, filmed):
    assert tracked.decoded_frames == len(filmed[1])
    assert tracked.choices["polarity"] == -1.0
    assert tracked.choices["ball_at_tip"] is False
    assert tracked.choices["length_m"] == pytest.approx(0.3, abs=0.002)
    assert tracked.warnings == []


def test_markers_table_has_each_sighting(tracked):
    assert len(tracked.markers["frame"]) == tracked.decoded_frames
    assert set(tracked.markers["marker"]) == {7}
    assert np.isfinite(tracked.markers["angle_rad"]).all()


def test_strobe_shows_the_throw(tracked, scene):
    assert tracked.strobe.shape == (scene.HEIGHT, scene.WIDTH, 3)
    coloured = np.ptp(tracked.strobe.astype(int), axis=2) > 60
    assert 1000 < coloured.sum() < 0.1 * coloured.size


def test_twice_gives_the_same(tracked, scene, filmed):
    marker = HandMarker(7, scene.MARKER_M, scene.MARKER_PLACE_M)
    again = track_video(
        filmed[0], inspect_video(filmed[0]), scene.flat_camera(), StringHint(0.3, POINTS), [marker]
    )
    np.testing.assert_array_equal(again.points_m, tracked.points_m)
    np.testing.assert_array_equal(again.sigma_m, tracked.sigma_m)


def test_a_ball_at_the_tip_is_seen_and_held(scene, tmp_path):
    _, curves = scene.film(tmp_path / "v.mkv", frames=70, tip_radius_px=6.0)
    marker = HandMarker(7, scene.MARKER_M, scene.MARKER_PLACE_M)
    tracked = track_video(
        tmp_path / "v.mkv",
        inspect_video(tmp_path / "v.mkv"),
        scene.flat_camera(),
        StringHint(0.3, POINTS),
        [marker],
    )
    assert tracked.choices["ball_at_tip"] is True
    assert tracked.choices["tip_excess_m"] == pytest.approx(6.0 * scene.SCALE_M, abs=0.0015)
    assert np.sqrt(((tracked.points_m[:, -1] - curves[:, -1]) ** 2).sum(axis=1).mean()) < 1.0e-3


def refusal(scene, path, facts, marker=7) -> StrandcastError:
    markers = [HandMarker(marker, scene.MARKER_M, scene.MARKER_PLACE_M)]
    with pytest.raises(StrandcastError) as caught:
        track_video(path, facts, scene.flat_camera(), StringHint(0.3, POINTS), markers)
    return caught.value


def test_a_wrong_count_is_refused(scene, filmed):
    facts = inspect_video(filmed[0])
    more = facts.model_copy(
        update={"packets": facts.packets + 1, "time_stamps": [*facts.time_stamps, facts.time_stamps[-1] + 2]}
    )
    assert refusal(scene, filmed[0], more).code == "SC-T001"


def test_another_size_is_refused(scene, filmed):
    facts = inspect_video(filmed[0]).model_copy(update={"width_px": 640})
    assert refusal(scene, filmed[0], facts).code == "SC-T002"


def test_an_unseen_marker_is_named(scene, tmp_path):
    scene.film(tmp_path / "v.mkv", frames=3)
    error = refusal(scene, tmp_path / "v.mkv", inspect_video(tmp_path / "v.mkv"), marker=33)
    assert error.code == "SC-T003"
    assert "33" in error.what


def test_hidden_runs_are_given_up_only_when_long():
    seen = np.array([True, False, False, True, False, False, False, False, True, False])
    np.testing.assert_array_equal(in_long_gap(seen, 3), [0, 0, 0, 0, 1, 1, 1, 1, 0, 0])
    np.testing.assert_array_equal(in_long_gap(np.array([True, False, False]), 3), [0, 1, 1])


def test_what_is_known_of_the_string_is_plain_data():
    assert dataclasses.asdict(StringHint(0.3, 10)) == {"length_m": 0.3, "points": 10, "thickness_m": None}
