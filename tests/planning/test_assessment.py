"""The assessment of rollouts, on paths whose assessment can be checked by hand."""

import numpy as np

from strandcast.core.objectives import AimedPoint
from strandcast.planning.approach import closest_approaches, segment_distance
from strandcast.planning.assessment import Assessment, Room, assess
from strandcast.planning.rollouts import Rollouts
from strandcast.planning.simulated_misses import simulated_miss

FAR = np.array([[-9.0, 9.0], [-9.0, 9.0]])


def assessed_values(
    points: np.ndarray,
    capsules: np.ndarray,
    target: tuple[float, float],
    box: np.ndarray = FAR,
    last: int | None = None,
    spacing_m: float = 99.0,
) -> list[float]:
    last = len(points) - 1 if last is None else last
    bias = np.zeros((1, len(points), 2))
    return [float(value[0]) for value in assessed(points, bias, capsules, target, box, last, spacing_m)]


def assessed(
    points: np.ndarray,
    bias: np.ndarray,
    capsules: np.ndarray,
    target: tuple[float, float],
    box: np.ndarray,
    last: int,
    spacing_m: float,
) -> Assessment:
    rollouts = Rollouts(points[None], bias, np.array([last]), 0.002, spacing_m, capsules[None])
    miss = simulated_miss(AimedPoint(target_m=target), rollouts)
    return assess(rollouts, miss, Room(np.array([0.02]), box, (0, 1)))


def moving_tip(tip: np.ndarray) -> np.ndarray:
    """Return (T, 3, 2): hand at the origin, a middle point at (0, -1), the tip."""
    points = np.zeros((len(tip), 3, 2))
    points[:, 1, 1] = -1.0
    points[:, 2] = tip
    return points


NO_CAPSULES = np.full((5, 1, 2, 2), 50.0)


def test_distance_to_a_segment_not_to_its_line() -> None:
    assert segment_distance(0.0, 1.0, -1.0, 0.0, 1.0, 0.0) == 1.0
    np.testing.assert_allclose(segment_distance(2.0, 1.0, -1.0, 0.0, 1.0, 0.0), np.sqrt(2.0))
    np.testing.assert_allclose(segment_distance(3.0, 4.0, 0.0, 0.0, 0.0, 0.0), 5.0)


def test_the_miss_is_to_the_path_between_samples() -> None:
    tip = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [5.0, 1.0], [5.0, 5.0]])
    for last, place, expected in ((4, (3.0, 1.25), (0.25, 3)), (2, (3.0, 1.0), (2.0, 2))):
        found = closest_approaches(tip[None], np.array([last]), np.array(place))
        np.testing.assert_allclose(np.ravel(found), expected)


def test_the_window_ends_where_specified() -> None:
    points = moving_tip(np.array([[0.0, -2.0], [1.0, -2.0], [2.0, -2.0], [3.0, -2.0], [4.0, -2.0]]))
    miss = assessed_values(points, NO_CAPSULES, (4.0, -2.0), last=2)[0]
    np.testing.assert_allclose(miss, 2.0)


def test_fold_is_of_the_largest_bend_before_the_hit() -> None:
    tip = np.array([[0.0, -2.0], [1.0, -1.0], [0.0, -2.0], [0.0, -0.5], [0.0, -0.5]])
    points = moving_tip(tip)
    miss, index, fold, *_, speed = assessed_values(points, NO_CAPSULES, (1.0, -1.0))
    assert (miss, index) == (0.0, 1.0)
    np.testing.assert_allclose(fold, 1.0)
    np.testing.assert_allclose(speed, np.sqrt(2.0) / 0.002)
    np.testing.assert_allclose(assessed_values(points, NO_CAPSULES, (0.0, -0.5))[2], 2.0)


def test_outside_and_touch_are_depths() -> None:
    points = moving_tip(np.tile([0.0, -2.0], (5, 1)))
    box = np.array([[-1.0, 1.0], [-1.7, 1.0]])
    capsules = np.zeros((5, 1, 2, 2))
    capsules[:, 0, 0], capsules[:, 0, 1] = [-1.0, -1.99], [1.0, -1.99]
    # Point 2 is a neighbour of the hand; a fourth point is the first that can be blamed.
    longer = np.concatenate([points, points[:, -1:] + [0.5, 0.005]], axis=1)
    _, _, _, outside, touch, hidden, _ = assessed_values(longer, capsules, (9.0, 9.0), box)
    np.testing.assert_allclose(outside, 0.3)
    np.testing.assert_allclose([touch, hidden], 0.02 - 0.005)
    assert assessed_values(points, capsules, (9.0, 9.0), box)[4] == 0.0


def test_the_tip_is_hidden_only_if_it_is_so_around_the_hit() -> None:
    points = np.zeros((60, 5, 2))
    points[:, :, 0] = np.arange(5)
    points[:, -1, 1] = np.abs(np.arange(60) - 30)  # nearest to (4, 0) at sample 30
    capsules = np.full((60, 1, 2, 2), 50.0)
    capsules[:, 0, :, 0] = [3.5, 4.5]
    capsules[:, 0, :, 1] = points[:, -1, 1, None] + np.where(np.arange(60) < 19, 0.0, 1.0)[:, None]
    _, index, _, _, touch, hidden, _ = assessed_values(points, capsules, (4.0, 0.0))
    assert index == 30
    np.testing.assert_allclose(touch, 0.02)
    assert hidden == 0.0
    capsules[40, 0, :, 1] = points[40, -1, 1]
    np.testing.assert_allclose(assessed_values(points, capsules, (4.0, 0.0))[5], 0.02)


def test_places_are_those_of_a_string_that_does_not_stretch() -> None:
    points = moving_tip(np.tile([0.0, -2.0], (5, 1)))
    box = np.array([[-1.0, 1.0], [-1.0, 1.0]])
    outside = assessed_values(points, NO_CAPSULES, (9.0, 9.0), box, spacing_m=0.6)[3]
    np.testing.assert_allclose(outside, 2 * 0.66 - 1.0)


def test_a_failed_simulation_misses_by_a_metre() -> None:
    points = moving_tip(np.tile([0.0, -2.0], (5, 1)))
    points[3:, 1] = np.nan
    assert assessed_values(points, NO_CAPSULES, (0.0, -2.0))[:2] == [1.0, 0.0]
    assert assessed_values(points, NO_CAPSULES, (0.0, -2.0), last=2)[0] == 0.0


def test_bias_correction_shifts_the_tip_alone() -> None:
    points = moving_tip(np.tile([0.0, -2.0], (5, 1)))
    bias = np.full((1, 5, 2), [0.3, 0.4])
    answer = assessed(points, bias, NO_CAPSULES, (0.0, -2.0), FAR, 4, 9.0)
    np.testing.assert_allclose(answer[0], 0.5)
    np.testing.assert_allclose(answer[2], 0.0)
