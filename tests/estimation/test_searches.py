"""The searches on functions whose minimum is known, and on a throw at an equal budget."""

from __future__ import annotations

import numpy as np
import pytest

from strandcast.estimation.objective import Ledger
from strandcast.estimation.search import SEARCHES, Start, run
from strandcast.estimation.searches import evolution, evolve, latin_hypercube, paper
from strandcast.estimation.settings import FitSettings
from strandcast.estimation.spread import distant_members

from .known_string import objective_of, seen

GOAL = np.array([0.3, 0.8, 0.55])


def bowl(chi):
    value = np.linalg.norm((chi - GOAL) * [1.0, 3.0, 0.3], axis=1)
    value[chi[:, 0] > 0.9] = np.inf
    value[chi[:, 1] < 0.1] = np.nan
    return value


def test_paper_search_is_equation_3():
    ledger = Ledger(bowl)
    centre = np.array([0.5, 0.5, 0.98])
    paper(ledger, centre, 400, np.random.default_rng(1), trials=2, centre="fixed", chi_0=0.4, beta=0.99)
    chi, _ = ledger.all()
    assert ledger.count == 400
    reach = 0.4 / 2 * 0.99 ** np.arange(400)
    off = np.abs(chi - centre).max(axis=1)
    assert np.all(off <= reach + 1e-12)
    assert off[1:100].max() > 0.9 * reach[1]
    assert chi.max() == 1.0  # clipped
    assert np.mean(chi[1:50] - centre) < 0  # both ways, but for the clipping


def test_running_centre_walks_where_the_fixed_one_cannot():
    far = np.array([0.85, 0.2, 0.1])
    ends = {}
    for centre in ("fixed", "running"):
        ledger = Ledger(bowl)
        paper(ledger, far, 600, np.random.default_rng(2), centre=centre, chi_0=0.2, beta=0.998)
        ends[centre] = ledger.best()[1]
    assert ends["running"] < 0.1 < 0.5 < ends["fixed"]


def test_cma_finds_the_minimum_past_invalid_candidates():
    ledger = Ledger(bowl)
    evolve(ledger, np.array([0.85, 0.15, 0.5]), 1200, np.random.default_rng(3), population=12)
    best, value = ledger.best()
    np.testing.assert_allclose(best, GOAL, atol=2e-3)
    assert value < 1e-3
    assert 0 < ledger.rejected() < 200
    assert np.all(np.diff(ledger.convergence()[1]) <= 0)


def test_differential_evolution_finds_it_too_and_says_that_it_converged():
    ledger, random = Ledger(lambda chi: 1.0 + bowl(chi)), np.random.default_rng(3)
    population = random.random((20, 3))
    assert evolution(ledger, population, 3000, random, patience=1e-4)
    np.testing.assert_allclose(ledger.best()[0], GOAL, atol=5e-3)
    assert ledger.rejected() > 0
    assert ledger.count < 2500
    short = Ledger(bowl)
    assert not evolution(short, population, 70, np.random.default_rng(3))
    assert short.count == 60  # whole generations only


def test_nan_never_wins():
    ledger = Ledger(lambda chi: np.where(chi[:, 0] < 0.5, np.nan, chi[:, 0]))
    ledger(np.array([[0.1], [0.7], [0.6]]))
    assert ledger.best()[1] == 0.6


@pytest.fixture(scope="module")
def by_chance():
    """The usual best E of 400 strings drawn anywhere."""
    objective = objective_of([seen(1.0)], FitSettings())
    drawn = np.random.default_rng(1).random((5, 400, objective.space.dimension))
    return np.median([objective.cost(draws).min() for draws in drawn])


@pytest.mark.parametrize("name", list(SEARCHES))
def test_every_search_beats_chance_within_its_budget(name, by_chance):
    settings = FitSettings(search=name, evaluations=400, beta=0.99)
    objective = objective_of([seen(1.0)], settings)
    ledgers = [run(objective, settings, np.random.default_rng(k), Start(None, 1), 400) for k in (1, 1, 2)]
    assert ledgers[0].all()[0].tobytes() == ledgers[1].all()[0].tobytes()
    assert all(ledger.count <= 400 for ledger in ledgers)
    assert max(ledger.best()[1] for ledger in ledgers) < by_chance


def test_latin_hypercube_fills_every_slice():
    draws = latin_hypercube(20, 4, np.random.default_rng(5))
    np.testing.assert_array_equal(
        np.sort((draws * 20).astype(int), axis=0), np.tile(np.arange(20)[:, None], 4)
    )


def test_members_are_near_optimal_and_apart():
    rng = np.random.default_rng(6)
    chi = rng.random((400, 2))
    values = 1.0 + np.abs(chi[:, 0] - 0.5)
    rows = distant_members(chi, values, 4)
    assert rows[0] == np.argmin(values)
    assert values[rows].max() <= 1.1 * values.min()
    assert np.ptp(chi[rows, 1]) > 0.9  # spread where the value does not care
    assert len(distant_members(chi[:2], np.array([1.0, np.inf]), 4)) == 1
