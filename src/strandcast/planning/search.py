"""Inputs and result of a search for a motion, and CMA-ES over motions."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from strandcast.config.plan import PlanSettings
from strandcast.core.cma_es import cma_es
from strandcast.core.disturbances import TYPICAL_SIZES
from strandcast.core.strings import StringBatch
from strandcast.planning.bezier import Curve
from strandcast.planning.miss_calibration import NO_EVIDENCE, Evidence
from strandcast.planning.rollouts import RolloutConditions
from strandcast.planning.task import PlanningTask

POPULATION = 16  # chosen


@dataclass(frozen=True, eq=False)
class SearchInputs:
    """The task, the strings and the conditions to simulate motions with, the settings, random numbers.

    ``sizes`` (1, 5) are those of the disturbances, see `planning.scenarios.disturbed`; ``evidence`` is what
    past trials say of the prediction.
    """

    task: PlanningTask
    strings: StringBatch
    conditions: RolloutConditions
    settings: PlanSettings
    rng: np.random.Generator
    sizes: np.ndarray = field(default_factory=lambda: TYPICAL_SIZES)
    evidence: Evidence = NO_EVIDENCE


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The motion that a search found, and how."""

    kind: str
    curve: Curve
    simulations: int
    flags: list[str]
    parent_trial: int | None = None


def minimise(
    value: Callable[[np.ndarray], np.ndarray],
    start: np.ndarray,
    spread: float,
    evaluations: int,
    rng: np.random.Generator,
    report: Callable[[int, float], None],
) -> tuple[np.ndarray, float, int]:
    """Minimise a function of whole populations.

    Parameters
    ----------
    value
        Returns (P,) values of (P, d) points.
    start, spread
        (d,) where the search starts, and its standard deviation, the same for all coordinates.
    evaluations
        How many points it may try.
    report
        Receives how many points were tried, and the least value so far.

    Returns
    -------
    The best point tried, the start included, its value, and how many points were tried.
    """
    strategy = cma_es(start, spread, POPULATION, rng, tolfun=1e-6)
    best, best_value = np.array(start, float), float(value(np.array(start)[None])[0])
    done = 1
    while done + POPULATION <= evaluations and best_value > 0.0 and not strategy.stop():
        points = np.array(strategy.ask())
        values = value(points)
        strategy.tell(list(points), values.tolist())
        done += POPULATION
        if values.min() < best_value:
            best, best_value = points[int(np.argmin(values))], float(values.min())
        report(done, best_value)
    return best, best_value, done
