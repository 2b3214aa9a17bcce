"""What tracking costs beside decoding alone, on the same file in the same run."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from strandcast.arm.load import Arm
from strandcast.bench.timing import Spread, spread
from strandcast.bench.video_cases import FRAME_RATE_HZ, Case
from strandcast.bench.video_scenes import SIZE_PX, film_case, shoot
from strandcast.bench.video_score import cpu_s, hand_markers, track_case
from strandcast.lab.video import FULL_RANGE, full_range_frame
from strandcast.records.camera import Camera
from strandcast.tracking.hand import HandFinder
from strandcast.video.reader import open_video


@dataclass(frozen=True)
class Codec:
    """How a file is made: the encoder's name and options, its pixels, the container's ending."""

    name: str
    encoder: str
    pixels: str
    suffix: str
    options: dict[str, str]
    least_share: float  # of the bare decoder's frames/s that the whole pass must reach


CODECS = (
    Codec("H.264 qp 18", "libx264", "yuv420p", ".mp4", {"preset": "medium", "qp": "18", "threads": "1"}, 0.8),
    Codec("MJPEG q 3", "mjpeg", "yuvj420p", ".avi", {"qmin": "3", "qmax": "3"}, 0.5),
)


@dataclass(frozen=True)
class Speed:
    """Costs on one file; CPU in ms per frame, all threads together, rates in frames/s of wall time.

    Attributes
    ----------
    codec, frames, megabits_s
        The file; its bitrate at the camera's frame rate.
    bare_cpu_ms, bare_rate
        PyAV with one thread, every frame's luma touched.
    markers_cpu_ms
        Finding the hand in frames that are decoded already.
    pass_cpu_ms, pass_rate
        Integrity, decoding, markers and tracking, as the stage runs them.
    tracking_cpu_ms
        What is left of the pass without the bare decoder and the markers: crops, background, the tracker
        forward and backward.
    rate_share
        Of the bare decoder's frames/s that the pass reaches, in wall time.
    share_on_two_cores
        The same if the pass's CPU time were spread evenly over two free cores: an upper bound.
    load
        Processes that wanted a core, on average over the last minute, before and after.
    """

    codec: str
    frames: int
    megabits_s: float
    bare_cpu_ms: Spread
    bare_rate: Spread
    markers_cpu_ms: Spread
    pass_cpu_ms: Spread
    pass_rate: Spread
    tracking_cpu_ms: Spread
    rate_share: Spread
    share_on_two_cores: Spread
    load: tuple[float, float]


def measure(case: Case, arm: Arm, work: Path, codec: Codec, repeats: int) -> Speed:
    """Measure a codec's file, the bare decoder and the pass in turns, after one turn that is not counted."""
    folder = film_case(case, arm, work)
    path = folder / f"{codec.encoder}{codec.suffix}"
    if not path.exists():
        encode(path, shoot(case, arm).frames(case), codec)
    markers = Markers(Camera.read(folder / "camera.json"), arm, path)
    runs: dict[str, Callable[[], int]] = {
        "bare": lambda: decode_bare(path),
        "markers": markers.find,
        "pass": lambda: track_case(folder, arm, path)[0].decoded_frames,
    }
    before = os.getloadavg()[0]
    turns = [{name: _timed(run) for name, run in runs.items()} for _ in range(repeats + 1)][1:]
    count = len(markers.frames)
    cpu = {name: np.array([turn[name][0] for turn in turns]) * 1e3 / count for name in runs}
    wall = {name: np.array([turn[name][1] for turn in turns]) for name in runs}
    return Speed(
        codec=codec.name,
        frames=count,
        megabits_s=8e-6 * path.stat().st_size * FRAME_RATE_HZ / count,
        bare_cpu_ms=_spread(cpu["bare"]),
        bare_rate=_spread(count / wall["bare"]),
        markers_cpu_ms=_spread(cpu["markers"]),
        pass_cpu_ms=_spread(cpu["pass"]),
        pass_rate=_spread(count / wall["pass"]),
        tracking_cpu_ms=_spread(cpu["pass"] - cpu["bare"] - cpu["markers"]),
        rate_share=_spread(wall["bare"] / wall["pass"]),
        share_on_two_cores=_spread(2.0 * cpu["bare"] / cpu["pass"]),
        load=(before, os.getloadavg()[0]),
    )


def _spread(values: np.ndarray) -> Spread:
    return spread(values.tolist())


def _timed(run: Callable[[], int]) -> tuple[float, float]:
    """Return CPU and wall time [s] of a run that handles some frames."""
    cpu_0, wall_0 = cpu_s(), time.perf_counter()
    handled = run()
    taken = cpu_s() - cpu_0, time.perf_counter() - wall_0
    assert handled > 0
    return taken


def decode_bare(path: Path) -> int:
    """Decode a file with one thread, touch every frame's luma, and return the number of frames."""
    count = 0
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        stream.codec_context.thread_count = 1
        for frame in container.decode(stream):
            count += np.frombuffer(frame.planes[0], np.uint8).size > 0
    return count


class Markers:
    """The hand's markers in the frames of a file, which are kept in memory."""

    def __init__(self, camera: Camera, arm: Arm, path: Path) -> None:
        self.camera = camera
        self.arm = arm
        with open_video(path) as video:
            self.frames = [grey.copy() for _, _, grey in video]

    def find(self) -> int:
        """Find the hand in all frames; return their number."""
        finder = HandFinder(
            self.camera, hand_markers(self.arm), self.arm.marker_dictionary, self.camera.string_offset_m
        )
        for frame in self.frames:
            finder.find(frame)
        return len(self.frames)


def encode(path: Path, frames: Iterable[np.ndarray], codec: Codec) -> None:
    """Write frames (H, W) uint8 with a codec."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec.encoder, rate=Fraction(int(FRAME_RATE_HZ)))
        stream.width, stream.height = SIZE_PX
        stream.pix_fmt = codec.pixels
        stream.codec_context.color_range = FULL_RANGE
        if "qmin" in codec.options:
            stream.codec_context.qmin = int(codec.options["qmin"])
            stream.codec_context.qmax = int(codec.options["qmax"])
        stream.codec_context.options = codec.options
        for index, grey in enumerate(frames):
            container.mux(stream.encode(full_range_frame(grey, index, codec.pixels)))
        container.mux(stream.encode(None))
