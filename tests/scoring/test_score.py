"""The miss of a tracked throw past a point or a bar, and when it is not known."""

import numpy as np
import pytest

from strandcast.core.objectives import Objective, PointObjective, SegmentObjective
from strandcast.records.alignment import Alignment
from strandcast.records.camera import PlaneError
from strandcast.records.summary import miss_in_words
from strandcast.records.track import OCCLUDED, PREDICTED, Track
from strandcast.scoring.measured_misses import bridged
from strandcast.scoring.score import Aim, score_throw

STEP_S = 0.002
OFFSET_S = 7.0
SPEED_M_S = 8.0


def alignment(start_s: float = 7.0, end_s: float = 7.2) -> Alignment:
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
        motion_start_s=start_s,
        motion_end_s=end_s,
    )


def fly_by(frames: int = 200, height_m: float = 0.013, keep: np.ndarray | None = None) -> Track:
    """The tip flies along y = height, past x = 0 half-way between frames 100 and 101."""
    time_s = np.arange(frames) * STEP_S
    points = np.full((frames, 3, 2), 0.1)
    points[:, 2, 0] = SPEED_M_S * (time_s - 100.5 * STEP_S)
    points[:, 2, 1] = height_m
    keep = np.ones(frames, bool) if keep is None else keep
    return Track(
        np.arange(frames)[keep],
        time_s[keep],
        points[keep],
        np.full((keep.sum(), 3), 0.001),
        np.zeros((keep.sum(), 3), np.int32),
    )


def scored(objective: Objective, track, target=(0.0, 0.0), radius=0.02, **when):
    aim = Aim("e", 1, objective.aimed_at(target), target, radius)
    return score_throw(track, alignment(**when), aim, 0.3)


def verdict(track: Track, target=(0.0, 0.0), radius=0.02, **when):
    return scored(PointObjective(), track, target, radius, **when)


def test_the_miss_is_that_of_the_segment_not_of_the_samples():
    found = verdict(fly_by())
    assert found.miss_m == pytest.approx(0.013, abs=1e-12)  # nearest sample: 15.3 mm
    assert found.miss_sigma_m == pytest.approx(0.001 / np.sqrt(2))
    assert found.hit
    assert found.closest_frame in (100, 101)
    assert found.closest_robot_time_s == pytest.approx(OFFSET_S + 100.5 * STEP_S, abs=1e-9)
    assert found.closest_m == pytest.approx([0.0, 0.013], abs=1e-12)
    assert found.reason is None


def test_the_error_of_the_cameras_plane_is_part_of_the_miss():
    # 1 mm at x = -1 m and 3 mm at x = 1 m: 2 mm where the tip passes; the worst counts nowhere else.
    error = PlaneError(
        x_m=[-1.0, 1.0],
        y_m=[-1.0, 1.0],
        sigma_m=[[0.001, 0.003], [0.001, 0.003]],
        median_m=0.009,
        worst_m=0.003,
        sources_m={},
        corner_sigma_px=0.1,
        place_sd_m=0.001,
        string_offset_sd_m=0.001,
    )
    aim = Aim("e", 1, PointObjective().aimed_at((0.0, 0.0)), (0.0, 0.0), 0.02)
    without, found = (score_throw(fly_by(), alignment(), aim, 0.3, each) for each in (None, error))
    assert found.miss_sigma_m == pytest.approx(np.hypot(without.miss_sigma_m, 0.002))
    assert found.model_copy(update={"miss_sigma_m": without.miss_sigma_m}) == without
    assert error.at(np.array([5.0, 0.3])) == 0.003


def test_the_error_that_all_frames_share_is_part_of_the_miss():
    aim = Aim("e", 1, PointObjective().aimed_at((0.0, 0.0)), (0.0, 0.0), 0.02)
    without, found = (score_throw(fly_by(), alignment(), aim, 0.3, None, each) for each in (0.0, 0.004))
    assert found.miss_sigma_m == pytest.approx(np.hypot(without.miss_sigma_m, 0.004))
    assert found.miss_m == without.miss_m


def test_a_doubtful_frame_is_scored_by_those_around_it():
    """Where the target hides the string's end, its frame says little, and those around it all."""
    track = fly_by()
    track.sigma_m[:] = 0.0003
    track.sigma_m[99:102, 2] = 0.003
    track.points_m[99:102, 2] += 0.002
    found = verdict(track)
    assert found.miss_m == pytest.approx(0.013, abs=0.0005)
    assert 0.0003 < found.miss_sigma_m < 0.0009
    lonely = verdict(fly_by(keep=np.isin(np.arange(200), [0, 50, 100, 101, 150])))  # nothing near
    assert lonely.miss_sigma_m == pytest.approx(0.001 / np.sqrt(2))


