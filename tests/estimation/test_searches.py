"""The searches on functions whose minimum is known."""

from __future__ import annotations

import numpy as np
import pytest

from strandcast.estimation.objective import Ledger
from strandcast.estimation.refine import refine
from strandcast.estimation.searches import evolve, latin_hypercube, paper
from strandcast.estimation.spread import distant_members

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


def test_nan_never_wins():
    ledger = Ledger(lambda chi: np.where(chi[:, 0] < 0.5, np.nan, chi[:, 0]))
    ledger(np.array([[0.1], [0.7], [0.6]]))
    assert ledger.best()[1] == 0.6


@pytest.mark.parametrize("corner", [False, True])
def test_refine_finds_the_least_weighted_distances(corner):
    rng = np.random.default_rng(4)
    slopes = rng.standard_normal((60, 2, 3))
    goal = np.array([0.3, 0.6, 1.2 if corner else 0.9])
    weight = rng.uniform(0.5, 1.5, 60) / 60

    def residuals(chi):
        return (chi - goal) @ slopes.transpose(0, 2, 1).reshape(-1, 3).T.reshape(3, -1), weight

    def shaped(chi):
        difference, _ = residuals(chi)
        return difference.reshape(len(chi), 60, 2), weight

    ledger = Ledger(lambda chi: np.linalg.norm(shaped(chi)[0], axis=2) @ weight)
    chi, curvature = refine(ledger, shaped, np.array([0.8, 0.1, 0.2]), 300)
    assert ledger.count <= 300
    if corner:
        assert chi[2] == 1.0
        around = np.clip(chi + 0.01 * rng.standard_normal((500, 3)), 0.0, 1.0)
        assert ledger.evaluate(around).min() > 0.999 * ledger.best()[1]
    else:
        np.testing.assert_allclose(chi, goal, atol=1e-3)
    assert np.linalg.eigvalsh(curvature).min() > 0


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
