"""The arguments and the protocol of an optimiser."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from strandcast.config.estimate import EstimateSettings
from strandcast.core.strings import StringBatch
from strandcast.estimation.fit_objective import EvaluationLog, FitObjective


@dataclass(frozen=True, eq=False)
class SearchStart:
    """The start of a search.

    Attributes
    ----------
    previous
        The previous estimate, the best string first; None for a first fit.
    trials
        Number of throws so far.
    """

    previous: StringBatch | None
    trials: int


@dataclass(frozen=True, eq=False)
class SearchProblem:
    """The problem that a search solves.

    Attributes
    ----------
    objective
        E of the throws, and the box of unknowns `objective.space`.
    settings, start
        The settings of the fit, and the result of earlier throws.
    rng
        The only source of randomness that an optimiser may use.
    evaluations
        Number of simulations that it may spend.
    """

    objective: FitObjective
    settings: EstimateSettings
    start: SearchStart
    rng: np.random.Generator
    evaluations: int

    def left(self, log: EvaluationLog) -> int:
        """Return the number of simulations that are left."""
        return self.evaluations - log.count


class Optimiser(Protocol):
    """A search for the exponents with the least E."""

    def __call__(self, problem: SearchProblem, log: EvaluationLog, /) -> bool:
        """Evaluate candidates by calling the log, until ``problem.left(log)`` is spent.

        ``log(chi)`` takes (B, d) exponents in [0, 1], simulates them in one batch, remembers them, and
        returns their costs (B,) [m], infinite for strings that cannot be simulated. The best candidate in the
        log is the result.

        Returns
        -------
        Whether the search ended because nothing improved any more.
        """
