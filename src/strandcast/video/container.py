"""Videos in containers (mp4, mov, avi, mkv, Phantom's cine ...), through FFmpeg's libraries."""

from __future__ import annotations

import errno
import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import av
import numpy as np

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.video.cine import cine_times_ns
from strandcast.video.files import check_video_path
from strandcast.video.source import Contents, Grey, Source, VideoInfo, check_pixels, in_place

# Demuxers that read one file and open no other (no playlists, no image patterns, no network).
FORMATS = "mov,matroska,avi,mjpeg,h264,hevc,ivf,ogg,nut,mpegts,asf,cine"
LUMA_8BIT = {"yuv420p", "yuv422p", "yuv444p", "yuv411p", "yuv440p", "nv12", "nv21"}
FULL_8BIT = {"yuvj420p", "yuvj422p", "yuvj444p", "gray"}
UPRIGHT = {"gray": "yuvj420p", "gray16le": "gray16be"}  # the same grey in other formats: the scaler must copy
FULL_RANGE_TAG = 2  # AVCOL_RANGE_JPEG
LONGEST_SPAN = 2.0  # of a cine's time stamps, in usual steps times frames
AVI_CHUNK_HEADER = 8  # bytes: the index points to it, a packet's place is behind it
BLACK, WHITE = 16, 235  # of limited range
BEYOND_SHARE = 0.01  # of the pixels may lie below or above these


@dataclass(frozen=True)
class Opened:
    """An open container, its first video stream, and what FFmpeg says while it is open."""

    container: av.container.InputContainer
    stream: av.VideoStream
    log: list[tuple[int, str, str]]

    def messages(self) -> list[str]:
        """Return what FFmpeg said so far."""
        return [f"{name}: {text.strip()}" for _, name, text in self.log]


@contextmanager
def open_container(path: str | Path) -> Iterator[Opened]:
    """Open a video file.

    Raises
    ------
    StrandcastError
        As `check_video_path`, and SC-V005 not a video or index lost, SC-V006 no video stream in it,
        SC-V007 frames too large, SC-V013 its frames lie in another file.
    """
    file = check_video_path(path)
    options = {"protocol_whitelist": "file", "format_whitelist": FORMATS}
    av.logging.set_level(av.logging.WARNING)
    try:
        # Decoder threads are not this thread: the capture must be global.
        with av.logging.Capture(local=False) as log:
            try:
                container = av.open(f"file:{file}", options=options)
            except (av.FFmpegError, ValueError) as error:
                _raise_if_memory(error)
                raise StrandcastError(
                    "SC-V005", f"is not a video that can be read ({reason(error)})", file=path,
                    exit_code=INTEGRITY, fix=_open_hint(file)) from None  # fmt: skip
            with container:
                _check_own_frames(log, path)
                yield Opened(container, _video_stream(container, path), log)
    finally:
        av.logging.set_level(None)


def _video_stream(container: av.container.InputContainer, path: str | Path) -> av.VideoStream:
    if not container.streams.video:
        raise StrandcastError("SC-V006", "holds no video stream", file=path, fix="give the camera's file")
    stream = container.streams.video[0]
    context = stream.codec_context
    if context is None:
        raise StrandcastError(
            "SC-V010", "is of a codec that is not read", file=path, fix="convert the video to FFV1 or H.264"
        )
    check_pixels(context.width, context.height, path)
    if context.format is None:
        raise StrandcastError(
            "SC-V005", "holds no whole frame", file=path, exit_code=INTEGRITY,
            fix="copy the file again from the camera")  # fmt: skip
    return stream


def _check_own_frames(log: list[tuple[int, str, str]], path: str | Path) -> None:
    """Refuse a QuickTime file that names another with its frames: FFmpeg then says that it skipped it."""
    if any("external track" in text for _, _, text in log):
        raise StrandcastError(
            "SC-V013", "its frames lie in another file, which is not opened", file=path,
            fix="save it as a self-contained movie")  # fmt: skip


