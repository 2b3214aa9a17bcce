"""Videos in containers (mp4, mov, avi, mkv, Phantom's cine ...), read with FFmpeg's libraries."""

import itertools
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import av

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.video.cine import cine_flips, cine_times_ns
from strandcast.video.ffmpeg import OpenContainer, open_container, reason
from strandcast.video.files import damaged
from strandcast.video.grey import (
    BLACK,
    LUMA_8BIT,
    WHITE,
    grey_converter,
    is_full_range,
    luma,
    plain_luma,
    upright,
)
from strandcast.video.source import SQUARE_TOLERANCE, Contents, Source, VideoInfo

LONGEST_SPAN = 2.0  # of a cine's time stamps, relative to their median step times the frames
AVI_CHUNK_HEADER = 8  # bytes between the position in the index and the packet's
BEYOND_SHARE = 0.01  # chosen: share of pixels beyond the limited range above which it is reported


def probe(path: str | Path) -> Contents:
    """Return the contents of a video file from its packets and its first frame."""
    with open_container(path) as opened:
        container, stream = opened.container, opened.stream
        packets, first = _packets(container, stream)
        context = stream.codec_context
        exact = int(stream.frames)
        contents = Contents(
            container=container.format.name,
            codec=context.name,
            pixel_format=context.format.name,
            width_px=int(context.width),
            height_px=int(context.height),
            ticks=_avi_index_ticks(stream, packets) or sorted(packets.stamps),
            time_base_s=float(stream.time_base),
            promised=exact or _promised_frames(container, stream),
            exact=exact > 0,
            discarded=packets.discarded,
            breaks_off=packets.breaks_off,
        )
        # Phones that export slow motion at 30 frames/s write the true rate here.
        rate = container.metadata.get("com.android.capture.fps")
        aspect = _pixel_aspect(stream)
        notes = [] if first is None else _notes_on_first_frame(first, int(context.color_range), path)
    if rate:
        contents.notes.append(f"its header says that it was filmed at {_number(rate)} frames/s")
    if abs(aspect - 1.0) > SQUARE_TOLERANCE:
        contents.notes.append(
            f"its pixels are not square, {aspect:.4g} times as wide as high: calibrate with pictures of the "
            "same pixels"
        )
    contents.notes.extend(notes)
    return _with_camera_times(contents, path) if contents.container == "cine" else contents


def _pixel_aspect(stream: av.VideoStream) -> float:
    """Return the width of a pixel over its height (sample aspect ratio); 1 if the file states none."""
    return float(stream.sample_aspect_ratio or 1)


def _number(text: str) -> str:
    """Return a number from a container's metadata without trailing zeros, and anything else as it stands."""
    try:
        return f"{float(text):g}"
    except ValueError:
        return repr(text)


@dataclass
class Packets:
    """The displayed packets of a stream: time stamps and positions in the file; and how the stream ends."""

    stamps: list[int] = field(default_factory=list)
    positions: list[int | None] = field(default_factory=list)
    discarded: int = 0
    breaks_off: str | None = None

    def add(self, packet: av.Packet) -> None:
        """Count a packet; set `breaks_off` if the video ends with it."""
        stamp = packet.pts if packet.pts is not None else packet.dts
        if packet.is_corrupt:
            self.breaks_off = "the last frame is cut"
        elif packet.is_discard:
            self.discarded += 1
        elif stamp is None:
            self.breaks_off = f"frame {len(self.stamps)} has no time stamp"
        else:
            self.stamps.append(int(stamp))
            self.positions.append(packet.pos)


def _packets(
    container: av.container.InputContainer, stream: av.VideoStream
) -> tuple[Packets, av.VideoFrame | None]:
    """Return the packets of a stream, and its first frame; None if that cannot be decoded."""
    packets = Packets()
    frames: list[av.VideoFrame] = []
    decodes = True
    try:
        for packet in container.demux(stream):
            if packet.size:
                packets.add(packet)
            if decodes and not frames:
                try:
                    frames = stream.decode(packet)
                except av.FFmpegError as error:
                    reason(error)
                    decodes = False  # decoding will report it
            if packets.breaks_off:
                break
    except av.FFmpegError as error:
        packets.breaks_off = reason(error)
    return packets, frames[0] if frames else None


def _avi_index_ticks(stream: av.VideoStream, packets: Packets) -> list[int] | None:
    """Return the time stamps of an AVI's packets from their positions in its index, if frames are missing.

    FFmpeg numbers an AVI's frames as it finds them: after a damaged one, all would be one frame early.
    """
    if packets.breaks_off or stream.container.format.name != "avi" or len(packets.stamps) >= stream.frames:
        return None
    known = {entry.pos + AVI_CHUNK_HEADER: number for number, entry in enumerate(stream.index_entries)}
    if len(known) != stream.frames or not all(position in known for position in packets.positions):
        return None
    return [known[position] for position in packets.positions]


