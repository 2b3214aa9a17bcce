"""State the throws of kept runs again: with a typical rig's scatter, with none, the prior, learnt, or known.

    python -m strandcast_studies.benchmarks.loop.drawn --wide --seeds 6201-6224 --work results/rigs
    python -m strandcast_studies.benchmarks.loop.restate results/rigs

The motions stay as they were thrown; only the disturbances with which their misses are simulated differ.
The statements of every variant are calibrated by themselves, those of an experiment on all others. If the
rig were the reason why misses differ from what is stated, they would differ least with the rig known.
"""

import argparse
import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from strandcast.arm.load import load_arm
from strandcast.arm.yielding_joints import JointResponse
from strandcast.core.disturbances import DISTURBING
from strandcast.lab.variation import scatter_of
from strandcast.planning.local_search import neighbourhood
from strandcast.planning.miss_calibration import MissCalibration, calibration, rms_of
from strandcast.planning.past_trials import curve_of
from strandcast.planning.plan import fitted_servo, predicted, predicted_near
from strandcast.planning.rig_scatter import drawn_sizes
from strandcast.planning.rollouts import RolloutConditions
from strandcast.planning.search import SearchInputs, SearchResult
from strandcast.records.estimate import Estimate
from strandcast.records.motion import Motion
from strandcast.seeds import rng
from strandcast.stages.files import past
from strandcast.stages.job import Files
from strandcast.stages.past_trials import read_trial
from strandcast.stages.plan_inputs import (
    first_inputs,
    next_inputs,
    past_trial_of,
    rehearsal_of,
    seen_deviations,
    servo_of,
)
from strandcast.stages.run import files_of
from strandcast_studies.benchmarks.loop.calibration import (
    SHARES,
    SIMILAR,
    CountedThrow,
    kind_calibration,
    stated,
)

VARIANTS = ("typical", "undisturbed", "prior", "learnt", "known")


class Statement(NamedTuple):
    """What a variant states of one throw: rms of the simulated misses [m], and the share of them that hit."""

    rms_m: float
    simulated: float


def statements(root: Path, name: str, trial: int) -> dict[str, Statement]:
    """Return the statements of every variant for a throw of a run whose folders were kept."""
    files = files_of("plan", root, name, trial)
    context = files.job.context
    motion = Motion.read(context.folder.trial(trial).results / "motion.json")
    assert motion.provenance is not None
    curve = curve_of(motion)
    assert curve is not None
    found = SearchResult(motion.provenance.kind, curve, 0, [])
    settings = context.settings.plan.model_copy(update={"disturbances": "learnt"})
    arm, random = load_arm(files.input("arm")), rng(name, context.settings.seed, trial, "plan")
    trials = [read_trial(files, number) for number in past(files.job)]
    if not trials:
        task, strings = first_inputs(context, arm, random)
        servo: JointResponse = task.arm.servo
        seen, near = [], None
        rehearsal = rehearsal_of(files, task)
        if rehearsal:
            servo = fitted_servo(task, [rehearsal])
            conditions = RolloutConditions(servo)
            near = neighbourhood(task, strings, conditions, rehearsal, [rehearsal], settings)
    else:
        task, strings = next_inputs(context, arm, files.input("ensemble"))
        fitted = servo_of(Estimate.read(files.input("estimate")).servo)
        seen = seen_deviations(task, strings, trials, fitted)
        known = [past_trial_of(one, task) for one in trials]
        servo = fitted_servo(task, known)
        best = known[_parent(files, motion)] if found.kind == "refined" else None
        conditions = RolloutConditions(servo)
        near = None if best is None else neighbourhood(task, strings, conditions, best, known, settings)
    sizes = {
        "typical": drawn_sizes(settings.model_copy(update={"disturbances": 1.0}), []),
        "undisturbed": drawn_sizes(settings.model_copy(update={"disturbances": 0.0}), []),
        "prior": drawn_sizes(settings, []),
        "learnt": drawn_sizes(settings, seen),
        "known": _true_sizes(files),
    }
    answer = {}
    for variant, rows in sizes.items():
        given = SearchInputs(task, strings, RolloutConditions(servo), settings, random, rows)
        plan = predicted(given, found) if near is None else predicted_near(given, near, found)
        rms_m = rms_of(plan.throws.miss_m)
        answer[variant] = Statement(rms_m, plan.simulated_hit_probability(task.hit_radius_m))
    return answer


