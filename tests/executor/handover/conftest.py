"""Motions of the two arms that ship, from rest to rest."""

from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.load import PlanarArm, load_arm
from strandcast.executor.handover.export import ExportForm, export_motion
from strandcast.executor.handover.handover import prepare

from ..motions import swing

HANGING_M = 0.3
DURATION_S = 0.511  # no multiple of 2 ms: the last step is a short one


@pytest.fixture(scope="session")
def planar3(project_root) -> PlanarArm:
    return load_arm(project_root / "config" / "arms" / "planar3.toml").planar()


@pytest.fixture(scope="session")
def ur5e(project_root) -> PlanarArm:
    return load_arm(project_root / "config" / "arms" / "ur5e-example.toml").planar()


@pytest.fixture
def planar_file(planar3, tmp_path) -> Path:
    swing(planar3, [0.4, -0.6, -0.3], np.array([0.7, 0.9, 0.8]), DURATION_S).write(tmp_path / "motion.json")
    return tmp_path / "motion.json"


@pytest.fixture
def ur_file(ur5e, tmp_path) -> Path:
    swing(ur5e, [-1.2, 1.0, -0.4], np.array([0.5, -0.4, -1.9e-6]), DURATION_S).write(tmp_path / "motion.json")
    return tmp_path / "motion.json"


@pytest.fixture
def export():
    """Return what writes a motion, as the command does."""

    def write(path: Path, arm: PlanarArm, kind: str, name: str, time_scale: float = 1.0, **form) -> Path:
        out = path.with_name(name)
        export_motion(prepare(path, arm, HANGING_M, time_scale), ExportForm(kind, **form), out)
        return out

    return write
