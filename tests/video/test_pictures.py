"""Folders of numbered pictures and multi-page TIFF files as videos."""

import hashlib
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image

from strandcast.errors import StrandcastError
from strandcast.video.checks import check_recorded
from strandcast.video.ingest import camera_times, inspect_video
from strandcast.video.reader import open_video

RNG = np.random.default_rng(0)


def series(folder: Path, names: list[str], kind: type = np.uint8) -> np.ndarray:
    folder.mkdir(exist_ok=True)
    pictures = RNG.integers(0, np.iinfo(kind).max, (len(names), 24, 32)).astype(kind)
    for name, picture in zip(names, pictures, strict=True):
        if name.endswith(".png"):
            Image.fromarray(picture).save(folder / name)
        else:
            tifffile.imwrite(folder / name, picture)
    return pictures


def read(path: Path) -> tuple[np.ndarray, list[float]]:
    with open_video(path) as video:
        found = [(grey.copy(), time_s) for _, time_s, grey in video]
    return np.stack([grey for grey, _ in found]), [time_s for _, time_s in found]


def refusal(path: Path, rate: float | None = 1000.0) -> StrandcastError:
    with pytest.raises(StrandcastError) as caught:
        inspect_video(path, rate)
        read(path)
    return caught.value


@pytest.mark.parametrize("suffix", ["png", "tif", "TIFF"])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_pictures_come_in_the_order_of_their_numbers(tmp_path, suffix, kind):
    true = series(tmp_path / "video", [f"cam 2_{k}.{suffix}" for k in range(8, 13)], kind)
    (tmp_path / "video" / "notes.txt").write_text("not a picture")
    (tmp_path / "video" / f"._cam 2_8.{suffix}").write_text("of macOS")
    facts = inspect_video(tmp_path / "video", 1000.0)
    assert (facts.packets, facts.width_px, facts.height_px) == (5, 32, 24)
    assert facts.frame_rate_hz == 1000.0
    np.testing.assert_allclose(camera_times(facts), np.arange(5) / 1000)
    found, _ = read(tmp_path / "video")
    assert found.dtype == kind
    np.testing.assert_array_equal(found, true)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_tiffs_of_lzw_as_opencv_writes_them_are_read(tmp_path, kind):
    true = RNG.integers(0, np.iinfo(kind).max, (3, 24, 32)).astype(kind)
    (tmp_path / "video").mkdir()
    for k, picture in enumerate(true):
        cv2.imwrite(str(tmp_path / "video" / f"f_{k}.tif"), picture)
    np.testing.assert_array_equal(read(tmp_path / "video")[0], true)
    deep_colour = RNG.integers(0, 65535, (24, 32, 3)).astype(np.uint16)
    cv2.imwrite(str(tmp_path / "video" / "f_3.tif"), deep_colour)
    with pytest.raises(StrandcastError, match="compressed TIFF of uint16 with 3 dimensions"):
        read(tmp_path / "video")


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_a_multi_page_tiff_is_a_video(tmp_path, kind):
    true = RNG.integers(0, np.iinfo(kind).max, (6, 24, 32)).astype(kind)
    tifffile.imwrite(tmp_path / "video.tif", true, photometric="minisblack")
    facts = inspect_video(tmp_path / "video.tif", 500.0)
    assert (facts.packets, facts.container) == (6, "tiff")
    np.testing.assert_allclose(camera_times(facts), np.arange(6) / 500)
    np.testing.assert_array_equal(read(tmp_path / "video.tif")[0], true)


def test_missing_numbers_are_lost_frames(tmp_path):
    series(tmp_path / "video", [f"f{k:04d}.png" for k in (1, 2, 3, 4, 5, 8, 9, 10, 11, 12)])
    facts = inspect_video(tmp_path / "video", 1000.0)
    assert [(gap.index, gap.missing, gap.duration_s) for gap in facts.gaps] == [(4, 2, pytest.approx(0.003))]
    assert camera_times(facts)[5] == pytest.approx(0.007)


def test_pictures_without_a_rate_ask_for_one(tmp_path):
    series(tmp_path / "video", ["f1.png", "f2.png"])
    error = refusal(tmp_path / "video", None)
    assert error.code == "SC-V017"
    assert error.field == "camera.frame_rate_hz"


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["a1.png", "b2.png"], "more than one series"),
        (["a1.png", "a2.tif"], "more than one series"),
        (["a1.png", "a01.png"], "same number"),
        (["a1.png", "other.png"], "no number"),
    ],
)
def test_a_folder_whose_order_is_not_clear_is_refused(tmp_path, names, words):
    series(tmp_path / "video", names)
    error = refusal(tmp_path / "video")
    assert error.code == "SC-V010"
    assert words in error.what


