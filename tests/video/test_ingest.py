"""The facts of a container, and one clear error for any file that is not a video."""

import hashlib
from fractions import Fraction

import av
import numpy as np
import pytest

from strandcast.errors import StrandcastError
from strandcast.video.checks import slow_rate_warning, warnings_of
from strandcast.video.ingest import camera_times, inspect_video
from strandcast.video.reader import open_video


def write(path, stamps, faststart=False, codec="libx264", base_s=Fraction(1, 500)):
    rng = np.random.default_rng(1)
    with av.open(str(path), "w", options={"movflags": "faststart"} if faststart else {}) as container:
        stream = container.add_stream(codec, rate=500)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.codec_context.time_base = base_s
        for stamp in stamps:
            picture = av.VideoFrame.from_ndarray(rng.integers(0, 255, (48, 64)).astype(np.uint8), "gray")
            picture = picture.reformat(format="yuv420p")
            picture.pts, picture.time_base = stamp, base_s
            container.mux(stream.encode(picture))
        container.mux(stream.encode())


def rounded(rate_hz, base_s, frames):
    return [round(frame / (rate_hz * base_s)) for frame in frames]


def refusal(path) -> StrandcastError:
    with pytest.raises(StrandcastError) as caught:
        inspect_video(path)
    return caught.value


def test_facts_of_a_complete_video(tmp_path):
    path = tmp_path / "v.mp4"
    write(path, range(60))
    facts = inspect_video(path)
    assert facts.packets == facts.header_frames == 60
    assert (facts.width_px, facts.height_px) == (64, 48)
    assert (facts.codec, facts.pixel_format) == ("h264", "yuv420p")
    assert facts.frame_rate_hz == pytest.approx(500.0, rel=1e-6)
    assert facts.gaps == []
    assert facts.duplicates == 0
    assert facts.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    np.testing.assert_allclose(camera_times(facts), np.arange(60) / 500, atol=1e-9)


def test_dropped_frames_are_gaps_and_do_not_change_the_rate(tmp_path):
    write(tmp_path / "v.mp4", [*range(20), *range(23, 40), *range(41, 60)])
    facts = inspect_video(tmp_path / "v.mp4")
    assert [(gap.index, gap.missing) for gap in facts.gaps] == [(19, 3), (36, 1)]
    assert facts.gaps[0].duration_s == pytest.approx(4 / 500)
    assert facts.frame_rate_hz == pytest.approx(500.0, rel=1e-6)
    assert camera_times(facts)[20] == pytest.approx(23 / 500)


def test_coarse_time_stamps_give_the_exact_rate(tmp_path):
    stamps = [round(16384 * k / 500) for k in range(126)]  # 32 or 33 steps apart: 496 or 512 frames/s
    write(tmp_path / "v.mp4", stamps, codec="mpeg4", base_s=Fraction(1, 16384))
    assert inspect_video(tmp_path / "v.mp4").frame_rate_hz == pytest.approx(500.0, abs=0.1)


@pytest.mark.parametrize(
    ("rate_hz", "frames", "base_s", "suffix"),
    [
        (240, 120, Fraction(1, 600), "mov"),
        (Fraction(240_000, 1001), 600, Fraction(1, 600), "mov"),
        (400, 120, Fraction(1, 600), "mov"),
        (500, 200, Fraction(1, 600), "mov"),  # one step of six is of two units: none is missing
        (560, 200, Fraction(1, 600), "mov"),
        (240, 120, Fraction(1, 1000), "mkv"),
        (400, 120, Fraction(1, 1000), "mkv"),
        (750, 120, Fraction(1, 1000), "mkv"),
        (239.89, 480, Fraction(1, 2400), "mov"),
    ],
)
def test_rounded_time_stamps_give_the_even_clock(tmp_path, rate_hz, frames, base_s, suffix):
    path = tmp_path / f"v.{suffix}"
    write(path, rounded(rate_hz, base_s, range(frames)), base_s=base_s)
    facts = inspect_video(path)
    np.testing.assert_allclose(
        camera_times(facts), np.arange(frames) / float(rate_hz), atol=1e-6 if rate_hz != 239.89 else 1e-4
    )
    assert facts.rounded_to_s == pytest.approx(float(base_s))
    assert facts.gaps == []
    assert not any("as they are" in note for note in facts.notes)


@pytest.mark.parametrize("frames", [120, 121])
@pytest.mark.parametrize(("base_s", "suffix"), [(Fraction(1, 1000), "mkv"), (Fraction(1, 15360), "mp4")])
def test_a_copy_in_another_format_rounds_the_stamps_again(tmp_path, base_s, suffix, frames):
    """A phone's film of 1/600 s after `ffmpeg -c copy`: steps of 3 and 5 ms, or of 51 and 77 ticks."""
    path = tmp_path / f"v.{suffix}"
    seen = [*range(60), *range(62, frames)]
    write(path, [round(each / 600 / base_s) for each in rounded(240, Fraction(1, 600), seen)], base_s=base_s)
    facts = inspect_video(path)
    np.testing.assert_allclose(camera_times(facts), np.array(seen) / 240, atol=1e-6)
    assert facts.rounded_to_s == pytest.approx(1 / 600)
    assert [(gap.index, gap.missing) for gap in facts.gaps] == [(59, 2)]


