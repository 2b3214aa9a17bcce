"""Rows 1 to 12, 25 and 26 of the fault list: a video missing, cut, damaged, or none at all."""

import hashlib
import os
from collections.abc import Callable
from dataclasses import dataclass

import av
import numpy as np
import pytest

from strandcast.errors import INTEGRITY, REFUSED, StrandcastError
from strandcast.tracking.preconditions import open_ingested
from strandcast.video.ingest import camera_times, inspect_video
from strandcast.video.reader import open_video
from strandcast.workflow.verify import verify

from .conftest import Trial, cut, damage, flipped, noisy, removed, write_film, zeroed

PREFIX = "{missing_policy: use_prefix}"


@dataclass(frozen=True)
class Fault:
    """A damaged film, and the error that it ends in."""

    row: int
    name: str
    make: Callable
    change: Callable
    code: str
    words: tuple[str, ...]


def h264(path):
    return write_film(path)


def h264_index_first(path):
    return write_film(path, faststart=True)


def mjpeg(path):
    return write_film(path, "mjpeg", "yuvj420p", full_range=True)


def raw(path):
    return write_film(path, "rawvideo", "gray")


def ffv1(path):
    return write_film(path, "ffv1", "gray", options={"slicecrc": "1", "level": "3"})


def vp9(path):
    return write_film(path, "libvpx-vp9", options={"lag-in-frames": "0", "cpu-used": "8"})


FAULTS = [
    Fault(2, "v.mp4", h264, cut(0), "SC-V005", ("video.mp4", "empty", "copy the file again")),
    Fault(3, "v.mp4", h264, lambda data: bytearray(b"hello"), "SC-V005", ("video.mp4", "not a video")),
    Fault(4, "v.mp4", h264, cut(0.99), "SC-V005", ("video.mp4", "copy the file again", "index at its end")),
    Fault(5, "v.mp4", h264_index_first, cut(0.5), "SC-V012", ("of the 60 that its header", PREFIX[1:-1])),
    Fault(5, "v.avi", mjpeg, cut(0.5), "SC-V012", ("of the 60", "use_prefix")),
    Fault(6, "v.mkv", ffv1, cut(0.5), "SC-V012", ("of the 60", "copy the file again")),
    Fault(8, "v.avi", raw, removed(0.5, 4096), "SC-V012", ("has 59 frames of the 60", "copy the file")),
    Fault(8, "v.avi", mjpeg, removed(0.5, 4096), "SC-V012", ("has 58 frames of the 60",)),
    Fault(11, "v.mp4", h264, zeroed(0.5, 1 << 16), "SC-V005", ("breaks off after", "copy the file again")),
    Fault(12, "v.webm", vp9, zeroed(0.5, 1 << 16), "SC-V012", ("of the 60", "copy the file again")),
]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: f"row{fault.row}-{fault.make.__name__}")
def test_a_damaged_video_is_refused(trial: Trial, fault: Fault):
    damage(fault.make(trial.folder / f"video{fault.name[1:]}"), fault.change)
    error = trial.outcome().refused(fault.code)
    assert str(trial.video.name) in (error.file or "")
    assert error.exit_code == INTEGRITY
    for words in fault.words:
        assert words in error.message()


@pytest.mark.parametrize("make", [h264, h264_index_first, mjpeg, raw, ffv1, vp9])
def test_the_same_videos_undamaged_are_taken(trial: Trial, make):
    suffix = {mjpeg: "avi", raw: "avi", ffv1: "mkv", vp9: "webm"}.get(make, "mp4")
    make(trial.folder / f"video.{suffix}")
    found = trial.outcome()
    assert found.error is None
    assert found.warnings == []
    assert len(found.frames) == 60


def test_the_second_part_of_a_film_is_named(trial: Trial):
    write_film(trial.folder / "video.mp4")
    write_film(trial.folder / "video-2.mp4")
    (warning,) = (text for text in trial.ingest().warnings if "video-2" in text)
    assert warning.startswith("video-2.mp4 not read, only video.mp4: join the parts")


def test_row1_a_missing_video_lists_what_is_there(trial: Trial):
    write_film(trial.folder / "vidoe.mp4")
    error = trial.outcome().refused("SC-V020")
    assert error.exit_code == REFUSED
    assert "trial-01" in error.message()
    assert "vidoe.mp4" in error.message()
    with pytest.raises(StrandcastError) as caught:
        inspect_video(trial.folder / "video.mp4")
    assert caught.value.code == "SC-V002"
    assert "vidoe.mp4" in (caught.value.fix or "")


@pytest.mark.parametrize(
    ("make", "suffix"), [(h264_index_first, "mp4"), (mjpeg, "avi"), (raw, "avi"), (ffv1, "mkv")]
)
def test_rows5_and_6_the_frames_before_a_cut_can_be_taken(trial: Trial, make, suffix):
    whole = make(trial.folder / f"video.{suffix}")
    with open_video(whole) as video:
        wanted = [grey.copy() for _, _, grey in video]
    damage(whole, cut(0.5))
    trial.settings(PREFIX)
    found = trial.outcome()
    assert found.error is None
    assert found.manifest is not None
    assert 10 <= len(found.frames) < 60
    assert not found.manifest.video.whole
    assert "of the 60" in found.printed
    for grey, true in zip(found.frames, wanted, strict=False):
        np.testing.assert_array_equal(grey, true)


