"""Measure the tracker and its peers on filmed throws, and write `results/bench-video.json` and its page.

    python -m strandcast_studies.benchmarks.video.run [--quick] [--work DIR] [--out FILE]

See docs/explanation/tracking-benchmark.md for what is measured and how.
"""

import argparse
import json
import math
import os
import platform
import tempfile
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.arm.load import PlanarArm, load_arm
from strandcast.camera.picture_file import write_picture
from strandcast.records.files import write_text
from strandcast_studies.benchmarks.simulation.entries import report_progress
from strandcast_studies.benchmarks.video import cases as video_cases
from strandcast_studies.benchmarks.video.cases import VideoCase
from strandcast_studies.benchmarks.video.page import FilmedVideo, PeerScore, Results, page
from strandcast_studies.benchmarks.video.peers import run_peers
from strandcast_studies.benchmarks.video.pictures import WEBP_QUALITY, picture
from strandcast_studies.benchmarks.video.scenes import ARM_FILE, film_case
from strandcast_studies.benchmarks.video.score import TARGETS, Score, errors_of, save_track, score, track_case
from strandcast_studies.benchmarks.video.speed import CODECS, measure
from strandcast_studies.benchmarks.video.truth import Truth


def run(cases: list[VideoCase], speed_case: VideoCase, repeats: int, work: Path, pictures: Path) -> Results:
    """Film, track and score the cases, run the peers on them, and time the pass on `speed_case`."""
    arm = load_arm(ARM_FILE).planar()
    results = Results([], [], [], [], {}, machine())
    for case in cases:
        report_progress(f"{case.name} …")
        folder = film_case(case, arm, work)
        truth = Truth.read(folder)
        results.filmed.append(filmed(case, truth))
        own = track_and_picture(folder, truth, arm, pictures / f"{case.name}.webp")
        results.scores.append(own)
        results.pictures[case.name] = f"{pictures.name}/{case.name}.webp"
        for name, track in run_peers(folder, arm).items():
            results.peers.append(PeerScore(name, score(case.name, truth, track, track.cpu_s), track.failed))
    for codec in CODECS:
        report_progress(f"speed on {codec.name} …")
        results.speeds.append(measure(speed_case, arm, work, codec, repeats))
    return results


def track_and_picture(folder: Path, truth: Truth, arm: PlanarArm, image: Path) -> Score:
    """Track a filmed video, draw its worst frame, and return its score."""
    tracked, cpu_s = track_case(folder, arm)
    save_track(folder, tracked)
    found = score(folder.name, truth, tracked, cpu_s)
    errors = errors_of(truth, tracked)
    write_picture(
        image, picture(folder / "video.mp4", truth, tracked, errors, found.worst_frame), WEBP_QUALITY
    )
    return found


def filmed(case: VideoCase, truth: Truth) -> FilmedVideo:
    """Return a video's properties."""
    arrays = truth.arrays
    low, middle = np.percentile(arrays.cnr, [5, 50])
    return FilmedVideo(
        case=case,
        frames=len(arrays.hand),
        cnr=float(middle),
        cnr_low=float(low),
        blur_px=float(arrays.blur_px.max()),
        tip_blur_px=float(arrays.tip_blur_px.max()),
        tip_speed_m_s=float(arrays.tip_speed_m_s.max()),
        crossing_frames=len({crossing.frame for crossing in truth.crossings}),
    )


def machine() -> dict[str, str]:
    """Return the processor, the number of cores and the versions."""
    packages = ("strandcast", "numba", "numpy", "opencv-contrib-python-headless", "av", "scikit-image")
    return {
        "processor": platform.processor() or platform.machine(),
        "cores": str(os.cpu_count()),
        "Python": platform.python_version(),
        **{package: version(package) for package in packages},
    }


def as_json(results: Results) -> str:
    """Return the results as JSON; numbers that are not available are null."""
    found = asdict(results)
    found["targets"] = [
        {
            "name": target.name,
            "least": target.least,
            "most": target.most,
            "met": sum(target.met(one) for one in results.scores),
            "of": len(results.scores),
        }
        for target in TARGETS
    ]
    return json.dumps(_finite(found), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def main(arguments: list[str] | None = None) -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=str(__doc__))
    parser.add_argument("--quick", action="store_true", help="one short video, as a test run")
    parser.add_argument(
        "--work", type=Path, help="keep the videos in this folder, about 3 GB; by default they are temporary"
    )
    parser.add_argument("--only", help="only videos whose names contain one of these, separated by commas")
    parser.add_argument("--out", type=Path, default=Path("results/bench-video.json"))
    chosen = parser.parse_args(arguments)
    cases = video_cases.quick() if chosen.quick else video_cases.held_out()
    if chosen.only:
        cases = [case for case in cases if any(part in case.name for part in chosen.only.split(","))]
    speed_case = cases[0] if chosen.quick else video_cases.speed()
    with tempfile.TemporaryDirectory() as kept_for_now:
        repeats, work = 1 if chosen.quick else 5, chosen.work or Path(kept_for_now)
        results = run(cases, speed_case, repeats, work, chosen.out.with_suffix(""))
    write_text(chosen.out, as_json(results))
    write_text(chosen.out.with_suffix(".md"), page(results))
    print(f"written: {chosen.out} and {chosen.out.with_suffix('.md')}")


if __name__ == "__main__":
    main()
