"""The cost of tracking compared with decoding alone, on the same file in the same run."""

import os
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from strandcast.arm.load import PlanarArm
from strandcast.records.camera import Camera
from strandcast.tracking.hand.finder import HandFinder
from strandcast.video.reader import open_video
from strandcast.video.small import FULL_RANGE, full_range_frame
from strandcast_studies.benchmarks.simulation.timing import Spread, spread
from strandcast_studies.benchmarks.video.cases import FRAME_RATE_HZ, VideoCase
from strandcast_studies.benchmarks.video.scenes import SIZE_PX, film_case, shoot
from strandcast_studies.benchmarks.video.score import cpu_s, track_case


@dataclass(frozen=True)
class Codec:
    """How a file is encoded: encoder and options, pixel format, the container's suffix."""

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

    The pass is integrity, decoding, markers and tracking, as the stage runs them.
    """

    codec: str
    frames: int
    megabits_s: float  # at the camera's frame rate
    bare_cpu_ms: Spread  # PyAV with one thread, every frame's luma touched
    bare_rate: Spread
    markers_cpu_ms: Spread  # finding the hand in decoded frames
    pass_cpu_ms: Spread
    pass_rate: Spread
    tracking_cpu_ms: Spread  # pass less bare decoder and markers: crops, background, tracker both ways
    rate_share: Spread  # frame rate of the pass relative to the bare decoder's, in wall time
    share_on_two_cores: Spread  # the same if two free cores shared the pass's CPU time: an upper bound
    load: tuple[float, float]  # average over the last minute, before and after


def measure(case: VideoCase, arm: PlanarArm, work: Path, codec: Codec, repeats: int) -> Speed:
    """Measure bare decoder, markers and pass in turn on a codec's file, after one uncounted round."""
    folder = film_case(case, arm, work)
    path = folder / f"{codec.encoder}{codec.suffix}"
    if not path.exists():
        encode(path, shoot(case, arm).frames(case), codec)
    camera = Camera.read(folder / "camera.json")
    with open_video(path) as video:
        frames = [grey.copy() for _, _, grey in video]
    runs: dict[str, Callable[[], int]] = {
        "bare": lambda: decode_bare(path),
        "markers": lambda: find_markers(camera, arm, frames),
        "pass": lambda: track_case(folder, arm, path)[0].decoded_frames,
    }
    before = os.getloadavg()[0]
    turns = [{name: _timed(run) for name, run in runs.items()} for _ in range(repeats + 1)][1:]
    count = len(frames)
    cpu = {name: np.array([turn[name][0] for turn in turns]) * 1e3 / count for name in runs}
    wall = {name: np.array([turn[name][1] for turn in turns]) for name in runs}
    return Speed(
        codec=codec.name,
        frames=count,
        megabits_s=8e-6 * path.stat().st_size * FRAME_RATE_HZ / count,
        bare_cpu_ms=spread(cpu["bare"]),
        bare_rate=spread(count / wall["bare"]),
        markers_cpu_ms=spread(cpu["markers"]),
        pass_cpu_ms=spread(cpu["pass"]),
        pass_rate=spread(count / wall["pass"]),
        tracking_cpu_ms=spread(cpu["pass"] - cpu["bare"] - cpu["markers"]),
        rate_share=spread(wall["bare"] / wall["pass"]),
        share_on_two_cores=spread(2.0 * cpu["bare"] / cpu["pass"]),
        load=(before, os.getloadavg()[0]),
    )


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


def find_markers(camera: Camera, arm: PlanarArm, frames: list[np.ndarray]) -> int:
    """Find the hand in all frames; return their number."""
    finder = HandFinder(camera, arm.markers, arm.marker_dictionary, camera.string_offset_m)
    for frame in frames:
        finder.find(frame)
    return len(frames)


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
