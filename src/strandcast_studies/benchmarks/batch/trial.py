"""What users wait for: one trial from raw files to its page, the demo, the commands that do nothing.

    python -m strandcast_studies.benchmarks.batch.trial --donor data/demo --no-batch

All figures are CPU times (user and system) of a command with all processes that it starts, which depend less
on other load than times of the clock. Where something comparable exists, it is measured in the same run.
"""

import argparse
import importlib.metadata
import json
import os
import re
import statistics
import sys
import tempfile
from collections import defaultdict
from pathlib import Path
from typing import Any, NamedTuple

from strandcast.arm.load import load_arm
from strandcast.core.trial_names import trial_name
from strandcast.packages import installed_version
from strandcast.records.manifest import Manifest
from strandcast.workflow.project import make_project
from strandcast_studies.benchmarks.batch.accounts import accounts_of
from strandcast_studies.benchmarks.batch.project import DONOR, record
from strandcast_studies.benchmarks.batch.run import LARGE, Size, engine_line, run, sizes
from strandcast_studies.benchmarks.loop.run import PROJECT
from strandcast_studies.benchmarks.video.cases import held_out
from strandcast_studies.benchmarks.video.scenes import ARM_FILE
from strandcast_studies.benchmarks.video.score import cpu_s
from strandcast_studies.benchmarks.video.speed import CODECS, decode_bare, measure

STRANDCAST = (sys.executable, "-m", "strandcast")
RECORDED = "batch-001"  # the experiment that `record` makes
EMPTY_RULES = """
rule all:
    input: expand("{n}.txt", n=range(COUNT))
rule one:
    output: "{n}.txt"
    shell: "touch {output}"
"""
BATCHES = "1x10,10x10"  # experiments x trials, from which a thousand trials are extrapolated
REPEATS = 5  # of commands that take a second


class MeasuredCost(NamedTuple):
    """A line of the table: a figure, and that of a peer in the same run."""

    what: str
    figure: float
    unit: str
    peer: str = ""
    peer_figure: float | None = None


def measured_demo(work: Path) -> list[MeasuredCost]:
    """Run the demo in two projects, in the first without compiled kernels."""
    # What follows finds the kernels of the first one; the variable would name this process's own folder.
    os.environ |= {"XDG_CACHE_HOME": str(work / "cache"), "NUMBA_CACHE_DIR": ""}
    rows = []
    for name in ("cold", "second"):
        make_project(work / name)
        spent = accounts_of([*STRANDCAST, "run", DONOR], work / name, work / "accounts.jsonl")
        rows.append(MeasuredCost(f"demo, {name}", spent.cpu_s, "CPU s"))
    return rows


def measured_trial(root: Path, donor: Path) -> list[MeasuredCost]:
    """Make the results of one recorded trial, and once more nothing, in a new project `root`."""
    for project in (root.with_name("compiled"), root):  # in the first one, kernels are compiled
        make_project(project)
        record(project, donor, 1, 1)
        first = accounts_of(engine_line(project, sys.executable), project, project / "accounts.jsonl")
    file = root / "accounts.jsonl"
    again = accounts_of([*STRANDCAST, "run", RECORDED], root, file)
    stages = stages_s(first.processes)
    rest_s = first.cpu_s - sum(stages.values())
    packets = Manifest.read(root / "results" / RECORDED / trial_name(1) / "manifest.json").video.packets
    ms = 1e3 / packets
    before_s = cpu_s()
    decode_bare(root / "data" / RECORDED / trial_name(1) / "video.mp4")
    decoder = "the decoder alone", ms * (cpu_s() - before_s)
    return [
        MeasuredCost("recorded trial", first.cpu_s, "CPU s"),
        *(MeasuredCost(f"  {name}", seconds, "CPU s") for name, seconds in stages.items()),
        MeasuredCost("  engine, starts, imports", rest_s, "CPU s"),
        MeasuredCost("track and film, per frame", ms * stages["track"], "CPU ms", *decoder),
        MeasuredCost("nothing to do, one trial", again.cpu_s, "CPU s", *empty_rules(root, len(stages))),
    ]


def stages_s(processes: list[dict[str, Any]]) -> dict[str, float]:
    """Return the CPU time of each stage without imports that it shares, the dearest first."""
    spent: dict[str, float] = defaultdict(float)
    for one in processes:
        if not one["nested"] and one["line"][:2] == ["-m", "strandcast"]:
            name = next(word for word in one["line"][2:] if word != "stage")
            spent[name] += one["cpu_s"] + one["children_s"] - one["start_s"] - one["imports_s"]
    return dict(sorted(spent.items(), key=lambda item: -item[1]))


