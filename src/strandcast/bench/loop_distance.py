"""How far a later motion may go from the fitted one: where the tip goes against where it was told to go.

    python -m strandcast.bench.loop_distance WORK/default/usual --seeds 2001-2003

WORK is the folder that `strandcast.bench.loop --work WORK` has left. Around the first motion of each
experiment others are drawn, ever farther from it; each is predicted with the string fitted to the first
throw, with and without what the simulation missed by there, and played in the lab without scatter. The error
is how far the real path passes from the place where the predicted one comes nearest to the target.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.arm.load import load_arm
from strandcast.bench.loop import cases_of, numbers
from strandcast.bench.loop_oracle import played
from strandcast.motion.bezier import Curve
from strandcast.motion.later import Neighbourhood, neighbourhood, throw_near
from strandcast.motion.objective import closest_approach
from strandcast.motion.paths import paths_of_any
from strandcast.motion.plan import fitted_servo
from strandcast.motion.task import Task
from strandcast.motion.throws import AFTER_END_S, World
from strandcast.paper.cases import FILE, load_plan
from strandcast.seeds import rng
from strandcast.stages import plan as plan_stage
from strandcast.stages.context import context_of
from strandcast.stages.trials import read_trial

DISTANCES_RAD_S = (0.05, 0.1, 0.2, 0.4, 0.8, 1.5)  # rms over the control heights
DRAWS = 2
TRIES = 200


def altered(task: Task, curve: Curve, distance_rad_s: float, random: np.random.Generator) -> Curve | None:
    """Return a motion within the limits whose inner heights are that far off, rms; None if there is none."""
    shape = curve.heights_rad_s[:, 2:-2].shape
    for _ in range(TRIES):
        step = random.standard_normal(shape)
        heights = curve.heights_rad_s.copy()
        heights[:, 2:-2] += distance_rad_s * step / np.sqrt(np.mean(step**2))
        other = replace(curve, heights_rad_s=heights)
        if paths_of_any([other], task.step_s).excess(task.arm.limits)[0] == 0.0:
            return other
    return None


def predicted_path(task: Task, near: Neighbourhood, curve: Curve, *, carried: bool) -> np.ndarray:
    """Return the tip's path (T, 2) with the best string, with or without the carried residual [m]."""
    paths = paths_of_any([curve], task.step_s, AFTER_END_S)
    thrown, shift = throw_near(task, near, paths, curve.heights_rad_s[None])
    tip = thrown.points_m[0, : thrown.last[0] + 1, -1]
    return tip + shift[0, : len(tip)] if carried else tip


def rows_of(root: Path, name: str) -> list[dict[str, Any]]:
    """Return the errors of one experiment [m], by distance."""
    context = context_of(root, name)
    arm = load_arm(context.arm_file)
    task, strings, options = plan_stage.known_after(context, arm, 1)
    earlier = plan_stage.earlier_of(read_trial(context, 1), task.step_s)
    world = World(fitted_servo(task, [earlier]))
    near = neighbourhood(task, strings, world, earlier, [earlier], options)
    random = rng(name, context.settings.seed, 1, "distance")
    rows = []
    for distance in np.repeat(DISTANCES_RAD_S, DRAWS):
        curve = altered(task, near.best, float(distance), random)
        if curve is None:
            continue
        real = played(context, arm, curve, task.step_s).earlier.tip_m
        row: dict[str, Any] = {"experiment": name, "distance_rad_s": float(distance)}
        for how, carried in (("carried_m", True), ("fitted_m", False)):
            path = predicted_path(task, near, curve, carried=carried)
            _, at = closest_approach(path, len(path) - 1, *task.target_m)
            row[how] = float(closest_approach(real, len(real) - 1, *path[at])[0])
        rows.append(row)
    return rows


def summary_of(rows: list[dict[str, Any]]) -> list[dict[str, float]]:
    """Return median and 90 % quantile of the errors by distance [m]."""
    answer = []
    for distance in DISTANCES_RAD_S:
        mine = [row for row in rows if row["distance_rad_s"] == distance]
        if mine:
            line = {"distance_rad_s": distance, "motions": float(len(mine))}
            for how in ("carried_m", "fitted_m"):
                median, p90 = np.quantile([row[how] for row in mine], (0.5, 0.9))
                line |= {f"{how[:-2]}_median_m": float(median), f"{how[:-2]}_p90_m": float(p90)}
            answer.append(line)
    return answer


def main(arguments: list[str] | None = None) -> None:
    """Measure experiment by experiment."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("root", type=Path)
    parser.add_argument("--seeds", type=numbers, default=[2001, 2002, 2003])
    parser.add_argument("--strings", type=numbers, default=[])
    parser.add_argument("--out", type=Path, default=Path("results/bench-distance.json"))
    told = parser.parse_args(arguments)
    paper = load_plan(Path(__file__).resolve().parents[3] / FILE)
    rows: list[dict[str, Any]] = []
    told.out.parent.mkdir(parents=True, exist_ok=True)
    for case in cases_of(paper, told.strings, told.seeds, "default"):
        rows += rows_of(told.root, case.name)
        told.out.write_text(
            json.dumps({"summary": summary_of(rows), "rows": rows}, indent=1), encoding="utf-8"
        )
        print(case.name, file=sys.stderr)
    print(json.dumps(summary_of(rows), indent=1))


if __name__ == "__main__":
    main()
