"""Every property of a string reaches the simulation of its rollout, row by row."""

from dataclasses import replace

import numpy as np
import pytest

from strandcast.arm.kinematics import PlanarChain, hand_pose, hand_poses
from strandcast.arm.settings import Clamp
from strandcast.core.disturbances import (
    GRASP_ANGLE_RAD,
    GRASP_LENGTH_M,
    JOINT_ZERO_RAD,
    SWAY_RAD,
    SWAY_RAD_S,
    TYPICAL_SIZES,
)
from strandcast.core.strings import PARAMETERS, StringBatch
from strandcast.dynamics.batch import HandPath, StringStart
from strandcast.dynamics.masses import MassLayout, mass_layout, point_masses
from strandcast.dynamics.simulate import simulate_batch
from strandcast.planning.bezier import Curve, rest_heights, sample
from strandcast.planning.rollouts import RolloutConditions, commands, simulate_rollouts
from strandcast.planning.scenarios import crossed, disturbed
from strandcast.planning.start_strings import in_another_clamp, rescaled
from strandcast.planning.task import PlanningTask


def curve(scale: float) -> Curve:
    heights = scale * np.array([[3.0, 2.0, -1.0], [2.0, 4.0, 1.0], [-2.0, 3.0, 5.0]])
    return Curve(np.array([0.4, -0.5, 0.3]), 0.5, rest_heights(heights))


@pytest.fixture
def odd(strings: StringBatch) -> StringBatch:
    """Three strings that differ in everything that a string can have."""
    factor = np.ones_like(strings.masses)
    factor[1:, 0:2] = 30.0, 80.0
    return replace(strings, bend_factor=factor).with_values(
        rest_curl_rad_m=np.array([0.0, 2.0, -3.0]),
        clamp_offset_rad=np.array([0.0, 0.05, -0.02]),
        bend_friction=np.array([0.0, 0.2, 3.0]),
    )


def test_rollouts_are_of_the_strings_given(task: PlanningTask, odd: StringBatch) -> None:
    time_s, q, last = commands([sample(curve(s), task.step_s) for s in (1.0, 0.8)], task.step_s)
    thrown = simulate_rollouts(task, odd, RolloutConditions(), q, last).points_m
    pose = hand_pose(task.arm.chain, task.arm.clamp, q).array()
    for p in range(2):
        for k in range(3):
            alone, _ = simulate_batch(task.model, odd.take(k), HandPath(time_s, pose[p]), time_s)
            np.testing.assert_allclose(thrown[3 * p + k], alone[0], atol=1e-9)
    # Friction and stiff sections matter: without them the tip is elsewhere.
    for plain in (odd.with_values(bend_friction=np.zeros(3)), replace(odd, bend_factor=np.ones((3, 10)))):
        tip_m = simulate_rollouts(task, plain, RolloutConditions(), q, last).points_m[:3, :, -1]
        away_m = np.abs(tip_m - thrown[:3, :, -1]).max(axis=(1, 2))
        assert away_m[0] == 0.0
        assert away_m[1:].min() > 1e-4


def physical(length_m: float, points: int, weight_m: float) -> tuple[StringBatch, MassLayout]:
    """Two strings of given mass, stiffness, drag, friction and weight per length, as so many points."""
    layout, h = mass_layout(length_m, points, [weight_m]), length_m / points
    mass, stiff, drag = np.array([0.004, 0.01]), np.array([1e-6, 4e-6]), np.array([0.3, 0.5])
    joint, weight = stiff / (mass * h**2), np.array([0.01, 0.004]) / (mass * h)
    none = np.zeros(2)
    columns = [2e4 / h**2 + none, 0.01 / h**2 + none, *[joint, 0.01 * joint] * 2, 0.01 + none, drag]
    strings = StringBatch(
        np.column_stack([*columns, 2.0 * joint, 0.02 * joint]),
        point_masses(layout, weight[:, None]),
        {
            "bend_friction": 1e-6 / (mass * h),
            "drag_along": none + 0.3,
            "rest_curl_rad_m": np.array([1.0, 2.0]),
        },
        free_masses=weight[:, None],
    )
    return strings, layout


