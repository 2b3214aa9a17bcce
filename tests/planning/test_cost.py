"""The arm as capsules, and start postures that hide the string."""

import numpy as np
import pytest

from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import PlanarArm
from strandcast.planning.cost import NEAR_HAND_M, start_violation_m

WIDE = np.array([[-2.0, 2.0], [-2.0, 2.0]])
UP, DOWN, SIDEWAYS = [np.pi / 2, 0.0, 0.0], [-np.pi / 2, 0.0, 0.0], [0.0, 0.0, 0.0]


def test_capsules_are_the_links_and_the_plate_between_the_markers(arm: PlanarArm) -> None:
    found = arm.capsules(np.array([SIDEWAYS, UP]))
    np.testing.assert_allclose(found[0, :, 0, 0], [0.0, 0.30, 0.55, 0.70 - 0.115], atol=1e-12)
    np.testing.assert_allclose(found[0, :, 1, 0], [0.30, 0.55, 0.70, 0.70 - 0.05], atol=1e-12)
    np.testing.assert_allclose(found[1, :, :, 1], found[0, :, :, 0], atol=1e-12)
    np.testing.assert_allclose(found[1, :, :, 0], 0.0, atol=1e-12)
    np.testing.assert_allclose(arm.capsule_radii(0.03), [0.03, 0.03, 0.03, 0.025 + 0.015])


def test_a_string_must_not_hang_over_the_arm(arm: PlanarArm) -> None:
    violation_m = start_violation_m(arm, 0.30, WIDE, np.array([UP, DOWN, SIDEWAYS]))
    # Over its middle, the string lies as deep in the plate as the plate is wide.
    np.testing.assert_allclose(violation_m, [0.040, 0.0, 0.0], atol=1e-12)
    # The last link 45 degrees below the hand: 60 mm down, the string is 42 mm beside it.
    tilted = start_violation_m(arm, 0.30, WIDE, np.array([[np.pi / 4, 0.0, 0.0]]))
    assert NEAR_HAND_M * np.sin(np.pi / 4) > 0.040
    np.testing.assert_allclose(tilted, 0.0)
    steeper = start_violation_m(arm, 0.30, WIDE, np.array([[np.radians(65), 0.0, 0.0]]))
    np.testing.assert_allclose(steeper, 0.040 - NEAR_HAND_M * np.sin(np.radians(25)), atol=1e-3)


def test_a_string_must_hang_within_the_box(arm: PlanarArm) -> None:
    box = np.array([[-1.0, 0.65], [-0.25, 1.0]])
    violation_m = start_violation_m(arm, 0.30, box, np.array([SIDEWAYS, [0.5, 0.5, -1.5]]))
    # The tip hangs 5 % further than specified: 0.315 m down; the hand is 0.05 m out to the right.
    np.testing.assert_allclose(violation_m, [0.315 - 0.25, 0.0], atol=1e-12)


def test_the_string_hangs_clear_of_its_target_at_the_start(arm: PlanarArm) -> None:
    hand_m = hand_pose(arm.chain, arm.clamp, np.array([SIDEWAYS])).position_m[0]
    for place_m, short_m in (((0.0, -0.30), 0.05), ((0.03, -0.15), 0.02), ((0.06, -0.15), 0.0)):
        clear_of = (np.array([hand_m + place_m]), 0.05)
        violation_m = start_violation_m(arm, 0.30, WIDE, np.array([SIDEWAYS]), clear_of)
        assert violation_m[0] == pytest.approx(short_m, abs=1e-12)
