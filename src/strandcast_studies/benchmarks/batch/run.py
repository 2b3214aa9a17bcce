"""The overhead of a batch of recorded experiments, from raw files to reports, over the stages' own work.

    python -m strandcast_studies.benchmarks.batch.run --size 2x3 --stubbed 1x10,10x10

All figures are CPU times of the processes, which depend less on other load than times of the clock. The
stages of `--size` (experiments x trials) do their work on videos of one throw in the lab. With `--stubbed`
they only write empty files: what is left is the engine; its cost for a thousand trials is extrapolated.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from strandcast.workflow.project import make_project, profile
from strandcast_studies.benchmarks.batch.accounts import Spent, accounts_of, spent_by
from strandcast_studies.benchmarks.batch.project import (
    note_results,
    python_without_stages,
    record,
    record_empty,
    throw_once,
)

LARGE, TEN = 1000, 10  # trials that the targets are of
# Most that is accepted: share of the stages' own work, MB, and CPU seconds.
TARGETS = {"overhead_share": 0.10, "engine_mb": 350.0, "asked_large_s": 10.0, "no_op_ten_s": 3.5}


class Size(NamedTuple):
    """The size of a batch."""

    experiments: int
    trials: int

    @property
    def all_trials(self) -> int:
        """Return the number of trials of all experiments."""
        return self.experiments * self.trials


def size(text: str) -> Size:
    """Return the size in words such as 2x3."""
    experiments, trials = text.split("x")
    return Size(int(experiments), int(trials))


def sizes(text: str) -> list[Size]:
    """Return the sizes in words such as 1x10,10x10."""
    return [size(part) for part in text.split(",") if part]


def engine_line(root: Path, python: str) -> list[str]:
    """Return the command that lets Snakemake make all results of a project."""
    line = [python, "-m", "snakemake", "--cores", "2", "--workflow-profile", str(profile(root))]
    return [*line, "--quiet", "all"]


def measure(batch: Size, root: Path, python: str) -> dict[str, Any]:
    """Return what a run of a batch spends, one without a change, and asking what a run would do."""
    line, file = engine_line(root, python), root / "accounts.jsonl"
    first = spent_by(line, root, file)
    if python != sys.executable:
        note_results(root)
    again = spent_by(line, root, file)
    asked = accounts_of([sys.executable, "-m", "strandcast", "run", "--dry-run"], root, file)
    return {
        **batch._asdict(),
        "first": _row(first),
        "overhead_share": first.overhead_s / first.stages_s if first.stages_s else None,
        "no_op": _row(again),
        "asked": {"cpu_s": round(asked.cpu_s, 2), "peak_mb": round(asked.peak_mb, 2)},
    }


def _row(spent: Spent) -> dict[str, float]:
    return {name: round(value, 2) for name, value in {**spent._asdict(), "total_s": spent.total_s}.items()}


def extrapolated(rows: list[dict[str, Any]], trials: int) -> dict[str, float]:
    """Return engine CPU, peak memory and no-op of more trials, linear from the two largest batches."""
    few, many = sorted(rows, key=lambda row: row["experiments"] * row["trials"])[-2:]
    counts = [row["experiments"] * row["trials"] for row in (few, many)]
    share = (trials - counts[0]) / (counts[1] - counts[0])

    def at(phase: str, name: str) -> float:
        return float(few[phase][name] + share * (many[phase][name] - few[phase][name]))

    return {
        "trials": trials,
        "engine_s": at("first", "engine_s"),
        "engine_mb": at("first", "engine_mb"),
        "starts_s": at("first", "starts_s"),
        "no_op_s": at("no_op", "total_s"),
        "asked_s": at("asked", "cpu_s"),
        "asked_mb": at("asked", "peak_mb"),
    }


def run(worked: Size, stubbed: list[Size], work: Path, donor: Path | None) -> dict[str, Any]:
    """Return the measurements of a batch with its stages and of batches without."""
    found: dict[str, Any] = {"stubbed": []}
    if worked.all_trials:
        root = work / "worked"
        make_project(root)
        record(root, donor or throw_once(work / "donor"), *worked)
        found["worked"] = measure(worked, root, sys.executable)
    for batch in stubbed:
        root = work / f"stubbed-{batch.experiments}x{batch.trials}"
        make_project(root)
        record_empty(root, *batch)
        python = python_without_stages(work / f"python-{batch.experiments}x{batch.trials}")
        found["stubbed"].append(measure(batch, root, str(python)))
        print(json.dumps(found["stubbed"][-1]), file=sys.stderr, flush=True)
    if len(stubbed) > 1:
        found["extrapolated"] = extrapolated(found["stubbed"], LARGE)
    return found | {"targets": against_targets(found)}


def against_targets(found: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return each target that was measured with what was found, and whether it is met."""
    values: dict[str, float | None] = {}
    if "worked" in found:
        values["overhead_share"] = found["worked"]["overhead_share"]
    if "extrapolated" in found:
        values["engine_mb"] = found["extrapolated"]["engine_mb"]
        values["asked_large_s"] = found["extrapolated"]["asked_s"]
    for row in found["stubbed"]:
        if row["experiments"] * row["trials"] == TEN:
            values["no_op_ten_s"] = row["no_op"]["total_s"]
    return {
        name: {"found": value, "most": TARGETS[name], "met": value <= TARGETS[name]}
        for name, value in values.items()
        if value is not None
    }


def main(arguments: list[str] | None = None) -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--size", type=size, default=Size(2, 3), help="experiments x trials; 0x0: none")
    parser.add_argument("--stubbed", type=sizes, default=sizes("1x10,5x10,10x10"))
    parser.add_argument("--donor", type=Path, help="take this data/EXPERIMENT instead of a throw in the lab")
    parser.add_argument("--out", type=Path, default=Path("results/bench-batch.json"))
    chosen = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="strandcast-batch-") as folder:
        found = run(chosen.size, chosen.stubbed, Path(folder), chosen.donor)
    chosen.out.parent.mkdir(parents=True, exist_ok=True)
    chosen.out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