def test_a_string_in_another_clamp_is_the_same_string() -> None:
    fitted, _ = physical(0.5, 10, 0.4)
    moved, layout = physical(0.36, 12, 0.26)  # 0.14 m of it were pulled into the clamp
    clamp = np.array([name.endswith("_ph") for name in PARAMETERS])
    worn = replace(fitted, parameters=np.where(clamp, 0.1, fitted.parameters))
    worn = worn.with_values(clamp_offset_rad=np.array([0.1, 0.1]))
    found = in_another_clamp(rescaled(worn, (0.5, 0.05), 0.36, layout), np.random.default_rng(0))
    np.testing.assert_allclose(found.parameters, moved.parameters, rtol=1e-12)
    np.testing.assert_allclose(found.masses, moved.masses, rtol=1e-12)
    np.testing.assert_allclose(found["bend_friction"], moved["bend_friction"], rtol=1e-12)
    assert not found["clamp_offset_rad"].any()
    assert np.abs(found["rest_curl_rad_m"]).tolist() == [1.0, 2.0]  # to either side


def test_a_tapered_string_in_another_clamp_ends_as_it_did() -> None:
    fitted, _ = physical(0.5, 10, 0.4)
    _, layout = physical(0.25, 10, 0.15)
    taper = fitted.with_values(taper=np.array([-1.0, 2.0]))
    found = rescaled(taper, (0.5, 0.05), 0.25, layout)
    before, after = taper.applied(), found.applied()
    end = (each.bend_factor[:, -1] * each.parameters[:, PARAMETERS.index("k_h")] for each in (before, after))
    first, second = end
    np.testing.assert_allclose(second, 4.0 * first, rtol=0.1)  # half the spacing; the last joint is elsewhere


def test_selected_strings_keep_all_their_columns(odd: StringBatch) -> None:
    held = disturbed(odd, 16, 3)
    again = held.take([2, 0, 5])
    for name in ("parameters", "masses", "bend_factor", "free_masses"):
        np.testing.assert_array_equal(getattr(again, name), getattr(held, name)[[2, 0, 5]])
    assert again.values.keys() == odd.values.keys()
    for name in odd.values:
        np.testing.assert_array_equal(again[name], held[name][[2, 0, 5]])
        np.testing.assert_array_equal(held[name][[0, 3, 15]], odd[name][[0, 0, 0]])
    np.testing.assert_array_equal(levels_of(again), levels_of(held)[[2, 0, 5]])
    # Those given come in turn.
    for name in ("parameters", "masses", "bend_factor"):
        np.testing.assert_array_equal(getattr(held, name)[[0, 3, 15]], getattr(odd, name)[[0, 0, 0]])
        np.testing.assert_array_equal(getattr(held, name)[4], getattr(odd, name)[1])


def levels_of(held: StringBatch) -> np.ndarray:
    one = held.disturbances
    return np.column_stack([one.clamp_turn_rad, one.longer_m, one.sway, one.joint_zero_rad])


SIZES = np.array([GRASP_ANGLE_RAD, GRASP_LENGTH_M, SWAY_RAD, SWAY_RAD_S, *[JOINT_ZERO_RAD] * 3])


@pytest.mark.parametrize("count", [8, 16])
def test_the_disturbances_are_a_balanced_design(strings: StringBatch, count: int) -> None:
    signs = levels_of(disturbed(strings.take([0]), count, 3)) / SIZES
    # One standard deviation each, either way as often, no two alike in more than half of the throws.
    np.testing.assert_allclose(np.abs(signs), 1.0)
    np.testing.assert_allclose(signs.T @ signs / count, np.eye(7), atol=1e-12)
    np.testing.assert_allclose(signs.sum(axis=0), 0.0, atol=1e-12)
    half = disturbed(strings.take([0]), count, 3, 0.5 * TYPICAL_SIZES)
    np.testing.assert_allclose(levels_of(half), 0.5 * signs * SIZES)


def test_the_mean_square_is_bias_and_variance_of_a_linear_response(strings: StringBatch) -> None:
    slopes, bias = np.array([0.3, -2.0, 1.0, 0.4, 5.0, -3.0, 2.0]), 0.017
    misses = bias + levels_of(disturbed(strings.take([0]), 8, 3)) @ slopes
    np.testing.assert_allclose(np.mean(misses**2), bias**2 + ((slopes * SIZES) ** 2).sum())
    # With all signs turned as well, a square in the response does not shift what is odd in it.
    both = levels_of(disturbed(strings.take([0]), 16, 3))
    np.testing.assert_allclose(both[8:], -both[:8])


