"""The whole loop on many strings and seeds in the lab, with supplied tracks: hit rates and misses as JSON.

Every stage but filming, calibration, tracking and alignment runs as it does for an experiment; the tracks
have the noise that was measured of the tracker and of the alignment. Each experiment throws a fixed number of
times, also after a hit, so that the misses of later trials are those of all experiments.

    python -m strandcast.bench.loop --seeds 2001-2015 --out results/bench-loop.json
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from strandcast.bench.loop_throw import Rig, still, throw, without_scatter
from strandcast.lab.capture import SeenNoise
from strandcast.lab.variation import Variation
from strandcast.paper.cases import FILE, WHOLE, Case, Plan, load_plan, merged, settings_of
from strandcast.records.estimate import Estimate
from strandcast.records.motion import Motion
from strandcast.records.summary import Verdict
from strandcast.report.hit_rates import hit_rates, misses_at
from strandcast.stages import estimate, judge, plan, supply
from strandcast.stages.context import context_of

PROJECT = Path(__file__).resolve().parents[3]
REPORTED_SEEDS = range(2001, 2016)  # planner and estimation were tried out on others: docs/throws.md

# Settings of experiment.yaml that a variant changes; estimate.profiles are for the pages alone.
QUIET: dict[str, Any] = {"estimate": {"profiles": False}}
VARIANTS: dict[str, dict[str, Any]] = {
    "default": {},
    "paper": {},
    "paper_wide": {"estimate": {"ranges": "wide"}},  # without which its masses end at 20 plain points
    "minima": {"start_string": "minima"},
    "small_search": {"plan": {"screening": 480, "evaluations": 800}},
    "four_strings": {"plan": {"ensemble": 4}},
    "one_spacing": {"plan": {"finer": False}},
    "undisturbed": {"plan": {"disturbances": 0.0}},
    "commanded": {"plan": {"use_servo": False}},
    "nothing_carried": {"plan": {"carry_residual": False}},
    "latest_only": {"estimate": {"trials": "latest"}},
}


def _same_servo(variation: Variation) -> Variation:
    return replace(variation, servo_gain=1.0 + 0.0 * variation.servo_gain)


def _clean_log(variation: Variation) -> Variation:
    return replace(variation, log_noise_rad=0.0)


NO_NOISE = SeenNoise(0.0, 0.0, 0.008, 0.0, 4, 0.0)
RIGS: dict[str, Rig] = {
    "usual": Rig(),
    "perfect_track": Rig(replace(NO_NOISE, offset_s=SeenNoise().offset_s)),
    "perfect_alignment": Rig(replace(SeenNoise(), offset_s=0.0)),
    "perfect_log": Rig(vary=_clean_log),
    "same_servo": Rig(vary=_same_servo),
    "same_grasp": Rig(vary=without_scatter),
    "model_alone": Rig(NO_NOISE, lambda variation: still(len(variation.joint_zero_rad))),
}


@dataclass
class Trial:
    """One throw of a run; lengths in metres, times in seconds of one core."""

    trial: int
    kind: str
    miss_m: float | None
    true_miss_m: float
    predicted_m: float
    hit_probability: float
    bend_rad: float
    tip_speed_m_s: float
    simulations: int
    flags: list[str]
    plan_cpu_s: float
    plan_wall_s: float
    E_m: float | None = None
    estimate_cpu_s: float | None = None


def prepare(root: Path, name: str, settings: dict[str, Any]) -> None:
    """Make the folder of one experiment, fresh, in a root that has the arms."""
    for folder in ("data", "results"):
        shutil.rmtree(root / folder / name, ignore_errors=True)
    file = root / "data" / name / "experiment.yaml"
    file.parent.mkdir(parents=True)
    with file.open("w", encoding="utf-8") as out:
        YAML(typ="safe").dump(merged(settings, QUIET), out)


def run_case(
    root: Path, case: Case, trials: int, variant: str = "default", rig: str = "usual"
) -> list[Trial]:
    """Throw one of the paper's experiments' string `trials` times, and estimate and plan in between."""
    prepare(root, case.name, merged(settings_of(load_plan(PROJECT / FILE), case), VARIANTS[variant]))
    return run_prepared(root, case.name, trials, RIGS[rig])


def run_prepared(root: Path, name: str, trials: int, rig: Rig) -> list[Trial]:
    """Throw the string of an experiment that is prepared `trials` times, and estimate and plan in between."""
    folder = context_of(root, name).folder
    thrown = []
    for number in range(1, trials + 1):
        results = folder.trial(number).results
        wall, cpu = time.perf_counter(), time.process_time()
        plan.run(root, name, number)
        spent = time.process_time() - cpu, time.perf_counter() - wall
        true_m = throw(root, name, number, rig)
        supply.run(root, name, number)
        judge.run(root, name, number)
        now = _trial(
            Motion.read(results / "motion.json"), Verdict.read(results / "verdict.json"), true_m, spent
        )
        thrown.append(now)
        if number < trials:
            cpu = time.process_time()
            estimate.run(root, name, number)
            now.estimate_cpu_s = time.process_time() - cpu
            now.E_m = Estimate.read(results / "estimate.json").E_m
    return thrown


def _trial(motion: Motion, verdict: Verdict, true_m: float, spent: tuple[float, float]) -> Trial:
    told, origin = motion.predicted, motion.provenance
    assert told is not None
    assert origin is not None
    return Trial(
        trial=motion.trial,
        kind=origin.kind,
        miss_m=verdict.miss_m,
        true_miss_m=true_m,
        predicted_m=told.miss_m,
        hit_probability=told.hit_probability,
        bend_rad=told.largest_bend_rad,
        tip_speed_m_s=told.peak_tip_speed_m_s,
        simulations=origin.simulations,
        flags=list(origin.flags),
        plan_cpu_s=spent[0],
        plan_wall_s=spent[1],
    )


def _job(root: str, case: Case, trials: int, variant: str, rig: str) -> dict[str, Any]:
    told = {"string": case.string, "target": case.target, "seed": case.seed, "variant": variant, "rig": rig}
    return told | outcome(lambda: run_case(Path(root), case, trials, variant, rig))


def outcome(run: Callable[[], list[Trial]]) -> dict[str, Any]:
    """Return the trials of a run, or its error: one run's failure must not stop the others."""
    try:
        return {"error": None, "trials": [asdict(trial) for trial in run()]}
    except Exception as error:
        return {"error": f"{type(error).__name__}: {error}", "trials": []}


