"""Rates and misses against numbers computed by hand."""

import pytest

from strandcast_studies.hit_rates import (
    hit_rate,
    hit_rates,
    misses_at,
    nearest_by,
    nearest_m,
)

RUNS = [
    [0.030, 0.004],  # hits at 20 mm in trial 2
    [0.018],  # in trial 1
    [0.120, None, 0.060],  # never; the tip of trial 2 was not detected
    [],  # failed before it was thrown
]


def test_rates_include_failed_runs():
    rate = hit_rate(RUNS, 0.020, 1)
    assert (rate.hits, rate.runs, rate.share) == (1, 4, 0.25)
    assert hit_rate(RUNS, 0.020, 2).hits == 2
    assert hit_rate(RUNS, 0.010, 2).hits == 1
    assert hit_rate(RUNS, 0.060, 3).hits == 3
    assert hit_rate([], 0.020, 1).share is None


def test_rates_are_ordered_by_radius():
    table = hit_rates(iter(RUNS), (0.05, 0.02), (1, 2))
    assert [(rate.radius_m, rate.trial, rate.hits) for rate in table] == [
        (0.05, 1, 2),
        (0.05, 2, 2),
        (0.02, 1, 1),
        (0.02, 2, 2),
    ]


def test_misses_of_the_throws_made():
    spread = misses_at(RUNS, 1)
    assert (spread.known, spread.unknown) == (3, 0)
    assert spread.median_m == 0.030
    assert spread.p90_m == pytest.approx(0.030 + 0.8 * 0.090)
    assert spread.max_m == 0.120
    second = misses_at(RUNS, 2)
    assert (second.known, second.unknown, second.median_m) == (1, 1, 0.004)
    assert misses_at(RUNS, 4) == (4, 0, 0, None, None, None)


def test_a_run_that_has_hit_keeps_its_hit():
    spread = nearest_by(RUNS, 3)
    assert (spread.known, spread.unknown) == (3, 1)
    assert spread.median_m == 0.018
    assert spread.max_m == 0.060
    assert nearest_m([None, None], 2) is None
