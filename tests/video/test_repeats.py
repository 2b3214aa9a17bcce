"""Frames that a converter doubled and encoded again, in films of a moving bar."""

from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from strandcast.video.reader import open_video
from strandcast.video.repeats import repeat_warnings, repeated_frames

RATE_HZ = 240
OLD = 90  # frames of the original film


@pytest.fixture(scope="module")
def film() -> list[np.ndarray]:
    """A bar that rests, turns by 3 rad with a soft start and stop, and rests again; noise of 2 levels."""
    random = np.random.default_rng(0)
    frames = []
    for k in range(OLD):
        share = np.clip((k - 15) / 60, 0.0, 1.0)
        angle = 3.0 * share**2 * (3.0 - 2.0 * share)
        image = np.full((240, 320), 170, np.uint8)
        tip = np.array([160, 120]) + 100 * np.array([np.cos(angle), np.sin(angle)])
        cv2.line(image, (160, 120), tuple(np.rint(tip).astype(int).tolist()), 40, 3, cv2.LINE_AA)
        frames.append(np.clip(image + random.normal(0.0, 2.0, image.shape), 0, 255).astype(np.uint8))
    return frames


def encode(path: Path, frames: list[np.ndarray], crf: int = 23) -> None:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=RATE_HZ, options={"crf": str(crf)})
        stream.width, stream.height, stream.pix_fmt = 320, 240, "yuv420p"
        for frame in frames:
            picture = av.VideoFrame.from_ndarray(frame, "gray").reformat(format="yuv420p")
            container.mux(stream.encode(picture))
        container.mux(stream.encode())


def warnings_after(path: Path) -> tuple[list[int], list[str]]:
    with open_video(path) as video:
        for _ in video:
            pass
        return repeated_frames(video.changes), repeat_warnings(video.changes, video.copies)


@pytest.mark.parametrize("crf", [18, 30])
def test_a_film_without_repeats_gives_no_warning(film, tmp_path, crf):
    encode(tmp_path / "v.mp4", film, crf)
    repeated, warnings = warnings_after(tmp_path / "v.mp4")
    assert len(repeated) <= 2
    assert warnings == []


@pytest.mark.parametrize(("times", "crf"), [(2, 18), (2, 30), (3, 23)])
def test_doubled_and_encoded_frames_are_named(film, tmp_path, times, crf):
    encode(tmp_path / "v.mp4", [frame for frame in film for _ in range(times)], crf)
    repeated, [warning] = warnings_after(tmp_path / "v.mp4")
    assert len(repeated) > 0.7 * 50 * (times - 1)  # of 60 moving frames, the fastest 50
    assert np.mean([frame % times != 0 for frame in repeated]) > 0.95
    share = 100 // times
    assert any(f"about {each}% of the frame rate is real" in warning for each in range(share, share + 12))


def test_a_rest_between_two_motions_is_no_repeat():
    changes = [0.0, 30.0, 30.0, *[1.0] * 40, 30.0, 30.0, 1.0, 30.0]
    assert repeated_frames(changes) == [45]
    assert repeat_warnings(changes, []) == []