def test_a_missing_frame_is_found_in_rounded_time_stamps(tmp_path):
    frames = [*range(50), *range(52, 120)]
    write(tmp_path / "v.mov", rounded(240, Fraction(1, 600), frames), base_s=Fraction(1, 600))
    facts = inspect_video(tmp_path / "v.mov")
    assert [(gap.index, gap.missing) for gap in facts.gaps] == [(49, 2)]
    np.testing.assert_allclose(camera_times(facts), np.array(frames) / 240, atol=1e-6)


@pytest.mark.parametrize("steps", [[1024] * 30 + [512] + [1024] * 29, [1024, 1536, 2048, 1536] * 15])
def test_frames_at_other_times_are_no_rounding(tmp_path, steps):
    """They differ by no more than the largest unit that divides all stamps, but not as rounding does."""
    stamps = [0, *np.cumsum(steps).tolist()]
    write(tmp_path / "v.mp4", stamps, base_s=Fraction(1, 30_720))
    facts = inspect_video(tmp_path / "v.mp4")
    assert facts.rounded_to_s is None
    np.testing.assert_allclose(camera_times(facts), np.array(stamps) / 30_720, atol=1e-9)


def test_uneven_time_stamps_are_used_as_they_are_and_named(tmp_path):
    """A phone at 60 frames/s: 16.1 to 17.2 ms from frame to frame, and one stands three times as long."""
    steps = np.random.default_rng(2).integers(1450, 1549, 60)
    steps[30] = 4500
    stamps = [0, *np.cumsum(steps).tolist()]
    write(tmp_path / "v.mp4", stamps, base_s=Fraction(1, 90_000))
    facts = inspect_video(tmp_path / "v.mp4")
    np.testing.assert_allclose(camera_times(facts), np.array(stamps) / 90_000, atol=1e-9)
    assert facts.rounded_to_s is None
    assert [(gap.index, gap.missing) for gap in facts.gaps] == [(30, 2)]
    low, high = (f"{step / 90:.4g}" for step in (steps.min(), steps[steps < 4500].max()))
    assert any(f"follow each other at {low} to {high} ms" in note for note in facts.notes)


def test_packets_without_a_picture_leave_each_frame_its_time(tmp_path):
    """As action cameras mark lost frames: four bytes, a length of nothing."""
    write(tmp_path / "whole.mp4", range(40))
    empty = {10, 11, 25}
    with av.open(str(tmp_path / "whole.mp4")) as whole, av.open(str(tmp_path / "v.mp4"), "w") as container:
        stream = container.add_stream_from_template(whole.streams.video[0])
        for packet in whole.demux(video=0):
            if packet.size:
                lost = av.Packet(bytes(4)) if round(packet.pts * packet.time_base * 500) in empty else packet
                lost.pts, lost.dts, lost.time_base = packet.pts, packet.dts, packet.time_base
                lost.stream, lost.is_keyframe = stream, packet.is_keyframe
                container.mux(lost)
    facts = inspect_video(tmp_path / "v.mp4")
    assert (facts.packets, facts.discarded_packets) == (37, 3)
    with open_video(tmp_path / "v.mp4") as video:
        shown_s = [time_s for _, time_s, _ in video]
    np.testing.assert_allclose(shown_s, camera_times(facts), atol=1e-6)


@pytest.mark.parametrize("suffix", ["mkv", "mp4"])
def test_a_film_that_begins_later_than_0_is_whole(tmp_path, suffix):
    write(tmp_path / f"v.{suffix}", range(500, 560))
    facts = inspect_video(tmp_path / f"v.{suffix}")
    assert facts.whole
    np.testing.assert_allclose(camera_times(facts), np.arange(60) / 500, atol=1e-6)


