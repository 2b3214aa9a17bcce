"""Photron's raw video: a header of text (.cih) or XML (.cihx) and, beside it, the frames without any (.mraw).

A reader of our own: pyMRAW unpacks all frames of a 12-bit file into memory at once.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.video.files import check_video_path, files_of
from strandcast.video.source import Contents, Grey, Source, VideoInfo, check_pixels, in_place

LARGEST_HEADER = 1 << 20
# What is needed, by its place in the XML and by its name in the text.
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
    """What a Photron header says of the frames beside it."""

    file: Path
    data: Path
    width: int
    height: int
    frames: int
    rate_hz: float
    bits: int
    max_level: int

    @property
    def frame_bytes(self) -> int:
        """Return the bytes of a frame."""
        return self.width * self.height * self.bits // 8


def read_header(path: str | Path) -> Header:
    """Read the header of a Photron video, given by either of its two files.

    Raises
    ------
    StrandcastError
        SC-V014 one of the two is missing; SC-V015 the header lacks or garbles a field; SC-V007 frames too
        large; SC-V010 colour, or bits that are not read.
    """
    head, data = _pair(check_video_path(path))
    text = head.read_bytes()[:LARGEST_HEADER].decode("utf-8", errors="ignore")
    values = _from_xml(text, head) if "<cih>" in text else _from_text(text)
    missing = [name for name in FIELDS if not values.get(name)]
    if missing:
        raise _garbled(head, FIELDS[missing[0]][1], "is not there")
    width, height, frames = (_number(values, name, head) for name in ("width", "height", "frames"))
    bits, depth = _number(values, "bits", head), _number(values, "depth", head)
    check_pixels(width, height, head)
    if bits not in (8, 12, 16) or width * height * bits % 8 or values["colour"].lower() not in GREY:
        raise StrandcastError(
            "SC-V010", f"{bits} bits of {values['colour']!r} are not read, but grey in 8, 12, 16", file=head,
            field="Color Bit", fix="save it from Photron's viewer as 12-bit or 16-bit MRAW")  # fmt: skip
    low = bits == 8 or values["side"].lower() == "lower"
    rate_hz = _number(values, "rate_hz", head)
    return Header(
        head, data, width, height, frames, rate_hz, bits, (1 << (min(depth, bits) if low else bits)) - 1
    )


def _pair(file: Path) -> tuple[Path, Path]:
    """Return header and data: always those of one name in one folder, whatever the header says."""
    both = files_of(file)
    heads = [one for one in both if one.suffix.lower() != ".mraw"]
    data = [one for one in both if one.suffix.lower() == ".mraw"]
    if not heads or len(data) != 1:
        lacking = ".mraw" if heads else ".cihx (or .cih)"
        raise StrandcastError(
            "SC-V014", f"its {lacking} file is not beside it", file=file,
            fix=f"put {file.stem}{lacking.split()[0]} into {file.parent}")  # fmt: skip
    # Newer cameras write both headers: the XML says more.
    return max(heads, key=lambda one: one.suffix.lower()), data[0]


def _from_xml(text: str, head: Path) -> dict[str, str]:
    start, end = text.find("<cih>"), text.rfind("</cih>")
    try:
        root = ElementTree.fromstring(text[start : end + len("</cih>")])
    except ElementTree.ParseError as error:
        raise _garbled(head, "cih", f"is no whole XML ({error})") from None
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
        raise _garbled(head, FIELDS[name][1], f"is {values[name]!r}, not a number above 0")
    return number


def _garbled(head: Path, field: str, what: str) -> StrandcastError:
    return StrandcastError(
        "SC-V015",
        what,
        file=head,
        field=field,
        exit_code=INTEGRITY,
        fix="copy the header again from the camera",
    )


def probe(path: str | Path) -> Contents:
    """Return what a Photron video holds."""
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
    )


@contextmanager
def open_source(path: str | Path, frames: int | None) -> Iterator[Source]:
    """Open a Photron video for one sequential pass; raises as `read_header` and, in it, SC-V008."""
    header = read_header(path)
    info = VideoInfo(
        Path(path), header.width, header.height, "raw", f"gray{header.bits}", header.max_level
    )  # fmt: skip
    to_grey = _unpack_12 if header.bits == 12 else _as_it_is
    shape = (header.height, header.width)
    yield Source(info, _frames(header, frames), lambda raw, out: to_grey(raw, shape, out))


def _frames(header: Header, limit: int | None) -> Iterator[tuple[float, np.ndarray]]:
    raw = np.empty(header.frame_bytes, np.uint8)
    with header.data.open("rb", buffering=0) as file:
        for index in range(min(header.frames, limit or header.frames)):
            if file.readinto(raw.data) != len(raw):
                raise StrandcastError(
                    "SC-V008", f"the video breaks off after {index} frames", file=header.data,
                    exit_code=INTEGRITY, cost="the rest of the throw is not seen",
                    fix="copy the file again from the camera")  # fmt: skip
            yield index / header.rate_hz, raw


def _as_it_is(raw: np.ndarray, shape: tuple[int, int], out: Grey | None) -> Grey:
    """Return a frame of 8 bits, or of 16 with the low byte first."""
    grey = raw if len(raw) == shape[0] * shape[1] else raw.view("<u2")
    return in_place(
        grey.reshape(shape), np.empty(shape, grey.dtype.newbyteorder("=")) if out is None else out
    )


def _unpack_12(raw: np.ndarray, shape: tuple[int, int], out: Grey | None) -> Grey:
    """Return a frame of two pixels in three bytes: 8 high bits, 4 low + 4 high, 8 low."""
    grey = np.empty(shape, np.uint16) if out is None else out
    pairs = len(raw) // 3
    # Bytes 0 and 1 of each three, and 1 and 2, as numbers of 16 bits with the high byte first.
    first, second = (np.ndarray((pairs,), ">u2", raw.data, offset, (3,)) for offset in (0, 1))
    np.right_shift(first, 4, out=grey.reshape(-1)[0::2])
    np.bitwise_and(second, 0xFFF, out=grey.reshape(-1)[1::2])
    return grey
