"""The whole loop on many strings and seeds in the lab, with supplied tracks: hit rates and misses as JSON.

All stages except filming, calibration, tracking and alignment run as in an experiment; the tracks have the
noise measured for the tracker and the alignment. Each experiment throws a fixed number of times, also after
a hit, so that the misses of later trials include all experiments.

    python -m strandcast_studies.benchmarks.loop.run --seeds 2001-2015 --out results/bench-loop.json
"""

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
from typing import Any, cast

from ruamel.yaml import YAML

from strandcast.lab.tracked_points import TrackerNoise
from strandcast.records.estimate import Estimate
from strandcast.records.motion import Motion
from strandcast.records.verdict import Verdict
from strandcast.stages.context import context_of
from strandcast.stages.run import run_stage
from strandcast_studies.benchmarks.loop.throw import (
    LoopRig,
    no_variation,
    throw,
    throw_filmed,
    without_scatter,
)
from strandcast_studies.hit_rates import hit_rates, misses_at
from strandcast_studies.paper.cases import FILE, WHOLE, PaperCase, PaperPlan, load_plan, merged, settings_of

PROJECT = Path(__file__).resolve().parents[4]
REPORTED_SEEDS = range(2001, 2016)  # other seeds were used for tuning: docs/explanation/throws.md

# Settings of experiment.yaml that a variant changes; only the pages need estimate.profiles.
QUIET: dict[str, Any] = {"estimate": {"profiles": False}}
VARIANTS: dict[str, dict[str, Any]] = {
    "default": {},
    "paper": {},
    "paper_wide": {"estimate": {"ranges": "wide"}},  # the paper's ranges limit masses to 20 plain points
    "minima": {"start_string": "minima"},
    "small_search": {"plan": {"evaluations": 800}},
    "undisturbed": {"plan": {"disturbances": 0.0}},
    "latest_only": {"estimate": {"trials": "latest"}},
}


NO_NOISE = TrackerNoise(0.0, 0.0, 0.008, 0.0, 4, 0.0)
RIGS: dict[str, LoopRig] = {
    "usual": LoopRig(),
    "perfect_track": LoopRig(replace(NO_NOISE, offset_s=TrackerNoise().offset_s)),
    "perfect_alignment": LoopRig(replace(TrackerNoise(), offset_s=0.0)),
    "perfect_log": LoopRig(vary=lambda drawn: replace(drawn, log_noise_rad=0.0)),
    "same_servo": LoopRig(vary=lambda drawn: replace(drawn, servo_gain=1.0 + 0.0 * drawn.servo_gain)),
    "same_grasp": LoopRig(vary=without_scatter),
    "model_alone": LoopRig(NO_NOISE, lambda drawn: no_variation(len(drawn.joint_zero_rad))),
}


@dataclass
class LoopTrial:
    """One throw of a run; lengths in metres, CPU and wall times in seconds."""

    trial: int
    kind: str
    miss_m: float | None
    true_miss_m: float
    predicted_m: float
    hit_probability: float
    simulated_hit_probability: float
    miss_rms_m: float
    miss_quantiles_m: dict[str, float]
    bend_rad: float
    tip_speed_m_s: float
    simulations: int
    flags: list[str]
    plan_cpu_s: float
    plan_wall_s: float
    E_m: float | None = None
    estimate_cpu_s: float | None = None


def prepare(root: Path, name: str, settings: dict[str, Any]) -> None:
    """Make a fresh folder for one experiment in a root folder that has the arms."""
    for folder in ("data", "results"):
        shutil.rmtree(root / folder / name, ignore_errors=True)
    file = root / "data" / name / "experiment.yaml"
    file.parent.mkdir(parents=True)
    with file.open("w", encoding="utf-8") as out:
        YAML(typ="safe").dump(merged(settings, QUIET), out)


def run_case(
    root: Path, case: PaperCase, trials: int, variant: str = "default", rig: str = "usual"
) -> list[LoopTrial]:
    """Run `trials` throws of one of the paper's experiments, with estimates and plans in between."""
    prepare(root, case.name, merged(settings_of(load_plan(PROJECT / FILE), case), VARIANTS[variant]))
    return run_prepared(root, case.name, trials, RIGS[rig])


def run_prepared(
    root: Path, name: str, trials: int, rig: LoopRig, *, filmed: bool = False
) -> list[LoopTrial]:
    """Run `trials` throws of a prepared experiment, with estimates and plans in between.

    If `filmed`, throws are tracked in their videos; else the tracks have the rig's noise.
    """
    context = context_of(root, name)
    folder = context.folder
    thrown = []
    for number in range(1, trials + 1):
        results = folder.trial(number).results
        wall, cpu = time.perf_counter(), time.process_time()
        if number == 1 and context.settings.lab_rehearses:
            run_stage("lab_rehearse", root, name)
        run_stage("plan", root, name, number)
        spent = time.process_time() - cpu, time.perf_counter() - wall
        if filmed:
            true_m = throw_filmed(root, name, number)
        else:
            true_m = throw(root, name, number, rig)
            run_stage("register_track", root, name, number)
        run_stage("score", root, name, number)
        now = _trial(
            Motion.read(results / "motion.json"), Verdict.read(results / "verdict.json"), true_m, spent
        )
        thrown.append(now)
        if number < trials:
            cpu = time.process_time()
            run_stage("estimate", root, name, number)
            now.estimate_cpu_s = time.process_time() - cpu
            now.E_m = Estimate.read(results / "estimate.json").E_m
    return thrown


