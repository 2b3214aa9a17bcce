"""Rows 22 to 24 and 27 of the fault list: files that ask for too much or for others; decoders that fail."""

import os
import struct
import sys

import av
import numpy as np
import pytest

from strandcast.errors import REFUSED, StrandcastError
from strandcast.video.ingest import inspect_video
from strandcast.video.reader import open_video

from .conftest import Trial, cut, damage, noisy, write_film


def refusal(path, **arguments) -> StrandcastError:
    with pytest.raises(StrandcastError) as caught, open_video(path, **arguments) as video:
        for _ in video:
            pass
    return caught.value


@pytest.mark.thorough
def test_row22_a_decode_bomb_is_refused_before_it_is_decoded(trial: Trial):
    path = trial.folder / "video.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=500)
        stream.width, stream.height, stream.pix_fmt = 16000, 8000, "gray"
        empty = np.zeros((8000, 16000), np.uint8)
        container.mux(stream.encode(av.VideoFrame.from_ndarray(empty, format="gray")))
        container.mux(stream.encode())
    assert path.stat().st_size < 1 << 20
    error = trial.outcome().refused("SC-V007")
    assert error.exit_code == REFUSED
    assert "16000 x 8000" in error.what
    assert "crop or scale" in (error.fix or "")


@pytest.mark.skipif(sys.platform == "darwin", reason="macOS does not limit a process's memory")
def test_row22_a_decoder_that_takes_too_much_memory_ends_in_one_error(trial: Trial, monkeypatch):
    """Frames of 24 megapixels are small enough to be tried, and too large for a limit of 160 MB."""
    path = write_film(trial.folder / "video.avi", "mjpeg", "yuvj420p", [np.zeros((4000, 6000), np.uint8)] * 2)
    monkeypatch.setattr("strandcast.video.isolated.MEMORY_BYTES", 160 << 20)
    error = refusal(path)
    assert error.code == "SC-V005"
    assert error.file == str(path)
    assert "needs more than 0.2 GiB of memory" in error.what


@pytest.mark.parametrize(
    ("path", "code"),
    [
        ("http://localhost/v.mp4", "SC-V002"),
        ("rtsp://camera/1", "SC-V002"),
        ("concat:a.mp4|b.mp4", "SC-V002"),
        ("pipe:0", "SC-V002"),
        ("trial_%03d.png", "SC-V002"),
    ],
)
def test_row23_what_is_no_file_is_refused(path, code):
    error = refusal(path)
    assert error.code == code
    assert error.exit_code == REFUSED
    with pytest.raises(StrandcastError) as caught:
        inspect_video(path)
    assert caught.value.code == code


def test_row23_a_pipe_is_refused(trial: Trial):
    os.mkfifo(trial.folder / "video.mp4")
    assert refusal(trial.folder / "video.mp4").code == "SC-V002"


PLAYLISTS = {
    "hls": "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{other}\n#EXT-X-ENDLIST\n",
    "ffconcat": "ffconcat version 1.0\nfile {other}\n",
    "sdp": "v=0\no=- 0 0 IN IP4 127.0.0.1\nc=IN IP4 127.0.0.1\nm=video 5004 RTP/AVP 96\n",
}


@pytest.mark.parametrize("suffix", ["avi", "mp4", "mkv"])
@pytest.mark.parametrize("kind", PLAYLISTS)
def test_row24_a_playlist_named_as_a_video_opens_no_other_file(trial: Trial, kind, suffix):
    other = write_film(trial.folder / "other.mp4", pictures=noisy(3))
    path = trial.folder / f"video.{suffix}"
    path.write_text(PLAYLISTS[kind].format(other=other.name))
    error = refusal(path)
    assert error.code == "SC-V005"
    assert "not a video" in error.what


def test_row24_the_same_playlists_would_open_the_other_file(trial: Trial):
    """What the refusals are held against: FFmpeg, if it may, follows them."""
    write_film(trial.folder / "other.mp4", pictures=noisy(3))
    (trial.folder / "list.txt").write_text(PLAYLISTS["ffconcat"].format(other="other.mp4"))
    with av.open(str(trial.folder / "list.txt")) as container:
        assert container.streams.video[0].width == 160