def reason(error: Exception) -> str:
    """Return what FFmpeg says went wrong."""
    return str(getattr(error, "strerror", None) or error)


def _raise_if_memory(error: Exception) -> None:
    if getattr(error, "errno", None) == errno.ENOMEM:
        raise MemoryError from None


def _open_hint(file: Path) -> str:
    if file.suffix.lower() in {".mp4", ".mov", ".m4v"}:
        return (
            "copy the file again: an mp4 that was cut, or is still being written, lacks the index at its end"
        )
    return "give an mp4, mov, avi, mkv or cine file"


def probe(path: str | Path) -> Contents:
    """Return what a video file holds, from its packets and its first frame."""
    with open_container(path) as opened:
        container, stream = opened.container, opened.stream
        packets = _packets(container, stream)
        context = stream.codec_context
        exact = int(stream.frames)
        facts = Contents(
            container=container.format.name,
            codec=context.name,
            pixel_format=context.format.name,
            width_px=int(context.width),
            height_px=int(context.height),
            ticks=_reindexed(stream, packets) or sorted(packets.stamps),
            time_base_s=float(stream.time_base),
            promised=exact or _promised_frames(container, stream),
            exact=exact > 0,
            discarded=packets.discarded,
            breaks_off=packets.breaks_off,
            notes=_notes(container),
        )
    facts.notes.extend(_notes_of_first_frame(path))
    return _with_own_times(facts, path) if facts.container == "cine" else facts


@dataclass
class Packets:
    """The packets of a video stream: time stamps and places in the file of those shown, and how it ends."""

    stamps: list[int] = field(default_factory=list)
    places: list[int | None] = field(default_factory=list)
    discarded: int = 0
    breaks_off: str | None = None


def _packets(container: av.container.InputContainer, stream: av.VideoStream) -> Packets:
    found = Packets()
    try:
        for packet in container.demux(stream):
            if packet.size and not _take(packet, found):
                break
    except av.FFmpegError as error:
        _raise_if_memory(error)
        found.breaks_off = reason(error)
    return found


def _take(packet: av.Packet, found: Packets) -> bool:
    """Count a packet; returns False where the video breaks off."""
    stamp = packet.pts if packet.pts is not None else packet.dts
    if packet.is_corrupt:
        found.breaks_off = "the last frame is cut"
    elif packet.is_discard:
        found.discarded += 1
    elif stamp is None:
        found.breaks_off = f"frame {len(found.stamps)} has no time stamp"
    else:
        found.stamps.append(int(stamp))
        found.places.append(packet.pos)
    return found.breaks_off is None


def _reindexed(stream: av.VideoStream, packets: Packets) -> list[int] | None:
    """Return the time stamps of an AVI's frames by their places in its index, where frames are missing.

    An AVI counts its frames as it finds them: after a damaged one, all would be a frame early.
    """
    if packets.breaks_off or stream.container.format.name != "avi" or len(packets.stamps) >= stream.frames:
        return None
    known = {entry.pos + AVI_CHUNK_HEADER: number for number, entry in enumerate(stream.index_entries)}
    if len(known) != stream.frames or not all(place in known for place in packets.places):
        return None
    return [known[place] for place in packets.places]


def _promised_frames(container: av.container.InputContainer, stream: av.VideoStream) -> int:
    """Frames by duration times rate, for containers (mkv) that keep no count; 0 if unknown."""
    if container.format.name == "cine":
        return int(stream.duration or 0)
    rate = stream.average_rate
    if container.duration is None or not rate:
        return 0
    return int(container.duration / av.time_base * float(rate) + 0.5)


def _with_own_times(facts: Contents, path: str | Path) -> Contents:
    """Take the camera's own time stamps, which a cine file keeps beside its nominal rate."""
    times = cine_times_ns(path)
    if times is None or len(times) != len(facts.ticks) or len(times) < 2:
        return facts
    steps = np.diff(times)
    if steps.min() <= 0 or steps.sum() > LONGEST_SPAN * len(steps) * np.median(steps):
        worst = int(np.abs(steps - np.median(steps)).argmax())
        jump = f"the camera's time stamps jump by {steps[worst] / 1e9:.4g} s after frame {worst}"
        return replace(facts, notes=[*facts.notes, f"{jump}: its rate is taken"])
    return replace(facts, ticks=times, time_base_s=1e-9)


