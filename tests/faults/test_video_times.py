"""Rows 13 to 17 of the fault list: wrong rates, frames dropped, frozen, or still to come."""

import threading
import time

import numpy as np
import pytest

from strandcast.core.objectives import PointObjective
from strandcast.errors import INTEGRITY, REFUSED, StrandcastError
from strandcast.records.alignment import Alignment
from strandcast.records.track import Track
from strandcast.scoring.score import Aim, score_throw
from strandcast.video.checks import unchanged
from strandcast.video.ingest import camera_times

from .conftest import RATE, Trial, noisy, write_film

TRUE_RATE = f"{{frame_rate_hz: {RATE}}}"


def test_row13_a_slow_motion_export_is_named_by_the_logs_duration(trial: Trial):
    write_film(trial.folder / "video.mp4", rate=30)
    trial.log(60 / RATE)
    found = trial.outcome()
    assert found.manifest is not None
    assert found.manifest.video.frame_rate_hz == pytest.approx(30, rel=1e-3)
    assert "slow-motion export" in found.printed
    assert "give the rate of filming in camera.frame_rate_hz" in found.printed


def test_row13_the_experiments_rate_settles_it(trial: Trial):
    write_film(trial.folder / "video.mp4", rate=30)
    trial.log(15 / RATE)
    trial.settings(TRUE_RATE)
    found = trial.outcome()
    assert found.manifest is not None
    facts = found.manifest.video
    assert facts.frame_rate_source == "experiment"
    np.testing.assert_allclose(camera_times(facts), np.arange(60) / RATE, atol=1e-9)
    assert "its time stamps give 30 frames/s, the experiment 500, which is used" in found.printed
    assert "slow-motion export, 16.7 times" in found.printed
    assert "give the rate of filming" not in found.printed


def test_row13_a_phones_own_word_is_passed_on(trial: Trial):
    import av

    with av.open(
        str(trial.folder / "video.mp4"), "w", options={"movflags": "use_metadata_tags"}
    ) as container:
        container.metadata["com.android.capture.fps"] = "240"
        stream = container.add_stream("mpeg4", rate=30)
        stream.width, stream.height, stream.pix_fmt = 160, 120, "yuv420p"
        for picture in noisy(10):
            container.mux(
                stream.encode(av.VideoFrame.from_ndarray(picture, "gray").reformat(format="yuv420p"))
            )
        container.mux(stream.encode())
    assert "its header says that it was filmed at 240 frames/s" in trial.outcome().printed


def test_row13_the_true_rate_is_reported_without_a_warning(trial: Trial):
    write_film(trial.folder / "video.mp4")
    trial.log(60 / RATE)
    trial.settings(TRUE_RATE)
    assert trial.outcome().warnings == []


def test_row14_a_conversion_to_a_lower_rate_is_refused(trial: Trial):
    """Of 400 frames at 500 per second, 96 were left, at 120 per second."""
    write_film(trial.folder / "video.mp4", pictures=noisy(96), rate=120)
    trial.log(0.8)
    trial.settings(TRUE_RATE)
    error = trial.outcome().refused("SC-V017")
    assert error.exit_code == INTEGRITY
    assert error.field == "camera.frame_rate_hz"
    assert "96 frames at 500 frames/s last 0.192" in error.message()
    assert "the motion took 0.8 s" in error.message()
    assert "the camera's original file" in error.message()


@pytest.mark.parametrize(("name", "codec"), [("video.mp4", "libx264"), ("video.mkv", "ffv1")])
def test_row15_dropped_frames_keep_the_true_times_of_the_others(trial: Trial, name, codec):
    stamps = [*range(20), *range(23, 41), *range(42, 64)]
    write_film(trial.folder / name, codec, "yuv420p", stamps=stamps)
    found = trial.outcome()
    assert found.manifest is not None
    facts = found.manifest.video
    assert [(gap.index, gap.missing) for gap in facts.gaps] == [(19, 3), (37, 1)]
    np.testing.assert_allclose(camera_times(facts), np.array(stamps) / RATE, atol=6e-4)
    assert "4 frames missing in 2 gaps, up to 0.0080 s" in found.printed


