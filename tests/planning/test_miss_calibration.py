"""Calibrated probabilities: they hold for throws that the calibration has not seen."""

import json

import numpy as np
import pytest

from strandcast.planning import miss_calibration
from strandcast.planning.miss_calibration import (
    LEVELS,
    KindCalibration,
    MissCalibration,
    MissDistribution,
    miss_distribution,
)
from strandcast_studies.benchmarks.loop.calibration import CountedThrow, fit, main, merged, reliability


def throws(count, seed, gain=2.0):
    """Misses of gain times what was simulated, and 3 mm that no simulation knows of."""
    random = np.random.default_rng(seed)
    rms_m = 10 ** random.uniform(-3.0, -1.5, count)
    miss_m = (0.003 + gain * rms_m) * random.rayleigh(0.7, count)
    simulated = 1.0 - np.exp(-((0.02 / rms_m) ** 2))
    return [CountedThrow("first", 1, *row) for row in zip(rms_m, simulated, miss_m, strict=True)]


def test_stated_shares_hold_for_other_throws():
    made = fit(throws(300, 1), "a test")
    seen = reliability(throws(2000, 2), made, 0.02)
    assert seen["below_p50"]["share"] == pytest.approx(0.5, abs=0.07)
    assert seen["below_p90"]["share"] == pytest.approx(0.9, abs=0.05)
    calibrated, simulated = seen["calibrated"], seen["simulated"]
    assert calibrated["mean"] == pytest.approx(seen["hits"] / seen["throws"], abs=0.04)
    assert simulated["mean"] > calibrated["mean"] + 0.1  # too sure
    assert calibrated["brier"] < simulated["brier"]
    assert calibrated["log_loss"] < simulated["log_loss"]


def test_a_kind_with_few_throws_takes_those_of_a_similar_one():
    few = [throw._replace(kind="replanned") for throw in throws(5, 3)]
    made = fit(throws(100, 1) + few, "a test")
    assert made.kinds["first"].throws == 100
    assert made.kinds["replanned"].throws == 105
    assert set(fit(few, "a test").kinds) == set()


def test_counts_in_space_leave_the_plane_as_it_was_and_the_other_way_round():
    in_plane = fit(throws(100, 1), "the plane")
    thrown = [throw._replace(kind="first in space") for throw in throws(60, 2, gain=5.0)]
    in_space = fit(thrown, "space")
    both = merged(in_plane, in_space, space=True)
    assert both.kinds == in_plane.kinds | in_space.kinds
    assert (both.made_from, both.made_from_in_space) == ("the plane", "space")
    again = merged(both, fit(throws(80, 3), "the plane again"), space=False)
    assert (again.made_from, again.made_from_in_space) == ("the plane again", "space")
    assert again.kinds["first"].throws == 80
    assert again.kinds["first in space"] == both.kinds["first in space"]


def test_probability_and_quantile_are_inverse_and_reach_into_the_tails():
    miss = MissDistribution(0.02 * np.array(LEVELS) ** 2)
    for share in (0.01, 0.05, 0.3, 0.5, 0.9, 0.95, 0.99, 0.999):
        assert miss.within(miss.quantile_m(share)) == pytest.approx(share)
    assert miss.within(0.0) == 0.0
    assert miss.within(10.0) < 1.0


def test_only_motions_like_those_counted_are_calibrated(monkeypatch):
    known = KindCalibration(throws=40, floor_m=0.001, gain=2.0, ratios=list(LEVELS))
    only = MissCalibration(made_from="a test", kinds={"first": known})
    monkeypatch.setattr(miss_calibration, "calibration", lambda: only)
    simulated_m = np.array([0.003, 0.004])
    stated = miss_distribution("ensemble", "first", simulated_m)
    assert stated.quantile_m(0.5) == pytest.approx(0.5 * (0.001 + 2.0 * np.sqrt(12.5e-6)))
    assert miss_distribution("ensemble", "refined", simulated_m) is None
    assert miss_distribution("paper", "first", simulated_m) is None


def test_the_script_reads_results_of_the_loop(tmp_path, capsys):
    run = {
        "trials": [
            dict(
                zip(
                    ("kind", "trial", "miss_rms_m", "simulated_hit_probability", "true_miss_m"),
                    row,
                    strict=True,
                )
            )
            for row in throws(60, 1)
        ]
    }
    (tmp_path / "runs.json").write_text(json.dumps({"runs": [run]}))
    main(["fit", str(tmp_path / "runs.json"), "--out", str(tmp_path / "made.json")])
    made = MissCalibration.model_validate_json((tmp_path / "made.json").read_text())
    assert made.kinds["first"].throws == 60
    assert "60 throws of runs" in made.made_from
    main(["check", str(tmp_path / "runs.json"), "--out", str(tmp_path / "made.json")])
    assert '"brier"' in capsys.readouterr().out
    # The same throws in space, half of them before a rehearsal.
    run = {"unrehearsed": run["trials"][:30], "trials": run["trials"][30:]}
    (tmp_path / "space.json").write_text(json.dumps({"runs": [run]}))
    main(["fit", str(tmp_path / "space.json"), "--space", "--out", str(tmp_path / "made.json")])
    made = MissCalibration.model_validate_json((tmp_path / "made.json").read_text())
    assert made.kinds["first in space"] == made.kinds["first"]
    assert made.made_from_in_space == "60 throws of space"