def test_a_path_that_turns_at_a_contact_is_not_smoothed():
    track = fly_by()
    track.points_m[101:, 2, 0] = track.points_m[100, 2, 0] - SPEED_M_S * STEP_S * np.arange(1, 100)
    track.sigma_m[100, 2] = 0.003
    found = verdict(track)
    assert found.closest_m == pytest.approx([-SPEED_M_S * STEP_S / 2, 0.013])
    assert found.miss_sigma_m == pytest.approx(0.003)
    slower = fly_by()
    slower.points_m[101:, 2, 0] = slower.points_m[100, 2, 0] - 0.2 * SPEED_M_S * STEP_S * np.arange(1, 100)
    slower.sigma_m[:] = 0.0003
    slower.sigma_m[99:102, 2] = 0.003
    assert verdict(slower).miss_sigma_m > 0.002
    assert verdict(slower).closest_m == pytest.approx([-SPEED_M_S * STEP_S / 2, 0.013])


def test_a_tip_that_is_hidden_for_a_few_frames_has_a_miss_with_the_doubt_of_what_it_struck():
    """Behind the target for 10 ms it may have passed, or have turned at the target."""
    track = fly_by()
    track.sigma_m[:] = 0.0003
    hidden = slice(99, 103)
    track.flags[hidden, 2] = OCCLUDED
    passed = verdict(track)
    assert passed.miss_m == pytest.approx(0.013, abs=1e-6)
    assert 0.0003 < passed.miss_sigma_m < 0.0015
    after = np.arange(101, 200)
    track.points_m[after, 2, 0] = -SPEED_M_S * STEP_S * (after - 100.5)
    turned = verdict(track)
    assert turned.miss_m is not None
    assert abs(turned.miss_m - np.hypot(0.013, SPEED_M_S * STEP_S / 2)) < 2 * turned.miss_sigma_m
    assert turned.miss_sigma_m > 0.005
    track.flags[98:104, 2] = OCCLUDED  # longer than that
    assert verdict(track).miss_m is None


def test_only_frames_without_a_place_are_bridged():
    time_s = np.arange(20) * STEP_S
    path_m = np.column_stack([time_s, np.zeros(20)])
    path_m[10, 1], sigma_m = 0.09, np.where(np.arange(20) == 10, 0.0, 0.001)
    np.testing.assert_array_equal(bridged(time_s, path_m, sigma_m)[0], path_m)


def test_a_throw_that_begins_at_its_target_hits_only_if_it_comes_back():
    track = fly_by(height_m=0.012)
    rests = np.arange(len(track.frame)) < 50
    track.points_m[rests, 2] = (0.003, 0.0)  # the string hangs 3 mm from the target
    found = verdict(track)
    assert found.miss_m == pytest.approx(0.012)
    assert found.closest_frame in (100, 101)
    track.points_m[:, 2] = (0.003, 0.0)
    assert not verdict(track).hit
    assert verdict(track).reason == "the tip was at the target from the start, and never clear of it"


def test_a_hit_is_a_miss_of_at_most_the_radius():
    assert verdict(fly_by(height_m=0.0199)).hit
    assert not verdict(fly_by(height_m=0.0201)).hit


def test_only_the_time_from_start_to_after_the_end_counts():
    late = verdict(fly_by(), start_s=OFFSET_S + 0.30)
    assert late.miss_m == pytest.approx(np.hypot(0.013, SPEED_M_S * (0.30 - 0.201)), abs=1e-6)
    assert verdict(fly_by(), end_s=OFFSET_S + 0.201 - 0.25).hit  # 0.25 s after the end is within 0.3 s
    early = verdict(fly_by(), start_s=6.0, end_s=OFFSET_S + 0.1 - 0.3)
    assert early.miss_m == pytest.approx(np.hypot(0.013, SPEED_M_S * (0.201 - 0.1)), abs=1e-6)


def test_one_lost_frame_is_bridged_and_two_are_not():
    frames = np.arange(200)
    assert verdict(fly_by(keep=frames != 100)).miss_m == pytest.approx(0.013, abs=1e-12)
    gap = verdict(fly_by(keep=(frames < 99) | (frames > 102)))
    assert gap.miss_m is None
    assert not gap.hit
    assert "not tracked at the closest approach (nothing between 7.196 and 7.206 s" in gap.reason


def test_a_gap_elsewhere_does_no_harm():
    frames = np.arange(200)
    assert verdict(fly_by(keep=(frames < 20) | (frames > 60))).hit