def _notes(container: av.container.InputContainer) -> list[str]:
    # Phones that export slow motion at 30 frames/s write the true rate here.
    rate = container.metadata.get("com.android.capture.fps")
    return [f"its header says that it was filmed at {float(rate):g} frames/s"] if rate else []


def _notes_of_first_frame(path: str | Path) -> list[str]:
    notes = []
    with open_container(path) as opened:
        try:
            frame = next(opened.container.decode(opened.stream))
        except (av.FFmpegError, StopIteration) as error:
            _raise_if_memory(error)
            return []  # decoding will tell
        if frame.rotation:
            notes.append(
                f"its header asks to turn it by {frame.rotation} degrees: it is read as it was filmed"
            )
        limited = not is_full(frame.format.name, int(opened.stream.codec_context.color_range))
        if frame.format.name in LUMA_8BIT and limited:
            plane = luma(upright(frame, Path(path)))
            beyond = float(((plane < BLACK) | (plane > WHITE)).mean())
            if beyond > BEYOND_SHARE:
                notes.append(
                    f"{100 * beyond:.0f} % of its pixels lie beyond the limited range that it claims "
                    f"({BLACK} to {WHITE}): they are clipped"
                )
    return notes


@contextmanager
def open_source(path: str | Path, threads: int, frames: int | None) -> Iterator[Source]:
    """Open a video for one sequential decoding pass, of the first `frames` frames if that is given.

    Raises
    ------
    StrandcastError
        As `open_container`; while iterating SC-V008 the data end in damage, SC-V009 a frame without time
        or of another size, SC-V010 a pixel format that is not read.
    """
    with open_container(path) as opened:
        context = opened.stream.codec_context
        if threads != 1:
            opened.stream.thread_type = "AUTO"
        context.thread_count = threads
        name = context.format.name
        to_grey, max_level = grey_converter(name, int(context.color_range), Path(path))
        info = VideoInfo(Path(path), context.width, context.height, context.name, name, max_level)
        yield Source(info, _frames(opened, info, frames), to_grey, opened.messages)


def _frames(opened: Opened, info: VideoInfo, limit: int | None) -> Iterator[tuple[float, av.VideoFrame]]:
    count, time_base = 0, opened.stream.time_base
    try:
        for frame in _decode(opened, limit):
            if frame.pts is None or (frame.width, frame.height) != (info.width, info.height):
                what = f"frame {count} has no time stamp or another size ({frame.width} x {frame.height})"
                raise StrandcastError("SC-V009", what, file=info.path, exit_code=INTEGRITY)
            yield float(frame.pts * time_base), upright(frame, info.path)
            count += 1
    except av.FFmpegError as error:
        _raise_if_memory(error)
        raise StrandcastError(
            "SC-V008", f"the video breaks off after {count} frames ({reason(error)})", file=info.path,
            exit_code=INTEGRITY, cost="the rest of the throw is not seen",
            fix="copy the file again from the camera") from None  # fmt: skip


def _decode(opened: Opened, limit: int | None) -> Iterator[av.VideoFrame]:
    """Yield all frames in order of display, or the first `limit` of those before a cut."""
    if limit is None:
        yield from opened.container.decode(opened.stream)
        return
    yield from itertools.islice(_decode_whole(opened), limit)


def _decode_whole(opened: Opened) -> Iterator[av.VideoFrame]:
    for packet in _whole_packets(opened):
        yield from opened.stream.decode(packet)
    yield from opened.stream.decode(None)