def _trial(motion: Motion, verdict: Verdict, true_m: float, spent: tuple[float, float]) -> LoopTrial:
    predicted, origin = motion.predicted, motion.provenance
    assert predicted is not None
    assert origin is not None
    return LoopTrial(
        trial=motion.trial,
        kind=origin.kind,
        miss_m=verdict.miss_m,
        true_miss_m=true_m,
        predicted_m=predicted.miss_m,
        hit_probability=predicted.hit_probability,
        simulated_hit_probability=cast(float, predicted.simulated_hit_probability),
        miss_rms_m=cast(float, predicted.miss_rms_m),
        miss_quantiles_m=predicted.miss_quantiles_m,
        bend_rad=predicted.largest_bend_rad,
        tip_speed_m_s=predicted.peak_tip_speed_m_s,
        simulations=origin.simulations,
        flags=list(origin.flags),
        plan_cpu_s=spent[0],
        plan_wall_s=spent[1],
    )


def _job(root: str, case: PaperCase, trials: int, variant: str, rig: str) -> dict[str, Any]:
    given = {"string": case.string, "target": case.target, "seed": case.seed, "variant": variant, "rig": rig}
    return given | outcome(lambda: run_case(Path(root), case, trials, variant, rig))


def outcome(run: Callable[[], Sequence[Any]]) -> dict[str, Any]:
    """Return the trials of a run, dataclasses, or its error: a failed run must not stop the others."""
    try:
        return {"error": None, "trials": [asdict(trial) for trial in run()]}
    except Exception as error:
        return {"error": f"{type(error).__name__}: {error}", "trials": []}


def summary_of(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the hit rates and misses of the runs."""
    misses = [[trial["miss_m"] for trial in run["trials"]] for run in runs]
    trials = range(1, max(map(len, misses), default=0) + 1)
    return {
        "runs": len(runs),
        "failed": sum(run["error"] is not None for run in runs),
        "rates": [rate._asdict() for rate in hit_rates(misses, trials=tuple(trials))],
        "misses": [misses_at(misses, trial)._asdict() for trial in trials],
    }


def cases_of(paper: PaperPlan, strings: list[int], seeds: list[int], variant: str) -> list[PaperCase]:
    """Return the cases of every chosen string at its own target with every seed."""
    method = "paper" if variant.startswith("paper") else "default"
    return [
        PaperCase(WHOLE, seed, one.number, one.target, method)
        for seed in seeds
        for one in paper.strings
        if not strings or one.number in strings
    ]


def numbers(text: str) -> list[int]:
    """Return the numbers of a list such as 1,3,7-9."""
    parts = [part.split("-") for part in text.split(",") if part]
    return [number for part in parts for number in range(int(part[0]), int(part[-1]) + 1)]


def loop_parser(
    description: str | None, seeds: list[int], out: str, *, strings: bool = True
) -> argparse.ArgumentParser:
    """Return the options of every benchmark of the loop: seeds, strings, output file."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=numbers, default=seeds, help="e.g. 2001,2005-2007")
    if strings:
        parser.add_argument("--strings", type=numbers, default=[], help="only these, e.g. 1,3")
    parser.add_argument("--out", type=Path, default=Path(out), help="JSON file of the results")
    return parser


def run_parser(
    description: str | None, seeds: list[int], out: str, *, strings: bool = True
) -> argparse.ArgumentParser:
    """Return the options of benchmarks that run whole experiments."""
    parser = loop_parser(description, seeds, out, strings=strings)
    parser.add_argument("--trials", type=int, default=3, help="throws per experiment")
    parser.add_argument("--jobs", type=int, default=2, help="experiments at the same time")
    return parser


def main(arguments: list[str] | None = None) -> None:
    """Run the experiments, two at a time; write each result as soon as it is known."""
    parser = run_parser(__doc__, list(REPORTED_SEEDS), "results/bench-loop.json")
    parser.add_argument("--variant", choices=VARIANTS, default="default")
    parser.add_argument("--rig", choices=RIGS, default="usual")
    parser.add_argument("--work", type=Path, default=None, help="keep the experiments' folders here")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="strandcast-loop-") as temporary:
        summary = run_cases(options, options.work or Path(temporary))
    print(json.dumps(summary, indent=1))


def run_cases(options: argparse.Namespace, work: Path) -> dict[str, Any]:
    """Run the experiments in a folder and return their summary."""
    cases = cases_of(load_plan(PROJECT / FILE), options.strings, options.seeds, options.variant)
    root = root_with_arms(work / options.variant / options.rig)
    jobs = [(str(root), case, options.trials, options.variant, options.rig) for case in cases]
    return run_jobs(_job, jobs, options.jobs, options.out)


def root_with_arms(root: Path) -> Path:
    """Return a root folder for experiments, with the arms copied into it."""
    shutil.copytree(PROJECT / "config" / "arms", root / "config" / "arms", dirs_exist_ok=True)
    return root


def run_jobs(
    job: Callable[..., dict[str, Any]], jobs: Sequence[tuple[Any, ...]], processes: int, out: Path
) -> dict[str, Any]:
    """Call `job` with each tuple, in processes, and return the summary; rewrite `out` after every one."""
    out.parent.mkdir(parents=True, exist_ok=True)
    done: dict[int, dict[str, Any]] = {}
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        place = {pool.submit(job, *given): k for k, given in enumerate(jobs)}
        for future in as_completed(place):
            done[place[future]] = future.result()
            runs = [done[k] for k in sorted(done)]
            text = json.dumps({"summary": summary_of(runs), "runs": runs}, indent=1)
            out.write_text(text, encoding="utf-8")
            print(f"{len(runs)} of {len(jobs)}", file=sys.stderr)
    return summary_of(list(done.values()))


if __name__ == "__main__":
    main()
