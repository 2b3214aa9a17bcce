"""Which frames of a throw enter E: those of the planned pass, until contact."""

from types import SimpleNamespace

import numpy as np
import pytest

from strandcast.config.estimate import EstimateSettings
from strandcast.core.objectives import PointObjective
from strandcast.records.joint_log import JointLog
from strandcast.stages import past_trials

START_S, END_S, EXPECTED_S = 2.0, 2.9, 0.6


def trial(closest_s: float | None, miss_m: float | None = 0.1, predicted: bool = True) -> SimpleNamespace:
    motion = SimpleNamespace(predicted=SimpleNamespace(hit_time_s=EXPECTED_S) if predicted else None)
    nearest = None if closest_s is None else SimpleNamespace(time_s=closest_s, miss_m=miss_m)
    return SimpleNamespace(
        motion=motion,
        aim=None if miss_m is None else PointObjective(),
        shortfall=lambda touch_m: nearest,
        alignment=SimpleNamespace(motion_start_s=START_S, motion_end_s=END_S),
    )


@pytest.mark.parametrize(
    ("closest_s", "miss_m", "predicted", "until_s"),
    [
        (2.55, 0.02, True, 2.55),  # what comes after a touch is another motion
        (2.55, 0.021, True, 2.63),  # a miss on the planned pass
        (2.66, 0.1, True, 2.69),
        (3.10, 0.1, True, 2.63),  # nearest long after the planned pass
        (2.05, 0.1, True, 2.63),  # or long before
        (None, 0.1, True, 2.63),  # closest approach not tracked
        (2.66, 0.1, False, 2.69),  # a motion without a prediction
        (None, 0.1, False, 3.20),
        (None, None, False, 3.20),  # without a target, the whole capture
        (None, None, True, 3.20),  # also of a motion that was planned for one
    ],
)
def test_the_last_frame(
    closest_s: float | None, miss_m: float | None, predicted: bool, until_s: float
) -> None:
    settings = EstimateSettings(horizon_s=0.03)
    assert past_trials.until_s(trial(closest_s, miss_m, predicted), settings) == pytest.approx(until_s)
    if until_s != closest_s:
        whole = EstimateSettings(horizon_s=None)
        assert past_trials.until_s(trial(closest_s, miss_m, predicted), whole) == pytest.approx(END_S + 0.3)


@pytest.mark.parametrize(("radius_m", "until_s"), [(0.02, 2.63), (0.05, 2.55), (None, 2.63)])
def test_the_size_of_the_target_decides_what_may_touch_it(radius_m: float | None, until_s: float) -> None:
    settings = EstimateSettings(contact_radius_m=radius_m)
    assert past_trials.until_s(trial(2.55, 0.03), settings) == pytest.approx(until_s)


def test_a_log_is_smoothed_near_its_motion_only() -> None:
    """The memory that it takes grows with the square of the rows."""
    time_s = np.arange(50.0, 62.0, 0.01)
    none = np.zeros((len(time_s), 1))
    log = JointLog(["a"], time_s, np.sin(time_s)[:, None], none, none, none, none[:, 0], none[:, 0])
    since_s, q_rad = past_trials.smooth_joints(log, ["a"], (55.0, 56.0), 55.0)
    assert (since_s[0], since_s[-1]) == pytest.approx((-1.0, 2.3), abs=0.011)
    np.testing.assert_allclose(q_rad[:, 0], np.sin(since_s + 55.0), atol=1e-4)
