"""Calibrated probabilities: they hold for throws that the calibration has not seen."""

import json

import numpy as np
import pytest

from strandcast.planning import miss_calibration
from strandcast.planning.miss_calibration import (
    LEVELS,
    TAIL_EXPONENT,
    Evidence,
    KindCalibration,
    MissCalibration,
    MissDistribution,
    miss_distribution,
)
from strandcast_studies.benchmarks.loop.calibration import (
    CountedThrow,
    crps_m,
    fit,
    held_out,
    main,
    reliability,
    stated,
    stated_run,
)


def throws(count, seed, gain=2.0):
    """Misses of gain times what was simulated, and 3 mm that no simulation knows of."""
    random = np.random.default_rng(seed)
    rms_m = 10 ** random.uniform(-3.0, -1.5, count)
    miss_m = (0.003 + gain * rms_m) * random.rayleigh(0.7, count)
    simulated = 1.0 - np.exp(-((0.02 / rms_m) ** 2))
    return [CountedThrow("first", 1, *row) for row in zip(rms_m, simulated, miss_m, strict=True)]


def test_stated_shares_hold_for_other_throws():
    made = fit(throws(300, 1), "a test")
    seen = reliability([(throw, stated(throw, made)) for throw in throws(2000, 2)], 0.02)
    assert seen["below_p50"]["share"] == pytest.approx(0.5, abs=0.07)
    assert seen["below_p90"]["share"] == pytest.approx(0.9, abs=0.05)
    calibrated, simulated = seen["calibrated"], seen["simulated"]
    assert calibrated["mean"] == pytest.approx(seen["hits"] / seen["throws"], abs=0.04)
    assert simulated["mean"] > calibrated["mean"] + 0.1  # too sure
    assert calibrated["brier"] < simulated["brier"]
    assert calibrated["log_loss"] < simulated["log_loss"]


def test_motions_from_scratch_are_counted_as_first_ones():
    few = [throw._replace(kind="replanned") for throw in throws(5, 3)]
    made = fit(throws(100, 1) + few, "a test")
    assert {kind: counted.throws for kind, counted in made.kinds.items()} == {"first": 105}
    assert stated(few[0], made).within(0.02) == stated(few[0]._replace(kind="first"), made).within(0.02)
    assert set(fit(few, "a test").kinds) == set()


def test_experiments_are_held_out_as_a_whole():
    runs = [[throw] for throw in throws(60, 1)]
    missed = [throw._replace(miss_m=10.0) for throw in throws(40, 2)]
    said = held_out([*runs, missed])
    assert len(said) == 100
    largest_m = max(run[0].miss_m for run in runs)
    stated_m = [miss.quantile_m(0.95) for throw, miss in said if throw.miss_m == 10.0]
    assert max(stated_m) < 3 * largest_m  # nothing of its own throws is in what is stated of them
    rare = [throw._replace(kind="refined") for throw in throws(5, 3)]
    assert len(held_out([*runs, rare])) == 60


def test_probability_and_quantile_are_inverse_and_reach_into_the_tails():
    miss = MissDistribution(0.02 * np.array(LEVELS) ** 2)
    for share in (0.01, 0.05, 0.3, 0.5, 0.9, 0.95, 0.99, 0.999):
        assert miss.within(miss.quantile_m(share)) == pytest.approx(share)
    assert miss.within(0.0) == 0.0
    assert miss.within(10.0) < 1.0


def test_only_motions_like_those_counted_are_calibrated(monkeypatch):
    known = KindCalibration(
        made_from="a test", throws=40, floor_m=0.001, gain=0.5, counted_m=0.02, ratios=list(LEVELS)
    )
    only = MissCalibration(kinds={"first": known})
    monkeypatch.setattr(miss_calibration, "calibration", lambda: only)
    simulated_m = np.array([0.003, 0.004])
    said = miss_distribution("ensemble", "first", simulated_m)
    assert said.quantile_m(0.5) == pytest.approx(0.5 * (0.001 + 0.5 * np.sqrt(12.5e-6)))
    # Beyond what was counted, misses grow as simulated.
    far = miss_distribution("ensemble", "first", np.array([0.05]))
    assert far.quantile_m(0.5) == pytest.approx(0.5 * (0.001 + 0.5 * 0.02 + 0.03))
    # A few failed simulations say nothing about the others; many do.
    few = miss_distribution("ensemble", "first", np.append(np.repeat(simulated_m, 20), 1.0))
    assert few.quantile_m(0.5) == pytest.approx(said.quantile_m(0.5))
    many = miss_distribution("ensemble", "first", np.append(np.repeat(simulated_m, 2), 1.0))
    assert many.quantile_m(0.5) > 0.1
    again = miss_distribution("ensemble", "replanned", simulated_m)
    assert again.quantile_m(0.5) == said.quantile_m(0.5)
    assert miss_distribution("ensemble", "refined", simulated_m) is None
    assert miss_distribution("paper", "first", simulated_m) is None


