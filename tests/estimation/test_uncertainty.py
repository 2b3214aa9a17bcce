"""Uncertainty: of a straight-line model, with an unobservable scale, and of a throw."""

from types import SimpleNamespace

import numpy as np
import pytest

from strandcast.config.estimate import EstimateSettings
from strandcast.core.strings import BEND_FRICTION, PLAIN_MASS, REST_CURL
from strandcast.estimation.descent import GaussNewtonModel, descend, descent_batch
from strandcast.estimation.fit_objective import EvaluationLog
from strandcast.estimation.uncertainty import (
    FLAT,
    RISE,
    correlated_count,
    decades_of,
    fisher,
    gauge_direction,
    near_range,
    uncertainty_of,
)
from strandcast.estimation.uncertainty import _crossing as crossing
from strandcast.estimation.unknowns import space_of

from .known_string import LAYOUT, MASS, TRUTH, objective_of, observed_throw

SIGMA_M = 0.001


def linear(frames=400, points=3, seed=0):
    """Differences that are linear in two exponents, with independent noise."""
    random = np.random.default_rng(seed)
    slopes = random.standard_normal((frames * points, 2, 2)) * [0.01, 0.002]
    noise = SIGMA_M * random.standard_normal((frames * points, 2))

    def residuals(chi):
        return noise - np.einsum("bd,rcd->brc", chi - 0.4, slopes), np.full(frames * points, 1.0)

    space = space_of(EstimateSettings(forces="paper"), LAYOUT)
    flat = SimpleNamespace(bounds=space.bounds[:2], prior_sd=np.full(2, np.inf))
    throw = SimpleNamespace(weight=np.ones((frames, points)))
    return SimpleNamespace(residuals=residuals, space=flat, throws=(throw,)), slopes


def test_fisher_information_is_that_of_a_straight_line_under_noise():
    objective, slopes = linear()
    information, noise_m, per_datum = fisher(
        objective, np.array([0.4, 0.4]), EvaluationLog(lambda chi: chi[:, 0])
    )
    assert noise_m == pytest.approx(SIGMA_M, rel=0.05)
    assert 1.0 <= per_datum < 2.0  # independent errors count one by one
    expected = np.einsum("rci,rcj->ij", slopes, slopes) / SIGMA_M**2
    np.testing.assert_allclose(information * per_datum, expected, rtol=0.1, atol=0.02 * expected.max())


def test_correlated_errors_count_once():
    objective, _ = linear()
    alone = np.random.default_rng(1).standard_normal((400, 1, 2))
    for points, frames in ((3, 1), (1, 8)):
        repeated = np.repeat(np.repeat(alone[: 400 // frames], frames, axis=0), 3, axis=1)
        if points == 1:
            repeated = repeated + 0.0
        found = correlated_count(objective, repeated.reshape(-1, 2))
        assert found == pytest.approx(3 * frames, rel=0.4)


def test_the_common_scale_of_masses_is_unobservable_and_fixed():
    assert gauge_direction(space_of(EstimateSettings(), LAYOUT)) is None
    settings = EstimateSettings(forces=["rest_curl", "bend_friction"])
    objective = objective_of([observed_throw(1.0)], settings, plain_mass=True)
    direction = gauge_direction(objective.space)
    assert objective.space.names[-3:] == (PLAIN_MASS, REST_CURL, BEND_FRICTION)
    values = np.concatenate([TRUTH, [MASS, 1.0, 0.5, 5.0]])
    chi = objective.space.exponents(values)
    both = objective.evaluate(np.array([chi, chi + 0.1 * direction]))
    assert both[0] == pytest.approx(both[1], rel=1e-6)
    ratios = objective.space.values(chi + 0.1 * direction) / values
    np.testing.assert_allclose(np.delete(ratios, -2), ratios[0])
    assert ratios[0] > 1.05
    assert ratios[-2] == pytest.approx(1.0)  # a curl has no mass
    log = EvaluationLog(objective.cost)
    log(chi[None])
    known = uncertainty_of(objective, log, profiles=False)
    assert not known.gauge_fixed
    covariance = known.correlation * np.outer(known.marginal, known.marginal)
    assert direction @ covariance @ direction < 1e-5


def test_profiles_and_deviations_of_a_throw():
    settings = EstimateSettings(forces="paper")
    objective = objective_of([observed_throw(1.0)], settings)
    log = EvaluationLog(objective.cost)
    start = objective.space.exponents(np.concatenate([TRUTH, [MASS]]))[None]
    descend(log, GaussNewtonModel(objective), descent_batch(start, log(start)), 600)
    known = uncertainty_of(objective, log, profiles=True)
    names = list(objective.space.names)
    tip, air = names.index("weight_1"), names.index("C_c1")
    assert known.noise_m == pytest.approx(0.0007, rel=0.15)
    assert np.all(known.marginal >= known.conditional * 0.999)
    assert np.all(known.marginal <= FLAT * 1.001)
    assert known.marginal[tip] < 0.1 * known.marginal[air]  # air drag hardly moves so heavy a string
    np.testing.assert_allclose(np.diag(known.correlation), 1.0)
    best, value = log.best()
    assert np.all((known.low <= best) & (best <= known.high))
    # A string of another valley that explains the throw as well extends the interval to its own.
    log.evaluate = lambda chi: np.full(len(chi), 1.01 * value)
    log(np.where(np.arange(len(best)) == tip, 1.0, best)[None])
    log.evaluate = objective.cost
    extended = uncertainty_of(objective, log, profiles=True)
    assert extended.high[tip] == 1.0
    assert extended.open_high[tip]
    truth = objective.space.exponents(np.concatenate([TRUTH, [MASS]]))
    assert known.low[tip] - 0.005 < truth[tip] < known.high[tip] + 0.005
    assert known.high[tip] - known.low[tip] < 0.05
    assert known.open_low[air]
    # At the end of an interval E has risen by RISE if the other unknowns do not compensate.
    moved = np.tile(best, (2, 1))
    moved[:, tip] = known.low[tip], known.high[tip]
    assert np.all(objective.cost(moved) > value * (1.0 + 0.5 * RISE))


def test_an_interval_includes_all_strings_that_explain_the_throw_as_well():
    log = EvaluationLog(lambda chi: np.array([1.0, 1.0 + 0.95 * RISE, 1.0 + 1.05 * RISE, np.nan]))
    log(np.array([[0.5, 0.5], [0.9, 0.4], [0.1, 0.6], [0.0, 1.0]]))
    np.testing.assert_array_equal(near_range(log), [[0.5, 0.4], [0.9, 0.5]])


def test_an_interval_ends_where_E_has_risen():
    tried = np.array([0.6, 0.7, 0.9])
    assert crossing(0.5, tried, RISE * np.array([0.25, 1.0, 9.0]) * (1 + 1e-9)) == (pytest.approx(0.7), False)
    assert crossing(0.5, tried, RISE * np.array([0.25, 4.0, 9.0])) == (pytest.approx(0.6 + 0.1 / 3), False)
    assert crossing(0.5, tried, RISE * np.array([0.0, 0.1, 0.2])) == (pytest.approx(0.9), True)
    assert crossing(0.5, tried, np.array([np.inf, np.inf, np.inf])) == (0.5, False)
    assert crossing(1.0, np.zeros(0), np.zeros(0)) == (1.0, True)


def test_ranges_in_decades():
    decades = decades_of(space_of(EstimateSettings(), LAYOUT))
    assert decades[0] == pytest.approx(5.0)
    assert np.isnan(decades[-1])
