"""Snakemake started for the user: the command is shown, and the end is told in one table."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from itertools import groupby
from pathlib import Path

from strandcast.errors import ENVIRONMENT, FAILED_TRIALS, StrandcastError
from strandcast.experiment import find_experiment
from strandcast.layout import VIDEO_SUFFIXES, trial_name
from strandcast.paper.cases import Case
from strandcast.records.paper import PaperRun, PaperSummary
from strandcast.records.summary import Summary

SMALL_TALK = (
    *(
        "Using workflow specific profile",
        "Assuming unrestricted",
        "Building DAG",
        "Using shell",
        "Singularity",
    ),
    *(
        "Select jobs",
        "Execute ",
        "Complete log",
        "Elapsed time",
        "DAG of jobs will be updated",
        "Updating checkpoint",
    ),
)
LOCKED = """Another run works in this folder, or one was killed here.
        Fix: wait for it; if there is none: snakemake --unlock"""


def command(experiments: list[str], cores: int) -> list[str]:
    """Return the Snakemake command line that makes the reports of experiments."""
    targets = [f"results/{name}/report.html" for name in experiments]
    profile = ["--workflow-profile", "workflow/profiles/default"]
    return ["snakemake", *targets, "--cores", str(cores), *profile, "--quiet", "rules", "progress", "host"]


def paper_command(form: str, cores: int) -> list[str]:
    """Return the Snakemake command line that makes the paper's page from the runs that there are."""
    line = command([], cores)
    return [
        line[0],
        f"results/{form}/report.html",
        *line[1:],
        "--forcerun",
        "paper",
        "--allowed-rules",
        "paper",
        "transfer",
    ]


def own_experiments(root: Path) -> list[str]:
    """Return the experiments under data/, which are run where none are named."""
    return sorted(path.parent.name for path in root.glob("data/*/experiment.yaml")) or ["demo"]


def run_experiments(root: Path, experiments: list[str], cores: int) -> int:
    """Run Snakemake and tell how it went; returns the exit code."""
    _refuse_elsewhere(root)
    for name in experiments:
        find_experiment(name, root)
    code = _run(command(experiments, cores), root)
    for name in experiments or own_experiments(root):
        summary = root / "results" / name / "summary.json"
        if code == 0 and summary.is_file():
            print(table(Summary.read(summary), root / "results" / name / "report.html"))
            files = sorted((root / "data" / name).glob("trial-*/video.*"))
            films = [file for file in files if file.suffix.lower() in VIDEO_SUFFIXES]
            print("".join(f"  film:   {film}\n" for film in films), end="")
    return code


def run_paper(root: Path, cases: list[Case], cores: int, page_only: bool = False) -> int:
    """Make the runs of the paper's experiment seed by seed, then its page from all that there is.

    A run that fails stops no other; the page tells its reason. What is done already is not done again.

    Returns
    -------
    The exit code: 0, or 1 if a run did not come to its end, or what Snakemake said of the page.
    """
    _refuse_elsewhere(root)
    for _, batch in [] if page_only else groupby(cases, key=lambda case: case.seed):
        # Many runs beside each other use the cores better than the threads of one.
        line = command([case.name for case in batch], cores)
        _run([*line, "--set-threads", "estimate=1", "plan=1"], root)
    form = cases[0].form
    code = _run(paper_command(form, cores), root)
    if code:
        return code
    page = root / "results" / form / "report.html"
    whole = PaperSummary.read(page.with_name("summary.json"))
    print("\n".join([*(_paper_line(run) for run in whole.experiments), f"  report: {page}"]))
    mine = {case.name for case in cases}
    wanting = [run for run in whole.experiments if run.experiment in mine and run.state != "done"]
    return FAILED_TRIALS if wanting else 0


def _paper_line(run: PaperRun) -> str:
    misses = ["–" if trial.miss_m is None else f"{1000 * trial.miss_m:.1f}" for trial in run.trials]
    told = f"hit at trial {run.hit_trial}" if run.hit_trial else "no hit"
    state = "" if run.state == "done" else f"; {run.state}: {run.reason}"
    return f"  {run.experiment}: {told}, misses {', '.join(misses) or '–'} mm{state}"


def _refuse_elsewhere(root: Path) -> None:
    if not (root / "workflow" / "Snakefile").is_file():
        raise StrandcastError(
            "SC-W001",
            "there is no workflow/Snakefile here",
            file=root.resolve(),
            fix="change to the folder that strandcast was cloned into",
            exit_code=ENVIRONMENT,
        )


def _run(line: list[str], root: Path) -> int:
    """Run Snakemake, passing on what it says but for its small talk; returns the exit code."""
    print(shlex.join(line), file=sys.stderr, flush=True)
    # Snakemake lies beside the Python that runs this.
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
    environment = os.environ | {"PATH": path}
    with subprocess.Popen(line, cwd=root, env=environment, stderr=subprocess.PIPE, text=True) as snakemake:
        assert snakemake.stderr is not None
        for words in snakemake.stderr:
            if words.strip() and not words.startswith(SMALL_TALK):
                print(words, end="", file=sys.stderr, flush=True)
            if words.startswith("LockException"):
                print(LOCKED, file=sys.stderr, flush=True)
    return snakemake.returncode


def table(summary: Summary, page: Path) -> str:
    """Return an experiment's trials as lines of text."""
    lines = [f"{summary.experiment}: string of {summary.string_length_m:g} m, target {summary.target_m} m"]
    for trial in summary.trials:
        if trial.excluded is not None:
            lines.append(f"  trial {trial.trial}: excluded ({trial.excluded})")
            continue
        verdict = "HIT " if trial.hit else "miss"
        near = "tip not seen" if trial.miss_m is None else f"{1000 * trial.miss_m:.1f} mm from the target"
        fit = "" if trial.E_m is None else f"; fitted to {1000 * trial.E_m:.1f} mm"
        lines.append(f"  trial {trial.trial}: {verdict} {near}{fit}")
    if summary.next_motion_sha256 is not None:
        following = trial_name(summary.trials[-1].trial + 1 if summary.trials else 1)
        lines.append(f"  next:   {page.parent / following / 'motion.json'}")
    lines.append(f"  report: {page}")
    return "\n".join(lines)
