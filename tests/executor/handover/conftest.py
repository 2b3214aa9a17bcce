"""Motions of the two arms that ship, from rest to rest."""

from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.load import Arm, load_arm
from strandcast.executor.handover.export import ExportForm, export_motion
from strandcast.executor.handover.handover import prepare
from strandcast.records.motion import Motion, Robot, StartPosture, points_of

HANGING_M = 0.3
DURATION_S = 0.511  # no multiple of 2 ms: the last step is a short one


def swing(arm: Arm, start: list[float], by: list[float]) -> Motion:
    """Return the quintic from rest to rest, a point every 2 ms and one at the end."""
    ns = np.append(np.arange(0, DURATION_S * 1e9, 2e6), DURATION_S * 1e9).astype(np.int64)
    s = (ns * 1e-9 / DURATION_S)[:, None]
    way = np.array(by)
    return Motion(
        experiment="e",
        trial=1,
        target_m=[0.5, 0.5],
        robot=Robot(name=arm.name, file_sha256=arm.sha256, urdf_sha256=arm.urdf_sha256),
        joint_names=list(arm.joints),
        start=StartPosture(positions_rad=start, tolerance_rad=[0.01] * len(start)),
        bezier=None,
        points=points_of(
            ns,
            np.array(start) + way * s**3 * (10 - 15 * s + 6 * s**2),
            way * 30 * s**2 * (1 - s) ** 2 / DURATION_S,
            way * 60 * s * (1 - s) * (1 - 2 * s) / DURATION_S**2,
        ),
        predicted=None,
        provenance=None,
    )


@pytest.fixture(scope="session")
def planar3(project_root) -> Arm:
    return load_arm(project_root / "config" / "arms" / "planar3.toml")


@pytest.fixture(scope="session")
def ur5e(project_root) -> Arm:
    return load_arm(project_root / "config" / "arms" / "ur5e-example.toml")


@pytest.fixture
def planar_file(planar3, tmp_path) -> Path:
    swing(planar3, [0.4, -0.6, -0.3], [0.7, 0.9, 0.8]).write(tmp_path / "motion.json")
    return tmp_path / "motion.json"


@pytest.fixture
def ur_file(ur5e, tmp_path) -> Path:
    swing(ur5e, [-1.2, 1.0, -0.4], [0.5, -0.4, -1.9e-6]).write(tmp_path / "motion.json")
    return tmp_path / "motion.json"


@pytest.fixture
def export():
    """Return what writes a motion, as the command does."""

    def write(path: Path, arm: Arm, kind: str, name: str, time_scale: float = 1.0, **form) -> Path:
        out = path.with_name(name)
        export_motion(prepare(path, arm, HANGING_M, time_scale), ExportForm(kind, **form), out)
        return out

    return write
