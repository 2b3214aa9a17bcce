"""An arm, a string and small budgets for the planners."""

from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.load import Arm, load_arm
from strandcast.config.plan import PlanSettings
from strandcast.core.box import Box
from strandcast.core.strings import StringBatch
from strandcast.dynamics.masses import mass_layout, point_masses
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import ensemble
from strandcast.planning.task import PlanningTask

LAYOUT = mass_layout(0.30, 10, [0.30])


@pytest.fixture(scope="session")
def arm(project_root: Path) -> Arm:
    return load_arm(project_root / "config/arms/planar3.toml")


@pytest.fixture(scope="session")
def task(arm: Arm) -> PlanningTask:
    box = Box(x_m=(-0.75, 1.25), y_m=(-0.32, 0.80))
    return PlanningTask(arm, StringModel(0.30, 10), np.array([0.50, 0.50]), 0.02, box)


@pytest.fixture(scope="session")
def strings() -> StringBatch:
    draw = ensemble(3, 0.30, 10, 1, np.random.default_rng(5))
    return StringBatch(draw.parameters, point_masses(LAYOUT, draw.weight_masses))


@pytest.fixture
def settings() -> PlanSettings:
    return PlanSettings(screening=64, evaluations=480, ensemble=3, mesh_refinement=False)
