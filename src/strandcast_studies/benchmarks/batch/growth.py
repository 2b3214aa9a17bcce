"""How tracking grows with frames and pixels, and the string's kernel with points and cores: docs/scaling.md.

    python -m strandcast_studies.benchmarks.batch.growth

A film of the video benchmark is played forth and back, and made larger or smaller, with its camera. Each one
is tracked in a process of its own. How an engine grows with trials: `make bench-batch`.
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from strandcast import threads
from strandcast.arm.load import load_arm
from strandcast.core.strings import StringBatch
from strandcast.dynamics.batch import HandPath
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.simulate import simulate_batch
from strandcast.lab.video import write_video
from strandcast.records.camera import Camera
from strandcast.video.reader import open_video
from strandcast_studies.benchmarks.batch.accounts import accounts_of
from strandcast_studies.benchmarks.simulation.swing import CAST, COMMON_S, LENGTH_M, knots, table_2
from strandcast_studies.benchmarks.simulation.timing import Timing, timed
from strandcast_studies.benchmarks.video.cases import FRAME_RATE_HZ, VideoCase, held_out
from strandcast_studies.benchmarks.video.scenes import ARM_FILE, film_case
from strandcast_studies.benchmarks.video.score import track_case

FILMS = ((1, 1.0), (4, 1.0), (16, 1.0), (1, 0.5), (1, 2.0))  # how often they are played, and their size
POINTS, STRINGS, REPEATS = (10, 20, 40, 100), 64, 3
ENCODER = {"preset": "ultrafast", "qp": "24", "threads": "1"}


def scaled(camera: Camera, scale: float) -> Camera:
    """Return the camera of pictures that are so many times as large."""
    matrix = np.array(camera.lens.matrix)
    matrix[:2, :2], matrix[:2, 2] = scale * matrix[:2, :2], scale * (matrix[:2, 2] + 0.5) - 0.5
    sides = {name: round(scale * getattr(camera.lens, name)) for name in ("width_px", "height_px")}
    lens = camera.lens.model_copy(update=sides | {"matrix": matrix.tolist()})
    return camera.model_copy(update={"lens": lens, "scale_m_per_px": camera.scale_m_per_px / scale})


def film(case: VideoCase, work: Path, times: int, scale: float) -> Path:
    """Return a folder with a case's film, played so often forth and back, and scaled, and its camera."""
    folder = film_case(case, load_arm(ARM_FILE).planar(), work)
    made = work / f"{times}x{scale:g}"
    made.mkdir()
    (made / "case.json").write_bytes((folder / "case.json").read_bytes())
    camera = scaled(Camera.read(folder / "camera.json"), scale)
    camera.write(made / "camera.json")
    size_px = camera.lens.width_px, camera.lens.height_px
    with open_video(folder / "video.mp4") as video:
        kept = [cv2.resize(grey, size_px) for _, _, grey in video]
    frames = (image for number in range(times) for image in (kept if number % 2 == 0 else kept[::-1]))
    write_video(made / "video.mp4", frames, size_px[0], size_px[1], FRAME_RATE_HZ, ENCODER)
    return made


def tracked(work: Path) -> Iterator[str]:
    """Yield a line for each film: its frames and pixels, and what tracking it takes."""
    case, command = held_out()[1], [sys.executable, "-m", __spec__.name, "--track"]
    for times, scale in FILMS:
        folder = film(case, work, times, scale)
        for _ in range(2 if (times, scale) == FILMS[0] else 1):  # kernels are compiled the first time
            spent = accounts_of([*command, str(folder)], work, work / "spent")
        with open_video(folder / "video.mp4") as video:
            frames, mpx = sum(1 for _ in video), 1e-6 * video.info.width * video.info.height
        cost = f"{1e3 * spent.cpu_s / frames:6.1f} CPU ms a frame, {spent.peak_mb:5.0f} MB"
        yield f"{frames:6} frames of {mpx:.2f} Mpx: {cost}"


def simulated() -> Iterator[str]:
    """Yield a line for each number of points and cores: what a second of a string takes."""
    parameters, hand = table_2(STRINGS, 1), HandPath(*knots(CAST))

    def spent(points: int) -> Timing:
        strings = StringBatch(parameters, np.ones((STRINGS, points)))
        model = StringModel(LENGTH_M, points)
        return timed(lambda: simulate_batch(model, strings, hand, COMMON_S), REPEATS).per(STRINGS)

    for points in POINTS:
        yield f"{points:6} points: {1e3 * spent(points).cpu.value:6.2f} CPU ms for a second of a string"
    for cores in (1, os.cpu_count() or 1):
        os.environ["NUMBA_NUM_THREADS"] = str(cores)
        threads.use_environment()
        yield f"{cores:6} cores: {1e3 * spent(20).wall.value:6.2f} ms of wall time for a second of a string"


def main(arguments: list[str] | None = None) -> None:
    """Run the benchmark from the command line, or track one film."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--track", type=Path, help="track the film in this folder")
    chosen = parser.parse_args(arguments)
    if chosen.track:
        track_case(chosen.track, load_arm(ARM_FILE).planar())
        return
    with tempfile.TemporaryDirectory(prefix="strandcast-growth-") as folder:
        for lines in (simulated(), tracked(Path(folder))):
            for line in lines:
                print(line, flush=True)


if __name__ == "__main__":
    main()
