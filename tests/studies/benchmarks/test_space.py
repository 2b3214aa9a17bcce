"""The benchmark in space: what is drawn, and one case from the first plan to the second throw."""

import numpy as np
import pytest

from strandcast.config.estimate import EstimateSettings
from strandcast.config.plan import PlanSettings
from strandcast_studies.benchmarks.space import run
from strandcast_studies.benchmarks.space.drawn import LENGTH_M, OF_LENGTH, REACH_M, drawn_case


@pytest.mark.parametrize("seed", [11, 12])
def test_targets_are_beyond_the_hand_but_not_the_string(seed: int) -> None:
    case = drawn_case(seed)
    assert len(case.arm.joints) == (7 if seed % 2 else 6)
    assert LENGTH_M[0] <= case.string.length_m <= LENGTH_M[1]
    away_m = np.linalg.norm(case.target_m - case.arm.chain.anchors_m[1])
    reach_m = REACH_M[case.arm.name]
    assert reach_m < away_m < reach_m + OF_LENGTH * case.string.length_m
    limits = case.arm.limits
    low, high = np.maximum(limits.lower_rad, -np.pi), np.minimum(limits.upper_rad, np.pi)
    q = np.random.default_rng(0).uniform(low, high, (20_000, len(low)))
    hands_m = case.arm.hand_path(q)[:, :3]
    assert np.linalg.norm(hands_m - case.arm.chain.anchors_m[1], axis=1).max() <= reach_m + 5e-4


@pytest.mark.thorough
def test_a_case_is_thrown_fitted_and_planned_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "PLAN", PlanSettings(evaluations=64))
    monkeypatch.setattr(run, "ESTIMATE", EstimateSettings(evaluations=150))
    monkeypatch.setattr(run, "HIT_RADIUS_M", 10.0)
    before, first, second = run.run_case(12, 2, rehearsed=True, every=True)  # also after a hit
    assert (before.kind, before.trial, before.fit_E_m) == ("first", 0, None)
    assert (first.kind, first.trial, first.fit_E_m) == ("rehearsed", 1, None)
    assert second.kind in ("refined", "replanned")
    assert second.fit_E_m is not None
    assert second.fit_E_m < 0.03
    for throw in (before, first, second):
        # The track's noise, and the frame rate.
        np.testing.assert_allclose(throw.miss_m, throw.true_miss_m, atol=0.01)
        assert throw.plan_cpu_s > 0.0


@pytest.mark.thorough
def test_a_case_ends_with_a_hit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "PLAN", PlanSettings(evaluations=64))
    monkeypatch.setattr(run, "HIT_RADIUS_M", 10.0)
    (only,) = run.run_case(12, 2)
    assert only.trial == 1