def _promised_frames(container: av.container.InputContainer, stream: av.VideoStream) -> int:
    """Return duration times rate for containers (mkv) that store no frame count; 0 if unknown."""
    if container.format.name == "cine":
        return int(stream.duration or 0)
    rate = stream.average_rate
    if container.duration is None or not rate:
        return 0
    return int(container.duration / av.time_base * float(rate) + 0.5)


def _with_camera_times(contents: Contents, path: str | Path) -> Contents:
    """Use the camera's own time stamps, which a cine contains beside its nominal rate; name its flips."""
    import numpy as np  # here: the process that decodes other videos does without

    contents = replace(contents, camera_clock=True, notes=contents.notes + cine_flips(path))
    times = cine_times_ns(path)
    if times is None or len(times) != len(contents.ticks) or len(times) < 2:
        return contents
    steps = np.diff(times)
    if steps.min() <= 0 or steps.sum() > LONGEST_SPAN * len(steps) * np.median(steps):
        worst = int(np.abs(steps - np.median(steps)).argmax())
        contents.notes.append(
            f"the camera's time stamps jump by {steps[worst] / 1e9:.4g} s after frame {worst}: "
            "its nominal rate is used"
        )
        return contents
    return replace(contents, ticks=times, time_base_s=1e-9)


def _notes_on_first_frame(frame: av.VideoFrame, color_range: int, path: str | Path) -> list[str]:
    notes = []
    if frame.rotation:
        notes.append(f"its header requests a rotation by {frame.rotation} degrees, which is not applied")
    if frame.format.name in LUMA_8BIT and not is_full_range(frame.format.name, color_range):
        plane = luma(upright(frame, Path(path)))
        beyond = float(((plane < BLACK) | (plane > WHITE)).mean())
        if beyond > BEYOND_SHARE:
            notes.append(
                f"{100 * beyond:.0f} % of its pixels are beyond the limited range that its header states "
                f"({BLACK} to {WHITE}): they are clipped"
            )
    return notes


@contextmanager
def open_source(path: str | Path, threads: int, frames: int | None) -> Iterator[Source]:
    """Open a video for one sequential decoding pass, of the first `frames` frames if given.

    Raises
    ------
    StrandcastError
        As `open_container`; while iterating SC-V008 the data end in damage, SC-V009 a frame without time
        stamp or of another size, SC-V010 an unsupported pixel format.
    """
    with open_container(path) as opened:
        context = opened.stream.codec_context
        if threads != 1:
            opened.stream.thread_type = "AUTO"
        context.thread_count = threads
        name = context.format.name
        to_grey, max_level = grey_converter(name, int(context.color_range), Path(path))
        info = VideoInfo(
            *(Path(path), context.width, context.height, context.name, name, max_level),
            pixel_aspect=_pixel_aspect(opened.stream),
        )
        as_it_is = plain_luma if is_full_range(name, int(context.color_range)) else Source.as_it_is
        yield Source(info, _frames(opened, info, frames), to_grey, opened.messages, as_it_is)


def _frames(
    opened: OpenContainer, info: VideoInfo, limit: int | None
) -> Iterator[tuple[float, av.VideoFrame]]:
    count, time_base = 0, opened.stream.time_base
    try:
        for frame in _decode(opened, limit):
            if frame.pts is None or (frame.width, frame.height) != (info.width, info.height):
                what = f"frame {count} has no time stamp or another size ({frame.width} x {frame.height})"
                raise StrandcastError("SC-V009", what, file=info.path, exit_code=INTEGRITY)
            yield float(frame.pts * time_base), upright(frame, info.path)
            count += 1
    except av.FFmpegError as error:
        what = f"the video breaks off after {count} frames ({reason(error)})"
        raise damaged("SC-V008", what, info.path, cost="the rest of the throw is missing") from None


def _decode(opened: OpenContainer, limit: int | None) -> Iterator[av.VideoFrame]:
    """Yield all frames in order of display, or the first `limit` before a cut."""
    if limit is None:
        yield from opened.container.decode(opened.stream)
        return
    whole = itertools.chain(_whole_packets(opened), [None])  # None: the frames still in the decoder
    yield from itertools.islice((frame for packet in whole for frame in opened.stream.decode(packet)), limit)


def _whole_packets(opened: OpenContainer) -> Iterator[av.Packet]:
    """Yield the packets before the first that is cut."""
    try:
        for packet in opened.container.demux(opened.stream):
            if packet.size == 0 or packet.is_corrupt:
                return
            yield packet
    except av.FFmpegError as error:
        reason(error)