def test_the_scale_of_an_experiment_is_learnt_from_its_throws():
    assert Evidence().scale() == 1.0
    one = Evidence(surprises=(10.0,)).scale()
    assert one == pytest.approx(np.sqrt((4.0 + 2.0 * np.log(2.0) * 100.0) / 6.0))
    # The second statement was as wide as the first throw made it: a miss at its median confirms the scale.
    assert Evidence(surprises=(10.0, 1.0)).scale() == pytest.approx(one, rel=0.1)
    assert 0.5 < Evidence(surprises=(0.0,) * 3).scale() < 0.8


def test_what_the_model_does_not_know_adds_as_an_independent_error():
    known = KindCalibration(
        made_from="a test", throws=40, floor_m=0.001, gain=0.5, counted_m=0.05, ratios=list(LEVELS)
    )
    said = known.distribution(0.003, Evidence(0.004))
    assert said.quantile_m(0.5) == pytest.approx(0.5 * (0.001 + 0.5 * 0.005))


def experiments(count, seed):
    """Experiments of four throws; all misses of one experiment are larger or smaller than usual."""
    random = np.random.default_rng(seed)
    scales = np.sqrt(TAIL_EXPONENT / random.chisquare(TAIL_EXPONENT, count))
    return [
        [
            CountedThrow("refined", 2 + k, 0.004, 0.9, miss_m, miss_m)
            for k, miss_m in enumerate(0.006 * scale * random.rayleigh(1.0, 4))
        ]
        for scale in scales
    ]


def test_statements_that_learn_from_the_experiment_score_better():
    made = fit([throw for run in experiments(200, 1) for throw in run], "a test")
    runs = experiments(300, 2)
    learnt, alone = (
        reliability([pair for run in runs for pair in stated_run(run, made, alone=one)], 0.02)
        for one in (False, True)
    )
    assert learnt["calibrated"]["brier"] < alone["calibrated"]["brier"] - 0.01
    assert learnt["calibrated"]["log_loss"] < alone["calibrated"]["log_loss"] - 0.03
    assert learnt["crps_m"] < 0.97 * alone["crps_m"]
    assert learnt["below_p90"]["share"] == pytest.approx(0.9, abs=0.05)
    assert sum(learnt["in_deciles"]) == learnt["throws"] == 1200
    assert min(learnt["in_deciles"]) > 60


def test_the_score_of_quantiles_is_least_for_the_truth():
    random = np.random.default_rng(1)
    misses_m = random.rayleigh(0.01, 2000)
    right_m = np.quantile(random.rayleigh(0.01, 20000), LEVELS)
    scores = [
        np.mean([crps_m(MissDistribution(wide * right_m), m) for m in misses_m]) for wide in (0.5, 1, 2)
    ]
    assert scores[1] < min(scores[0], scores[2])


def test_the_script_reads_results_of_the_loop(tmp_path, capsys):
    run = {
        "trials": [
            dict(
                zip(
                    ("kind", "trial", "miss_rms_m", "simulated_hit_probability", "true_miss_m"),
                    row[:5],
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
    assert made.kinds["first"].made_from == "runs"
    for what in ("check", "held-out"):
        main([what, str(tmp_path / "runs.json"), "--out", str(tmp_path / "made.json")])
        assert ('"brier"' in capsys.readouterr().out) is (what == "check")  # there is no other run
    # The same throws in space, half of them before a rehearsal.
    run = {"unrehearsed": run["trials"][:30], "trials": run["trials"][30:]}
    (tmp_path / "space.json").write_text(json.dumps({"runs": [run]}))
    main(["fit", str(tmp_path / "space.json"), "--space", "--out", str(tmp_path / "made.json")])
    known = MissCalibration.model_validate_json((tmp_path / "made.json").read_text()).kinds
    assert known["first"] == made.kinds["first"]  # the plane's stay as they were
    assert known["first in space"] == made.kinds["first"].model_copy(update={"made_from": "space"})
