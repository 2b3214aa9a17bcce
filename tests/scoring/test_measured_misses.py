"""The shortfall of throws for a direction, a speed, a shape, a swing, and when it is not known."""

import numpy as np
import pytest

from strandcast.core.objectives import (
    AimedPoint,
    Objective,
    SegmentObjective,
    ShapeObjective,
    ShapePlace,
    SwingObjective,
)
from strandcast.planning.rollouts import Rollouts
from strandcast.planning.simulated_misses import simulated_miss
from strandcast.records.track import PREDICTED, Track
from strandcast.records.verdict import Verdict
from strandcast.scoring.measured_misses import TrackedThrow, swing_series
from strandcast.scoring.score import Aim, score_throw

from .test_score import OFFSET_S, STEP_S, alignment

LENGTH_M, END_S = 0.4, 0.35
SIGMA_M = 0.001
FRAMES = 200


def swinging(keep: np.ndarray | None = None) -> Track:
    """A straight string swings about its hand at 10 rad/s, from hanging to past the horizontal."""
    time_s = np.arange(FRAMES) * STEP_S
    angle = -np.pi / 2 + 10.0 * time_s
    away = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = away[:, None] * np.linspace(0.0, LENGTH_M, 5)[:, None]
    sigma, flags = np.full((FRAMES, 5), SIGMA_M), np.zeros((FRAMES, 5), np.int32)
    if keep is not None:
        flags[~keep] = PREDICTED
    return Track(np.arange(FRAMES), time_s, points, sigma, flags)


def scored(objective: Objective, track: Track | None = None) -> Verdict:
    aim = Aim("e", 1, objective, (0.4, 0.0), 0.02)
    clocks = alignment(end_s=OFFSET_S + END_S - 0.3)
    return score_throw(swinging() if track is None else track, clocks, aim, LENGTH_M)


def passing(target_m, direction_rad, tolerance_rad, least_speed_m_s) -> AimedPoint:
    direction = None if direction_rad is None else (direction_rad, tolerance_rad)
    return AimedPoint(target_m=target_m, direction_rad=direction, least_speed_m_s=least_speed_m_s)


def shape(*places: tuple[float, tuple[float, float]]) -> ShapeObjective:
    return ShapeObjective(kind="shape", places=[ShapePlace(along_m=along, at_m=at) for along, at in places])


def swing(**wanted: float) -> SwingObjective:
    return SwingObjective(kind="swing", **wanted)


# The tip passes the horizontal at pi/20 s, upwards at 4 m/s.
@pytest.mark.parametrize(
    ("direction_rad", "least_speed_m_s", "miss_m"),
    [
        (np.pi / 2, 0.0, 0.0),
        (np.pi / 2 + 0.46, 3.9, 0.044),  # 0.11 rad later, or earlier, it moves that way
        (np.pi / 2 - 0.46, 0.0, 0.044),
        (None, 4.5, 0.05),
        (None, 3.5, 0.0),
    ],
)
def test_direction_and_speed_at_a_place(direction_rad, least_speed_m_s, miss_m):
    found = scored(passing((0.4, 0.0), direction_rad, 0.35, least_speed_m_s))
    # From one frame to the next the tip turns by 0.02 rad, which is 8 mm.
    assert found.miss_m == pytest.approx(miss_m, abs=0.003)
    assert found.closest_robot_time_s == pytest.approx(OFFSET_S + np.pi / 20, abs=0.013)
    assert found.hit == (miss_m < 0.02)
    speed_too = miss_m > 0.0 and direction_rad is None
    assert found.miss_sigma_m == pytest.approx(
        np.hypot(SIGMA_M, 0.1 * SIGMA_M / (np.sqrt(2) * 0.006)) if speed_too else found.miss_sigma_m
    )


