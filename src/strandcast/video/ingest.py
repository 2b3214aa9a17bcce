"""What a video's container tells without decoding: packets, time stamps, gaps, hash."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.files import sha256_file
from strandcast.records.manifest import Gap, VideoFacts
from strandcast.video.files import open_container

GAP_FACTOR = 1.5  # neighbours further apart than this many usual intervals have lost frames between them


def inspect_video(path: str | Path, frame_rate_hz: float | None = None) -> VideoFacts:
    """Read the facts of a video file from its packets; nothing is decoded.

    Parameters
    ----------
    path
        The video file.
    frame_rate_hz
        The true frame rate, if the experiment gives it: cameras that export slow motion write another.

    Returns
    -------
    VideoFacts
        ``packets`` and ``time_stamps`` hold what a decoder shows: packets that the container's edit list
        takes out are counted in ``discarded_packets`` instead.

    Raises
    ------
    StrandcastError
        As `strandcast.video.files.open_container`, and SC-V011 fewer than two frames, SC-V012 fewer
        packets than the header promises (the file was cut).
    """
    with open_container(path) as (container, stream):
        stamps, discarded = _packets(container, stream, path)
        promised = int(stream.frames) or _promised_frames(container, stream)
        context = stream.codec_context
        codec, pixel_format = context.name, context.format.name
        size_px = (int(context.width), int(context.height))
        container_name = container.format.name
        time_base = Fraction(stream.time_base)
    _check_count(len(stamps) + discarded, promised, path)
    ticks = np.sort(np.asarray(stamps, dtype=np.int64))
    ticks -= ticks[0]
    measured_hz = 1.0 / (_usual_step(ticks) * float(time_base))
    return VideoFacts(
        file=Path(path).name,
        sha256=sha256_file(path),
        size_bytes=Path(path).stat().st_size,
        container=container_name,
        codec=codec,
        pixel_format=pixel_format,
        width_px=size_px[0],
        height_px=size_px[1],
        header_frames=promised or None,
        packets=len(ticks),
        frame_rate_hz=float(frame_rate_hz or measured_hz),
        frame_rate_source="experiment" if frame_rate_hz else "time stamps",
        time_base_s=float(time_base) * (measured_hz / frame_rate_hz if frame_rate_hz else 1.0),
        time_stamps=ticks.tolist(),
        gaps=_gaps(ticks, measured_hz * float(time_base), frame_rate_hz or measured_hz),
        duplicates=int((np.diff(ticks) == 0).sum()),
        discarded_packets=discarded,
        time_stamp_rate_hz=measured_hz,
    )


def camera_times(facts: VideoFacts) -> np.ndarray:
    """Return the camera time (s) of each frame, from 0 at the first, shape (packets,)."""
    return np.asarray(facts.time_stamps, dtype=np.float64) * facts.time_base_s


def _packets(
    container: av.container.InputContainer, stream: av.VideoStream, path: str | Path
) -> tuple[list[int], int]:
    stamps: list[int] = []
    discarded = 0
    try:
        for packet in container.demux(stream):
            if packet.size == 0:
                continue
            if packet.is_discard:
                discarded += 1
            else:
                stamps.append(packet.pts if packet.pts is not None else packet.dts)
    except av.FFmpegError as error:
        raise StrandcastError(
            "SC-V012", f"the file breaks off after {len(stamps)} frames ({error.strerror})", file=path,
            exit_code=INTEGRITY, fix="copy the file again from the camera") from None  # fmt: skip
    if len(stamps) < 2 or None in stamps:
        raise StrandcastError(
            "SC-V011", f"holds {len(stamps)} frames with a time stamp; at least 2 are needed", file=path,
            exit_code=INTEGRITY, fix="give the recording of the throw")  # fmt: skip
    return stamps, discarded


def _promised_frames(container: av.container.InputContainer, stream: av.VideoStream) -> int:
    """Frames by duration times rate, for containers (mkv) that keep no count; 0 if unknown."""
    rate = stream.average_rate
    if container.duration is None or not rate:
        return 0
    return int(container.duration / av.time_base * float(rate) + 0.5)


def _check_count(packets: int, promised: int, path: str | Path) -> None:
    # A container that states a duration only may be one frame off.
    if promised and packets < promised - 1:
        raise StrandcastError(
            "SC-V012", f"holds {packets} frames of the {promised} that its header promises: it was cut",
            file=path, exit_code=INTEGRITY, cost="the rest of the throw is not seen",
            fix="copy the file again from the camera")  # fmt: skip


def _usual_step(ticks: np.ndarray) -> float:
    """Return the usual spacing of the time stamps, in ticks: the mean of those near the median.

    Time bases are coarse (500 frames/s at 1/16384 s steps by 32 or 33 ticks), so the median alone is not it.
    """
    steps = np.diff(ticks).astype(np.float64)
    median = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
    near = steps[(steps > 0.5 * median) & (steps < GAP_FACTOR * median)]
    return float(near.mean())


def _gaps(ticks: np.ndarray, steps_per_tick: float, rate_hz: float) -> list[Gap]:
    spans = np.diff(ticks) * steps_per_tick
    return [
        Gap(index=int(index), duration_s=float(spans[index] / rate_hz), missing=int(spans[index] + 0.5) - 1)
        for index in np.flatnonzero(spans > GAP_FACTOR)
    ]
