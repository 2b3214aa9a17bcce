"""How many trials a fit needs: the prediction of the next throw, and CPU, by `estimate.trials`.

    python -m strandcast_studies.benchmarks.loop.recent_trials --strings 1,4 --seeds 2001 --trials 12

Every throw of an experiment has a target of its own, so that no motion is like another; the tracks have the
noise of tracker and alignment. Each string is fitted after every throw, from all trials so far and from the
newest few. The next throw, which the fit has not seen, is then simulated with it.
"""

import json
import shutil
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from ruamel.yaml import YAML

from strandcast.records.estimate import UNDER_PREVIOUS, Estimate
from strandcast.stages.context import context_of
from strandcast.stages.run import run_stage
from strandcast_studies.benchmarks.loop.run import (
    PROJECT,
    QUIET,
    cases_of,
    numbers,
    prepare,
    root_with_arms,
    run_parser,
)
from strandcast_studies.benchmarks.loop.throw import LoopRig, throw
from strandcast_studies.paper.cases import FILE, PaperCase, load_plan, merged, settings_of

COUNTS = [3, 5, 8]
SMALL_PLAN = {"plan": {"evaluations": 600}}
NEAR_M = 0.15  # targets differ by up to this along each axis; chosen, within reach of all strings


class Fit(NamedTuple):
    """The fit after one throw: E of this throw, of it under the fit before [m], and CPU time [s]."""

    case: str
    trials: str
    after: int
    E_m: float
    predicted_E_m: float | None
    cpu_s: float


def throw_all(root: Path, name: str, settings: dict[str, Any], throws: int) -> None:
    """Throw an experiment: each motion is planned as the first one of a helper experiment."""
    random = np.random.default_rng(settings["seed"])
    prepare(root, name, settings)
    for number in range(1, throws + 1):
        target_m = (np.array(settings["target_m"]) - NEAR_M * random.random(2)).round(3).tolist()
        aim = f"{name}-aim"
        prepare(root, aim, merged(settings, SMALL_PLAN, {"target_m": target_m, "seed": number}))
        run_stage("plan", root, aim, 1)
        results = context_of(root, name).folder.trial(number).results
        results.mkdir(parents=True)
        shutil.copy(context_of(root, aim).folder.trial(1).results / "motion.json", results)
        throw(root, name, number, LoopRig())
        run_stage("register_track", root, name, number)


def fits(root: Path, case: PaperCase, throws: int, counts: list[int]) -> list[Fit]:
    """Return the fits of one experiment after every throw: from all trials, and from the newest few."""
    settings = merged(settings_of(load_plan(PROJECT / FILE), case), QUIET)
    throw_all(root, case.name, settings, throws)
    found = list(_fits(root, case.name, merged(settings, {"estimate": {"trials": "all"}}), 1, throws))
    kept = root / "all"
    shutil.copytree(root / "results" / case.name, kept)
    for count in counts:
        shutil.rmtree(root / "results" / case.name)
        shutil.copytree(kept, root / "results" / case.name)
        fewer = merged(settings, {"estimate": {"trials": count}})
        found += _fits(root, case.name, fewer, count + 1, throws)  # before, they are the same
    return found


def _fits(root: Path, name: str, settings: dict[str, Any], first: int, last: int) -> Iterator[Fit]:
    with (root / "data" / name / "experiment.yaml").open("w", encoding="utf-8") as out:
        YAML(typ="safe").dump(settings, out)
    for number in range(first, last + 1):
        began_s = time.process_time()
        run_stage("estimate", root, name, number)
        spent_s = time.process_time() - began_s
        fit = Estimate.read(context_of(root, name).folder.trial(number).results / "estimate.json")
        trials = str(settings["estimate"]["trials"])
        yield Fit(name, trials, number, fit.E_m, fit.held_out_m(UNDER_PREVIOUS), spent_s)


def table(found: list[Fit], counts: list[int]) -> list[dict[str, Any]]:
    """Return one row per count: fits from the newest against those from all, after more throws than that."""
    from_all = {(fit.case, fit.after): fit for fit in found if fit.trials == "all"}
    rows = []
    for count in counts:
        some = [fit for fit in found if fit.trials == str(count)]
        both = [(fit, from_all[fit.case, fit.after]) for fit in some]
        # The first of these fits still starts from what both share: its prediction is the same.
        foretold = [pair for pair in both if pair[0].after > count + 1]
        predicted_m = np.array([[one.predicted_E_m, other.predicted_E_m] for one, other in foretold], float)
        ratio = predicted_m[:, 0] / predicted_m[:, 1]
        rows.append(
            {
                "trials": count,
                "fits": len(both),
                "E_mm": 1e3 * float(np.median([fit.E_m for fit, _ in both])),
                "E_from_all_mm": 1e3 * float(np.median([fit.E_m for _, fit in both])),
                "predicted_E_mm": 1e3 * float(np.median(predicted_m[:, 0])),
                "predicted_E_from_all_mm": 1e3 * float(np.median(predicted_m[:, 1])),
                "predicted_ratio_mean": float(np.exp(np.log(ratio).mean())),
                "predicted_ratio_sd_of_mean": float(np.log(ratio).std(ddof=1) / np.sqrt(len(ratio))),
                "cpu_s": float(np.mean([fit.cpu_s for fit, _ in both])),
                "cpu_from_all_s": float(np.mean([fit.cpu_s for _, fit in both])),
            }
        )
    return rows


def main(arguments: list[str] | None = None) -> None:
    """Throw and fit the experiments; write every fit and the table."""
    parser = run_parser(__doc__, [2001], "results/bench-recent-trials.json")
    parser.set_defaults(trials=12)
    parser.add_argument("--counts", type=numbers, default=COUNTS, help="values of estimate.trials")
    options = parser.parse_args(arguments)
    cases = cases_of(load_plan(PROJECT / FILE), options.strings, options.seeds, "default")
    found: list[Fit] = []
    with (
        tempfile.TemporaryDirectory(prefix="strandcast-recent-") as folder,
        ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool,
    ):
        roots = [root_with_arms(Path(folder) / str(k)) for k in range(len(cases))]
        for part in pool.map(
            fits, roots, cases, *([value] * len(cases) for value in (options.trials, options.counts))
        ):
            found += part
    rows = table(found, options.counts)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"table": rows, "fits": [fit._asdict() for fit in found]}, indent=1)
    options.out.write_text(text, encoding="utf-8")
    print(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
