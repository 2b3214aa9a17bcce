"""Image sequences: a folder of numbered TIFF or PNG files, or one TIFF with many pages."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import tifffile
from PIL import Image, UnidentifiedImageError

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.folders import files_of_video
from strandcast.video.files import check_video_path, damaged
from strandcast.video.source import Contents, Grey, Source, VideoInfo, check_pixels, in_place

NUMBERED = re.compile(r"^(.*?)(\d+)$")
PNG_MODES = {"L": 255, "1": 255, "P": 255, "RGB": 255, "RGBA": 255, "LA": 255, "I;16": 65535}


def numbered(folder: Path) -> list[tuple[int, Path]]:
    """Return the numbers in the names of a folder's pictures, ascending, and the pictures.

    Raises
    ------
    StrandcastError
        SC-V010 a name without a number, a number that occurs twice, or two series in one folder; SC-V002 a
        link out of the folder.
    """
    found: dict[int, Path] = {}
    series = set()
    for file in files_of_video(folder):
        match = NUMBERED.match(file.stem)
        if match is None:
            raise _unclear(folder, f"{file.name!r} has no number at the end of its name")
        if file.resolve().parent != folder.resolve() or not file.is_file():
            what = "is a link out of its folder, or not a file"
            raise StrandcastError("SC-V002", what, file=file, fix="copy the file itself")
        series.add((match[1], file.suffix.lower()))
        number = int(match[2])
        if number in found:
            raise _unclear(folder, f"{found[number].name!r} and {file.name!r} have the same number")
        found[number] = file
    if len(series) > 1:
        names = ", ".join(f"{stem}*{suffix}" for stem, suffix in sorted(series)[:3])
        raise _unclear(folder, f"contains more than one series of pictures: {names}")
    return sorted(found.items())


def _unclear(folder: Path, what: str) -> StrandcastError:
    fix = "keep one series of pictures, numbered in the order of recording"
    return StrandcastError("SC-V010", what, file=folder, fix=fix)


def probe(path: str | Path) -> Contents:
    """Return the contents of an image sequence; it has no rate, and a missing number is a lost frame."""
    file = check_video_path(path)
    if file.is_dir():
        pictures = numbered(file)
        ticks = [number for number, _ in pictures]
        first, max_level = _read(pictures[0][1])
        kind = pictures[0][1].suffix.lower().lstrip(".")
    else:
        with _open_tiff(file) as tiff:
            ticks = list(range(len(tiff.pages)))
            first, max_level = _page(tiff, 0, file)
            kind = "tiff"
    return Contents(
        container="folder" if file.is_dir() else "tiff",
        codec=kind,
        pixel_format="gray" if max_level == 255 else "gray16",
        width_px=first.shape[1],
        height_px=first.shape[0],
        ticks=ticks,
        time_base_s=None,
    )


@contextmanager
def open_source(path: str | Path, threads: int, frames: int | None) -> Iterator[Source]:
    """Open an image sequence; a frame's time is its number from the first, as if at 1 frame/s.

    Raises
    ------
    StrandcastError
        As `numbered`, and SC-V005 not a PNG or TIFF, or damaged, SC-V007 too large, SC-V010 one of another
        size or depth, or an unsupported kind of pixel.
    """
    held = probe(path)
    file = check_video_path(path)
    max_level = 255 if held.pixel_format == "gray" else 65535
    info = VideoInfo(Path(path), held.width_px, held.height_px, held.codec, held.pixel_format, max_level)
    pictures = _folder(file) if file.is_dir() else _pages(file)
    yield Source(info, _checked(pictures, info, frames), in_place)


def _checked(
    pictures: Iterator[tuple[int, Path, Grey, int]], info: VideoInfo, limit: int | None
) -> Iterator[tuple[float, Grey]]:
    first = None
    for count, (number, file, grey, max_level) in enumerate(pictures):
        if count == limit:
            return
        if grey.shape != (info.height, info.width) or max_level != info.max_level:
            what = f"frame {count} has another size or depth than the first ({grey.shape[::-1]} px)"
            raise StrandcastError("SC-V010", what, file=file, exit_code=INTEGRITY)
        first = number if first is None else first
        yield float(number - first), grey


def _folder(folder: Path) -> Iterator[tuple[int, Path, Grey, int]]:
    for number, file in numbered(folder):
        yield number, file, *_read(file)


def _pages(file: Path) -> Iterator[tuple[int, Path, Grey, int]]:
    with _open_tiff(file) as tiff:
        for number in range(len(tiff.pages)):
            yield number, file, *_page(tiff, number, file)


def _read(file: Path) -> tuple[Grey, int]:
    if file.stat().st_size == 0:
        raise damaged("SC-V005", "is empty (0 bytes)", file)
    if file.suffix.lower() != ".png":
        with _open_tiff(file) as tiff:
            return _page(tiff, 0, file)
    return _read_png(file)


def _read_png(file: Path) -> tuple[Grey, int]:
    try:
        with Image.open(file, formats=["PNG"]) as picture:
            check_pixels(*picture.size, file)
            # Pillow reduces colours of 16 bits to 8.
            deep_colour = picture.mode in {"RGB", "RGBA", "LA"} and ";16" in str(picture.tile)
            if picture.mode not in PNG_MODES or deep_colour:
                raise _unsupported(
                    file, f"PNG of mode {picture.mode}" + (" with 16 bits" if deep_colour else "")
                )
            max_level = PNG_MODES[picture.mode]
            grey = picture if max_level > 255 else picture.convert("L")
            return np.asarray(grey, dtype=np.uint8 if max_level == 255 else np.uint16), max_level
    except UnidentifiedImageError:
        raise damaged("SC-V005", "is not a PNG", file) from None
    except (OSError, SyntaxError, ValueError) as error:
        raise damaged("SC-V005", f"is damaged ({error})", file) from None


def _open_tiff(file: Path) -> tifffile.TiffFile:
    try:
        tiff = tifffile.TiffFile(file)
        in_one = len(tiff.pages) == 1 and (tiff.imagej_metadata or {}).get("images", 1) > 1  # above 4 GB
    except MemoryError:
        raise
    except Exception as error:  # exceptions of any kind, as for a page
        raise damaged("SC-V005", f"is not a TIFF ({error})", file) from None
    if in_one:
        tiff.close()
        raise _unsupported(file, "TIFF with all frames in one page")
    return tiff


def _page(tiff: tifffile.TiffFile, number: int, file: Path) -> tuple[Grey, int]:
    try:
        page = tiff.pages[number]
        if page.axes not in ("YX", "YXS"):
            planes = "a plane per colour" if page.axes == "SYX" else "several pictures in one page"
            raise _unsupported(file, f"TIFF with {planes}")
        check_pixels(page.shape[1], page.shape[0], file)
        grey = _pixels(page, number, file)
    except (StrandcastError, MemoryError):
        raise
    except Exception as error:  # tifffile and its codecs raise exceptions of any kind
        raise damaged("SC-V005", f"is damaged ({error})", file) from None
    if grey.dtype not in (np.uint8, np.uint16):
        raise _unsupported(file, f"TIFF of {grey.dtype}")
    if grey.ndim == 3 and grey.shape[2] < 3:
        grey = np.ascontiguousarray(grey[..., 0])  # beside it is its opacity
    elif grey.ndim == 3:
        grey = cv2.cvtColor(np.ascontiguousarray(grey[..., :3]), cv2.COLOR_RGB2GRAY)
    return grey, 255 if grey.dtype == np.uint8 else 65535


@lru_cache(maxsize=1)  # to find a page takes as long as all before it
def _opened(file: Path, changed_ns: int) -> Image.Image:
    return Image.open(file, formats=["TIFF"])


def _pixels(page: tifffile.TiffPage | tifffile.TiffFrame, number: int, file: Path) -> np.ndarray:
    """Return a page's pixels, by Pillow where tifffile has not the decompression: LZW and the like."""
    try:
        return np.asarray(page.asarray())
    except ValueError as error:
        if "imagecodecs" not in str(error):
            raise
    picture = _opened(file, file.stat().st_mtime_ns)
    picture.seek(number)
    pixels = np.asarray(picture)
    if pixels.dtype != page.dtype:  # Pillow reduces colours of 16 bits to 8
        raise _unsupported(file, f"compressed TIFF of {page.dtype} with {page.ndim} dimensions")
    return pixels


def _unsupported(file: Path, kind: str) -> StrandcastError:
    fix = "save single pictures, or a TIFF with one page per frame, in 8-bit or 16-bit grey"
    return StrandcastError("SC-V010", f"{kind} is not supported", file=file, fix=fix)
