"""What is drawn for the loop: a string, a target and a servo that the planner has never seen."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from strandcast.bench import loop, loop_drawn
from strandcast.experiment import load_experiment
from strandcast.lab.strings import thread_of
from strandcast.paper.cases import FILE, load_plan


@pytest.mark.parametrize("seed", range(20))
def test_what_is_drawn_is_an_experiment_out_of_the_arms_reach(seed: int, tmp_path: Path) -> None:
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
    thread = thread_of(experiment)
    assert thread.length_m == length_m
    assert len(thread.weights) == len(experiment.string.weights) <= 2
    assert all(0.0 < place_m <= length_m and 0.003 <= mass_kg <= 0.02 for place_m, mass_kg in thread.weights)


def test_seeds_draw_different_strings() -> None:
    common = load_plan(loop.PROJECT / FILE).common
    drawn = [loop_drawn.settings_of(common, seed) for seed in range(12)]
    assert len({one["string"]["length_m"] for one in drawn}) > 6
    assert len({one["lab"]["servo"] for one in drawn}) > 2
    assert {len(one["string"]["weights"]) for one in drawn} == {0, 1, 2}


def test_a_run_that_fails_says_why_and_stops_no_other() -> None:
    def broken() -> list[loop.Trial]:
        raise ValueError("no such string")

    assert loop.outcome(broken) == {"error": "ValueError: no such string", "trials": []}