def test_the_edge_of_a_gap_is_not_taken_for_the_closest_approach():
    """The tip is lost while it turns near the target: the chord from edge to edge passes far from it."""
    time_s = np.arange(120) * STEP_S
    points = np.zeros((120, 1, 2))
    points[:, 0, 0] = -0.2 * np.abs(np.cos(2 * np.pi * time_s / 0.24))
    points[:, 0, 1] = 0.1 * np.sin(2 * np.pi * time_s / 0.24)
    keep = np.abs(time_s - 0.06) > 0.01
    track = Track(
        np.arange(120)[keep],
        time_s[keep],
        points[keep],
        np.full((keep.sum(), 1), 1e-3),
        np.zeros((keep.sum(), 1), np.int32),
    )
    assert verdict(track, target=(0.05, 0.1)).miss_m is None


@pytest.mark.parametrize("order", [1, -1], ids=["before the gap", "after the gap"])
def test_the_nearest_frame_at_the_edge_of_a_gap_is_not_taken_for_the_closest_approach(order):
    """The tip is far away at the other edge: a cubic through both edges comes no nearer."""
    track = fly_by(keep=np.abs(np.arange(200) - 99.5) > 10)
    track.points_m[:, 2, 0] = np.where(track.frame < 100, 0.001 * (track.frame - 89), 0.5)[::order]
    assert verdict(track).miss_m is None


def test_a_predicted_tip_is_not_a_tracked_one():
    track = fly_by()
    track.flags[98:104, -1] = PREDICTED
    assert verdict(track).miss_m is None


def test_a_track_that_ends_too_early_or_is_empty_gives_no_miss():
    frames = np.arange(200)
    ended = verdict(fly_by(keep=frames < 90))
    assert ended.miss_m is None
    assert "still comes nearer" in ended.reason
    started = verdict(fly_by(keep=frames > 110))
    assert started.miss_m is None
    lost = verdict(fly_by(keep=frames < 1))
    assert "tracked in 1 frames" in lost.reason


def test_the_verdict_is_a_record(tmp_path):
    found = verdict(fly_by())
    found.write(tmp_path / "verdict.json")
    assert type(found).read(tmp_path / "verdict.json") == found


def test_a_bar_is_missed_by_the_distance_of_path_and_bar():
    def bar(*ends):
        return scored(SegmentObjective(kind="segment", ends_m=ends), fly_by())

    crossed = bar((-0.3, -0.387), (0.3, 0.413))
    assert crossed.miss_m == pytest.approx(0.0, abs=1e-12)
    assert crossed.hit
    assert crossed.closest_m == pytest.approx([0.0, 0.013], abs=1e-12)
    assert (crossed.objective, crossed.bar_m) == ("segment", [[-0.3, -0.387], [0.3, 0.413]])
    above = bar((0.003, 0.033), (0.003, 1.0))
    assert above.miss_m == pytest.approx(0.020, abs=1e-12)
    assert above.closest_robot_time_s == pytest.approx(
        OFFSET_S + 100.5 * STEP_S + 0.003 / SPEED_M_S, abs=1e-9
    )
    # Beside its middle, which is where the target is, the tip passes far away.
    end = bar((-0.4, 0.018), (0.4, 0.418))
    assert end.miss_m == pytest.approx(0.005, abs=1e-12)
    assert not verdict(fly_by(), (0.0, 0.218)).hit
    gap = np.ones(200, bool)
    gap[95:106] = False
    bar_there = SegmentObjective(kind="segment", ends_m=((0.0, -1.0), (0.0, 1.0)))
    hidden = scored(bar_there, fly_by(keep=gap))
    assert hidden.miss_m is None


@pytest.mark.parametrize(
    ("miss_m", "sigma_m", "words"),
    [
        (0.0077, 0.0005, "HIT  7.7 ± 0.5 mm from the target"),
        (0.0195, 0.0005, "HIT? 19.5 ± 0.5 mm from the target"),
        (0.0205, 0.0005, "miss? 20.5 ± 0.5 mm from the target"),
        (0.1229, None, "miss 122.9 mm from the target"),
    ],
)
def test_a_miss_near_the_hit_radius_is_an_uncertain_one_in_the_terminal_too(
    miss_m: float, sigma_m: float | None, words: str
) -> None:
    aim = Aim("e", 1, PointObjective().aimed_at((0.0, 0.0)), (0.0, 0.0), 0.02)
    verdict = score_throw(fly_by(), alignment(), aim, 0.3)
    throw = verdict.model_copy(
        update={"miss_m": miss_m, "miss_sigma_m": sigma_m, "hit": miss_m <= verdict.hit_radius_m}
    )
    assert miss_in_words(throw, verdict.hit_radius_m) == words
