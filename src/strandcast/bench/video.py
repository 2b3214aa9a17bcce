"""Measure the tracker and its peers on filmed throws, and write `results/bench-video.json` and its page.

    python -m strandcast.bench.video [--quick] [--work DIR] [--out FILE]

What is measured, and how, is told in docs/tracking-benchmark.md.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.arm.load import Arm, load_arm
from strandcast.bench import video_cases
from strandcast.bench.video_cases import Case
from strandcast.bench.video_page import Filmed, PeerScore, Results, page
from strandcast.bench.video_peers import run_peers
from strandcast.bench.video_pictures import picture, write_picture
from strandcast.bench.video_scenes import ARM_FILE, film_case
from strandcast.bench.video_score import TARGETS, Score, errors_of, save_track, score, track_case
from strandcast.bench.video_speed import CODECS, Speed, measure
from strandcast.bench.video_truth import Truth
from strandcast.records.files import write_text

REPEATS = 5


def run(cases: list[Case], speed_case: Case, repeats: int, work: Path, pictures: Path) -> Results:
    """Film, track and score the cases, run the peers on them, and time the pass on `speed_case`."""
    arm = load_arm(ARM_FILE)
    results = Results([], [], [], [], {}, machine())
    for case in cases:
        _say(f"{case.name} …")
        folder = film_case(case, arm, work)
        truth = Truth.read(folder)
        results.filmed.append(filmed(case, truth))
        own = track_and_picture(folder, truth, arm, pictures / f"{case.name}.webp")
        results.scores.append(own)
        results.pictures[case.name] = f"{pictures.name}/{case.name}.webp"
        for name, track in run_peers(folder, arm).items():
            results.peers.append(PeerScore(name, score(case.name, truth, track, track.cpu_s), track.failed))
    results.speeds.extend(speeds(speed_case, arm, work, repeats))
    return results


def track_and_picture(folder: Path, truth: Truth, arm: Arm, image: Path) -> Score:
    """Track a filmed video, draw its worst frame, and return its score."""
    tracked, cpu_s = track_case(folder, arm)
    save_track(folder, tracked)
    found = score(folder.name, truth, tracked, cpu_s)
    errors = errors_of(truth, tracked)
    write_picture(image, picture(folder / "video.mp4", truth, tracked, errors, found.worst_frame))
    return found


def filmed(case: Case, truth: Truth) -> Filmed:
    """Tell what a video is like."""
    arrays = truth.arrays
    low, middle = np.percentile(arrays.cnr, [5, 50])
    return Filmed(
        case=case,
        frames=len(arrays.hand),
        cnr=float(middle),
        cnr_low=float(low),
        blur_px=float(arrays.blur_px.max()),
        tip_blur_px=float(arrays.tip_blur_px.max()),
        tip_speed_m_s=float(arrays.tip_speed_m_s.max()),
        crossing_frames=len({crossing.frame for crossing in truth.crossings}),
    )


def speeds(case: Case, arm: Arm, work: Path, repeats: int) -> Iterator[Speed]:
    """Time the pass on a file of each codec."""
    for codec in CODECS:
        _say(f"speed on {codec.name} …")
        yield measure(case, arm, work, codec, repeats)


def machine() -> dict[str, str]:
    """Tell what ran, and on what."""
    packages = ("strandcast", "numba", "numpy", "opencv-contrib-python-headless", "av", "scikit-image")
    return {
        "processor": platform.processor() or platform.machine(),
        "cores": str(os.cpu_count()),
        "Python": platform.python_version(),
        **{package: version(package) for package in packages},
    }


def as_json(results: Results) -> str:
    """Return the results as JSON; a number that could not be had is null."""
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


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def main(arguments: list[str] | None = None) -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(prog="python -m strandcast.bench.video", description=str(__doc__))
    parser.add_argument("--quick", action="store_true", help="one short video: whether it runs")
    parser.add_argument(
        "--work", type=Path, help="folder that keeps the videos, some 3 GB; by default none does"
    )
    parser.add_argument("--only", help="only the videos whose names hold one of these, parted by commas")
    parser.add_argument("--out", type=Path, default=Path("results/bench-video.json"))
    chosen = parser.parse_args(arguments)
    cases = video_cases.quick() if chosen.quick else video_cases.held_out()
    if chosen.only:
        cases = [case for case in cases if any(part in case.name for part in chosen.only.split(","))]
    speed_case = cases[0] if chosen.quick else video_cases.speed()
    with tempfile.TemporaryDirectory() as kept_for_now:
        results = run(
            cases,
            speed_case,
            1 if chosen.quick else REPEATS,
            chosen.work or Path(kept_for_now),
            chosen.out.with_suffix(""),
        )
    write_text(chosen.out, as_json(results))
    write_text(chosen.out.with_suffix(".md"), page(results))
    print(f"written: {chosen.out} and {chosen.out.with_suffix('.md')}")


if __name__ == "__main__":
    main()
