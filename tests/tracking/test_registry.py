"""Trackers by name: the built-in ones, one from outside the package, and settings that a tracker ignores."""

import dataclasses

import numpy as np
import pytest

from strandcast.config.align import LedSettings
from strandcast.config.track import TrackSettings
from strandcast.errors import StrandcastError
from strandcast.tracking.registry import TRACKERS, track
from strandcast.tracking.result import Tracked, marker_columns
from strandcast.tracking.tracker import Tracker, TrackerInput


def hanging(given: TrackerInput, settings: TrackSettings) -> Tracked:
    """Return a string that hangs straight down from the origin in every frame: a toy."""
    frames, points = given.facts.packets, given.string.n
    places = np.zeros((frames, points + 1, 2))
    places[:, :, 1] = np.linspace(0.0, -given.free_length_m, points + 1)
    return Tracked(
        camera_time_s=np.arange(frames) / given.facts.frame_rate_hz,
        points_m=places,
        sigma_m=np.full((frames, points + 1), 1e-3),
        flags=np.zeros((frames, points + 1), np.int32),
        markers=marker_columns(np.zeros((0, 7))),
        strobe=np.zeros((2, 2, 3), np.uint8),
        choices={"tracker": settings.tracker},
    )


HANGING = Tracker(hanging, unused_settings=("track.polarity", "align.led"))


@pytest.fixture
def own_registry(monkeypatch):
    """Let a test register trackers that others do not see."""
    monkeypatch.setattr(TRACKERS, "_entries", TRACKERS.known())


def test_a_registered_tracker_is_called(own_registry, scene, filmed):
    TRACKERS.register("hanging", HANGING)
    tracked = track(scene.tracker_input(filmed[0]), TrackSettings(tracker="hanging"))
    assert tracked.decoded_frames == len(filmed[1])
    np.testing.assert_allclose(tracked.points_m[:, -1], [[0.0, -0.3]] * len(filmed[1]))


def test_a_name_is_registered_once(own_registry):
    with pytest.raises(ValueError, match="chain"):
        TRACKERS.register("chain", HANGING)


def test_an_installed_package_provides_a_tracker(own_registry):
    """`plugins/pendulum`, by its entry point."""
    pendulum = TRACKERS.get("pendulum")
    assert pendulum.track.__module__.partition(".")[0] == "strandcast_pendulum"
    assert pendulum.calibrate is not None


def test_an_unknown_tracker_is_refused_with_the_known_ones():
    with pytest.raises(StrandcastError, match="chain, pendulum") as caught:
        TRACKERS.get("kalman", file="experiment.yaml")
    assert (caught.value.code, caught.value.field) == ("SC-W021", "track.tracker")


@pytest.mark.parametrize(
    ("settings", "changes", "named"),
    [
        ({"polarity": "dark", "contrast_grey": 30.0}, {}, "track.polarity, track.contrast_grey"),
        ({"background_picture": "empty.png"}, {}, "track.background_picture"),
        ({}, {"led": LedSettings(place_m=(0.1, 0.2)), "exposure_s": 1e-3}, "camera.exposure_s, align.led"),
    ],
)
def test_the_installed_pendulum_refuses_settings_that_it_ignores(scene, filmed, settings, changes, named):
    given = dataclasses.replace(scene.tracker_input(filmed[0]), settings_file="experiment.yaml", **changes)
    with pytest.raises(StrandcastError) as caught:
        track(given, TrackSettings(tracker="pendulum", **settings))
    assert caught.value.code == "SC-E008"
    assert caught.value.what == f"the tracker 'pendulum' does not use {named}"
    assert (caught.value.file, caught.value.field) == ("experiment.yaml", named.split(", ")[0])
