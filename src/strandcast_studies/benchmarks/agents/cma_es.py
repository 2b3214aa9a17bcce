"""The CMA-ES library, set up for reproducible runs without output: the only place that calls it."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import cma


def cma_es(
    start: np.ndarray, sigma: float, population: int, rng: np.random.Generator, *, tolfun: float
) -> "cma.CMAEvolutionStrategy":
    """Return a CMA-ES strategy: `ask` returns a generation, `tell` takes its values, `stop` reasons to end.

    Parameters
    ----------
    start, sigma
        (d,) first mean, and the first standard deviation; all coordinates are of one scale.
    population
        Candidates per generation.
    rng
        Source of randomness, instead of numpy's global generator.
    tolfun
        The library stops when the values differ by less.
    """
    import cma  # takes as long as all else together: only for a search that needs it

    options = {
        "popsize": population,
        "seed": np.nan,
        "randn": lambda *shape: rng.standard_normal(shape),
        "verbose": -9,
        "verb_log": 0,
        "tolfun": tolfun,
        "tolx": 1e-5,
    }
    return cma.CMAEvolutionStrategy(start, sigma, options)
