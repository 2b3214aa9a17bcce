"""Frames come in order, at full range, with the container's time stamps."""

from fractions import Fraction

import av
import numpy as np
import pytest

from strandcast.video.grey import expand
from strandcast.video.reader import open_video

from .here import frames_here

STEPS = np.repeat(np.array([0, 64, 128, 192, 255], np.uint8), 16)[None].repeat(48, axis=0)


def write(path, frames, pixel_format, codec="ffv1", stamps=None, full_range=False):
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=100)
        stream.height, stream.width, stream.pix_fmt = *frames[0].shape, pixel_format
        stream.codec_context.time_base = stream.time_base = Fraction(1, 1000)
        if full_range:
            stream.codec_context.color_range = 2
        for index, grey in enumerate(frames):
            picture = av.VideoFrame(grey.shape[1], grey.shape[0], pixel_format)
            depth = grey.itemsize
            rows = np.zeros((grey.shape[0], picture.planes[0].line_size // depth), grey.dtype)
            rows[:, : grey.shape[1]] = grey
            picture.planes[0].update(rows)
            for plane in list(picture.planes)[1:]:
                plane.update(bytes([128]) * plane.buffer_size)
            picture.pts = stamps[index] if stamps is not None else 10 * index
            picture.time_base = Fraction(1, 1000)
            if full_range:
                picture.color_range = 2
            container.mux(stream.encode(picture))
        container.mux(stream.encode())


def read(path):
    with open_video(path) as video:
        return [(index, time_s, grey.copy()) for index, time_s, grey in video], video


def test_limited_range_is_expanded(tmp_path):
    limited = np.rint(16 + STEPS * 219.0 / 255.0).astype(np.uint8)
    assert limited.min() == 16
    assert limited.max() == 235
    write(tmp_path / "v.mkv", [limited] * 2, "yuv420p")
    frames, _ = read(tmp_path / "v.mkv")
    assert np.abs(frames[1][2].astype(int) - STEPS).max() <= 1
    assert frames[0][2].min() == 0
    assert frames[0][2].max() == 255


@pytest.mark.parametrize(("pixel_format", "full_range"), [("yuv420p", True), ("gray", False)])
def test_full_range_is_unchanged(tmp_path, pixel_format, full_range):
    write(tmp_path / "v.mkv", [STEPS] * 2, pixel_format, full_range=full_range)
    frames, _ = read(tmp_path / "v.mkv")
    np.testing.assert_array_equal(frames[0][2], STEPS)


def test_sixteen_bits_are_kept(tmp_path):
    deep = (np.arange(48 * 80).reshape(48, 80) * 17).astype(np.uint16)
    write(tmp_path / "v.mkv", [deep], "gray16le")
    frames, video = read(tmp_path / "v.mkv")
    assert frames[0][2].dtype == np.uint16
    assert video.info.max_level == 65535
    np.testing.assert_array_equal(frames[0][2], deep)


def test_times_are_the_containers_not_the_nominal_rates(tmp_path):
    stamps = [0, 10, 20, 45, 50]
    write(tmp_path / "v.mkv", [STEPS] * 5, "gray", stamps=stamps)
    frames, _ = read(tmp_path / "v.mkv")
    assert [index for index, _, _ in frames] == [0, 1, 2, 3, 4]
    np.testing.assert_allclose([time_s for _, time_s, _ in frames], np.array(stamps) / 1000, atol=1e-9)


def test_damage_is_reported(tmp_path):
    rng = np.random.default_rng(0)
    noisy = [rng.integers(0, 255, (240, 320)).astype(np.uint8) for _ in range(30)]
    write(tmp_path / "v.mp4", noisy, "yuv420p", codec="libx264")
    data = bytearray((tmp_path / "v.mp4").read_bytes())
    for place in rng.integers(len(data) // 3, len(data), 50):
        data[place] ^= 1 << int(rng.integers(8))
    (tmp_path / "bad.mp4").write_bytes(data)
    whole, clean = read(tmp_path / "v.mp4")
    assert len(whole) == 30
    assert clean.messages == []
    _, damaged = read(tmp_path / "bad.mp4")
    assert any("h264" in message for message in damaged.messages)


@pytest.mark.parametrize(
    ("codec", "pixels", "suffix"),
    [
        ("libx264", "yuv420p", "mp4"),
        ("libx264", "yuv420p", "mkv"),
        ("libx265", "yuv420p", "mp4"),
        ("mjpeg", "yuvj420p", "avi"),
        ("mjpeg", "yuvj422p", "mov"),
        ("mpeg4", "yuv420p", "avi"),
        ("ffv1", "gray", "mkv"),
        ("rawvideo", "gray", "avi"),
        ("rawvideo", "bgr24", "avi"),
        ("libvpx-vp9", "yuv420p", "webm"),
        ("prores_ks", "yuv422p10le", "mov"),
    ],
)
def test_each_codec_in_its_container_gives_ffmpegs_own_pictures(tmp_path, codec, pixels, suffix):
    """Compare with FFmpeg's scaler, which rounds grey of limited range by one level at most."""
    path = tmp_path / f"v.{suffix}"
    rng = np.random.default_rng(0)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=100)
        stream.width, stream.height, stream.pix_fmt = 161, 121, pixels
        if "420" in pixels or "422" in pixels:
            stream.width, stream.height = 162, 122
        for _ in range(8):
            grey = rng.integers(30, 220, (stream.height, stream.width)).astype(np.uint8)
            picture = av.VideoFrame.from_ndarray(grey, "gray").reformat(format=pixels, threads=1)
            container.mux(stream.encode(picture))
        container.mux(stream.encode())
    deep = "gray16le" if "10le" in pixels else "gray"
    with av.open(str(path)) as container:
        decoded = container.decode(video=0)
        true = [frame.reformat(format=deep, threads=1).to_ndarray() for frame in decoded]
    frames, video = read(path)
    assert len(frames) == 8
    assert video.info.max_level == (65535 if "10le" in pixels else 255)
    for (_, _, grey), wanted in zip(frames, true, strict=True):
        assert np.abs(grey.astype(int) - wanted).max() <= 1


def test_limited_range_is_expanded_as_exact_arithmetic_would(tmp_path):
    levels = np.arange(256, dtype=np.uint8)
    wanted = [min(255, max(0, round((int(level) - 16) * 255 / 219))) for level in levels]
    for width in (256, 7, 33):  # with and without what is left over by vector instructions
        picture = np.resize(levels, (40, width))
        np.testing.assert_array_equal(expand(picture, None), np.array(wanted)[picture])
        out = np.empty_like(picture)
        assert expand(picture, out) is out or np.shares_memory(expand(picture, out), out)
        np.testing.assert_array_equal(out, np.array(wanted)[picture])


def test_every_reading_gives_the_same_pixels(tmp_path):
    """With several threads, FFmpeg's scaler sometimes changes eight pixels in widths such as 162."""
    rng = np.random.default_rng(0)
    frames = [rng.integers(64, 940, (122, 162)).astype(np.uint16) for _ in range(8)]
    write(tmp_path / "v.mkv", frames, "yuv422p10le")
    wanted = np.clip(np.rint((np.array(frames) - 64.0) * 65535 / 876), 0, 65535)
    for _ in range(6):
        found = np.stack([grey for _, grey in frames_here(tmp_path / "v.mkv")])
        assert np.abs(found - wanted).max() <= 1
