"""A pendulum whose pivot is out of view: scale and pivot from its arc; a drawn one and a real one."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from strandcast.config.track import TrackSettings
from strandcast.errors import StrandcastError
from strandcast.tracking.preconditions import check_pixel_aspect
from strandcast.tracking.result import Tracked
from strandcast.video.ingest import inspect_video
from strandcast.video.source import VideoInfo
from strandcast_pendulum.arc import calibrate_arc, fit_arc
from strandcast_pendulum.period import check_period, period_s
from strandcast_pendulum.track import track_pendulum


def periods_s(time_s: np.ndarray, x_m: np.ndarray) -> np.ndarray:
    """Times between upward crossings of the mean."""
    seen = np.isfinite(x_m)
    x = np.interp(time_s, time_s[seen], x_m[seen])
    x = x - x.mean()
    k = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    return np.diff(time_s[k] - x[k] * (time_s[k + 1] - time_s[k]) / (x[k + 1] - x[k]))


def pendulum(scene, path, camera, length_m, points) -> Tracked:
    return track_pendulum(scene.tracker_input(path, length_m, points, camera=camera), TrackSettings())


def swing_film(scene, path, swing_rad):
    """Film a ball of 15 px on a thread of 700 px, 1.68 s a period; the pivot is 500 px above the picture."""
    rng = np.random.default_rng(0)
    frames, angles = [], []
    for k in range(202):
        angle = swing_rad * np.cos(2 * np.pi * k / 101)
        centre = np.array([250 + 700 * np.sin(angle), -500 + 700 * np.cos(angle)])
        image = np.full((300, 500), 170.0, np.float32)
        cv2.circle(image, np.rint(centre * 64).astype(int).tolist(), 15 * 64, 60.0, -1, cv2.LINE_AA, 6)
        frames.append(np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8))
        angles.append(angle)
    scene.write_video(path, frames, 60)
    return np.array(angles)


@pytest.mark.thorough
def test_scale_pivot_and_path_of_a_drawn_pendulum(scene, tmp_path):
    angles = swing_film(scene, tmp_path / "v.mkv", 0.2)
    facts = inspect_video(tmp_path / "v.mkv")
    camera, _ = calibrate_arc(tmp_path / "v.mkv", facts, 0.7, TrackSettings())
    assert camera.source == "arc"
    assert camera.scale_m_per_px == pytest.approx(0.001, rel=0.01)
    tracked = pendulum(scene, tmp_path / "v.mkv", camera, 0.7, 4)
    tip = tracked.points_m[:, -1]
    expected = 0.7 * np.column_stack([np.sin(angles), -np.cos(angles)])
    assert np.abs(tip - expected).max() < 0.004
    assert np.isnan(tracked.points_m[:, 1:-1]).all()
    np.testing.assert_array_equal(tracked.points_m[:, 0], 0.0)
    assert (tracked.flags[:, 0] != 0).all()
    assert tracked.choices["period_s"] == pytest.approx(101 / 60, rel=1e-3)


@pytest.mark.thorough
def test_too_short_an_arc_is_refused(scene, tmp_path):
    swing_film(scene, tmp_path / "v.mkv", 0.015)
    with pytest.raises(StrandcastError) as caught:
        calibrate_arc(tmp_path / "v.mkv", inspect_video(tmp_path / "v.mkv"), 0.7, TrackSettings())
    assert caught.value.code == "SC-T004"


def test_pixels_that_are_not_square_are_refused(tmp_path):
    wide = tmp_path / "wide.mp4"
    with av.open(str(wide), "w") as container:
        stream = container.add_stream("libx264", rate=60)
        stream.width, stream.height, stream.pix_fmt = 160, 120, "yuv420p"
        stream.codec_context.sample_aspect_ratio = Fraction(4, 3)
        for _ in range(4):
            grey = av.VideoFrame.from_ndarray(np.zeros((120, 160), np.uint8), "gray")
            container.mux(stream.encode(grey.reformat(format="yuv420p")))
        container.mux(stream.encode())
    facts = inspect_video(wide)
    assert "not square, 1.333 times as wide as high" in facts.notes[0]
    with pytest.raises(StrandcastError, match="1.333 times as wide as high") as caught:
        calibrate_arc(wide, facts, 0.7, TrackSettings())
    assert caught.value.code == "SC-C012"
    assert "by 33%" in caught.value.cost


def test_a_lens_for_the_videos_pixels_is_accepted(scene):
    info = VideoInfo(Path("v.mp4"), 800, 600, "h264", "gray", 255, pixel_aspect=4 / 3)
    camera = scene.flat_camera()
    with pytest.raises(StrandcastError, match="fy / fx = 1") as caught:
        check_pixel_aspect(info, camera, info.path)
    assert caught.value.code == "SC-C012"
    camera.lens.matrix[1][1] *= 4 / 3
    check_pixel_aspect(info, camera, info.path)
    check_pixel_aspect(replace(info, pixel_aspect=496 / 495), scene.flat_camera(), info.path)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("length_m", "rate_hz", "fits"),
    [(0.3, 60.0, "0.70"), pytest.param(0.7, 120.0, "0.5 times", marks=pytest.mark.thorough)],
)
def test_a_period_that_contradicts_the_length_is_refused(scene, tmp_path, length_m, rate_hz, fits):
    swing_film(scene, tmp_path / "v.mkv", 0.2)
    facts = inspect_video(tmp_path / "v.mkv", rate_hz)
    with pytest.raises(StrandcastError, match=r"gravity would be \d+\.\d m/s") as caught:
        calibrate_arc(tmp_path / "v.mkv", facts, length_m, TrackSettings())
    assert caught.value.code == "SC-T004"
    assert fits in caught.value.cost
    camera, _ = calibrate_arc(tmp_path / "v.mkv", inspect_video(tmp_path / "v.mkv"), 0.7, TrackSettings())
    given = replace(scene.tracker_input(tmp_path / "v.mkv", length_m, 4, camera=camera), facts=facts)
    with pytest.raises(StrandcastError) as caught:
        track_pendulum(given, TrackSettings())
    assert caught.value.code == "SC-T004"


def test_noise_does_not_add_passages_and_less_than_a_period_is_not_checked():
    time_s = np.arange(0.0, 5.0, 1e-3)
    angle = 0.2 * np.cos(2 * np.pi * time_s / 1.68) + np.random.default_rng(0).normal(0.0, 2e-3, len(time_s))
    rising = np.count_nonzero((angle[:-1] < 0) & (angle[1:] >= 0))
    assert rising > 3
    assert period_s(time_s, angle) == pytest.approx(1.68, rel=2e-3)
    short = time_s < 1.0
    assert np.isnan(period_s(time_s[short], angle[short]))
    check_period(time_s[short], angle[short], 7.0, "v.mkv")


def test_places_on_a_line_determine_no_radius():
    assert fit_arc(np.array([[3.0, 1.0], [8.0, 2.0], [3.0, 1.0]])).radius_sigma_px == np.inf


def test_arc_of_exact_points():
    angle = np.linspace(1.2, 1.9, 40)
    places = np.column_stack([30 + 500 * np.cos(angle), -200 + 500 * np.sin(angle)])
    places[3] = np.nan
    arc = fit_arc(places)
    np.testing.assert_allclose(arc.centre_px, [30, -200], atol=1e-4)
    assert arc.radius_px == pytest.approx(500, abs=1e-4)


@pytest.mark.thorough
def test_period_of_a_real_pendulum(scene, real_data):
    path = real_data / "string_pendulum" / "rope_pendulum_0.62m_60fps.mp4"
    facts = inspect_video(path)
    camera, _ = calibrate_arc(path, facts, 0.62, TrackSettings())
    tracked = pendulum(scene, path, camera, 0.62, 20)
    assert tracked.decoded_frames == 1844
    periods = periods_s(tracked.camera_time_s, tracked.points_m[:, -1, 0])
    assert len(periods) >= 15
    assert periods.mean() == pytest.approx(1.600, abs=0.005)
    assert np.isfinite(tracked.points_m[:, -1, 0]).mean() > 0.85
    radius_m = np.linalg.norm(tracked.points_m[:, -1], axis=1)
    assert np.nanmean(radius_m) == pytest.approx(0.62, abs=0.002)
