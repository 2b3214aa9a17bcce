"""Rows 22, 27 and 76 of the fault list for single pictures: bombs, decoders that fail, links."""

import struct
import sys
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from strandcast.errors import REFUSED, StrandcastError
from strandcast.stages.calibrate import UNROTATED
from strandcast.stages.context import context_of
from strandcast.stages.photos import given_background
from strandcast.stages.run import run_stage
from strandcast.video.isolated import read_photos

GREY = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH


def png_of_zeros(path: Path, side: int, rows: int | None = None) -> Path:
    """Write a PNG of one bit per pixel, all black, with all its rows or the first few."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    pixels = zlib.compress(bytes((side // 8 + 1) * (side if rows is None else rows)), 1)
    head = struct.pack(">IIBBBBB", side, side, 1, 0, 0, 0, 0)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")
    )
    return path


def refusal(path: Path) -> StrandcastError:
    with pytest.raises(StrandcastError) as caught:
        list(read_photos([path], UNROTATED))
    assert caught.value.file == str(path)
    return caught.value


@pytest.mark.parametrize(("side", "rows"), [(30_000, None), (50_000, 100), (6_400, None)])
def test_row22_a_picture_bomb_is_refused_before_it_is_decoded(tmp_path: Path, side: int, rows: int | None):
    path = png_of_zeros(tmp_path / "plane.png", side, rows)
    assert path.stat().st_size < 1 << 20
    error = refusal(path)
    assert (error.code, error.exit_code) == ("SC-V007", REFUSED)
    assert f"{side} x {side} pixels" in error.what
    assert error.cost is None


def test_row22_a_size_that_only_opencv_reads_is_refused_too(tmp_path: Path):
    path = tmp_path / "plane.hdr"
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 20000 +X 20000\n" + bytes(100))
    error = refusal(path)
    assert error.code == "SC-V007"
    assert "more than 40000000 pixels" in error.what


@pytest.mark.skipif(sys.platform == "darwin", reason="macOS does not limit a process's memory")
def test_row22_a_picture_that_takes_too_much_memory_ends_in_one_error(tmp_path: Path, monkeypatch):
    path = png_of_zeros(tmp_path / "plane.png", 6_000)
    monkeypatch.setattr("strandcast.video.isolated.MEMORY_BYTES", 150 << 20)
    error = refusal(path)
    assert error.code == "SC-V005"
    assert "needs more than 0.1 GiB of memory" in error.what


@pytest.mark.parametrize(
    ("program", "code"),
    [
        ("import os; os.kill(os.getpid(), 11)", "SC-V005"),
        ("import time; time.sleep(600)", "SC-V005"),
        ("raise SystemExit(3)", "SC-W004"),
    ],
)
def test_row27_a_decoder_that_fails_ends_in_one_error(tmp_path: Path, monkeypatch, program: str, code: str):
    path = png_of_zeros(tmp_path / "plane.png", 80)
    monkeypatch.setattr("strandcast.video.isolated.COMMAND", [sys.executable, "-c", program])
    monkeypatch.setattr("strandcast.video.isolated.STALL_S", 1.0)
    error = refusal(path)
    assert error.code == code
    assert "frames" not in error.what


def test_pictures_are_those_that_opencv_reads_in_this_process(tmp_path: Path):
    random = np.random.default_rng(0)
    paths = []
    for name, shape, kind in (
        ("a.png", (60, 80), np.uint8),
        ("b.png", (50, 70), np.uint16),
        ("c.jpg", (60, 80, 3), np.uint8),
        ("d.png", (60, 80, 4), np.uint8),
        ("e.tif", (30, 20), np.uint16),
        ("f\n'ü.webp", (30, 20, 3), np.uint8),
    ):
        paths.append(tmp_path / name)
        cv2.imwrite(str(paths[-1]), random.integers(0, np.iinfo(kind).max, shape).astype(kind))
    (tmp_path / "g.png").write_text("hello")
    (tmp_path / "h.png").write_bytes(paths[0].read_bytes()[:200])
    paths += [tmp_path / "g.png", tmp_path / "h.png"]
    for flags in (GREY, UNROTATED):
        for path, found in zip(paths, read_photos(paths, flags), strict=True):
            expected = cv2.imread(str(path), flags)
            assert (found is None) == (expected is None)
            if found is not None:
                assert found.dtype == expected.dtype
                assert found.flags.writeable
                np.testing.assert_array_equal(found, expected)


def test_a_cut_jpeg_is_no_picture(tmp_path: Path):
    """OpenCV returns it, grey from where it was cut: an empty scene that never was."""
    path = tmp_path / "empty.jpg"
    cv2.imwrite(str(path), np.random.default_rng(0).integers(0, 256, (240, 320, 3)).astype(np.uint8))
    whole = path.read_bytes()
    for more in (b"", b"\0" * 100, whole[:500]):  # cameras append things
        path.write_bytes(whole + more)
        assert [picture is not None for picture in read_photos([path], GREY)] == [True]
    for share in (0.5, 0.99):
        path.write_bytes(whole[: int(share * len(whole))])
        assert cv2.imread(str(path), GREY) is not None
        assert list(read_photos([path], GREY)) == [None]


class TestAnExperimentsPictures:
    @pytest.fixture
    def root(self, tmp_path: Path) -> Path:
        folder = tmp_path / "data" / "film"
        (folder / "calibration").mkdir(parents=True)
        png_of_zeros(folder / "calibration/lens-01.png", 80)
        (folder / "experiment.yaml").write_text(
            "string: {length_m: 0.3}\ntarget_m: [0, 0]\ntrack: {background_picture: empty.png}\n"
        )
        return tmp_path

    def calibrate(self, root: Path) -> StrandcastError:
        with pytest.raises(StrandcastError) as caught:
            run_stage("calibrate", root, "film")
        return caught.value

    def test_a_bomb_stops_the_stage_with_one_error(self, root: Path):
        plane = png_of_zeros(root / "data/film/calibration/plane.png", 50_000, 10)
        error = self.calibrate(root)
        assert (error.code, error.file) == ("SC-V007", str(plane))
        background = png_of_zeros(root / "data/film/empty.png", 50_000, 10)
        with pytest.raises(StrandcastError, match="SC-V007") as caught:
            given_background(context_of(root, "film"), None)
        assert caught.value.file == str(background)

    def test_row76_a_link_out_of_the_data_is_not_followed(self, root: Path):
        outside = png_of_zeros(root / "secret.png", 80)
        plane, empty = root / "data/film/calibration/plane.png", root / "data/film/empty.png"
        for link in (plane, empty):
            link.symlink_to(outside)
        error = self.calibrate(root)
        assert (error.code, error.file) == ("SC-F010", str(plane))
        assert str(outside) in error.what
        with pytest.raises(StrandcastError, match="SC-F010"):
            given_background(context_of(root, "film"), None)

    def test_row76_a_link_to_another_experiments_photo_is_followed(self, root: Path):
        other = root / "data" / "other"
        other.mkdir()
        (root / "data/film/calibration/plane.png").symlink_to(png_of_zeros(other / "plane.png", 80))
        assert self.calibrate(root).code == "SC-C013"  # the plane is read; no photo shows the lens board

    def test_what_is_no_picture_keeps_its_error(self, root: Path):
        assert self.calibrate(root).code == "SC-C031"
        plane = root / "data/film/calibration/plane.png"
        plane.write_text("hello")
        error = self.calibrate(root)
        assert (error.code, error.exit_code) == ("SC-C031", REFUSED)