def test_row15_too_many_dropped_frames_are_refused(trial: Trial):
    stamps = np.flatnonzero(np.arange(100) % 10 < 6)
    write_film(trial.folder / "video.mp4", stamps=stamps.tolist())
    error = trial.outcome().refused("SC-V012")
    assert "36 of 96 frames are missing" in error.what


def test_row15_no_miss_is_reported_where_frames_were_dropped_at_the_closest_approach(trial: Trial):
    """The tip flies past the target in a straight line; the frames around that moment were dropped."""
    verdicts = []
    for gone in (range(0), range(26, 36)):
        stamps = [k for k in range(70) if k not in gone]
        write_film(trial.folder / "video.mp4", pictures=noisy(len(stamps)), stamps=stamps)
        manifest = trial.ingest()
        time_s = camera_times(manifest.video)
        tip = np.stack([time_s - 30.5 / RATE, np.full(len(time_s), 0.01)], axis=1)
        points = np.stack([tip - [0, 0.1], tip], axis=1)
        track = Track(
            np.arange(len(time_s)),
            time_s,
            points,
            np.full((len(time_s), 2), 1e-3),
            np.zeros((len(time_s), 2), int),
        )
        aligned = Alignment(
            experiment="film",
            trial=1,
            source="fit",
            offset_s=0.0,
            offset_se_s=1e-4,
            drift=0.0,
            drift_se=None,
            drift_prior=None,
            residual_rms_m=1e-3,
            frames=len(time_s),
            motion_start_s=0.0,
            motion_end_s=0.2,
        )
        target = (0.0, 0.0)
        aim = Aim("film", 1, PointObjective().aimed_at(target), target, 0.02)
        verdicts.append(score_throw(track, aligned, aim, 0.3))
    assert verdicts[0].miss_m == pytest.approx(0.01, abs=1e-6)
    assert verdicts[1].miss_m is None
    assert verdicts[1].reason


def test_row16_frozen_frames_are_flagged(trial: Trial):
    pictures = noisy(60)
    pictures[20:30] = [pictures[19]] * 10
    pictures[45] = pictures[44]
    write_film(trial.folder / "video.mkv", "ffv1", "gray", pictures)
    found = trial.outcome()
    assert found.error is None
    assert "frames 20 to 29 are copies of frame 19, bit by bit" in found.printed
    assert "frame 45 is a copy of frame 44" in found.printed
    assert found.printed.count("of frame") == 2


def test_row16_frames_that_are_only_alike_are_not(trial: Trial):
    """A still scene, and the least noise that there is: one pixel, one level."""
    still = noisy(1)[0]
    pictures = [still.copy() for _ in range(30)]
    for k, picture in enumerate(pictures):
        picture[0, k] += 1
    write_film(trial.folder / "video.mkv", "ffv1", "gray", pictures)
    assert trial.outcome().warnings == []


def test_row17_a_video_that_grows_is_refused(trial: Trial):
    """A camera copies its file, in pieces, while it is ingested."""
    whole = write_film(trial.root / "whole.avi", "rawvideo", "gray").read_bytes()
    path = trial.folder / "video.avi"
    path.write_bytes(whole[: len(whole) // 2])
    done = threading.Event()

    def copy() -> None:
        with path.open("ab") as file:
            for start in range(len(whole) // 2, len(whole), 1000):
                file.write(whole[start : start + 1000])
                file.flush()
                if done.wait(0.02):
                    return

    camera = threading.Thread(target=copy)
    camera.start()
    with pytest.raises(StrandcastError) as caught:
        trial.ingest()
    done.set()
    camera.join()
    assert caught.value.code == "SC-V022"
    assert caught.value.exit_code == REFUSED
    assert "still being written" in caught.value.what
    assert "wait until the camera" in (caught.value.fix or "")
    assert not (trial.root / "results").exists()
    path.write_bytes(whole)
    assert trial.outcome().error is None


def test_row17_a_file_at_rest_is_not_waited_for(trial: Trial, monkeypatch: pytest.MonkeyPatch):
    import os

    waits: list[float] = []
    monkeypatch.setattr(time, "sleep", waits.append)
    path = write_film(trial.folder / "video.mp4")
    os.utime(path, (0, time.time() - 60))
    with unchanged(path):
        pass
    assert waits == []
