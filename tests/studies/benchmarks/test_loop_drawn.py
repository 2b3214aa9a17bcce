"""Random experiments for the loop: strings, targets and servos that the planner was not tuned on."""

import math
from pathlib import Path

import pytest

from strandcast.config.load import load_experiment
from strandcast.lab.strings import physical_string
from strandcast_studies.benchmarks.loop import drawn as loop_drawn
from strandcast_studies.benchmarks.loop import known
from strandcast_studies.benchmarks.loop import run as loop
from strandcast_studies.paper.cases import FILE, load_plan


@pytest.mark.parametrize("seed", range(20))
def test_a_drawn_experiment_is_valid_and_out_of_the_arms_reach(seed: int, tmp_path: Path) -> None:
    common = load_plan(loop.PROJECT / FILE).common
    settings = loop_drawn.settings_of(common, seed)
    assert settings == loop_drawn.settings_of(common, seed)
    loop.prepare(tmp_path, "drawn", settings)
    experiment = load_experiment(tmp_path / "data" / "drawn" / "experiment.yaml")
    length_m, (x_m, y_m) = experiment.string.length_m, experiment.target_m
    assert 0.70 < math.hypot(x_m, y_m) < 0.70 + length_m
    box = experiment.workspace_m
    assert box.x_m[0] < x_m < box.x_m[1]
    assert box.y_m[0] < y_m < box.y_m[1]
    thread = physical_string(experiment)
    assert thread.length_m == length_m
    assert len(thread.weights) == len(experiment.string.weights) <= 2
    assert all(0.0 < place_m <= length_m and 0.003 <= mass_kg <= 0.02 for place_m, mass_kg in thread.weights)


def test_seeds_draw_different_strings() -> None:
    common = load_plan(loop.PROJECT / FILE).common
    drawn = [loop_drawn.settings_of(common, seed) for seed in range(12)]
    assert len({one["string"]["length_m"] for one in drawn}) > 6
    assert len({one["lab"]["servo"] for one in drawn}) > 2
    assert {len(one["string"]["weights"]) for one in drawn} == {0, 1, 2}


def test_a_failed_run_gives_its_reason_and_does_not_stop_others() -> None:
    def broken() -> list[loop.LoopTrial]:
        raise ValueError("no such string")

    assert loop.outcome(broken) == {"error": "ValueError: no such string", "trials": []}


def test_a_known_string_is_the_same_one_elsewhere() -> None:
    common = load_plan(loop.PROJECT / FILE).common
    for seed in range(9001, 9013):
        here, moved = loop_drawn.settings_of(common, seed), known.moved_settings_of(common, seed, True)
        pulled_m = here["string"]["length_m"] - moved["string"]["length_m"]
        assert -1e-9 < pulled_m <= known.PULLED * here["string"]["length_m"]
        assert pulled_m == pytest.approx(0.0) or seed % 2
        pairs = zip(here["string"]["weights"], moved["string"]["weights"], strict=True)
        for before, after in pairs:
            assert before["place_m"] - after["place_m"] == pytest.approx(pulled_m, abs=1e-9)
            assert before["mass_kg"] == after["mass_kg"]
        assert moved["lab"]["string"] == here["lab"]["string"]
        assert moved["lab"]["servo"] != here["lab"]["servo"]
        assert moved["target_m"] != here["target_m"]
