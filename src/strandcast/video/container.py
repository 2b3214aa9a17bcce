"""Videos in containers (mp4, mov, avi, mkv, Phantom's cine ...), read with FFmpeg's libraries."""

import itertools
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from statistics import median

import av

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.video.cine import cine_flips, clock_of_images_ns
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

AVI_CHUNK_HEADER = 8  # bytes between the position in the index and the packet's
# Bytes of the length before each part of a packet in mp4 and mov: a packet of that size holds no picture.
PREFIX_BYTES = 4
TRAILER_BYTES = 1 << 16  # chosen: of a phone's own data after the film, which are some kilobytes
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
            promised=exact or _promised_frames(container, stream, sorted(packets.stamps)),
            exact=exact > 0,
            discarded=packets.discarded,
            breaks_off=packets.breaks_off,
            several_rates=_several_rates(path),
        )
        # Phones that export slow motion at 30 frames/s write the true rate here.
        rate = container.metadata.get("com.android.capture.fps")
        aspect = _pixel_aspect(stream)
        streams = container.streams.video
        notes = [] if first is None else _notes_on_first_frame(first, int(context.color_range), path)
        if len(streams) > 1:
            contents.notes.append(
                f"it contains {len(streams)} video streams: stream {stream.index} "
                f"({contents.width_px} x {contents.height_px}, {len(contents.ticks)} frames) is used"
            )
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


def _several_rates(path: str | Path) -> str | None:
    """Return what a Samsung phone's trailer says of super slow motion, which time stamps do not show."""
    with Path(path).open("rb") as file:
        file.seek(max(0, file.seek(0, 2) - TRAILER_BYTES))
        trailer = file.read()
    if not (trailer.endswith(b"SEFT") and b"SuperSlowMotion" in trailer):
        return None
    return (
        "the phone's data at its end mark super slow motion: parts were filmed at other rates than they play"
    )


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
        """Count a packet; set `breaks_off` if the video ends with it.

        An AVI has no times but the order of its packets: where some are empty, FFmpeg guesses the
        presentation times of H.264 wrongly.
        """
        in_avi = packet.stream.container.format.name == "avi"
        stamp = packet.dts if packet.pts is None or (in_avi and packet.dts is not None) else packet.pts
        if packet.is_corrupt:
            self.breaks_off = "the last frame is cut"
        elif packet.is_discard or _is_empty(packet):
            self.discarded += 1
        elif stamp is None:
            self.breaks_off = f"frame {len(self.stamps)} has no time stamp"
        else:
            self.stamps.append(int(stamp))
            self.positions.append(packet.pos)


def _is_empty(packet: av.Packet) -> bool:
    """Return whether a packet marks a lost frame, as action cameras write it: an empty length."""
    context = packet.stream.codec_context
    prefixed = context.name in ("h264", "hevc") and (context.extradata or b"")[:1] == b"\x01"
    return prefixed and 0 < packet.size <= PREFIX_BYTES


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
            if decodes and not frames and not _is_empty(packet):
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


def _promised_frames(
    container: av.container.InputContainer, stream: av.VideoStream, stamps: list[int]
) -> int:
    """Return the frames of containers (mkv) that store only a duration; 0 if unknown.

    The stated rate of such a file may be a guess from its first rounded time stamps: the frames' own steps
    say how many would follow the last one.
    """
    if container.format.name == "cine":
        return int(stream.duration or 0)
    rate = stream.average_rate
    if container.duration is None or not rate:
        return 0
    duration_s = container.duration / av.time_base
    steps = [after - before for before, after in pairwise(stamps) if after > before]
    if not steps:
        return int(duration_s * float(rate) + 0.5)
    step = median(steps)
    # Matroska's duration is that from 0, not from the first frame.
    first = 0.0 if "matroska" in container.format.name else max(container.start_time or 0, 0) / av.time_base
    left_s = duration_s - (float(stream.time_base) * (stamps[-1] + step) - first)
    return len(stamps) + max(0, int(left_s / (float(stream.time_base) * step) + 0.5))


def _with_camera_times(contents: Contents, path: str | Path) -> Contents:
    """Use the camera's own time stamps, which a cine contains beside its nominal rate; name its flips."""
    contents = replace(contents, camera_clock=True, notes=contents.notes + cine_flips(path))
    times, jump = clock_of_images_ns(path, len(contents.ticks))
    contents.notes.extend([] if jump is None else [jump])
    return contents if times is None else replace(contents, ticks=times, time_base_s=1e-9)


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
        As `open_container`; while iterating SC-V005 the data end in damage, SC-V010 a frame without time
        stamp, of another size or an unsupported pixel format.
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
    cine = opened.container.format.name == "cine"
    times = clock_of_images_ns(info.path, int(opened.stream.duration or 0))[0] if cine else None
    try:
        for frame in _decode(opened, limit):
            stamp = frame.pts if frame.pts is not None else frame.dts
            if stamp is None or (frame.width, frame.height) != (info.width, info.height):
                what = f"frame {count} has no time stamp or another size ({frame.width} x {frame.height})"
                raise StrandcastError("SC-V010", what, file=info.path, exit_code=INTEGRITY)
            yield (
                float(stamp * time_base) if times is None else 1e-9 * times[count],
                upright(frame, info.path),
            )
            count += 1
    except av.FFmpegError as error:
        what = f"the video breaks off after {count} frames ({reason(error)})"
        raise damaged("SC-V005", what, info.path, cost="the rest of the throw is missing") from None


def _decode(opened: OpenContainer, limit: int | None) -> Iterator[av.VideoFrame]:
    """Yield all frames in order of display, or the first `limit` before a cut."""
    packets = opened.container.demux(opened.stream) if limit is None else _whole_packets(opened)
    # Without a limit, demuxing ends with the empty packet that flushes the decoder.
    flushed = packets if limit is None else itertools.chain(packets, [None])
    frames = (
        frame
        for packet in flushed
        if packet is None or not _is_empty(packet)
        for frame in opened.stream.decode(packet)
    )
    yield from itertools.islice(frames, limit)


def _whole_packets(opened: OpenContainer) -> Iterator[av.Packet]:
    """Yield the packets before the first that is cut."""
    try:
        for packet in opened.container.demux(opened.stream):
            if packet.size == 0 or packet.is_corrupt:
                return
            yield packet
    except av.FFmpegError as error:
        reason(error)