def test_a_shape_for_a_moment():
    found = scored(shape((0.2, (0.2, 0.003)), (0.35, (0.35, 0.004))))
    # At the horizontal 3 and 4 mm; a little later the inner place is passed exactly.
    assert found.miss_m == pytest.approx(0.0005, abs=0.0015)
    assert found.closest_robot_time_s == pytest.approx(OFFSET_S + np.pi / 20, abs=0.004)
    assert found.wanted == "shape through 2 places"
    away = scored(shape((0.4, (0.5, 0.0))))
    assert away.miss_m == pytest.approx(0.1, abs=1e-4)
    assert away.miss_sigma_m == pytest.approx(SIGMA_M)
    assert not away.hit


def test_a_swing_by_height_and_speed():
    assert scored(swing(height_m=0.3)).miss_m == 0.0
    assert scored(swing(height_m=0.5)).miss_m == pytest.approx(0.5 - LENGTH_M, abs=1e-3)
    assert scored(swing(speed_m_s=3.9)).miss_m == 0.0
    # 0.1 m for each m/s; the chord over 12 ms is 0.1 % shorter than the way.
    assert scored(swing(speed_m_s=5.0)).miss_m == pytest.approx(0.1, abs=0.002)


@pytest.mark.parametrize(
    "objective",
    [
        passing((0.41, 0.02), 1.2, 0.05, 4.6),
        passing((0.39, 0.02), None, 0.35, 6.0),
        passing((0.39, 0.02), None, 0.35, 0.0),
        SegmentObjective(kind="segment", ends_m=((0.45, 0.1), (0.45, 0.2))),
        shape((0.15, (0.2, 0.0)), (0.4, (0.4, 0.1))),
        swing(height_m=0.6),
        swing(speed_m_s=7.0),
    ],
    ids=lambda objective: objective.description,
)
def test_planner_and_scorer_agree(objective: Objective) -> None:
    track = swinging()
    inside = track.camera_time_s <= END_S + 1e-9
    points = track.points_m[None, inside]
    no_bias, capsules = np.zeros((*points.shape[:2], 2)), np.zeros((1, points.shape[1], 0, 2, 2))
    rollouts = Rollouts(points, no_bias, np.array([inside.sum() - 1]), STEP_S, 0.1, capsules)
    planned_m = simulated_miss(objective, rollouts)[0][0]
    assert scored(objective).miss_m == pytest.approx(planned_m, abs=1e-9)


@pytest.mark.parametrize(
    "wanted",
    [passing((0.4, 0.0), None, 0.35, 9.0), shape((0.4, (0.4, 0.0))), shape((0.2, (0.2, 0.0)))],
)
def test_no_miss_where_the_best_moment_was_not_tracked(wanted):
    time_s = np.arange(FRAMES) * STEP_S
    hidden = scored(wanted, swinging(keep=np.abs(time_s - np.pi / 20) > 0.02))
    assert hidden.miss_m is None
    assert hidden.reason is not None
    assert "not tracked at its best moment (nothing between 7.1" in hidden.reason
    tracked = scored(wanted, swinging(keep=np.abs(time_s - 0.03) > 0.02))
    assert tracked.miss_m == pytest.approx(scored(wanted).miss_m)


def test_no_velocity_across_a_gap():
    time_s = np.arange(FRAMES) * STEP_S
    keep = np.abs(time_s - 0.2) > 0.01
    shortfall_m, _ = swing_series(swing(speed_m_s=9.0), _tracked(keep))
    unknown = np.flatnonzero(np.isnan(shortfall_m))
    assert set(np.flatnonzero(~keep)) < set(unknown)
    assert len(unknown) == (~keep).sum() + 6  # three frames to each side
    assert np.nanmax(np.abs(shortfall_m - 0.5)) < 0.002


def _tracked(keep: np.ndarray) -> TrackedThrow:
    track = swinging()
    points = np.where(keep[:, None, None], track.points_m, np.nan)
    return TrackedThrow(track.camera_time_s, points, track.sigma_m, LENGTH_M, STEP_S, (0.0, END_S))