def _whole_packets(opened: Opened) -> Iterator[av.Packet]:
    """Yield the packets before the first that is cut."""
    packets = opened.container.demux(opened.stream)
    while True:
        try:
            packet = next(packets)
        except StopIteration:
            return
        except av.FFmpegError as error:
            _raise_if_memory(error)
            return
        if packet.size == 0 or packet.is_corrupt:
            return
        yield packet


def grey_converter(
    pixel_format: str, color_range: int, file: Path
) -> tuple[Callable[[av.VideoFrame, Grey | None], Grey], int]:
    """Return the function that makes a full-range grey image of a frame, and its largest level.

    The luma plane of ``yuv420p`` is of limited range: black is 16, white 235. Taken as it is, contrast
    is lost and levels do not compare with a grey video's; ``yuvj`` and ``gray`` are full.
    """
    if is_full(pixel_format, color_range):
        return lambda frame, out: in_place(luma(frame), out), 255
    if pixel_format in LUMA_8BIT:
        return lambda frame, out: expand(luma(frame), out), 255
    depth = _depth(pixel_format)
    if depth > 8 and pixel_format.startswith("gray"):
        return lambda frame, out: in_place(_luma_16(frame), out), (1 << depth) - 1
    if depth > 8:
        return lambda frame, out: in_place(_luma_16(scaled(frame, "gray16le")), out), 65535
    if depth == 8:
        return lambda frame, out: in_place(luma(scaled(frame, "gray")), out), 255
    raise StrandcastError(
        "SC-V010", f"pixel format {pixel_format!r} is not read", file=file,
        fix="convert the video to 8-bit grey")  # fmt: skip


def is_full(pixel_format: str, color_range: int) -> bool:
    """Return whether the first plane of a pixel format is grey in 8 bits, from 0 to 255."""
    return pixel_format in FULL_8BIT or (pixel_format in LUMA_8BIT and color_range == FULL_RANGE_TAG)


def _depth(pixel_format: str) -> int:
    components = av.VideoFormat(pixel_format).components
    return max((component.bits for component in components), default=0)


def luma(frame: av.VideoFrame) -> Grey:
    """Return the first plane of a frame of 8 bits, not copied."""
    plane = frame.planes[0]
    return np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)[: frame.height, : frame.width]


def expand(limited: Grey, out: Grey | None) -> Grey:
    """Return the full range of limited levels: (level - 16) 255 / 219, rounded, within 0 and 255.

    No level comes near a half, so single precision rounds as exact arithmetic does.
    """
    import cv2  # here: most videos do without

    gain = 255.0 / (WHITE - BLACK)
    return np.asarray(cv2.addWeighted(limited, gain, limited, 0.0, -BLACK * gain, out))


def scaled(frame: av.VideoFrame, pixel_format: str) -> av.VideoFrame:
    """Return a frame in another pixel format.

    With more threads, FFmpeg's scaler writes past the ends of rows into those of other threads: in widths
    that are no multiple of 16, some pixels then change from run to run.
    """
    return frame.reformat(format=pixel_format, threads=1)


def upright(frame: av.VideoFrame, file: Path) -> av.VideoFrame:
    """Return a frame whose rows lie from top to bottom in memory: a cine file's lie upside down.

    FFmpeg then gives the place of the last row, before which PyAV's view does not reach; its scaler copies.
    """
    name = frame.format.name
    if frame.planes[0].line_size >= 0:
        return frame
    if name in LUMA_8BIT or (name.startswith("gray") and name not in UPRIGHT):
        raise StrandcastError(
            "SC-V010", f"pixel format {name!r}, bottom row first, is not read", file=file,
            fix="convert the video to 8-bit grey")  # fmt: skip
    return scaled(frame, UPRIGHT[name]) if name in UPRIGHT else frame


def _luma_16(frame: av.VideoFrame) -> Grey:
    plane = frame.planes[0]
    kind = np.dtype(">u2" if frame.format.name.endswith("be") else "<u2")
    rows = np.frombuffer(plane, kind).reshape(-1, plane.line_size // 2)[: frame.height, : frame.width]
    return rows.astype(np.uint16, copy=False)