def test_row7_a_frame_lost_in_an_avi_shifts_no_other(trial: Trial):
    path = raw(trial.folder / "video.avi")
    with open_video(path) as video:
        wanted = [grey.copy() for _, _, grey in video]
    damage(path, zeroed(0.5, 4096))
    found = trial.outcome()
    assert found.error is None
    assert found.manifest is not None
    facts = found.manifest.video
    assert len(found.frames) == facts.packets == 59
    (gap,) = facts.gaps
    assert gap.missing == 1
    assert "1 frames missing in 1 gaps" in found.printed
    frames = np.rint(camera_times(facts) * 500).astype(int)
    assert frames.tolist() == [*range(gap.index + 1), *range(gap.index + 2, 60)]
    clean = [k for k, frame in enumerate(frames) if np.array_equal(found.frames[k], wanted[frame])]
    assert len(clean) >= 58


def test_an_avi_with_a_hole_is_not_taken_as_the_frames_before_it(trial: Trial):
    damage(raw(trial.folder / "video.avi"), removed(0.5, 4096))
    trial.settings(PREFIX)
    trial.outcome().refused("SC-V012")


@pytest.mark.parametrize(("row", "make", "name"), [(9, h264, "video.mp4"), (10, raw, "video.avi")])
def test_rows9_and_10_flipped_bits_are_found_by_the_hash_at_recording(trial: Trial, row, make, name):
    path = make(trial.folder / name)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    (trial.folder / f"{name}.sha256").write_text(f"{digest}  {name}\n")
    assert trial.outcome().error is None
    damage(path, flipped(0.4, 0.9))
    error = trial.outcome().refused("SC-V005")
    assert error.exit_code == INTEGRITY
    assert name in error.message()
    assert "copy the file again" in error.message()


def test_a_hash_in_the_runs_record_counts_too(trial: Trial):
    path = raw(trial.folder / "video.avi")
    digest = hashlib.sha256(path.read_bytes()).hexdigest().upper()  # as Windows' Get-FileHash prints it
    trial.log(0.1, {"file": path.name, "sha256": digest})
    assert trial.outcome().error is None
    damage(path, flipped(0.4, 0.9))
    error = trial.outcome().refused("SC-V005")
    assert "run.json" in error.what


@pytest.mark.parametrize("make", [h264, raw])
def test_rows9_and_10_bits_flipped_after_ingest_are_found_before_tracking(trial: Trial, make):
    path = make(trial.folder / ("video.mp4" if make is h264 else "video.avi"))
    manifest = trial.ingest()
    damage(path, flipped(0.4, 0.9))
    with pytest.raises(StrandcastError) as caught, open_ingested(path, manifest.video):
        pass
    assert caught.value.code == "SC-V005"
    assert "manifest.json" in caught.value.what


def test_row67_a_video_replaced_by_an_older_one_of_its_size_is_found(trial: Trial):
    path = raw(trial.folder / "video.avi")
    manifest, made = trial.ingest(), path.stat()
    damage(path, lambda data: data[::-1])
    os.utime(path, (made.st_atime - 1e6, made.st_mtime - 1e6))
    assert path.stat().st_size == made.st_size
    with pytest.raises(StrandcastError, match="SC-V005"), open_ingested(path, manifest.video):
        pass
    (finding,) = verify(trial.root, "film")
    assert (finding.file, finding.state) == (path, "damaged")


@pytest.mark.parametrize(
    ("make", "name", "words"),
    [
        (h264, "video.mp4", "decoder: h264"),
        (ffv1, "video.mkv", "CRC mismatch"),
        (mjpeg, "video.avi", "decoder: mjpeg"),
    ],
)
def test_row9_without_a_hash_the_decoder_reports_flipped_bits(trial: Trial, make, name, words):
    damage(make(trial.folder / name), flipped(0.3, 0.9))
    found = trial.outcome()
    # A picture that one version of FFmpeg shows with a report, another version refuses.
    assert words in found.printed or found.refused("SC-V005").exit_code == INTEGRITY


def test_row26_sound_alone_is_refused(trial: Trial):
    with av.open(str(trial.folder / "video.mp4"), "w") as container:
        stream = container.add_stream("aac", rate=44100)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
        frame.rate = 44100
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    error = trial.outcome().refused("SC-V010")
    assert "no video stream" in error.what


@pytest.mark.skipif(
    "STRANDCAST_LARGE_FILES" not in os.environ, reason="writes 5 GB: set STRANDCAST_LARGE_FILES"
)
def test_row25_an_avi_beyond_4_gb_works_whole_and_cut_it_is_refused(trial: Trial):
    picture = noisy(1, (1600, 1200))[0]
    pictures = [np.roll(picture, k, axis=1) for k in range(50)] * 48
    path = write_film(trial.folder / "video.avi", "rawvideo", "gray", pictures)
    assert path.stat().st_size > 1 << 32
    facts = inspect_video(path)
    assert facts.packets == 2400
    with open_video(path) as video:
        for index, _, grey in video:
            assert np.array_equal(grey[0], pictures[index][0])
        assert index == 2399
    os.truncate(path, int(0.6 * path.stat().st_size))
    trial.outcome().refused("SC-V012")
