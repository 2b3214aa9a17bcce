"""Throws that are for a direction, a speed, a shape, a swing: what lacks, and when that is not told."""

from __future__ import annotations

import numpy as np
import pytest

from strandcast.motion.objective import Throws
from strandcast.motion.objectives import Point
from strandcast.motion.objectives import Shape as PlannedShape
from strandcast.motion.objectives import Swing as PlannedSwing
from strandcast.records.alignment import Alignment
from strandcast.records.summary import Verdict
from strandcast.records.track import PREDICTED, Track
from strandcast.verdict.judge import blank_verdict, judge_moment
from strandcast.verdict.moment import Seen, Shape, Swing, Velocity

STEP_S, OFFSET_S, LENGTH_M, END_S = 0.002, 7.0, 0.4, 0.35
SIGMA_M = 0.001
FRAMES = 200


def alignment() -> Alignment:
    return Alignment(
        experiment="e",
        trial=1,
        source="fit",
        offset_s=OFFSET_S,
        offset_se_s=1e-5,
        drift=0.0,
        drift_se=0.0,
        drift_prior=None,
        residual_rms_m=1e-4,
        frames=100,
        motion_start_s=OFFSET_S,
        motion_end_s=OFFSET_S + END_S - 0.3,
    )


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


def judged(wanted: Velocity | Shape | Swing, track: Track | None = None) -> Verdict:
    blank = blank_verdict((0.4, 0.0), 0.02, "e", 1, "swing", str(wanted))
    return judge_moment(swinging() if track is None else track, alignment(), wanted, LENGTH_M, blank)


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
    found = judged(Velocity((0.4, 0.0), direction_rad, 0.35, least_speed_m_s))
    # From one frame to the next the tip turns by 0.02 rad, which is 8 mm.
    assert found.miss_m == pytest.approx(miss_m, abs=0.003)
    assert found.closest_robot_time_s == pytest.approx(OFFSET_S + np.pi / 20, abs=0.013)
    assert found.hit == (miss_m < 0.02)
    speed_too = miss_m > 0.0 and direction_rad is None
    assert found.miss_sigma_m == pytest.approx(
        np.hypot(SIGMA_M, 0.1 * SIGMA_M / (np.sqrt(2) * 0.006)) if speed_too else found.miss_sigma_m
    )


def test_a_shape_for_a_moment():
    found = judged(Shape((0.2, 0.35), ((0.2, 0.003), (0.35, 0.004))))
    # At the horizontal 3 and 4 mm; a little later the inner place is passed exactly.
    assert found.miss_m == pytest.approx(0.0005, abs=0.0015)
    assert found.closest_robot_time_s == pytest.approx(OFFSET_S + np.pi / 20, abs=0.004)
    assert found.wanted == "shape through 2 places"
    away = judged(Shape((0.4,), ((0.5, 0.0),)))
    assert away.miss_m == pytest.approx(0.1, abs=1e-4)
    assert away.miss_sigma_m == pytest.approx(SIGMA_M)
    assert not away.hit


def test_a_swing_by_height_and_speed():
    assert judged(Swing(0.3, None)).miss_m == 0.0
    assert judged(Swing(0.5, None)).miss_m == pytest.approx(0.5 - LENGTH_M, abs=1e-3)
    assert judged(Swing(None, 3.9)).miss_m == 0.0
    # 0.1 m for each m/s; the chord over 12 ms is 0.1 % shorter than the way.
    assert judged(Swing(None, 5.0)).miss_m == pytest.approx(0.1, abs=0.002)


def test_planner_and_judge_mean_the_same():
    track = swinging()
    inside = track.camera_time_s <= END_S + 1e-9
    points = track.points_m[None, inside]
    throws = Throws(points, np.zeros((*points.shape[:2], 2)), np.array([inside.sum() - 1]), STEP_S, 0.1)
    pairs = [
        (Velocity((0.41, 0.02), 1.2, 0.05, 4.6), Point((0.41, 0.02), 1.2, 0.05, 4.6)),
        (Velocity((0.39, 0.02), None, 0.35, 6.0), Point((0.39, 0.02), None, 0.35, 6.0)),
        (Shape((0.15, 0.4), ((0.2, 0.0), (0.4, 0.1))), PlannedShape((0.15, 0.4), ((0.2, 0.0), (0.4, 0.1)))),
        (Swing(0.6, None), PlannedSwing(0.6)),
        (Swing(None, 7.0), PlannedSwing(None, 7.0)),
    ]
    for seen, planned in pairs:
        assert judged(seen).miss_m == pytest.approx(planned.miss(throws)[0][0], abs=1e-9)
        assert str(seen) == str(planned)


@pytest.mark.parametrize(
    "wanted",
    [Velocity((0.4, 0.0), None, 0.35, 9.0), Shape((0.4,), ((0.4, 0.0),)), Shape((0.2,), ((0.2, 0.0),))],
)
def test_what_was_best_unseen_is_not_told(wanted):
    time_s = np.arange(FRAMES) * STEP_S
    hidden = judged(wanted, swinging(keep=np.abs(time_s - np.pi / 20) > 0.02))
    assert hidden.miss_m is None
    assert hidden.reason is not None
    assert "not tracked at its best moment (nothing between 7.1" in hidden.reason
    seen = judged(wanted, swinging(keep=np.abs(time_s - 0.03) > 0.02))
    assert seen.miss_m == pytest.approx(judged(wanted).miss_m)


def test_no_velocity_is_told_across_a_gap():
    time_s = np.arange(FRAMES) * STEP_S
    keep = np.abs(time_s - 0.2) > 0.01
    velocity_lack, _ = Swing(None, 9.0).lack(_seen(keep))
    unknown = np.flatnonzero(np.isnan(velocity_lack))
    assert set(np.flatnonzero(~keep)) < set(unknown)
    assert len(unknown) == (~keep).sum() + 6  # three frames to each side
    assert np.nanmax(np.abs(velocity_lack - 0.5)) < 0.002


def _seen(keep: np.ndarray) -> Seen:
    track = swinging()
    points = np.where(keep[:, None, None], track.points_m, np.nan)
    return Seen(track.camera_time_s, points, track.sigma_m, LENGTH_M, STEP_S)
