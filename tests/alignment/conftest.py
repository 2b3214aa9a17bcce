"""Synthetic throws of the planar3 arm: joint log and marker sightings with known clocks and errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from strandcast.alignment.rig import Misfit, marker_poses, rig_of
from strandcast.arm.load import Arm, load_arm
from strandcast.records.joint_log import JointLog

ROBOT_START_S = 1305.0  # the controller counts from its own boot


@dataclass
class Recording:
    markers: dict[str, np.ndarray]
    log: JointLog
    offset_s: float
    drift: float

    def robot_s(self, camera_s: float) -> float:
        return self.offset_s + (1 + self.drift) * camera_s


@pytest.fixture(scope="session")
def arm(project_root) -> Arm:
    return load_arm(project_root / "config/arms/planar3.toml")


@pytest.fixture(scope="session")
def record(arm) -> Callable[..., Recording]:
    """Return a function that records throw `seed`; `slow` is the share of the noise that follows itself."""

    def swing(seed: int, time_s: np.ndarray, duration_s: float, reach: float) -> np.ndarray:
        draw = np.random.default_rng(seed)
        start = np.array([1.2, 0.3, 0.2]) + draw.normal(0, 0.2, 3)
        turn = np.array([-1.0, -0.8, -0.6]) * draw.uniform(0.6, 1.3, 3)
        back = draw.uniform(0.1, 0.5, 3)
        s = np.clip(time_s / duration_s, 0, 1)[:, None]
        return start + reach * (turn * (10 * s**3 - 15 * s**4 + 6 * s**5) + back * 64 * s**3 * (1 - s) ** 3)

    def make(
        seed: int,
        frame_rate_hz: float = 500.0,
        marker_error_m: float = 2.4e-4,
        slow: float = 0.0,
        joint_noise_rad: float = 5e-4,
        joint_zero_rad: float = 1e-3,
        shift_m: float = 1e-3,
        reach: float = 1.0,
        log_of: int | None = None,
    ) -> Recording:
        draw = np.random.default_rng(seed + 1000)
        log_s = np.arange(-0.5, 1.3, 0.002)
        q = swing(seed if log_of is None else log_of, log_s, 0.6, reach)
        log = JointLog(
            joint_names=list(arm.joints),
            time_s=log_s + ROBOT_START_S,
            since_start_s=log_s,
            q_rad=q + draw.normal(0, joint_noise_rad, q.shape),
            qd_rad_s=np.zeros_like(q),
            q_cmd_rad=q,
            qd_cmd_rad_s=np.zeros_like(q),
            flags=np.zeros(len(q), np.int32),
        )
        offset_s, drift = ROBOT_START_S - 0.3 + draw.uniform(0, 0.01), draw.normal(0, 2e-5)
        camera_s = np.arange(int(1.4 * frame_rate_hz)) / frame_rate_hz
        q = swing(seed, offset_s + (1 + drift) * camera_s - ROBOT_START_S, 0.6, reach)
        misfit = Misfit(
            draw.normal(0, shift_m, 2),
            draw.normal(0, 0.005),
            draw.normal(0, 3e-4, 2),
            draw.normal(0, joint_zero_rad, 3),
        )
        poses = []
        for marker in range(len(arm.markers)):
            noise = draw.normal(size=(len(camera_s), 3))
            for k in range(1, len(noise)):
                noise[k] = slow * noise[k - 1] + np.sqrt(1 - slow**2) * noise[k]
            exact = marker_poses(rig_of(arm), q, np.full(len(q), marker), misfit)
            poses.append(exact + noise * marker_error_m * (1, 1, np.sqrt(2) / 0.05))
        pose = np.concatenate(poses)
        many = len(arm.markers)
        markers = {
            "frame": np.tile(np.arange(len(camera_s)), many),
            "camera_time_s": np.tile(camera_s, many),
            "marker": np.repeat([marker.id for marker in arm.markers], len(camera_s)),
            "x_m": pose[:, 0],
            "y_m": pose[:, 1],
            "angle_rad": np.angle(np.exp(1j * pose[:, 2])),
            "sigma_m": np.full(len(pose), 1.2e-4),
        }
        return Recording(markers, log, offset_s, drift)

    return make
