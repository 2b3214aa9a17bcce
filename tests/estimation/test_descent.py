"""Levenberg-Marquardt from several starts: on a sum of distances with a known minimum, and on a throw."""

import numpy as np
import pytest

from strandcast.config.estimate import EstimateSettings
from strandcast.core.strings import CAMERA_OFFSET
from strandcast.estimation.descent import (
    NEAREST_M,
    GaussNewtonModel,
    apart,
    descend,
    descent_batch,
    normal_equations,
)
from strandcast.estimation.ensemble import WIDTH, near_samples
from strandcast.estimation.fit_objective import EvaluationLog

from .known_string import objective_of, observed_throw

SLOPES = np.random.default_rng(4).standard_normal((60, 2, 3))
WEIGHT = np.random.default_rng(5).uniform(0.5, 1.5, 60) / 60
STEP = 1e-6


def distances_to(goal):
    def differences(chi):
        return np.einsum("bd,rcd->brc", np.atleast_2d(chi) - goal, SLOPES)

    def slopes(chi):
        found = []
        for point in chi:
            moved = np.vstack([point, point + STEP * np.eye(3)])
            found.append(normal_equations(differences(moved), WEIGHT, np.full(3, STEP), NEAREST_M))
        return tuple(np.array(part) for part in zip(*found, strict=True))

    return EvaluationLog(lambda chi: np.linalg.norm(differences(chi), axis=2) @ WEIGHT), slopes


@pytest.mark.parametrize("corner", [False, True])
def test_several_starts_reach_the_minimum_of_weighted_distances(corner):
    goal = np.array([0.3, 0.6, 1.2 if corner else 0.9])
    log, slopes = distances_to(goal)
    starts = np.array([[0.8, 0.1, 0.2], [0.1, 0.9, 0.9]])
    now = descend(log, slopes, descent_batch(starts, log(starts)), 600)
    assert log.count <= 602
    if corner:
        np.testing.assert_array_equal(now.chi[:, 2], 1.0)
        around = np.clip(now.chi[0] + 0.01 * np.random.default_rng(6).standard_normal((500, 3)), 0.0, 1.0)
        assert log.evaluate(around).min() > 0.999 * log.best()[1]
    else:
        np.testing.assert_allclose(now.chi, [goal, goal], atol=1e-3)
    assert np.linalg.eigvalsh(now.curvature[0]).min() > 0


def test_a_held_unknown_stays_and_the_others_compensate():
    log, slopes = distances_to(np.array([0.3, 0.6, 0.9]))
    start = np.array([[0.5, 0.1, 0.2]])
    held = np.array([[True, False, False]])
    now = descend(log, slopes, descent_batch(start, log(start), held), 600)
    assert now.chi[0, 0] == 0.5
    nearby = now.chi + np.array([[0.0, 1e-2, 0.0], [0.0, -1e-2, 0.0], [0.0, 0.0, 1e-2], [0.0, 0.0, -1e-2]])
    assert np.all(log.evaluate(nearby) > now.value[0])


def test_normal_equations_are_the_derivatives_of_the_sum():
    log, slopes = distances_to(np.array([0.3, 0.6, 0.9]))
    point = np.array([[0.7, 0.2, 0.4]])
    gradient = slopes(point)[0][0]
    ahead, behind = (log.evaluate(point + sign * 1e-5 * np.eye(3)) for sign in (1.0, -1.0))
    np.testing.assert_allclose(gradient, (ahead - behind) / 2e-5, rtol=1e-4)


def test_the_gradient_of_a_throw_includes_the_prior():
    settings = EstimateSettings(camera_offset_sd_m=0.001)
    objective = objective_of([observed_throw(1.0)], settings)
    chi = np.full((1, objective.space.dimension), 0.5)
    k = objective.space.names.index(CAMERA_OFFSET[0])
    chi[0, k] = 0.9
    gradient, curvature = GaussNewtonModel(objective)(chi)
    loose = objective_of([observed_throw(1.0)], EstimateSettings(camera_offset_sd_m=0.001)).space
    width = loose.bounds[k, 1] - loose.bounds[k, 0]
    penalty = objective.space.penalty(chi + 1e-4 * np.eye(len(chi[0]))[k]) - objective.space.penalty(chi)
    free = objective_of([observed_throw(1.0)], settings)
    free.space.prior_sd[:] = np.inf
    without = GaussNewtonModel(free)(chi)
    assert gradient[0, k] - without[0][0, k] == pytest.approx(penalty[0] / 1e-4, rel=1e-3)
    assert curvature[0, k, k] - without[1][0, k, k] == pytest.approx(4e-5 * (width / 0.001) ** 2, rel=1e-6)


def test_starts_differ_and_the_best_is_first():
    chi = np.array([[0.5, 0.5], [0.52, 0.5], [0.9, 0.5], [0.5, 0.1]])
    np.testing.assert_array_equal(apart(chi, np.array([2.0, 1.0, 3.0, np.inf]), 4), [1, 2])


def test_samples_next_to_a_string_without_a_derivative_are_as_wide_as_allowed() -> None:
    best = np.full(4, 0.5)
    found = near_samples(best, 1e-3, np.full((4, 4), np.nan), 400, np.random.default_rng(1))
    np.testing.assert_allclose(found.std(axis=0), WIDTH, rtol=0.2)
