"""Prediction error of the tip's path against the distance of a motion from the fitted one.

    python -m strandcast_studies.benchmarks.loop.distance WORK/default/usual --seeds 2001-2003

WORK is the folder made by `loop.run --work WORK`. Random motions are drawn at increasing distances from the
first motion of each experiment. Each is predicted with the string fitted to the first throw, with and without
bias correction, and played in the lab without scatter. The error is the distance of the true path from the
point of the predicted path that is nearest to the target.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.arm.load import load_arm
from strandcast.planning.approach import closest_approaches
from strandcast.planning.bezier import Curve
from strandcast.planning.local_search import Neighbourhood, neighbourhood, rollouts_near
from strandcast.planning.paths import paths_of_any
from strandcast.planning.plan import fitted_servo
from strandcast.planning.rollouts import AFTER_END_S, RolloutConditions
from strandcast.planning.task import PlanningTask
from strandcast.seeds import rng
from strandcast.stages.past_trials import read_trial
from strandcast.stages.plan_inputs import next_inputs, past_trial_of
from strandcast.stages.run import files_of
from strandcast_studies.benchmarks.loop.follow_up import follow_up
from strandcast_studies.benchmarks.loop.oracle import played

DISTANCES_RAD_S = (0.05, 0.1, 0.2, 0.4, 0.8, 1.5)  # rms over the control heights; chosen
DRAWS = 2  # motions per distance
TRIES = 200  # to find a motion within the limits


def altered(
    task: PlanningTask, curve: Curve, distance_rad_s: float, random: np.random.Generator
) -> Curve | None:
    """Return a motion within the limits at an rms distance in its inner heights; None if none is found."""
    shape = curve.heights_rad_s[:, 2:-2].shape
    for _ in range(TRIES):
        step = random.standard_normal(shape)
        heights = curve.heights_rad_s.copy()
        heights[:, 2:-2] += distance_rad_s * step / np.sqrt(np.mean(step**2))
        other = replace(curve, heights_rad_s=heights)
        if paths_of_any([other], task.step_s).excess(task.arm)[0] == 0.0:
            return other
    return None


def predicted_path(task: PlanningTask, near: Neighbourhood, curve: Curve, *, corrected: bool) -> np.ndarray:
    """Return the tip's path (T, 2) with the best string, with or without bias correction [m]."""
    paths = paths_of_any([curve], task.step_s, AFTER_END_S)
    rollouts = rollouts_near(task, near, paths, curve.heights_rad_s[None])
    tip = rollouts.points_m[0, : rollouts.last[0] + 1, -1]
    return tip + rollouts.tip_bias_m[0, : len(tip)] if corrected else tip


def rows_of(root: Path, name: str) -> list[dict[str, Any]]:
    """Return the errors of one experiment [m] by distance."""
    files = files_of("plan", root, name, 2)
    context = files.job.context
    arm = load_arm(context.arm_file).planar()
    task, strings = next_inputs(context, arm, files.input("ensemble"))
    first = past_trial_of(read_trial(files, 1), task)
    conditions = RolloutConditions(fitted_servo(task, [first]))
    near = neighbourhood(task, strings, conditions, first, [first])
    random = rng(name, context.settings.seed, 1, "distance")
    rows = []
    for distance in np.repeat(DISTANCES_RAD_S, DRAWS):
        curve = altered(task, near.best, float(distance), random)
        if curve is None:
            continue
        real = played(context, arm, curve, task.step_s).tip_m
        row: dict[str, Any] = {"experiment": name, "distance_rad_s": float(distance)}
        for how, corrected in (("carried_m", True), ("fitted_m", False)):
            path = predicted_path(task, near, curve, corrected=corrected)
            _, (at,) = closest_approaches(path[None], np.array([len(path) - 1]), task.target_m)
            (away_m,), _ = closest_approaches(real[None], np.array([len(real) - 1]), path[at])
            row[how] = float(away_m)
        rows.append(row)
    return rows


def summary_of(rows: list[dict[str, Any]]) -> list[dict[str, float]]:
    """Return the median and the 90 % quantile of the errors by distance [m]."""
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
    """Measure the experiments one by one."""
    follow_up(__doc__, "results/bench-distance.json", rows_of, summary_of, arguments)


if __name__ == "__main__":
    main()
