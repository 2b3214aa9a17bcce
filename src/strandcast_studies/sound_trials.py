"""Warnings of throws in which nothing is wrong: each of them is one too many.

    python -m strandcast_studies.sound_trials --seeds 7101-7134 --work results/sound-trials
    python -m strandcast_studies.sound_trials --seeds 7201-7204 --filmed --work results/sound-films
    python -m strandcast_studies.sound_trials --count results/sound-trials results/sound-films

Strings, targets, servos and rigs are drawn, every second one from the wide ranges, see
`benchmarks.loop.drawn`; with ``--filmed`` every throw is filmed and tracked in its video. All stages run as
in an experiment, with smaller searches. What is counted are the warnings on the trials' pages.
"""

import re
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

from strandcast.report.results import read_results
from strandcast.report.text import warnings_of
from strandcast.stages.run import run_stage
from strandcast_studies.benchmarks.loop.drawn import settings_of, wide_settings_of
from strandcast_studies.benchmarks.loop.run import (
    PROJECT,
    RIGS,
    outcome,
    prepare,
    root_with_arms,
    run_jobs,
    run_parser,
    run_prepared,
)
from strandcast_studies.paper.cases import FILE, load_plan, merged

# Searches smaller than the defaults: what is warned of hardly depends on them.
SMALL: dict[str, Any] = {
    "plan": {"evaluations": 600},
    "estimate": {"evaluations": 1500},
}
NUMBER = re.compile(r"[-+−]?\d+(\.\d+)?")


def _job(root: str, seed: int, trials: int, filmed: bool) -> dict[str, Any]:
    draw = wide_settings_of if seed % 2 else settings_of
    settings = merged(draw(load_plan(PROJECT / FILE).common, seed), SMALL)
    name = f"sound-{seed}"
    prepare(Path(root), name, merged(settings, {"lab": {"rehearsal": seed % 4 < 2}}))
    thrown = outcome(lambda: run_prepared(Path(root), name, trials, RIGS["usual"], filmed=filmed))
    if thrown["error"] is None:
        run_stage("estimate", Path(root), name, trials)
    return {"name": name} | thrown


def counted(roots: list[Path]) -> str:
    """Return a table of the warnings' kinds: how often, in how many trials, and an example."""
    kinds: Counter[str] = Counter()
    trials: dict[str, set[Path]] = {}
    examples: dict[str, str] = {}
    folders = sorted(folder for root in roots for folder in root.glob("results/*/trial-*"))
    folders = [folder for folder in folders if (folder / "estimate.json").exists()]
    for folder in folders:
        for file, text in warnings_of(read_results(folder)):
            kind = f"{file}: {NUMBER.sub('#', text)}"
            kinds[kind] += 1
            trials.setdefault(kind, set()).add(folder)
            examples.setdefault(kind, f"{folder.parent.name}/{folder.name}: {text}")
    each = sum(kinds.values()) / max(len(folders), 1)
    lines = [f"{sum(kinds.values())} warnings in {len(folders)} trials, {each:.2f} each"]
    lines += [f"{count:4} in {len(trials[kind])}: {examples[kind]}" for kind, count in kinds.most_common()]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    """Throw, and count the warnings."""
    parser = run_parser(__doc__, list(range(7101, 7135)), "results/sound-trials.json", strings=False)
    parser.add_argument("--filmed", action="store_true", help="film and track every throw, a minute of CPU")
    parser.add_argument("--work", type=Path, default=None, help="keep the experiments' folders here")
    parser.add_argument("--count", type=Path, nargs="*", help="throw nothing, count in these folders")
    options = parser.parse_args(arguments)
    if options.count:
        print(counted(options.count))
        return
    with tempfile.TemporaryDirectory(prefix="strandcast-sound-") as folder:
        root = root_with_arms(options.work or Path(folder))
        jobs = [(str(root), seed, options.trials, options.filmed) for seed in options.seeds]
        run_jobs(_job, jobs, options.jobs, options.out)
        print(counted([root]))


if __name__ == "__main__":
    main()