def summary_of(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Return hit rates and misses of runs."""
    misses = [[trial["miss_m"] for trial in run["trials"]] for run in runs]
    trials = range(1, max(map(len, misses), default=0) + 1)
    return {
        "runs": len(runs),
        "failed": sum(run["error"] is not None for run in runs),
        "rates": [rate._asdict() for rate in hit_rates(misses, trials=tuple(trials))],
        "misses": [misses_at(misses, trial)._asdict() for trial in trials],
    }


def cases_of(paper: Plan, strings: list[int], seeds: list[int], variant: str) -> list[Case]:
    """Return every string at its own target with every seed."""
    method = "paper" if variant.startswith("paper") else "default"
    return [
        Case(WHOLE, seed, one.number, one.target, method)
        for seed in seeds
        for one in paper.strings
        if not strings or one.number in strings
    ]


def numbers(text: str) -> list[int]:
    """Return the numbers of a list such as 1,3,7-9."""
    parts = [part.split("-") for part in text.split(",") if part]
    return [number for part in parts for number in range(int(part[0]), int(part[-1]) + 1)]


def main(arguments: list[str] | None = None) -> None:
    """Run the experiments, two at a time; write what each came to as soon as it is known."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=numbers, default=list(REPORTED_SEEDS))
    parser.add_argument("--strings", type=numbers, default=[])
    parser.add_argument("--trials", type=int, default=3)
    parser.add_argument("--variant", choices=VARIANTS, default="default")
    parser.add_argument("--rig", choices=RIGS, default="usual")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("results/bench-loop.json"))
    parser.add_argument("--work", type=Path, default=None, help="keep the experiments' folders here")
    told = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="strandcast-loop-") as nowhere:
        summary = run_cases(told, told.work or Path(nowhere))
    print(json.dumps(summary, indent=1))


def run_cases(told: argparse.Namespace, work: Path) -> dict[str, Any]:
    """Run the experiments in a folder and return their summary."""
    cases = cases_of(load_plan(PROJECT / FILE), told.strings, told.seeds, told.variant)
    root = root_with_arms(work / told.variant / told.rig)
    jobs = [(str(root), case, told.trials, told.variant, told.rig) for case in cases]
    return run_jobs(_job, jobs, told.jobs, told.out)


def root_with_arms(root: Path) -> Path:
    """Return the folder, made so that experiments can be in it."""
    shutil.copytree(PROJECT / "config" / "arms", root / "config" / "arms", dirs_exist_ok=True)
    return root


def run_jobs(
    job: Callable[..., dict[str, Any]], jobs: Sequence[tuple[Any, ...]], processes: int, out: Path
) -> dict[str, Any]:
    """Call `job` with each tuple, in processes, and return the summary; `out` has all after every one."""
    out.parent.mkdir(parents=True, exist_ok=True)
    done: dict[int, dict[str, Any]] = {}
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        place = {pool.submit(job, *told): k for k, told in enumerate(jobs)}
        for future in as_completed(place):
            done[place[future]] = future.result()
            runs = [done[k] for k in sorted(done)]
            text = json.dumps({"summary": summary_of(runs), "runs": runs}, indent=1)
            out.write_text(text, encoding="utf-8")
            print(f"{len(runs)} of {len(jobs)}", file=sys.stderr)
    return summary_of(list(done.values()))


if __name__ == "__main__":
    main()
