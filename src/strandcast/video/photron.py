"""Photron's raw video: a text (.cih) or XML (.cihx) header, and beside it the bare frames (.mraw).

pyMRAW is not used: it unpacks all frames of a 12-bit file into memory at once.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.folders import files_of_video
from strandcast.video.files import check_video_path, damaged
from strandcast.video.source import Contents, Grey, Source, VideoInfo, check_pixels, in_place

LARGEST_HEADER = 1 << 20
# Required fields: path in the XML header, name in the text header.
FIELDS = {
    "width": ("imageDataInfo/resolution/width", "Image Width"),
    "height": ("imageDataInfo/resolution/height", "Image Height"),
    "frames": ("frameInfo/totalFrame", "Total Frame"),
    "rate_hz": ("recordInfo/recordRate", "Record Rate(fps)"),
    "bits": ("imageDataInfo/colorInfo/bit", "Color Bit"),
    "colour": ("imageDataInfo/colorInfo/type", "Color Type"),
    "depth": ("imageDataInfo/effectiveBit/depth", "EffectiveBit Depth"),
    "side": ("imageDataInfo/effectiveBit/side", "EffectiveBit Side"),
}
GREY = {"raw", "mono", "monochrome", "grey", "gray"}


@dataclass(frozen=True)
class Header:
    """A Photron header, and the file of its frames, `data`."""

    data: Path
    width: int
    height: int
    frames: int
    rate_hz: float
    bits: int
    max_level: int

    @property
    def frame_bytes(self) -> int:
        """Return the size of a frame [bytes]."""
        return self.width * self.height * self.bits // 8


def read_header(path: str | Path) -> Header:
    """Read the header of a Photron video, given by either of its two files.

    Raises
    ------
    StrandcastError
        SC-V020 one of the two is missing; SC-V005 a field of the header is missing or invalid; SC-V007
        frames too large; SC-V010 colour, or an unsupported number of bits.
    """
    head, data = _pair(check_video_path(path))
    text = head.read_bytes()[:LARGEST_HEADER].decode("utf-8", errors="ignore")
    values = _from_xml(text, head) if "<cih>" in text else _from_text(text)
    missing = [name for name in FIELDS if not values.get(name)]
    if missing:
        raise _invalid(head, FIELDS[missing[0]][1], "is missing")
    width, height, frames = (_number(values, name, head) for name in ("width", "height", "frames"))
    bits, depth = _number(values, "bits", head), _number(values, "depth", head)
    check_pixels(width, height, head)
    if bits not in (8, 12, 16) or width * height * bits % 8 or values["colour"].lower() not in GREY:
        what = f"{bits} bits of {values['colour']!r} are not supported, only grey with 8, 12 or 16 bits"
        fix = "save it from Photron's viewer as 12-bit or 16-bit MRAW"
        raise StrandcastError("SC-V010", what, file=head, field="Color Bit", fix=fix)
    low = bits == 8 or values["side"].lower() == "lower"
    max_level = (1 << (min(depth, bits) if low else bits)) - 1
    return Header(data, width, height, frames, _number(values, "rate_hz", head), bits, max_level)


def _pair(file: Path) -> tuple[Path, Path]:
    """Return header and data file of the same name in the same folder; a name in the header is ignored."""
    files = files_of_video(file)
    heads = [each for each in files if each.suffix.lower() != ".mraw"]
    data = [each for each in files if each.suffix.lower() == ".mraw"]
    if not heads or len(data) != 1:
        missing = ".mraw" if heads else ".cihx (or .cih)"
        fix = f"put {file.stem}{missing.split()[0]} into {file.parent}"
        raise StrandcastError("SC-V020", f"its {missing} file is not beside it", file=file, fix=fix)
    # Newer cameras write both headers; the XML contains more.
    return max(heads, key=lambda each: each.suffix.lower()), data[0]


def _from_xml(text: str, head: Path) -> dict[str, str]:
    start, end = text.find("<cih>"), text.rfind("</cih>")
    try:
        root = ElementTree.fromstring(text[start : end + len("</cih>")])
    except ElementTree.ParseError as error:
        raise _invalid(head, "cih", f"is not complete XML ({error})") from None
    return {name: (root.findtext(place) or "").strip() for name, (place, _) in FIELDS.items()}


def _from_text(text: str) -> dict[str, str]:
    pairs = dict(re.findall(r"^(.+?) : (.*?)\s*$", text, re.MULTILINE))
    return {name: pairs.get(key, "") for name, (_, key) in FIELDS.items()}


def _number(values: dict[str, str], name: str, head: Path) -> int:
    try:
        number = int(float(values[name]))
    except (ValueError, OverflowError):
        number = 0
    if number <= 0:
        raise _invalid(head, FIELDS[name][1], f"is {values[name]!r}, not a number above 0")
    return number


def _invalid(head: Path, field: str, what: str) -> StrandcastError:
    return damaged("SC-V005", what, head, field=field)


def probe(path: str | Path) -> Contents:
    """Return the contents of a Photron video."""
    header = read_header(path)
    held = header.data.stat().st_size // header.frame_bytes
    return Contents(
        container="mraw",
        codec="raw",
        pixel_format=f"gray{header.bits}",
        width_px=header.width,
        height_px=header.height,
        ticks=list(range(min(held, header.frames))),
        time_base_s=1.0 / header.rate_hz,
        promised=header.frames,
        camera_clock=True,
    )


@contextmanager
def open_source(path: str | Path, threads: int, frames: int | None) -> Iterator[Source]:
    """Open a Photron video for one sequential pass.

    Raises
    ------
    StrandcastError
        As `read_header`; while iterating SC-V005 the data end early.
    """
    header = read_header(path)
    pixel_format = f"gray{header.bits}"
    info = VideoInfo(Path(path), header.width, header.height, "raw", pixel_format, header.max_level)
    to_grey = _unpack_12 if header.bits == 12 else _unpacked
    shape = (header.height, header.width)
    yield Source(info, _frames(header, frames), lambda raw, out: to_grey(raw, shape, out))


def _frames(header: Header, limit: int | None) -> Iterator[tuple[float, np.ndarray]]:
    raw = np.empty(header.frame_bytes, np.uint8)
    with header.data.open("rb", buffering=0) as file:
        for index in range(min(header.frames, limit or header.frames)):
            if file.readinto(raw.data) != len(raw):
                what = f"the video breaks off after {index} frames"
                raise damaged("SC-V005", what, header.data, cost="the rest of the throw is missing")
            yield index / header.rate_hz, raw


def _unpacked(raw: np.ndarray, shape: tuple[int, int], out: Grey | None) -> Grey:
    """Return a frame of 8 bits, or of 16 with the low byte first."""
    grey = raw if len(raw) == shape[0] * shape[1] else raw.view("<u2")
    out = np.empty(shape, grey.dtype.newbyteorder("=")) if out is None else out
    return in_place(grey.reshape(shape), out)


def _unpack_12(raw: np.ndarray, shape: tuple[int, int], out: Grey | None) -> Grey:
    """Return a frame of two pixels in three bytes: 8 high bits, 4 low + 4 high, 8 low."""
    grey = np.empty(shape, np.uint16) if out is None else out
    pairs = len(raw) // 3
    # Bytes 0 and 1 of each three, and bytes 1 and 2, as 16-bit numbers with the high byte first.
    first, second = (np.ndarray((pairs,), ">u2", raw.data, offset, (3,)) for offset in (0, 1))
    np.right_shift(first, 4, out=grey.reshape(-1)[0::2])
    np.bitwise_and(second, 0xFFF, out=grey.reshape(-1)[1::2])
    return grey
