"""Intervals of shares against published values."""

import math

import pytest

from strandcast.core.shares import wilson


def test_wilson_agrees_with_published_values():
    # Wilson's interval of 8 out of 10 at 95 %: 0.4902 to 0.9433 (Agresti & Coull 1998 and any table).
    assert wilson(8, 10) == pytest.approx((0.4902, 0.9433), abs=1e-4)
    assert wilson(0, 10) == pytest.approx((0.0, 0.2775), abs=1e-4)
    assert wilson(21, 21) == pytest.approx((0.8454, 1.0), abs=1e-4)
    assert wilson(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize("runs", [1, 7, 105, 10**6])
def test_wilson_is_symmetric_and_contains_the_share(runs):
    for hits in {0, 1, runs // 3, runs}:
        low, high = wilson(hits, runs)
        assert 0.0 <= low <= hits / runs <= high <= 1.0
        assert (1 - high, 1 - low) == pytest.approx(wilson(runs - hits, runs), abs=1e-12)


def test_wilson_solves_its_quadratic():
    # Its ends are the shares p that are z standard errors away from the observed share.
    for end in wilson(3, 17):
        assert abs(3 / 17 - end) / math.sqrt(end * (1 - end) / 17) == pytest.approx(1.959964, rel=1e-6)


def test_more_hits_than_runs_is_refused():
    with pytest.raises(ValueError, match="3 hits out of 2"):
        wilson(3, 2)
