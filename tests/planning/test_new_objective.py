"""An objective declared outside the package: experiment.yaml accepts it, planner and scorer know it."""

import importlib
import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from strandcast.config.experiment import Experiment
from strandcast.config.load import load_experiment
from strandcast.config.plan import PlanSettings
from strandcast.core.objectives import OBJECTIVES, Objective, register_objective
from strandcast.core.strings import StringBatch
from strandcast.errors import StrandcastError, StrandcastErrors
from strandcast.planning.plan import plan_first
from strandcast.planning.rollouts import RolloutConditions, rollouts_of_curves
from strandcast.planning.simulated_misses import simulated_miss
from strandcast.planning.task import PlanningTask
from strandcast.scoring.measured_misses import TrackedThrow, measured_shortfall

TEXT = "string: {length_m: 0.30}\ntarget_m: [0.6, 0.2]\n"
WANTED = "objective: {kind: middle-hits, from_hand_m: 0.15, at_m: [0.6, 0.2]}\n"


@pytest.fixture
def registry(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Forget what a test registers."""
    with monkeypatch.context() as patch:
        patch.setattr(OBJECTIVES, "_entries", OBJECTIVES.known())
        yield
    Experiment.model_rebuild(force=True)


@pytest.fixture
def toy(
    registry: None, project_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> type[Objective]:
    """Import the code of the how-to page as a module of its own."""
    page = (project_root / "docs/extending/objective.md").read_text(encoding="utf-8")
    (source,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    (tmp_path / "my_objectives.py").write_text(source, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "my_objectives", raising=False)
    return importlib.import_module("my_objectives").MiddleHits  # type: ignore[no-any-return]


def load(folder: Path, text: str) -> Experiment:
    (folder / "experiment.yaml").write_text(text, encoding="utf-8")
    return load_experiment(folder / "experiment.yaml")


def test_an_experiment_accepts_a_registered_kind(toy: type[Objective], tmp_path: Path) -> None:
    settings = load(tmp_path, TEXT + WANTED)
    assert settings.aim == toy(kind="middle-hits", from_hand_m=0.15, at_m=(0.6, 0.2))
    assert settings.model_dump(mode="json")["objective"]["at_m"] == [0.6, 0.2]
    with pytest.raises(StrandcastErrors, match="from_hand_m: there is no such setting"):
        load(tmp_path, TEXT + "objective: {kind: point, from_hand_m: 0.1}\n")
    with pytest.raises(StrandcastErrors, match="did you mean 'from_hand_m'"):
        load(tmp_path, TEXT + WANTED.replace("from_hand_m", "from_hand"))


def test_an_experiment_refuses_a_kind_that_nobody_registered(registry: None, tmp_path: Path) -> None:
    with pytest.raises(StrandcastErrors, match="kind"):
        load(tmp_path, TEXT + WANTED)


def test_a_kind_is_found_among_the_installed_packages(
    registry: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Anywhere(Objective):
        kind: Literal["anywhere"]

    class EntryPoint:
        name = "anywhere"

        def load(self) -> None:
            register_objective(Anywhere)

    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: [EntryPoint()])
    assert load(tmp_path, TEXT + "objective: {kind: anywhere}\n").objective == Anywhere(kind="anywhere")
    throw = TrackedThrow(np.zeros(0), np.zeros((0, 2, 2)), np.zeros((0, 2)), 0.3, 0.002, (0.0, 1.0))
    with pytest.raises(StrandcastError, match="SC-P008"):
        measured_shortfall(Anywhere(kind="anywhere"), throw)


def test_it_is_planned_for_and_scored(toy: type[Objective], task: PlanningTask, strings: StringBatch) -> None:
    objective = toy(kind="middle-hits", from_hand_m=0.15, at_m=(0.6, 0.2))
    settings = PlanSettings(evaluations=480, disturbances=0.3)
    goal = replace(task, objective=objective)
    plan = plan_first(goal, strings, settings, np.random.default_rng(1))
    assert plan.miss_m < 0.02
    best = rollouts_of_curves(goal, strings.take([0]), RolloutConditions(task.arm.servo), [plan.curve])
    middle_m = best.points_m[0, round(plan.hit_time_s / task.step_s), 5]
    assert np.hypot(*(middle_m - [0.6, 0.2])) < 0.04
    # The scorer takes the nearest frame; the planner also looks between the samples.
    time_s = np.arange(best.last[0] + 1) * task.step_s
    points_m = best.points_m[0, : len(time_s)]
    sigma_m = np.full(points_m.shape[:2], 0.001)
    throw = TrackedThrow(time_s, points_m, sigma_m, 0.30, task.step_s, (0.0, float(time_s[-1])))
    shortfall, reason = measured_shortfall(objective, throw)
    assert reason is None
    assert shortfall is not None
    assert shortfall.miss_m == pytest.approx(simulated_miss(objective, best)[0][0], abs=0.01)
