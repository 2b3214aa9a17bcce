"""What throws miss by, in mm per cause: the same experiments again with one cause at a time switched off.

    python -m strandcast.bench.loop_budget WORK/default/usual --seeds 2001-2003

WORK is the folder that `strandcast.bench.loop --work WORK` has left. The first motions are those thrown
there; the fit, the second motion and its throw are made anew with every cause, with supplied tracks.
`results/error-budget.json` is shown on the page of the paper's experiment.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from strandcast.bench.loop import PROJECT, RIGS, cases_of, numbers, prepare
from strandcast.bench.loop_throw import Rig, throw
from strandcast.paper.cases import FILE, Case, load_plan, settings_of
from strandcast.records.budget import BudgetThrow, ErrorBudget, Without
from strandcast.stages import estimate, judge, plan, supply
from strandcast.stages.context import context_of

NONE = "none"
CAUSES: dict[str, Rig] = {
    NONE: RIGS["usual"],
    "tracking": RIGS["perfect_track"],
    "alignment": RIGS["perfect_alignment"],
    "joint log": RIGS["perfect_log"],
    "servo": RIGS["same_servo"],
    "repeatability": RIGS["same_grasp"],
    "all but the model": RIGS["model_alone"],
}
TRIALS = (1, 2)


def throws_without(root: Path, begun: Path, case: Case, cause: str) -> list[float]:
    """Return the true misses [m] of an experiment's first two throws with a cause switched off.

    Parameters
    ----------
    root
        Where the experiment is made, with the arms.
    begun
        The root in which its first motion was planned.
    """
    prepare(root, case.name, settings_of(load_plan(PROJECT / FILE), case))
    folder = context_of(root, case.name).folder
    missed = []
    for trial in TRIALS:
        results = folder.trial(trial).results
        if trial == 1:
            results.mkdir(parents=True)
            shutil.copyfile(
                context_of(begun, case.name).folder.trial(1).results / "motion.json", results / "motion.json"
            )
        else:
            estimate.run(root, case.name, trial - 1)
            plan.run(root, case.name, trial)
        missed.append(throw(root, case.name, trial, CAUSES[cause]))
        supply.run(root, case.name, trial)
        judge.run(root, case.name, trial)
    return missed


def summary_of(throws: list[BudgetThrow]) -> ErrorBudget:
    """Return the budget of throws: what is left without each cause, and by how much less that is."""
    lines = []
    for trial in sorted({one.trial for one in throws}):
        mine = [one.miss_m for one in throws if one.trial == trial]
        usual = np.array([miss[NONE] for miss in mine])
        for cause in CAUSES:
            misses = np.array([miss[cause] for miss in mine])
            gone = float(np.mean(usual**2) - np.mean(misses**2))
            lines.append(
                Without(
                    cause=cause,
                    trial=trial,
                    throws=len(misses),
                    median_m=float(np.median(misses)),
                    p90_m=float(np.quantile(misses, 0.9)),
                    rms_m=float(np.sqrt(np.mean(misses**2))),
                    cause_rms_m=float(np.sign(gone) * np.sqrt(abs(gone))),
                )
            )
    return ErrorBudget(without=lines, throws=throws)


def _job(work: str, begun: str, case: Case) -> list[BudgetThrow]:
    missed = {}
    for cause in CAUSES:
        root = Path(work) / cause.replace(" ", "-")
        shutil.copytree(PROJECT / "config" / "arms", root / "config" / "arms", dirs_exist_ok=True)
        missed[cause] = throws_without(root, Path(begun), case, cause)
    return [
        BudgetThrow(
            experiment=case.name,
            string=case.string,
            target=case.target,
            seed=case.seed,
            trial=trial,
            miss_m={cause: misses[k] for cause, misses in missed.items()},
        )
        for k, trial in enumerate(TRIALS)
    ]


def main(arguments: list[str] | None = None) -> None:
    """Measure experiment by experiment, two at a time."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("root", type=Path)
    parser.add_argument("--seeds", type=numbers, default=[2001, 2002, 2003])
    parser.add_argument("--strings", type=numbers, default=[])
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("results/error-budget.json"))
    told = parser.parse_args(arguments)
    cases = cases_of(load_plan(PROJECT / FILE), told.strings, told.seeds, "default")
    work = told.root.parent / "budget"
    throws: list[BudgetThrow] = []
    told.out.parent.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(told.jobs, mp_context=get_context("spawn")) as pool:
        jobs = [pool.submit(_job, str(work), str(told.root), case) for case in cases]
        for case, job in zip(cases, jobs, strict=True):
            throws += job.result()
            summary_of(throws).write(told.out)
            print(f"{case.name}: {1e3 * throws[-1].miss_m[NONE]:.1f} mm", file=sys.stderr)
    for line in summary_of(throws).without:
        print(
            f"trial {line.trial}, without {line.cause}: median {1e3 * line.median_m:.1f}, "
            f"p90 {1e3 * line.p90_m:.1f}, rms {1e3 * line.rms_m:.1f} mm"
        )


if __name__ == "__main__":
    main()