def test_every_string_is_crossed_with_every_disturbance(strings: StringBatch) -> None:
    every = crossed(strings, 3)
    assert len(every) == 16 * len(strings)
    for k in range(len(strings)):
        mine = every.take(range(16 * k, 16 * k + 16))
        np.testing.assert_array_equal(mine.parameters, np.tile(strings.parameters[k], (16, 1)))
        np.testing.assert_allclose(levels_of(mine), levels_of(disturbed(strings.take([0]), 16, 3)))


def test_a_longer_string_hangs_out_further(task: PlanningTask, strings: StringBatch) -> None:
    longer = strings.take([0]).with_disturbances(longer_m=np.array([0.01]))
    q = np.tile([0.0, 0.0, 0.0], (1, 50, 1))
    one, two = (
        simulate_rollouts(task, s, RolloutConditions(), q, np.array([49])).points_m[0]
        for s in (strings.take([0]), longer)
    )
    np.testing.assert_allclose(two[0] - one[0], np.tile([0.01, 0.0], (11, 1)), atol=1e-9)


def test_a_joints_zero_is_added_to_its_angle(task: PlanningTask, strings: StringBatch) -> None:
    zero = np.array([[0.03, -0.02, 0.05]])
    _, q, last = commands([sample(curve(1.0), task.step_s)], task.step_s)
    off = simulate_rollouts(
        task, strings.take([0]).with_disturbances(joint_zero_rad=zero), RolloutConditions(), q, last
    )
    moved = simulate_rollouts(task, strings.take([0]), RolloutConditions(), q + zero, last)
    np.testing.assert_allclose(off.points_m, moved.points_m, atol=1e-12)


def test_sway_is_the_whole_string_turned_about_the_hand(task: PlanningTask, strings: StringBatch) -> None:
    time_s, q, last = commands([sample(curve(1.0), task.step_s)], task.step_s)
    turn, rate = 0.05, 0.2
    swaying = strings.take([0]).with_disturbances(sway=np.array([[turn, rate]]))
    found = simulate_rollouts(task, swaying, RolloutConditions(), q, last).points_m[0]
    pose = hand_pose(task.arm.chain, task.arm.clamp, q[0]).array()
    still = simulate_rollouts(task, strings.take([0]), RolloutConditions(), q, last).points_m[0, 0]
    arms = still[1:] - still[0]
    cos, sin = np.cos(turn), np.sin(turn)
    turned = np.stack([cos * arms[:, 0] - sin * arms[:, 1], sin * arms[:, 0] + cos * arms[:, 1]], axis=1)
    given, _ = simulate_batch(
        task.model,
        StringBatch(strings.parameters[:1], strings.masses[:1]),
        HandPath(time_s, pose),
        time_s,
        StringStart(still[0] + turned, rate * np.stack([-turned[:, 1], turned[:, 0]], axis=1), respace=False),
    )
    np.testing.assert_allclose(found, given[0], atol=1e-6)
    assert (
        np.abs(
            found[:, -1]
            - simulate_rollouts(task, strings.take([0]), RolloutConditions(), q, last).points_m[0, :, -1]
        ).max()
        > 0.005
    )


def test_hand_poses_match_the_chains_kinematics(task: PlanningTask) -> None:
    rng = np.random.default_rng(1)
    q, zero, longer = rng.uniform(-2, 2, (3, 20, 3)), rng.normal(0, 0.1, (2, 3)), np.array([0.0, 0.02])
    chain = PlanarChain(
        np.array([0.1, -0.2]),
        np.array([0.4, 0.3, 0.1]),
        np.array([0.3, -0.1, 0.8]),
        np.array([1.0, -1.0, 1.0]),
    )
    clamp = Clamp(link="hand", offset_m=(0.05, -0.03), angle_rad=0.4)
    found = hand_poses(q, zero, longer, chain, clamp).reshape(3, 2, 20, 3)
    for k in range(2):
        pose = hand_pose(chain, clamp, q + zero[k]).array()
        out = np.stack([np.cos(pose[..., 2]), np.sin(pose[..., 2])], axis=-1)
        np.testing.assert_allclose(found[:, k, :, :2], pose[..., :2] + longer[k] * out, atol=1e-12)
        np.testing.assert_allclose(found[:, k, :, 2], pose[..., 2], atol=1e-12)


def test_strings_of_parameters_and_masses_alone_are_plain(strings: StringBatch) -> None:
    assert not any(values.any() for values in strings.options().values())
    np.testing.assert_array_equal(strings.bend_factor, np.ones((3, 10)))
