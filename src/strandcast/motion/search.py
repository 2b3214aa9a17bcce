"""CMA-ES over motions."""

from __future__ import annotations

from collections.abc import Callable

import cma
import numpy as np

from strandcast.progress import Progress

POPULATION = 16


def minimise(
    value: Callable[[np.ndarray], np.ndarray],
    start: np.ndarray,
    spread: float,
    evaluations: int,
    rng: np.random.Generator,
    tell: Progress,
    told: int = 0,
    good_enough: float = 0.0,
) -> tuple[np.ndarray, float, int]:
    """Minimise a function of whole populations.

    Parameters
    ----------
    value
        Takes (P, d) points, gives (P,) values.
    start, spread
        (d,) where the search starts, and its standard deviation, all coordinates being of one scale.
    evaluations
        How many points it may try.
    tell, told
        Progress, and how many evaluations were told before.
    good_enough
        Value at which the search stops.

    Returns
    -------
    The best point tried, the start included, its value, and how many points were tried.
    """
    strategy = cma.CMAEvolutionStrategy(
        start,
        spread,
        {
            "popsize": POPULATION,
            "seed": np.nan,  # leave numpy's global generator alone
            "randn": lambda *shape: rng.standard_normal(shape),
            "verbose": -9,
            "tolfun": 1e-6,
            "tolx": 1e-5,
        },
    )
    best, best_value = np.array(start, float), float(value(np.array(start)[None])[0])
    done = 1
    while done + POPULATION <= evaluations and best_value > good_enough and not strategy.stop():
        points = np.array(strategy.ask())
        values = value(points)
        strategy.tell(list(points), values.tolist())
        done += POPULATION
        if values.min() < best_value:
            best, best_value = points[int(np.argmin(values))], float(values.min())
        tell(told + done, f"best {1000 * best_value:.1f} mm")
    return best, best_value, done
