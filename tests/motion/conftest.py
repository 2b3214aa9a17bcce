"""An arm, a string and small budgets for the planners."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.load import Arm, Box, load_arm
from strandcast.motion.strings import Strings
from strandcast.motion.task import Options, Task
from strandcast.string.masses import mass_layout, point_masses
from strandcast.string.model import StringModel
from strandcast.string.parameters import ensemble

LAYOUT = mass_layout(0.30, 10, [0.30])


@pytest.fixture(scope="session")
def arm(project_root: Path) -> Arm:
    return load_arm(project_root / "config/arms/planar3.toml")


@pytest.fixture(scope="session")
def task(arm: Arm) -> Task:
    box = Box((-0.75, 1.25), (-0.32, 0.80))
    return Task(arm, StringModel(0.30, 10), np.array([0.50, 0.50]), 0.02, box)


@pytest.fixture(scope="session")
def strings() -> Strings:
    draw = ensemble(3, 0.30, 10, 1, np.random.default_rng(5))
    return Strings(draw.parameters, point_masses(LAYOUT, draw.weight_masses))


@pytest.fixture
def options() -> Options:
    return Options(screening=64, evaluations=480, members=3, finer=False)
