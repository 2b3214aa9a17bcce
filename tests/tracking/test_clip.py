"""The film of a throw: which frames, which part of them, how many bytes."""

import base64
import io
from pathlib import Path

import av
import numpy as np
import pytest

from strandcast.camera.flat import flat_camera
from strandcast.records.clip import Clip
from strandcast.tracking import clip as clips
from strandcast.tracking.clip import (
    VideoFrames,
    even_size,
    make_clip,
    strip_frames,
    swept_box_px,
    throw_frames,
)
from strandcast.tracking.crops import SmallFrames
from strandcast.video.ingest import inspect_video
from strandcast.video.small import small_video

RATE_HZ, FRAMES = 100.0, 120


def still_then_moved() -> np.ndarray:
    """Return points (F, 2, 2): a hand that moves by 0.1 m from frame 20.5 to 60.5, a tip 0.2 m below it."""
    x_m = 0.1 * np.clip((np.arange(FRAMES) - 20.5) / 40, 0.0, 1.0)
    return np.stack([np.column_stack([x_m, np.full(FRAMES, y)]) for y in (0.5, 0.3)], axis=1)


def test_the_film_holds_the_motion_and_the_time_in_which_the_tip_may_still_hit(facts) -> None:
    first, last = throw_frames(still_then_moved(), facts)
    assert first == 23  # the first that is 5 mm away
    assert last == 58 + round(0.15 * (58 - 23)) + 30  # 15 % of the motion, and 0.3 s


def test_a_long_film_leaves_out_frames_evenly(frames, facts, camera, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clips, "MOST_FRAMES", 30)
    made = make_clip(frames, facts, still_then_moved(), camera, np.array([0.1, 0.3]))
    assert made["step"] == 3
    assert made["frames"] == len(numbers_in(made["mp4"])) == 24
    assert numbers_in(made["mp4"]) == list(range(23, 23 + 3 * 24, 3))


def test_every_frame_is_the_cameras_and_the_bytes_are_the_same_again(frames, facts, camera) -> None:
    made = make_clip(frames, facts, still_then_moved(), camera, np.array([0.1, 0.3]))
    assert numbers_in(made["mp4"]) == list(range(23, 23 + made["frames"]))
    kept = SmallFrames(facts.width_px, facts.height_px)
    for image in frames.pictures(range(FRAMES)):
        kept.keep(image)
    assert make_clip(kept, facts, still_then_moved(), camera, np.array([0.1, 0.3])) == made
    Clip(experiment="e", trial=1, **made)


def test_the_strip_holds_the_frame_nearest_to_the_target() -> None:
    points_m = still_then_moved()
    frames = strip_frames(points_m, np.arange(20, 90), np.array([0.0487, 0.3]))
    assert 40 in frames
    assert len(frames) <= 12
    unseen_m = np.where([[False], [True]], np.nan, points_m)
    assert {20, 89} <= strip_frames(unseen_m, np.arange(20, 90), np.array([0.0487, 0.3]))


def test_without_a_target_the_film_shows_what_the_string_sweeps(frames, facts, camera) -> None:
    track = still_then_moved()
    swept, aimed = (make_clip(frames, facts, track, camera, aim) for aim in (None, np.array([0.1, 0.3])))
    assert swept["frames"] == aimed["frames"]
    assert swept["box_px"] == aimed["box_px"]  # the tip ends at that target: the box needs nothing more
    assert len(swept["strip"]) <= 12
    instants = strip_frames(track, np.arange(20, 90), None)
    assert 23 in instants  # even along the tip's path, from its first place on
    assert len(instants) == 12


def test_a_tip_that_is_seen_after_the_motion_only_has_a_strip() -> None:
    points_m = still_then_moved()
    points_m[:70, 1] = np.nan
    assert {23, 93} <= strip_frames(points_m, np.arange(23, 94), np.array([0.1, 0.3]))


def test_a_large_film_is_kept_smaller_in_its_depth_and_its_box_is_in_the_cameras_pixels(scene) -> None:
    small = SmallFrames(2560, 1441)
    pictures = np.zeros((2, 1441, 2560), np.uint16)
    pictures[1, 600:660, 900:960] = 3000
    for picture in pictures:
        small.keep(picture)
    (kept,) = small.pictures([1])
    assert (small.factor, kept.shape) == (3, (480, 853))
    assert np.all(kept[200:220, 300:320] == 3000)
    assert np.count_nonzero(kept) == 400
    points_m = still_then_moved()
    alone, smaller = (swept_box_px(points_m, scene.flat_camera(), None, factor) for factor in (1, 3))
    assert np.abs(3 * np.array(smaller) - alone).max() <= 9


def test_a_box_stays_in_a_narrow_picture() -> None:
    points_m = np.full((2, 2, 2), [60.0, -30.0])
    assert swept_box_px(points_m, flat_camera(128, 64, 1.0, (0.0, 0.0)), None, 1) == (20, 0, 80, 64)


def test_sides_are_even_and_never_enlarged() -> None:
    assert even_size(1000, 501, 640) == (640, 320)
    assert even_size(301, 99, 640) == (300, 100)


def test_pure_noise_stays_within_its_bytes() -> None:
    random = np.random.default_rng(1)
    pictures = (random.integers(0, 256, (240, 320), dtype=np.uint8) for _ in range(200))
    made = small_video(pictures, width_px=320, height_px=240, count=200, rate_hz=25, most_bytes=300_000)
    assert len(made) < 330_000


def numbers_in(mp4: str) -> list[int]:
    """Return the numbers in the frames of a film: half their mean grey level, less 5."""
    with av.open(io.BytesIO(base64.b64decode(mp4))) as opened:
        return [round(frame.to_ndarray(format="gray").mean() / 2) - 5 for frame in opened.decode(video=0)]


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a video: frame k has the grey level 10 + 2 k."""
    path = tmp_path_factory.mktemp("film") / "video.mp4"
    pictures = (np.full((480, 640), 10 + 2 * k, np.uint8) for k in range(FRAMES))
    path.write_bytes(
        small_video(
            pictures, width_px=640, height_px=480, count=FRAMES, rate_hz=int(RATE_HZ), most_bytes=10**7
        )
    )
    return path


@pytest.fixture(scope="module")
def frames(film: Path, facts) -> VideoFrames:
    return VideoFrames(film, facts)


@pytest.fixture(scope="module")
def facts(film: Path):
    return inspect_video(film, RATE_HZ)


@pytest.fixture(scope="module")
def camera(scene):
    return scene.flat_camera()
