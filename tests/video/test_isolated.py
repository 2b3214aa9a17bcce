"""Decoding in a separate process gives the same frames, and its failures become single clear errors."""

import gc
import os
import signal
import subprocess
import sys
import time
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import psutil
import pytest

from strandcast.errors import StrandcastError
from strandcast.video import isolated
from strandcast.video.reader import open_video

from .here import frames_here

COUNT = 80


def write(
    path: Path,
    codec: str = "libx264",
    pixels: str = "yuv420p",
    size: tuple[int, int] = (160, 120),
    count: int = COUNT,
) -> Path:
    rng = np.random.default_rng(1)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=500)
        stream.width, stream.height, stream.pix_fmt = *size, pixels
        stream.codec_context.time_base = Fraction(1, 500)
        for stamp in range(count):
            grey = rng.integers(0, 255, size[::-1]).astype(np.uint8)
            picture = av.VideoFrame.from_ndarray(grey, "gray").reformat(format=pixels)
            picture.pts, picture.time_base = stamp, Fraction(1, 500)
            container.mux(stream.encode(picture))
        container.mux(stream.encode())
    return path


@pytest.fixture(scope="module")
def film(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("film") / "v.mp4")


def children() -> list[psutil.Process]:
    return [
        one
        for one in psutil.Process().children(recursive=True)
        if "strandcast.video" in " ".join(one.cmdline())
    ]


def shared_memory() -> list[str]:
    """Return the paths of the decoders' rings that this process maps."""
    return [
        one.path for one in psutil.Process().memory_maps(grouped=False) if "strandcast-frames" in one.path
    ]


def open_files() -> int:
    return psutil.Process().num_fds()


@pytest.mark.parametrize(
    ("codec", "pixels", "suffix"),
    [
        ("libx264", "yuv420p", "mp4"),
        ("mjpeg", "yuvj420p", "avi"),
        ("ffv1", "gray16le", "mkv"),
        ("ffv1", "bgr0", "mkv"),
    ],
)
@pytest.mark.parametrize("threads", [1, pytest.param(0, marks=pytest.mark.thorough)])
def test_the_frames_are_those_of_this_process(tmp_path, codec, pixels, suffix, threads):
    path = write(tmp_path / f"v.{suffix}", codec, pixels)
    wanted = frames_here(path)
    with open_video(path, threads=threads) as there:
        for index, time_s, grey in there:
            assert time_s == wanted[index][0]
            assert grey.dtype == wanted[index][1].dtype
            np.testing.assert_array_equal(grey, wanted[index][1])
    assert index == COUNT - 1


@pytest.mark.parametrize("frames", [1, 10, COUNT])
def test_the_first_frames_are_those_of_the_complete_video(film, frames):
    """H.264 decodes some frames before others that are shown earlier."""
    with open_video(film) as video:
        wanted = [(index, time_s, grey.copy()) for index, time_s, grey in video][:frames]
    with open_video(film, frames=frames) as video:
        found = [(index, time_s, grey.copy()) for index, time_s, grey in video]
    assert [one[:2] for one in found] == [one[:2] for one in wanted]
    np.testing.assert_array_equal([one[2] for one in found], [one[2] for one in wanted])


def test_a_frame_stays_valid_until_the_next_is_taken(film):
    with open_video(film) as video:
        wanted = [grey.copy() for _, _, grey in video]
    with open_video(film) as video:
        for index, _, grey in video:
            time.sleep(0.001)  # for the decoder to get as far ahead as it may
            np.testing.assert_array_equal(grey, wanted[index])
    assert index == COUNT - 1


def test_an_image_outlives_its_video(film):
    with open_video(film) as video:
        _, _, grey = next(iter(video))
    gc.collect()
    assert grey.sum() > 0


def test_nothing_is_left_behind(film):
    before, others = open_files(), shared_memory()  # pytest keeps what a failed test held
    for stop in (None, 3):
        with open_video(film) as video:
            for seen, _, grey in video:  # noqa: B007
                if seen == stop:
                    break
            assert len(children()) == 1
        assert children() == []
    with pytest.raises(KeyboardInterrupt), open_video(film) as video:
        for _, _, grey in video:  # noqa: B007
            raise KeyboardInterrupt
    assert len(shared_memory()) == len(others) + 1
    del video, grey
    gc.collect()
    assert children() == []
    assert open_files() == before
    assert shared_memory() == others


def test_an_interrupt_from_the_keyboard_reaches_this_process_only(film):
    with open_video(film) as video:
        frames = iter(video)
        next(frames)
        (process,) = children()
        assert os.getpgid(process.pid) != os.getpgid(0)
        assert sum(1 for _ in frames) == COUNT - 1