def _parent(files: Files, motion: Motion) -> int:
    """Return which of the past trials a motion was searched for around."""
    assert motion.provenance is not None
    parent = motion.provenance.parent_motion_sha256
    numbers = past(files.job)
    hashes = [Motion.read(files.input("motion", number)).content_sha256() for number in numbers]
    return hashes.index(str(parent))


def _true_sizes(files: Files) -> np.ndarray:
    """Return the sizes (1, 5) that the lab draws its throws with."""
    settings, name = files.job.context.settings, files.job.context.name
    assert settings.lab is not None
    scatter = scatter_of(name, settings.seed, settings.lab)
    return settings.lab.noise * np.array([[getattr(scatter, column) for column in DISTURBING]])


def restated(root: Path) -> list[dict[str, Any]]:
    """Return every throw of the kept runs with its true miss and the statements of all variants."""
    throws = []
    for file in sorted((root / "runs").glob("*.json")):
        run = json.loads(file.read_text(encoding="utf-8"))
        for thrown in run["trials"]:
            said = statements(root, run["name"], thrown["trial"])
            throws.append(
                {
                    "run": run["name"],
                    "trial": thrown["trial"],
                    "kind": thrown["kind"],
                    "miss_m": thrown["true_miss_m"],
                    "statements": {variant: each._asdict() for variant, each in said.items()},
                }
            )
    return throws


def compared(throws: list[dict[str, Any]], radius_m: float, *, shipped: bool) -> list[dict[str, Any]]:
    """Return, for every variant and throw of an experiment, how well its calibrated statements held.

    They are calibrated on all other experiments, or as `planning.miss_calibration` is shipped.
    """
    rows = []
    for variant in VARIANTS:
        counted = [
            (
                each["run"],
                CountedThrow(
                    SIMILAR.get(each["kind"], each["kind"]),
                    each["trial"],
                    miss_m=each["miss_m"],
                    **each["statements"][variant],
                ),
            )
            for each in throws
        ]
        said = [
            stated(throw, calibration() if shipped else _of_others(run, throw, counted))
            for run, throw in counted
        ]
        for trial in sorted({throw.trial for _, throw in counted}):
            mine = [k for k, (_, throw) in enumerate(counted) if throw.trial == trial]
            miss_m = np.array([counted[k][1].miss_m for k in mine])
            stated_m = np.array([[said[k].quantile_m(share) for share in SHARES] for k in mine])
            probability = np.clip([said[k].within(radius_m) for k in mine], 0.005, 0.995)
            hit = miss_m <= radius_m
            ratio = np.log(np.maximum(miss_m, 1e-4) / stated_m[:, 0])
            rows.append(
                {
                    "variant": variant,
                    "calibrated": "as shipped" if shipped else "on all others",
                    "throw": trial,
                    "throws": len(mine),
                    "hits": float(hit.mean()),
                    "stated": float(probability.mean()),
                    "rms_mm": 1e3 * float(np.median([counted[k][1].rms_m for k in mine])),
                    "below_p50": float(np.mean(miss_m <= stated_m[:, 0])),
                    "below_p90": float(np.mean(miss_m <= stated_m[:, 1])),
                    "brier": float(np.mean((probability - hit) ** 2)),
                    "log_loss": float(
                        -np.mean(np.where(hit, np.log(probability), np.log(1.0 - probability)))
                    ),
                    "spread": float(np.abs(ratio - np.median(ratio)).mean()),
                }
            )
    return rows


def _of_others(run: str, throw: CountedThrow, counted: list[tuple[str, CountedThrow]]) -> MissCalibration:
    """Return the calibration by the throws of a throw's kind in all other runs."""
    others = [one for other, one in counted if other != run and one.kind == throw.kind]
    rms_m, miss_m = (np.array([getattr(one, name) for one in others]) for name in ("rms_m", "miss_m"))
    return MissCalibration(kinds={throw.kind: kind_calibration(rms_m, miss_m)})


def main(arguments: list[str] | None = None) -> None:
    """State the throws again; print a table as JSON, and write every throw's statements."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("work", type=Path, help="folder of runs kept by loop.drawn --work")
    parser.add_argument("--radius", type=float, default=0.020, help="hit radius [m]")
    parser.add_argument("--out", type=Path, default=Path("results/restated.json"))
    options = parser.parse_args(arguments)
    throws = restated(options.work)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps(throws, indent=1), encoding="utf-8")
    for shipped in (False, True):
        for row in compared(throws, options.radius, shipped=shipped):
            print(json.dumps(row))


if __name__ == "__main__":
    main()
