"""The searches by name, each with the same budget: from the throws to a ledger of tried strings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from strandcast.estimation import searches
from strandcast.estimation.evaluation import Array
from strandcast.estimation.objective import Ledger, Objective
from strandcast.estimation.refine import LADDER, Slope, apart, descend, valleys
from strandcast.estimation.settings import FitSettings, prior_exponents
from strandcast.estimation.space import Strings
from strandcast.progress import Progress

DRAWS = 192  # of which a third knows no prior
KNOWN_DRAWS = 32  # beside the ensemble of the estimate before
POPULATION = 32
ROUNDS = 2  # of a descent, before the next thing is done
EARLY = (0.4, 0.7)  # of the used frames
EARLY_SHARE, WALK_SHARE, POLISH_SHARE = 0.085, 0.17, 0.15  # of the evaluations
ENDS = 2


@dataclass(frozen=True, eq=False)
class Start:
    """Where a search begins.

    Attributes
    ----------
    previous
        The estimate after the throw before, the best first; None for a first fit.
    trials
        Number of throws so far.
    """

    previous: Strings | None
    trials: int


@dataclass(frozen=True, eq=False)
class Job:
    """What a search works on: the throws, the settings, a start, chance, and how much it may simulate."""

    objective: Objective
    settings: FitSettings
    start: Start
    rng: np.random.Generator
    evaluations: int

    def left(self, ledger: Ledger) -> int:
        """Return the simulations that are not spent."""
        return self.evaluations - ledger.count


def run(
    objective: Objective,
    settings: FitSettings,
    rng: np.random.Generator,
    start: Start,
    evaluations: int,
) -> Ledger:
    """Search by the settings' name with at most so many simulations; the ledger holds all that was tried."""
    tell = Progress("estimate", evaluations)

    def told(count: int, best: float) -> None:
        more = f", {count - evaluations} more behind the search" if count > evaluations else ""
        tell(min(count, evaluations), f"best E {1e3 * best:.2f} mm{more}")

    ledger = Ledger(objective.cost, told)
    job = Job(objective, settings, start, rng, evaluations)
    ledger.converged = SEARCHES[settings.search](job, ledger)
    return ledger


def _paper(job: Job, ledger: Ledger) -> bool:
    """Search as the paper does, around the previous estimate or, without one, a random string."""
    space, previous, settings = job.objective.space, job.start.previous, job.settings
    centre = job.rng.random(space.dimension) if previous is None else space.chi_of(previous.pick(0))[0]
    searches.paper(
        ledger,
        centre,
        job.evaluations,
        job.rng,
        trials=job.start.trials,
        centre=settings.centre,
        chi_0=settings.chi_0,
        beta=settings.beta,
    )
    return False


def _descent(job: Job, ledger: Ledger) -> bool:
    """Descend from many draws for a while, let the ends evolve, and descend from the best to the bottom.

    A descent ends in the valley where it began, and E has many; evolution finds the valley but is slow in it.
    """
    _draw(job, ledger)
    population, values = _population(ledger)
    if not np.isfinite(values[0]):
        return False
    effort = ROUNDS * (population.shape[1] + 1 + len(LADDER))
    if job.start.previous is None:
        few = int(EARLY_SHARE * job.evaluations / (len(EARLY) * effort))
        population[:few] = _by_early_frames(job, ledger, population[:few])
        values[:few] = ledger(population[:few])
    many = int(WALK_SHARE * job.evaluations / effort)
    walked = valleys(population[:many], values[:many])
    population[:many] = descend(ledger, Slope(job.objective), walked, job.left(ledger), ROUNDS).chi
    polish = int(POLISH_SHARE * job.evaluations)
    searches.evolution(ledger, population, job.left(ledger) - polish, job.rng)
    return _to_the_bottom(job, ledger)


def _population(ledger: Ledger) -> tuple[Array, Array]:
    """Return candidates (P, d), the best first, that lie apart as far as there are such, and their E (P,)."""
    chi, values = ledger.all()
    rows = apart(chi, values, POPULATION)
    others = np.argsort(values, kind="stable")
    rows = np.concatenate([rows, others[~np.isin(others, rows)]])[:POPULATION]
    return chi[rows], values[rows]


def _by_early_frames(job: Job, ledger: Ledger, starts: Array) -> Array:
    """Walk down on the early frames, then on more of them: a whip forgets, and its E has many valleys."""
    for share in EARLY if len(starts) else ():
        tasks = tuple(task.until(share) for task in job.objective.tasks)
        early = replace(job.objective, tasks=tasks)
        own = Ledger(early.cost)
        now = valleys(starts, own(starts))
        starts = descend(own, Slope(early), now, job.left(ledger), ROUNDS).chi
        ledger.count += own.count
    return starts


def _evolution(job: Job, ledger: Ledger) -> bool:
    """Differential evolution from the best draws."""
    _draw(job, ledger)
    return searches.evolution(ledger, _population(ledger)[0], job.left(ledger), job.rng)


def _cma(job: Job, ledger: Ledger) -> bool:
    """CMA-ES from the best draw."""
    _draw(job, ledger)
    return searches.evolve(ledger, ledger.best()[0], job.left(ledger), job.rng)


def _draw(job: Job, ledger: Ledger) -> None:
    """Try strings of the prior and, for a first fit, of a Latin hypercube; else the ensemble before."""
    space, model = job.objective.space, job.objective.model
    if job.start.previous is not None:
        ledger(space.chi_of(job.start.previous))
        ledger(prior_exponents(space, model, KNOWN_DRAWS, job.rng))
        return
    draws = min(DRAWS, job.evaluations // 12)
    ledger(prior_exponents(space, model, draws - draws // 3, job.rng))
    ledger(searches.latin_hypercube(draws // 3, space.dimension, job.rng))


def _to_the_bottom(job: Job, ledger: Ledger) -> bool:
    """Walk down from the best candidates that lie apart; the worse half ends now and then.

    Returns
    -------
    Whether the best arrived.
    """
    chi, values = ledger.all()
    rows = apart(chi, values, ENDS)
    now, slope = valleys(chi[rows], values[rows]), Slope(job.objective)
    before = -1
    while not now.done.all() and ledger.count > before:
        before = ledger.count
        now = descend(ledger, slope, now, job.left(ledger), ROUNDS)
        now = now.pick(np.argsort(now.value, kind="stable")[: max(len(now.value) // 2, 1)])
    return bool(now.done.all())


SEARCHES: dict[str, Callable[[Job, Ledger], bool]] = {
    "descent": _descent,
    "cma": _cma,
    "evolution": _evolution,
    "paper": _paper,
}
