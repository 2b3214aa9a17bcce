from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.load import PlanarArm, load_arm
from strandcast.config.experiment import Experiment
from strandcast.core.trajectory import JointTrajectory
from strandcast.lab.throw import photograph_boards, throw
from strandcast.records.motion import Motion, Robot, StartPosture, points_of

ROOT = Path(__file__).parents[2]
TARGET_M = (0.55, 0.35)


def swing_command(duration_s: float = 0.4, by: tuple[float, ...] = (0.7, 0.9, 0.8)) -> JointTrajectory:
    """A jerk-limited swing from rest to rest."""
    time_s = np.arange(round(duration_s / 0.002) + 1) * 0.002
    s = (time_s / duration_s)[:, None]
    way = np.array(by)
    return JointTrajectory(
        time_s,
        np.array([0.3, -0.6, -0.5]) + way * s**3 * (10 - 15 * s + 6 * s**2),
        way * 30 * s**2 * (1 - s) ** 2 / duration_s,
        way * 60 * s * (1 - s) * (1 - 2 * s) / duration_s**2,
    )


def write_motion(path: Path, arm: PlanarArm, command: JointTrajectory) -> Path:
    Motion(
        experiment="lab-test",
        trial=1,
        target_m=list(TARGET_M),
        robot=Robot(name=arm.name, file_sha256=arm.sha256, urdf_sha256=arm.urdf_sha256),
        joint_names=list(arm.joints),
        start=StartPosture(positions_rad=command.q_rad[0].tolist(), tolerance_rad=[0.01] * 3),
        bezier=None,
        points=points_of(
            np.round(command.time_s * 1e9).astype(int), command.q_rad, command.qd_rad_s, command.qdd_rad_s2
        ),
        predicted=None,
        provenance=None,
    ).write(path)
    return path


def make_experiment(**lab: object) -> Experiment:
    places = [(-0.25, 0.75), (0.3, 0.76), (0.85, 0.75), (-0.25, -0.4), (0.3, -0.42), (0.85, -0.4)]
    markers = [{"id": k, "x_m": x, "y_m": y} for k, (x, y) in enumerate(places)]
    camera = {"size_px": (800, 640), "frame_rate_hz": 250.0}
    return Experiment.model_validate(
        {
            "string": {"length_m": 0.3},
            "target_m": TARGET_M,
            "workspace_m": {"x_m": [-0.32, 0.92], "y_m": [-0.48, 0.82]},
            "cameras": {"main": {"plane": {"size_m": 0.08, "markers": markers}}},
            "lab": {"camera": camera} | lab,
        }
    )


@dataclass
class Thrown:
    """A virtual rig that was set up and has thrown once."""

    experiment: Experiment
    arm: PlanarArm
    motion: Path
    data: Path
    truth: Path

    @property
    def trial(self) -> Path:
        return self.data / "trial-01"


@pytest.fixture(scope="session")
def arm() -> PlanarArm:
    return load_arm(ROOT / "config" / "arms" / "planar3.toml").planar()


@pytest.fixture(scope="session")
def thrown(arm: PlanarArm, tmp_path_factory: pytest.TempPathFactory) -> Thrown:
    folder = tmp_path_factory.mktemp("lab")
    experiment = make_experiment()
    motion = write_motion(folder / "motion.json", arm, swing_command())
    data, truth = folder / "data", folder / "lab_truth.parquet"
    photograph_boards(experiment, "lab-test", arm, data)
    throw(experiment, "lab-test", arm, 1, motion, data, truth)
    return Thrown(experiment, arm, motion, data, truth)
