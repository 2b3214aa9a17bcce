"""The loop in space by files and commands alone: plan, play on the lab's arm, import its capture, run.

    python -m strandcast_studies.benchmarks.space.by_files FOLDER --seeds 7002-7004,7006

makes a project of each seed in FOLDER, and prints the misses of its throws. The cases, the scatter of
throws and the budget are those of `run`; the random numbers of searches are others.
"""

import argparse
import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from strandcast.workflow.project import make_project
from strandcast_studies.benchmarks.loop.run import numbers
from strandcast_studies.benchmarks.space.drawn import ARMS, SpaceCase, drawn_case
from strandcast_studies.benchmarks.space.rig import SpaceRig, capture_options, play_motion, write_capture

NAME = "cast"
BUDGET = """\
plan: {screening: 800, evaluations: 1800, duration_s: [0.4, 1.3]}
estimate: {evaluations: 800, ensemble: 8}
"""


class ThrowByFiles(NamedTuple):
    """One throw: its true miss and the one that was scored [m], and what `strandcast run` printed."""

    true_miss_m: float
    miss_m: float | None
    said: str


def make_experiment(root: Path, case: SpaceCase, budget: str = BUDGET) -> None:
    """Make a project with the arms of the cases and the experiment of one."""
    make_project(root)
    shutil.copytree(ARMS, root / "config" / "arms", dirs_exist_ok=True)
    weights = ", ".join(f"{{place_m: {place_m:g}}}" for place_m in case.weight_places_m)
    file = root / "data" / NAME / "experiment.yaml"
    file.parent.mkdir(parents=True)
    file.write_text(
        f"string: {{length_m: {case.whole_length_m():g}, weights: [{weights}]}}\n"
        f"arm: {case.arm.name}\ntarget_m: {case.target_m.tolist()}\n{budget}",
        encoding="utf-8",
    )


def strandcast(root: Path, *words: str) -> str:
    """Run a command in a project and return what it prints."""
    line = [sys.executable, "-m", "strandcast", *words]
    done = subprocess.run(line, cwd=root, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"strandcast {' '.join(words)}: {done.stderr}")
    return done.stdout


def throw_by_files(root: Path, case: SpaceCase, trial: int, random: np.random.Generator) -> ThrowByFiles:
    """Play a trial's planned motion, import its capture, and run the experiment: it plans the next one."""
    folder = f"trial-{trial:02d}"
    rig, results = SpaceRig(case, random), root / "results" / NAME / folder
    motion_s = play_motion(rig, case, results / "motion.json", root / "data" / NAME / folder)
    capture = write_capture(rig, root / f"capture-{trial}.csv")
    strandcast(root, "import", "track", NAME, str(trial), str(capture), *capture_options(case))
    said = strandcast(root, "run", NAME)
    verdict = json.loads((results / "verdict.json").read_text(encoding="utf-8"))
    return ThrowByFiles(rig.true_miss_m(motion_s), verdict["miss_m"], said)


def run_seed(root: Path, seed: int, trials: int) -> list[float]:
    """Rehearse the first motion, and throw until the tip hits; return the true misses [m]."""
    case, misses = drawn_case(seed), []
    make_experiment(root, case)
    strandcast(root, "plan", NAME, "1")
    rig = SpaceRig(case, np.random.default_rng([seed, 10]), empty=True)
    play_motion(
        rig, case, root / "results" / NAME / "trial-01" / "motion.json", root / "data" / NAME / "rehearsal"
    )
    strandcast(root, "plan", NAME, "1")
    for trial in range(1, trials + 1):
        done = throw_by_files(root, case, trial, np.random.default_rng([seed, trial - 1, 9]))
        misses.append(done.true_miss_m)
        if "HIT" in done.said:
            break
    return misses


def main(arguments: list[str] | None = None) -> None:
    """Run the seeds one after another; print the misses of each as soon as they are known."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=numbers, required=True, help="e.g. 7002-7004,7006")
    parser.add_argument("--trials", type=int, default=3)
    options = parser.parse_args(arguments)
    for seed in options.seeds:
        misses = run_seed(options.folder / str(seed), seed, options.trials)
        print(seed, ", ".join(f"{1e3 * miss_m:.1f} mm" for miss_m in misses), flush=True)


if __name__ == "__main__":
    main()