def test_a_link_out_of_the_folder_is_not_followed(tmp_path):
    series(tmp_path / "video", ["a1.png", "a2.png"])
    series(tmp_path / "other", ["a3.png"])
    (tmp_path / "video" / "a3.png").symlink_to(tmp_path / "other" / "a3.png")
    assert refusal(tmp_path / "video").code == "SC-V002"


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0x10
    path.write_bytes(data)


@pytest.mark.parametrize(
    ("fault", "code", "words"),
    [
        (lambda path: path.write_bytes(b""), "SC-V005", "is empty"),
        (lambda path: path.write_bytes(b"hello"), "SC-V005", "is not a PNG"),
        (lambda path: path.write_bytes(path.read_bytes()[:400]), "SC-V005", "is damaged"),
        (flip, "SC-V005", "is damaged"),
        (lambda path: Image.new("L", (30, 24)).save(path), "SC-V010", "another size"),
        (lambda path: Image.new("I;16", (32, 24)).save(path), "SC-V010", "another size or depth"),
        (lambda path: Image.new("CMYK", (32, 24)).save(path, "TIFF"), "SC-V005", "is not a PNG"),
    ],
)
def test_a_damaged_or_odd_picture_is_refused_by_name(tmp_path, fault, code, words):
    series(tmp_path / "video", [f"f{k}.png" for k in range(3)])
    fault(tmp_path / "video" / "f1.png")
    error = refusal(tmp_path / "video")
    assert error.code == code
    assert words in error.what
    assert "f1.png" in (error.file or "")


def test_a_cut_tiff_is_refused(tmp_path):
    series(tmp_path / "video", [f"f{k}.tif" for k in range(3)])
    path = tmp_path / "video" / "f2.tif"
    path.write_bytes(path.read_bytes()[:500])
    error = refusal(tmp_path / "video")
    assert error.code == "SC-V005"
    assert "f2.tif" in (error.file or "")


def test_colour_pictures_become_grey(tmp_path):
    (tmp_path / "video").mkdir()
    for k in range(2):
        Image.new("RGB", (32, 24), (200, 100, 50)).save(tmp_path / "video" / f"f{k}.png")
    found, _ = read(tmp_path / "video")
    assert np.abs(found.astype(int) - round(0.299 * 200 + 0.587 * 100 + 0.114 * 50)).max() <= 1


def test_the_opacity_of_grey_pictures_does_not_count(tmp_path):
    grey = RNG.integers(0, 255, (2, 24, 32)).astype(np.uint8)
    both = np.stack([grey, np.full_like(grey, 255)], axis=-1)
    tifffile.imwrite(tmp_path / "video.tif", both, photometric="minisblack", planarconfig="contig")
    np.testing.assert_array_equal(read(tmp_path / "video.tif")[0], grey)


@pytest.mark.parametrize(
    ("words", "kind"),
    [
        ("a plane per colour", {"photometric": "rgb", "planarconfig": "separate"}),
        ("several pictures in one page", {"photometric": "minisblack", "volumetric": True}),
        ("all frames in one page", {"photometric": "minisblack", "imagej": True}),
    ],
)
def test_a_page_that_is_no_grey_picture_is_refused(tmp_path, words, kind):
    path = tmp_path / "video.tif"
    tifffile.imwrite(path, np.zeros((3, 24, 32), np.uint8), **kind)
    if "imagej" in kind:  # the pages' table ends after the first, as above 4 GB
        with tifffile.TiffFile(path, mode="r+b") as tiff:
            place = tiff.pages[0].offset + 2 + 12 * len(tiff.pages[0].tags)
        with path.open("r+b") as file:
            file.seek(place)
            file.write(bytes(4))
    error = refusal(path)
    assert error.code == "SC-V010"
    assert words in error.what
    assert "one page per frame" in error.fix


def test_a_decode_bomb_in_a_picture_is_refused(tmp_path):
    series(tmp_path / "video", ["f0.png"])
    Image.new("L", (16000, 8000)).save(tmp_path / "video" / "f1.png")
    assert refusal(tmp_path / "video").code == "SC-V007"


def test_the_hash_is_that_of_all_pictures(tmp_path):
    series(tmp_path / "video", [f"f{k}.tif" for k in range(3)])
    before = inspect_video(tmp_path / "video", 10.0).sha256
    flip(tmp_path / "video" / "f1.tif")
    assert inspect_video(tmp_path / "video", 10.0).sha256 != before


def test_a_note_of_sha256sum_lists_the_pictures(tmp_path):
    video = tmp_path / "video"
    series(video, ["f0.png", "f1.png"])
    facts = inspect_video(video, 10.0)
    lines = [
        f"{hashlib.sha256(file.read_bytes()).hexdigest()}  video/{file.name}" for file in video.iterdir()
    ]
    (tmp_path / "video.sha256").write_text("\n".join(lines))
    check_recorded(video, facts, None)
    flip(video / "f1.png")
    with pytest.raises(StrandcastError, match="video.sha256 has another SHA-256"):
        check_recorded(video, facts, None)
