"""What a string is made of reaches the simulation of a throw, row by row."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from strandcast.arm.kinematics import hand_pose
from strandcast.motion.bezier import Curve, rest_heights, sample
from strandcast.motion.strings import Strings, joined, regrasped
from strandcast.motion.task import Task
from strandcast.motion.throws import World, commands, throw
from strandcast.string.simulate import simulate_batch


def curve(scale: float) -> Curve:
    heights = scale * np.array([[3.0, 2.0, -1.0], [2.0, 4.0, 1.0], [-2.0, 3.0, 5.0]])
    return Curve(np.array([0.4, -0.5, 0.3]), 0.5, rest_heights(heights))


@pytest.fixture
def odd(strings: Strings) -> Strings:
    """Three strings that differ in everything that a string can have."""
    factor = np.ones_like(strings.masses)
    factor[1:, 0:2] = 30.0, 80.0
    return replace(
        strings,
        curl_rad_m=np.array([0.0, 2.0, -3.0]),
        clamp_offset_rad=np.array([0.0, 0.05, -0.02]),
        bend_friction=np.array([0.0, 0.2, 3.0]),
        bend_factor=factor,
    )


def test_a_throw_is_of_the_very_strings_given(task: Task, odd: Strings) -> None:
    time_s, q, last = commands([sample(curve(s), task.step_s) for s in (1.0, 0.8)], task.step_s)
    thrown = throw(task, odd, World(), q, last).points_m
    pose = hand_pose(task.arm.chain, task.arm.clamp, q)
    for p in range(2):
        for k in range(3):
            alone, _ = simulate_batch(
                replace(task.model, bend_factor=tuple(odd.bend_factor[k])),
                odd.parameters[[k]],
                odd.masses[[k]],
                time_s,
                pose[p],
                time_s,
                rest_curl_rad_m=odd.curl_rad_m[[k]],
                clamp_offset_rad=odd.clamp_offset_rad[[k]],
                bend_friction=odd.bend_friction[[k]],
            )
            np.testing.assert_allclose(thrown[3 * p + k], alone[0], atol=1e-9)
    # Friction and stiff sections matter: without them the tip is elsewhere.
    for plain in (replace(odd, bend_friction=np.zeros(3)), replace(odd, bend_factor=np.ones((3, 10)))):
        tip_m = throw(task, plain, World(), q, last).points_m[:3, :, -1]
        away_m = np.abs(tip_m - thrown[:3, :, -1]).max(axis=(1, 2))
        assert away_m[0] == 0.0
        assert away_m[1:].min() > 1e-4


def test_taken_joined_and_regrasped_strings_keep_all_they_are_made_of(odd: Strings) -> None:
    again = joined(odd.take([2]), odd.first(2))
    for column in fields(Strings):
        np.testing.assert_array_equal(getattr(again, column.name), getattr(odd, column.name)[[2, 0, 1]])
    held = regrasped(odd, np.random.default_rng(0))
    np.testing.assert_array_equal(held.bend_friction, odd.bend_friction)
    np.testing.assert_array_equal(held.bend_factor, odd.bend_factor)


def test_strings_of_parameters_and_masses_alone_are_plain(strings: Strings) -> None:
    assert not strings.bend_friction.any()
    np.testing.assert_array_equal(strings.bend_factor, np.ones((3, 10)))
