"""An arm, a string and small budgets for the planners."""

from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.load import PlanarArm, load_arm
from strandcast.config.plan import PlanSettings
from strandcast.core.box import Box
from strandcast.core.strings import StringBatch
from strandcast.dynamics.masses import mass_layout, point_masses
from strandcast.dynamics.model import StringModel
from strandcast.planning.task import PlanningTask

LAYOUT = mass_layout(0.30, 10, [0.30])


@pytest.fixture(scope="session")
def arm(project_root: Path) -> PlanarArm:
    return load_arm(project_root / "config/arms/planar3.toml").planar()


@pytest.fixture(scope="session")
def task(arm: PlanarArm) -> PlanningTask:
    box = Box(x_m=(-0.75, 1.25), y_m=(-0.32, 0.80))
    return PlanningTask(arm, StringModel(0.30, 10), np.array([0.50, 0.50]), 0.02, box)


@pytest.fixture(scope="session")
def strings() -> StringBatch:
    """Return three strings as unlike as cords with 10 g of clay are: 3 to 9 g/m, thread to thin rope."""
    density_kg_m = np.array([[3e-3], [5e-3], [9e-3]])
    bending, drag = np.array([[0.4], [1.5], [6.0]]) * 1e-6 / (density_kg_m * 0.03**2), 1e-3 / density_kg_m
    springs = np.full((3, 1), 2e7), np.full((3, 1), 20.0)
    damping, slow = 0.01 * bending, np.full((3, 1), 0.01)
    parameters = [*springs, bending, damping, 0.7 * bending, 0.7 * damping, slow, drag]
    masses = point_masses(LAYOUT, 0.010 / (density_kg_m * 0.03))
    return StringBatch(np.hstack([*parameters, 2.0 * bending, 2.0 * damping]), masses)


@pytest.fixture
def settings() -> PlanSettings:
    return PlanSettings(evaluations=480)
