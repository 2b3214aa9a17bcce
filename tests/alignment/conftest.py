"""Lab throws with known clocks, and ways to spoil them."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from strandcast.alignment.align import RobotData, VideoData, align
from strandcast.arm.load import PlanarArm, load_arm
from strandcast.config.align import AlignSettings
from strandcast.core.trajectory import JointTrajectory
from strandcast.lab.servo import CYCLE_S
from strandcast.records.alignment import Alignment
from strandcast.records.joint_log import JointLog
from strandcast_studies.evidence.clock_trials import ClockTrial, Recipe, clock_trial

PER_ROW = ("time_s", "since_start_s", "q_rad", "qd_rad_s", "q_cmd_rad", "qd_cmd_rad_s", "flags")


@pytest.fixture(scope="session")
def arm(project_root) -> PlanarArm:
    return load_arm(project_root / "config/arms/planar3.toml").planar()


@pytest.fixture(scope="session")
def throw(arm) -> Callable[..., ClockTrial]:
    """Return a function that makes throw `seed` of a kind."""
    return lambda seed=5, **kind: clock_trial(arm, seed, Recipe(**kind))


@pytest.fixture(scope="session")
def fit(arm) -> Callable[..., Alignment]:
    """Return a function that aligns a throw, as it is or with parts exchanged."""

    def run(
        trial: ClockTrial,
        markers=None,
        log=None,
        on: PlanarArm = arm,
        sync_events=(),
        led=None,
        settings=None,
        **more,
    ) -> Alignment:
        return align(
            VideoData(trial.markers if markers is None else markers, led),
            RobotData(trial.log if log is None else log, sync_events, file="trial-01/joints.csv"),
            on,
            AlignSettings() if settings is None else settings,
            experiment="e",
            trial=1,
            **more,
        )

    return run


@pytest.fixture(scope="session")
def error_s() -> Callable[[Alignment, ClockTrial], float]:
    """Return a function that gives the error in the middle of the detections."""

    def run(found: Alignment, trial: ClockTrial) -> float:
        middle = found.middle_camera_time_s
        return float(found.robot_time_s(np.array(middle))) - trial.robot_s(middle)

    return run


@pytest.fixture(scope="session")
def rows() -> Callable[[JointLog, np.ndarray], JointLog]:
    """Return a function that selects rows of a log by an index, in its order."""
    return lambda log, which: dataclasses.replace(
        log, **{name: getattr(log, name)[which] for name in PER_ROW}
    )


@pytest.fixture(scope="session")
def motion() -> Callable[..., JointTrajectory]:
    """Return a function that samples joint angles given as a function of time."""

    def run(angles: Callable[[np.ndarray], np.ndarray], duration_s: float = 0.6) -> JointTrajectory:
        time_s = np.arange(round(duration_s / CYCLE_S) + 1) * CYCLE_S
        q = angles(time_s)
        qd = np.gradient(q, CYCLE_S, axis=0)
        return JointTrajectory(time_s, q, qd, np.gradient(qd, CYCLE_S, axis=0))

    return run
