"""The paper's shrinking random search, eq. 3."""

import numpy as np

from strandcast.estimation.evaluation import Array
from strandcast.estimation.fit_objective import EvaluationLog
from strandcast.estimation.optimisers.optimiser import SearchProblem

CHI_0, BETA = 1.0, 0.999  # not printed in the paper; beta is "slightly less than 1"
BATCH = 16  # candidates evaluated together, after which the centre may move (chosen)


def search_like_the_paper(problem: SearchProblem, log: EvaluationLog) -> bool:
    """Search as the paper does, around the previous estimate or, without one, a random string."""
    space, previous = problem.objective.space, problem.start.previous
    centre = problem.rng.random(space.dimension) if previous is None else space.chi_of(previous.take(0))[0]
    shrinking_search(log, centre, problem.evaluations, problem.rng, trials=problem.start.trials)
    return False


def shrinking_search(
    log: EvaluationLog,
    chi_best: Array,
    evaluations: int,
    rng: np.random.Generator,
    *,
    trials: int = 1,
    chi_0: float = CHI_0,
    beta: float = BETA,
) -> None:
    """Shrinking random search, eq. (3): chi_m = chi_best + chi_0 / M beta^m RAND(-1, 1), clipped to [0, 1].

    Parameters
    ----------
    log
        Evaluates candidates and remembers them.
    chi_best
        (d,) first centre: the estimate after the previous trial. It moves to the best found so far, batch by
        batch: fixed, as printed, it is much worse.
    evaluations
        Number of parameter changes m.
    rng
        Source of randomness.
    trials
        M, the number of real trials so far.
    chi_0, beta
        Largest first change of a parameter, as a share of its range, and the factor by which it shrinks.
    """
    start = log.count
    best_chi, best_value = np.clip(chi_best, 0.0, 1.0), float(log(chi_best[None])[0])
    while (done := log.count - start) < evaluations:
        m = np.arange(done, min(done + BATCH, evaluations))
        reach = chi_0 / trials * beta ** m[:, None]
        step = reach * rng.uniform(-1.0, 1.0, (len(m), len(chi_best)))
        candidates = np.clip(best_chi + step, 0.0, 1.0)
        values = log(candidates)
        k = int(np.argmin(values))
        if values[k] < best_value:
            best_chi, best_value = candidates[k], float(values[k])