def empty_rules(root: Path, count: int) -> tuple[str, float]:
    """Return a name for, and the CPU time of, a Snakemake that has nothing to do for so many empty rules."""
    folder = root / "empty"
    folder.mkdir()
    (folder / "Snakefile").write_text(EMPTY_RULES.replace("COUNT", str(count)), encoding="utf-8")
    line = [sys.executable, "-m", "snakemake", "--cores", "1", "--quiet", "all"]
    _, again = (accounts_of(line, folder, root / "accounts.jsonl") for _ in range(2))
    return "Snakemake, empty rules", again.cpu_s


def measured_commands(root: Path) -> list[MeasuredCost]:
    """Call commands that only look at a project, several times each."""

    def median_s(*line: str) -> float:
        every = [accounts_of(list(line), root, root / "accounts.jsonl").cpu_s for _ in range(REPEATS)]
        return statistics.median(every)

    python = "Python alone", median_s(sys.executable, "-c", "")
    asked = (["--help"], ["status"], ["check", RECORDED])
    return [MeasuredCost(" ".join(words), median_s(*STRANDCAST, *words), "CPU s", *python) for words in asked]


def measured_tracker(work: Path) -> list[MeasuredCost]:
    """Return what a frame costs the tracker, with markers and decoding, beside decoding alone."""
    arm = load_arm(ARM_FILE).planar()
    rows = []
    for codec in CODECS:
        found = measure(held_out()[1], arm, work, codec, repeats=1)
        peer = "the decoder alone", found.bare_cpu_ms.value
        rows.append(MeasuredCost(f"tracker's pass, {codec.name}", found.pass_cpu_ms.value, "CPU ms", *peer))
    return rows


def measured_environment() -> MeasuredCost:
    """Return the size of all packages that strandcast needs to run."""
    lock = (PROJECT / "requirements" / "runtime.lock").read_text(encoding="utf-8")
    names = {*re.findall(r"^([\w.-]+)==", lock, re.MULTILINE)}  # twice where a Python has another version
    here = filter(installed_version, names)  # some are for Windows
    paths = (Path(str(file.locate())) for name in here for file in importlib.metadata.files(name) or ())
    size = sum(each.stat().st_size for each in paths if each.is_file())
    return MeasuredCost("packages to run", size / 1e6, "MB")


def measured_batch(work: Path) -> list[MeasuredCost]:
    """Return what the engine costs for a thousand trials of stages that do nothing."""
    large = run(Size(0, 0), sizes(BATCHES), work, None)["extrapolated"]
    what = f"{LARGE} trials (extrapolated)"
    snakemake = "by Snakemake"
    return [
        MeasuredCost(f"nothing to do, {what}", large["asked_s"], "CPU s", snakemake, large["no_op_s"]),
        MeasuredCost(f"its memory, {what}", large["asked_mb"], "MB", snakemake, large["engine_mb"]),
    ]


def table(rows: list[MeasuredCost]) -> str:
    """Return the rows as text."""
    width = max(len(row.what) for row in rows)
    lines = []
    for row in rows:
        peer = "" if row.peer_figure is None else f"   {row.peer}: {row.peer_figure:.2f}"
        lines.append(f"{row.what:{width}} {row.figure:9.2f} {row.unit}{peer}")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--donor", type=Path, help="data/demo of a project that has run it; no demo is run")
    parser.add_argument("--no-batch", action="store_true", help="leave out a thousand trials")
    parser.add_argument("--out", type=Path, default=Path("results/bench-trial.json"))
    chosen = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="strandcast-trial-") as folder:
        work = Path(folder)
        rows = [] if chosen.donor else measured_demo(work)
        rows += measured_trial(work / "trial", chosen.donor or work / "second" / "data" / DONOR)
        rows += [
            *measured_commands(work / "trial"),
            *measured_tracker(work / "films"),
            measured_environment(),
        ]
        rows += [] if chosen.no_batch else measured_batch(work)
    chosen.out.parent.mkdir(parents=True, exist_ok=True)
    chosen.out.write_text(json.dumps([row._asdict() for row in rows], indent=1) + "\n", encoding="utf-8")
    print(table(rows))


if __name__ == "__main__":
    main()