def test_the_decoder_ends_if_its_parent_is_killed(film):
    """A killed process cannot clean up: the decoder notices the closed pipe."""
    program = (
        "import os, sys\nimport psutil\nfrom strandcast.video.reader import open_video\n"
        f"with open_video({str(film)!r}) as video:\n"
        "    next(iter(video))\n    print(psutil.Process().children()[0].pid, flush=True)\n"
        "    sys.stdin.read()\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert parent.stdout is not None
    decoder = psutil.Process(int(parent.stdout.readline()))
    parent.kill()
    parent.wait()
    gone, _ = psutil.wait_procs([decoder], timeout=20)
    assert gone or decoder.status() == psutil.STATUS_ZOMBIE


@pytest.mark.parametrize("number", [signal.SIGSEGV, signal.SIGKILL, signal.SIGXCPU])
def test_a_crash_is_one_clear_error(film, number):
    with pytest.raises(StrandcastError) as caught, open_video(film) as video:
        for index, _, _ in video:
            if index == 5:
                os.kill(children()[0].pid, number)
    codes = {signal.SIGSEGV: "SC-V005", signal.SIGKILL: "SC-W004", signal.SIGXCPU: "SC-V005"}
    assert caught.value.code == codes[number]
    assert caught.value.file == str(film)
    assert "frames" in caught.value.what
    assert children() == []


def test_a_hanging_decoder_is_killed(film, monkeypatch):
    monkeypatch.setattr(isolated, "STALL_S", 0.5)
    with pytest.raises(StrandcastError) as caught, open_video(film) as video:
        for index, _, _ in video:
            if index == 5:
                os.kill(children()[0].pid, signal.SIGSTOP)
    assert caught.value.code == "SC-V005"
    assert "no frame for 0.5 s" in caught.value.what
    assert children() == []


@pytest.mark.skipif(sys.platform == "darwin", reason="macOS does not limit a process's memory")
def test_memory_is_limited(tmp_path, monkeypatch):
    path = write(tmp_path / "v.avi", "mjpeg", "yuvj420p", (5000, 4000), 2)
    monkeypatch.setattr(isolated, "MEMORY_BYTES", 160 << 20)
    with pytest.raises(StrandcastError) as caught, open_video(path) as video:
        for _ in video:
            pass
    assert caught.value.code == "SC-V005"
    assert "GiB of memory" in caught.value.what


@pytest.mark.parametrize("width", [128, 130])  # without and with gaps between the decoder's rows
def test_full_range_frames_are_those_of_this_process(tmp_path, width):
    path = write(tmp_path / "v.avi", "mjpeg", "yuvj420p", (width, 96), 6)
    expected = [grey for _, grey in frames_here(path)]
    with open_video(path) as video:
        np.testing.assert_array_equal([grey.copy() for _, _, grey in video], expected)


def test_the_decoding_process_starts_without_heavy_modules(tmp_path):
    modules = "strandcast.video.decoding_process, strandcast.video.container, sys"
    heavy = "{'numpy', 'cv2', 'numba', 'importlib.metadata'}"
    done = subprocess.run(
        [sys.executable, "-c", f"import {modules}; print({heavy} & set(sys.modules))"],
        capture_output=True,
        text=True,
        env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
    )
    assert done.stdout.strip() == "set()", done.stderr


def test_cpu_time_without_a_frame_is_limited(film, monkeypatch, tmp_path):
    endless = tmp_path / "endless.py"
    endless.write_text(
        "import json, sys\nfrom strandcast.video import decoding_process\n"
        "decoding_process._limit_cpu(json.loads(sys.argv[1])['cpu_s'])\nwhile True: pass\n"
    )
    monkeypatch.setattr("strandcast.video.isolated.COMMAND", [sys.executable, str(endless)])
    monkeypatch.setattr(isolated, "CPU_S", 1)
    with pytest.raises(StrandcastError) as caught, open_video(film) as video:
        next(iter(video))
    assert caught.value.code == "SC-V005"
    assert "CPU time" in caught.value.what


def test_a_decoder_that_cannot_run_reports_the_reason(film, monkeypatch):
    monkeypatch.setattr(
        "strandcast.video.isolated.COMMAND", [sys.executable, "-c", "raise SystemExit('no such library')"]
    )
    with pytest.raises(StrandcastError) as caught, open_video(film) as video:
        next(iter(video))
    assert caught.value.code == "SC-W004"
    assert "no such library" in caught.value.what


def test_no_module_is_imported_from_the_working_folder(film, tmp_path, monkeypatch):
    (tmp_path / "av.py").write_text("raise SystemExit('taken')\n")
    monkeypatch.chdir(tmp_path)
    with open_video(film) as video:
        assert sum(1 for _ in video) == COUNT


def test_errors_of_the_file_are_passed_on_completely(tmp_path):
    (tmp_path / "v.mp4").write_bytes(b"hello")
    with pytest.raises(StrandcastError) as here:
        frames_here(tmp_path / "v.mp4")
    with pytest.raises(StrandcastError) as there, open_video(tmp_path / "v.mp4"):
        pass
    assert there.value.message() == here.value.message()
    assert there.value.exit_code == here.value.exit_code
