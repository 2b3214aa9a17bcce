"""The error budget of throws: the same experiments repeated with one cause of error at a time switched off.

    python -m strandcast_studies.benchmarks.loop.error_budget WORK/default/usual --seeds 2001-2003

WORK is the folder made by `loop.run --work WORK`. The first motions are taken from there; the fit, the second
motion and its throw are repeated for every cause, with supplied tracks. The page of the paper's experiment
shows `results/error-budget.json`.
"""

import shutil
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from strandcast.stages.context import context_of
from strandcast.stages.run import run_stage
from strandcast_studies.benchmarks.loop.follow_up import follow_up_parser
from strandcast_studies.benchmarks.loop.run import PROJECT, RIGS, cases_of, prepare, root_with_arms
from strandcast_studies.benchmarks.loop.throw import LoopRig, throw
from strandcast_studies.paper.cases import FILE, PaperCase, load_plan, settings_of
from strandcast_studies.paper.records import BudgetThrow, ErrorBudget, MissWithout

NONE = "none"
CAUSES: dict[str, LoopRig] = {
    NONE: RIGS["usual"],
    "tracking": RIGS["perfect_track"],
    "alignment": RIGS["perfect_alignment"],
    "joint log": RIGS["perfect_log"],
    "servo": RIGS["same_servo"],
    "repeatability": RIGS["same_grasp"],
    "all but the model": RIGS["model_alone"],
}
TRIALS = (1, 2)


def throws_without(root: Path, planned: Path, case: PaperCase, cause: str) -> list[float]:
    """Return the true misses [m] of an experiment's first two throws with a cause switched off.

    Parameters
    ----------
    root
        Root folder of the new experiment, with the arms.
    planned
        Root folder of the experiment whose first motion is used.
    """
    prepare(root, case.name, settings_of(load_plan(PROJECT / FILE), case))
    folder = context_of(root, case.name).folder
    missed = []
    for trial in TRIALS:
        results = folder.trial(trial).results
        if trial == 1:
            results.mkdir(parents=True)
            shutil.copyfile(
                context_of(planned, case.name).folder.trial(1).results / "motion.json",
                results / "motion.json",
            )
        else:
            run_stage("estimate", root, case.name, trial - 1)
            run_stage("plan", root, case.name, trial)
        missed.append(throw(root, case.name, trial, CAUSES[cause]))
        run_stage("register_track", root, case.name, trial)
        run_stage("score", root, case.name, trial)
    return missed


def summary_of(throws: list[BudgetThrow]) -> ErrorBudget:
    """Return the error budget: the misses left without each cause, and the cause's share."""
    lines = []
    for trial in sorted({one.trial for one in throws}):
        mine = [one.miss_m for one in throws if one.trial == trial]
        usual = np.array([miss[NONE] for miss in mine])
        for cause in CAUSES:
            misses = np.array([miss[cause] for miss in mine])
            gone = float(np.mean(usual**2) - np.mean(misses**2))
            lines.append(
                MissWithout(
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


def _job(work: str, planned: str, case: PaperCase) -> list[BudgetThrow]:
    missed = {}
    for cause in CAUSES:
        root = Path(work) / cause.replace(" ", "-")
        missed[cause] = throws_without(root_with_arms(root), Path(planned), case, cause)
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
    """Measure the experiments, two at a time."""
    parser = follow_up_parser(__doc__, "results/error-budget.json")
    parser.add_argument("--jobs", type=int, default=2, help="experiments at the same time")
    options = parser.parse_args(arguments)
    cases = cases_of(load_plan(PROJECT / FILE), options.strings, options.seeds, "default")
    work = options.root.parent / "budget"
    throws: list[BudgetThrow] = []
    options.out.parent.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
        jobs = [pool.submit(_job, str(work), str(options.root), case) for case in cases]
        for case, job in zip(cases, jobs, strict=True):
            throws += job.result()
            summary_of(throws).write(options.out)
            print(f"{case.name}: {1e3 * throws[-1].miss_m[NONE]:.1f} mm", file=sys.stderr)
    for line in summary_of(throws).without:
        print(
            f"trial {line.trial}, without {line.cause}: median {1e3 * line.median_m:.1f}, "
            f"p90 {1e3 * line.p90_m:.1f}, rms {1e3 * line.rms_m:.1f} mm"
        )


if __name__ == "__main__":
    main()
