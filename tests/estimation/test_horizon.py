"""Which frames of a throw enter E: those of the planned pass, until contact."""

from types import SimpleNamespace

import pytest

from strandcast.config.estimate import EstimateSettings
from strandcast.stages.estimate import _until_s

START_S, END_S, EXPECTED_S = 2.0, 2.9, 0.6


def trial(closest_s: float | None, hit: bool | None = False, predicted: bool = True) -> SimpleNamespace:
    motion = SimpleNamespace(predicted=SimpleNamespace(hit_time_s=EXPECTED_S) if predicted else None)
    return SimpleNamespace(
        motion=motion,
        verdict=SimpleNamespace(
            closest_robot_time_s=closest_s, hit=hit, target_m=None if hit is None else [0.5, 0.5]
        ),
        alignment=SimpleNamespace(motion_start_s=START_S, motion_end_s=END_S),
    )


@pytest.mark.parametrize(
    ("closest_s", "hit", "predicted", "until_s"),
    [
        (2.55, True, True, 2.55),  # what comes after a touch is another motion
        (2.55, False, True, 2.63),  # a miss on the planned pass
        (2.66, False, True, 2.69),
        (3.10, False, True, 2.63),  # nearest long after the planned pass
        (2.05, False, True, 2.63),  # or long before
        (None, False, True, 2.63),  # closest approach not tracked
        (2.66, False, False, 2.69),  # a motion without a prediction
        (None, False, False, 3.20),
        (None, None, False, 3.20),  # without a target, the whole capture
        (None, None, True, 3.20),  # also of a motion that was planned for one
    ],
)
def test_the_last_frame(closest_s: float | None, hit: bool | None, predicted: bool, until_s: float) -> None:
    settings = EstimateSettings(horizon_s=0.03)
    assert _until_s(trial(closest_s, hit, predicted), settings) == pytest.approx(until_s)
    if not hit:
        whole = EstimateSettings(horizon_s=None)
        assert _until_s(trial(closest_s, hit, predicted), whole) == pytest.approx(END_S + 0.3)
