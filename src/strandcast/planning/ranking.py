"""How near past trials came, also those whose tip was hidden, and which strings stay stable on them."""

import numpy as np

from strandcast.core.strings import StringBatch
from strandcast.dynamics.simulate import LONGEST_SEGMENT
from strandcast.planning.bias_correction import tip_bias
from strandcast.planning.past_trials import PastTrial
from strandcast.planning.rollouts import RolloutConditions, simulate_rollouts
from strandcast.planning.simulated_misses import simulated_miss
from strandcast.planning.task import PlanningTask


def likely_miss_m(task: PlanningTask, strings: StringBatch, trial: PastTrial) -> float:
    """Return the measured miss or, where there is none, that of the best string on the same joints.

    Where the tip was tracked, the bias correction takes the simulated path to the tracked one; in between,
    the bias is interpolated.
    """
    if trial.miss_m is not None:
        return trial.miss_m
    last = np.array([len(trial.q_rad) - 1])
    conditions = RolloutConditions(start_m=trial.start_m)
    rollouts = simulate_rollouts(task, strings.take([0]), conditions, trial.q_rad[None], last)
    bias_m = tip_bias(trial, rollouts.points_m[:, :, -1], task.step_s)
    if not np.isfinite(rollouts.points_m).all():
        return np.inf
    return float(simulated_miss(task.aim, rollouts.with_bias(bias_m))[0][0])


def stable_on_past_trials(task: PlanningTask, strings: StringBatch, trials: list[PastTrial]) -> np.ndarray:
    """Return (K,) whether each string can be simulated on the joints of all trials without diverging."""
    stable = np.ones(len(strings), dtype=bool)
    for trial in trials:
        last = np.array([len(trial.q_rad) - 1])
        conditions = RolloutConditions(start_m=trial.start_m)
        points_m = simulate_rollouts(task, strings, conditions, trial.q_rad[None], last).points_m
        length_m = np.linalg.norm(np.diff(points_m, axis=2), axis=3)
        # A comparison with NaN is false.
        stable &= (length_m < LONGEST_SEGMENT * task.model.spacing_m).all(axis=(1, 2))
    return stable
