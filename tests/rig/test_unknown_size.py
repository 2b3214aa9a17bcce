"""A standard deviation that is not known: near its prior with few deviations, the truth with many."""

import numpy as np

from strandcast.rig.unknown_size import SizePrior, prior_of, size_posterior

PRIOR = SizePrior(median=0.01, factor=2.0)


def posterior_rms(values: list[float], error: float = 0.0) -> float:
    column = np.array(values).reshape(-1, 1)
    return size_posterior(PRIOR, column, np.full_like(column, error)).rms


def test_without_deviations_the_size_is_the_priors() -> None:
    # E sigma^2 of a logarithmic normal distribution.
    np.testing.assert_allclose(prior_of(PRIOR).rms, 0.01 * np.exp(np.log(2.0) ** 2), rtol=2e-3)


def test_few_deviations_move_it_a_little_and_many_to_the_truth() -> None:
    drawn = np.random.default_rng(1).standard_normal(400)
    drawn *= 0.03 / drawn.std()
    np.testing.assert_allclose(posterior_rms((5.0 + drawn).tolist()), 0.03, rtol=0.02)
    assert prior_of(PRIOR).rms < posterior_rms([0.03, -0.03]) < 0.04


def test_a_common_offset_is_no_scatter_and_one_deviation_shows_none() -> None:
    np.testing.assert_allclose(posterior_rms([7.0]), prior_of(PRIOR).rms, rtol=1e-3)
    assert posterior_rms([7.0, 7.0, 7.0]) < 0.8 * prior_of(PRIOR).rms


def test_what_is_measured_badly_teaches_little() -> None:
    usual = prior_of(PRIOR).rms
    moved = posterior_rms([0.05, -0.05]) - usual
    assert abs(posterior_rms([0.05, -0.05], error=0.05) - usual) < 0.3 * moved
