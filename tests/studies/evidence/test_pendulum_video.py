"""The filmed pendulum: its noise and its period."""

import numpy as np
import pytest

from strandcast_pendulum.ball import BallTrack
from strandcast_studies.evidence import pendulum_video as pendulum


def test_added_noise_is_measured():
    rng = np.random.default_rng(5)
    time_s = np.arange(3000) / 60.0
    swing = np.column_stack([80.0 * np.sin(2 * np.pi * time_s / 1.6), 6.0 * np.cos(4 * np.pi * time_s / 1.6)])
    centre = swing + rng.normal(0.0, [0.3, 0.15], swing.shape)
    centre[400:420] = np.nan
    filmed = pendulum.FilmedSwing(BallTrack(centre, 30.0, np.zeros((1, 1)), 3000, []), time_s, 1e-3, 0.0)
    off = pendulum.noise_px(filmed)
    assert len(off) == 3000 - 14 - 20 - 14
    np.testing.assert_allclose(np.sqrt((off**2).mean(axis=0)), [0.3, 0.15], rtol=0.05)


@pytest.mark.thorough
def test_period_frames_and_noise_of_the_real_pendulum(real_data):
    figures = {figure.name: figure for figure in pendulum.measure(real_data / "string_pendulum")}
    for name in ("period", "frames_lost", "not_seen"):
        assert figures[f"pendulum_video.{name}"].met, figures[f"pendulum_video.{name}"]
    noise = figures["pendulum_video.tip_noise"]
    assert noise.value == pytest.approx(0.34, abs=0.1)
    assert noise.detail["arc_rms_px"] < 0.7