def naming_another(movie: bytearray, other: str) -> bytearray:
    """Turn a movie's own data reference into an alias of another file (QuickTime's 'alis')."""
    name, folder = other.encode(), b"data"
    alias = bytearray(150)
    struct.pack_into(">4sHH", alias, 0, bytes(4), 150, 2)
    alias[10] = len(folder)
    alias[11 : 11 + len(folder)] = folder
    alias[50] = len(name)
    alias[51 : 51 + len(name)] = name
    struct.pack_into(">HH", alias, 130, 1, 1)
    path = b"/" + name + b"\0" * (1 - len(name) % 2)
    alias += struct.pack(">HH", 2, len(path)) + path + struct.pack(">HH", 0xFFFF, 0)
    entry = struct.pack(">I4sI", 12 + len(alias), b"alis", 0) + alias
    place = movie.index(b"dref") + 4 + 8
    old = struct.unpack_from(">I", movie, place)[0]
    movie[place : place + old] = entry
    for kind in (b"moov", b"trak", b"mdia", b"minf", b"dinf", b"dref"):
        start = movie.index(kind) - 4
        struct.pack_into(">I", movie, start, struct.unpack_from(">I", movie, start)[0] + len(entry) - old)
    return movie


def test_row24_a_movie_whose_frames_lie_in_another_file_is_refused(trial: Trial):
    other = write_film(trial.folder / "other.mov", pictures=noisy(3))
    path = write_film(trial.folder / "video.mov", pictures=noisy(3))
    damage(path, lambda data: naming_another(data, other.name))
    error = refusal(path)
    assert error.code == "SC-V010"
    assert "another file" in error.what
    assert "self-contained" in (error.fix or "")


@pytest.mark.parametrize(
    ("program", "code", "words"),
    [
        ("import os; os.kill(os.getpid(), 11)", "SC-V005", "crashed (SIGSEGV)"),
        ("import time; time.sleep(600)", "SC-V005", "returned no frame for 1 s"),
        ("import os; os.abort()", "SC-V005", "crashed (SIGABRT)"),
        ("raise SystemExit(3)", "SC-W004", "exit code 3"),
    ],
)
def test_row27_a_decoder_that_fails_ends_in_one_error_and_others_go_on(
    trial: Trial, monkeypatch, program, code, words
):
    path = write_film(trial.folder / "video.mp4")
    with monkeypatch.context() as patch:
        patch.setattr("strandcast.video.isolated.COMMAND", [sys.executable, "-c", program])
        patch.setattr("strandcast.video.isolated.STALL_S", 1.0)
        error = refusal(path)
        assert error.code == code
        assert error.file == str(path)
        assert words in error.what
        advice = "limits of this computer" if code == "SC-W004" else "convert it with another program"
        assert advice in (error.fix or "")
    found = trial.outcome()
    assert found.error is None
    assert len(found.frames) == 60


def test_row27_ingest_fails_in_the_same_way(trial: Trial, monkeypatch):
    write_film(trial.folder / "video.mp4")
    monkeypatch.setattr(
        "strandcast.video.isolated.COMMAND", [sys.executable, "-c", "import os; os.kill(os.getpid(), 11)"]
    )
    trial.outcome().refused("SC-V005")
    assert not (trial.root / "results").exists()


def test_a_pair_of_files_is_that_of_one_name_in_one_folder(trial: Trial):
    """A Photron header that names another file's folder is not followed."""
    frames = np.stack(noisy(4))
    header = trial.folder / "video.cih"
    header.write_text(
        "#Camera Information Header\nFile : ../../../other.mraw\nRecord Rate(fps) : 1000\nTotal Frame : 4\n"
        "Image Width : 160\nImage Height : 120\nColor Type : Mono\nColor Bit : 8\nEffectiveBit Depth : 8\n"
        "EffectiveBit Side : Lower\n"
    )
    frames.tofile(trial.root / "other.mraw")
    error = trial.outcome().refused("SC-V020")
    assert "put video.mraw into" in (error.fix or "")
    frames.tofile(trial.folder / "video.mraw")
    assert len(trial.outcome().frames) == 4
    damage(trial.folder / "video.mraw", cut(0.5))
    error = trial.outcome().refused("SC-V012")
    assert "2 frames of the 4" in error.what
