"""The loop in space by files and commands alone: the cases of `run` as experiments of the lab.

    python -m strandcast_studies.benchmarks.space.by_files FOLDER --seeds 7002-7004,7006

makes a project of each seed in FOLDER, runs it, and prints the misses of its throws. The cases, the scatter's
sizes and the budget are those of `run`; random numbers, and the direction of the string's curl, are others.
"""

import argparse
import subprocess
import sys
from pathlib import Path

from strandcast.records.folders import ExperimentFolder
from strandcast.records.lab_truth import LAB_TRUTH
from strandcast.records.tables import read_facts
from strandcast.workflow.project import make_project
from strandcast_studies.benchmarks.loop.run import numbers
from strandcast_studies.benchmarks.space.drawn import SpaceCase, drawn_case

NAME = "cast"
BUDGET = """\
plan: {evaluations: 1800, duration_s: [0.4, 1.3]}
estimate: {evaluations: 800}
"""


def make_experiment(root: Path, case: SpaceCase, more: str = BUDGET) -> None:
    """Make a project and the experiment of a case."""
    make_project(root)
    string = case.string
    weights = ", ".join(f"{{place_m: {place:g}, mass_kg: {mass!r}}}" for place, mass in string.weights)
    own = ("linear_density_kg_m", "bending_stiffness_n_m2", "curl_rad_m", "diameter_m")
    values = ", ".join(f"{name}: {getattr(string, name)!r}" for name in own)
    file = ExperimentFolder(root, NAME).data / "experiment.yaml"
    file.parent.mkdir(parents=True)
    file.write_text(
        f"string: {{length_m: {case.whole_length_m():g}, weights: [{weights}]}}\n"
        f"arm: {case.arm.name}\ntarget_m: {case.target_m.tolist()}\n"
        f"lab: {{servo: {case.servo}, string: {{{values}}}}}\n{more}",
        encoding="utf-8",
    )


def strandcast(root: Path, *words: str) -> str:
    """Run a command in a project and return what it prints."""
    line = [sys.executable, "-m", "strandcast", *words]
    done = subprocess.run(line, cwd=root, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"strandcast {' '.join(words)}: {done.stderr}")
    return done.stdout


def true_misses_m(root: Path) -> list[float]:
    """Return the true misses of the throws of a project [m]."""
    folder = ExperimentFolder(root, NAME)
    paths = [folder.trial(number).results / "lab_truth.parquet" for number in folder.reported_trials()]
    return [read_facts(path, LAB_TRUTH)["miss_m"] for path in paths]


def main(arguments: list[str] | None = None) -> None:
    """Run the seeds one after another; print the misses of each as soon as they are known."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=numbers, required=True, help="e.g. 7002-7004,7006")
    parser.add_argument("--trials", type=int, default=3)
    options = parser.parse_args(arguments)
    for seed in options.seeds:
        root = options.folder / str(seed)
        make_experiment(root, drawn_case(seed), f"{BUDGET}max_trials: {options.trials}\nseed: {seed}\n")
        strandcast(root, "run", NAME)
        print(seed, ", ".join(f"{1e3 * miss_m:.1f} mm" for miss_m in true_misses_m(root)), flush=True)


if __name__ == "__main__":
    main()