def test_frames_that_an_avi_of_h264_left_out_are_missing_at_their_places(tmp_path):
    kept = [k for k in range(120) if k not in (50, 51, 80)]
    with av.open(str(tmp_path / "v.avi"), "w") as container:
        stream = container.add_stream("libx264", rate=240, options={"bf": "0"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for k in kept:
            picture = av.VideoFrame.from_ndarray(np.full((48, 64), k, np.uint8), "gray")
            picture = picture.reformat(format="yuv420p")
            picture.pts, picture.time_base = k, Fraction(1, 240)
            container.mux(stream.encode(picture))
        container.mux(stream.encode())
    facts = inspect_video(tmp_path / "v.avi")
    np.testing.assert_allclose(camera_times(facts), np.array(kept) / 240)
    assert [(gap.index, gap.missing) for gap in facts.gaps] == [(49, 2), (77, 1)]


def test_the_stream_that_is_read_is_named(tmp_path):
    with av.open(str(tmp_path / "v.mkv"), "w") as container:
        streams = [container.add_stream("ffv1", rate=240) for _ in range(2)]
        for stream, width in zip(streams, (64, 32), strict=True):
            stream.width, stream.height, stream.pix_fmt = width, 48, "gray"
        for k in range(10):
            for stream in streams:
                picture = av.VideoFrame.from_ndarray(np.full((48, stream.width), k, np.uint8), "gray")
                picture.pts = k
                container.mux(stream.encode(picture))
        for stream in streams:
            container.mux(stream.encode())
    notes = inspect_video(tmp_path / "v.mkv").notes
    assert "it contains 2 video streams: stream 0 (64 x 48, 10 frames) is used" in notes


def test_super_slow_motion_needs_a_stated_rate(tmp_path):
    write(tmp_path / "v.mp4", range(30))
    with (tmp_path / "v.mp4").open("ab") as file:
        file.write(b"SuperSlowMotion_Data" + bytes(40) + b"SEFT")
    error = refusal(tmp_path / "v.mp4")
    assert error.code == "SC-V017"
    assert "super slow motion" in error.what
    assert inspect_video(tmp_path / "v.mp4", frame_rate_hz=960.0).frame_rate_hz == 960.0


def test_the_experiments_rate_wins_over_a_slow_motion_export(tmp_path):
    write(tmp_path / "v.mp4", range(30))
    facts = inspect_video(tmp_path / "v.mp4", frame_rate_hz=1000.0)
    assert facts.frame_rate_source == "experiment"
    assert camera_times(facts)[10] == pytest.approx(0.010)


def test_a_low_rate_asks_for_the_rate_of_filming(tmp_path):
    write(tmp_path / "v.mp4", range(0, 500, 17))  # 29.4 frames/s
    warning = warnings_of(inspect_video(tmp_path / "v.mp4"), None)[-1]
    assert "v.mp4 states 29.4118 frames/s; a throw needs 240 or more" in warning
    assert "camera.frame_rate_hz" in warning
    assert slow_rate_warning(inspect_video(tmp_path / "v.mp4", frame_rate_hz=30.0)) == []
    write(tmp_path / "fast.mp4", range(0, 60, 2))  # 250 frames/s
    assert slow_rate_warning(inspect_video(tmp_path / "fast.mp4")) == []


def test_missing_video_lists_similar_names(tmp_path):
    (tmp_path / "video.avi").write_bytes(b"x")
    error = refusal(tmp_path / "vidoe.avi")
    assert error.code == "SC-V002"
    assert "video.avi" in (error.fix or "")


@pytest.mark.parametrize("path", ["http://host/v.mp4", "concat:a.mp4|b.mp4", "rtsp://camera/1"])
def test_addresses_are_refused(path):
    assert refusal(path).code == "SC-V002"


def test_patterns_are_refused(tmp_path):
    (tmp_path / "trial_001.png").write_bytes(b"x")
    error = refusal(tmp_path / "trial_%03d.png")
    assert error.code == "SC-V002"
    assert "patterns" in error.what


def test_folders_are_refused(tmp_path):
    assert refusal(tmp_path).code == "SC-V002"


def test_empty_file_is_refused(tmp_path):
    (tmp_path / "v.mp4").write_bytes(b"")
    assert refusal(tmp_path / "v.mp4").code == "SC-V005"


@pytest.mark.parametrize(
    "text", ["hello", "#EXTM3U\n#EXTINF:1,\nother.mp4\n", "ffconcat version 1.0\nfile other.mp4\n"]
)
@pytest.mark.parametrize("suffix", [".mp4", ".avi"])
def test_text_named_as_video_is_refused(tmp_path, text, suffix):
    (tmp_path / f"v{suffix}").write_text(text)
    assert refusal(tmp_path / f"v{suffix}").code == "SC-V005"


def test_sound_alone_is_refused(tmp_path):
    with av.open(str(tmp_path / "v.mp4"), "w") as container:
        stream = container.add_stream("aac", rate=44100)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
        frame.rate = 44100
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    assert refusal(tmp_path / "v.mp4").code == "SC-V010"


def test_a_cut_file_is_refused(tmp_path):
    write(tmp_path / "index-last.mp4", range(60))
    write(tmp_path / "index-first.mp4", range(60), faststart=True)
    write(tmp_path / "v.mkv", range(60), codec="ffv1")
    for name, code in (("index-last.mp4", "SC-V005"), ("index-first.mp4", "SC-V012"), ("v.mkv", "SC-V012")):
        whole = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(whole[: len(whole) // 2])
        assert refusal(tmp_path / name).code == code


def test_real_video_whose_edit_list_hides_frames(real_data):
    facts = inspect_video(real_data / "string_pendulum" / "rope_pendulum_0.62m_60fps.mp4")
    assert facts.header_frames == 2057
    assert facts.packets == 1844
    assert facts.frame_rate_hz == pytest.approx(60.0, abs=0.05)


@pytest.mark.parametrize("name", ["iphone240_tb600.mov", "obs240.mkv"])
def test_halves_that_are_rounded_up_and_down_are_an_even_clock(real_data, name):
    facts = inspect_video(real_data / "made" / name)
    np.testing.assert_allclose(camera_times(facts), np.arange(facts.packets) / 240.0, atol=1e-9)
    assert facts.rounded_to_s is not None
