"""Clock and place of a capture in space are found from a body that is tracked on the arm's hand."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strandcast.arm.load import load_arm
from strandcast.errors import StrandcastError
from strandcast.imports.clock import supplied_clock
from strandcast.imports.throw_in_space import ThrownBy, place_capture, placement_warnings, standard_error_m

ARM = "config/arms/ur5e-space.toml"
START_S, END_S = 11.0, 11.8
TURN, SHIFT_M, OFFSET_S = Rotation.from_euler("xyz", [0.3, -0.2, 2.0]), np.array([0.4, -1.2, 0.3]), 7.3
BODY_M = [0.02, -0.04, 0.03]  # in the hand's axes
FILE = Path("capture.csv")


TRAVEL_RAD, RISING = [0.9, -0.6, 0.8, 0.7, -1.0, 0.4], [0.0, 0.3, 0.15, 0.0, 0.3, 0.35]


def eased(time_s: np.ndarray, start_s: float | np.ndarray, end_s: float) -> np.ndarray:
    share = np.clip((time_s - start_s) / (end_s - start_s), 0.0, 1.0)
    return np.asarray(share**3 * (10.0 - 15.0 * share + 6.0 * share**2))


def moved(root: Path, travel_rad: list[float], wrist_turns: bool = False, rest_s: float = 0.0) -> ThrownBy:
    """Return a motion from rest to rest in a log of 500 Hz; joints set off one after the other."""
    arm = load_arm(root / ARM).spatial()
    time_s = np.arange(0.0 if wrist_turns else 10.5 - rest_s, 12.4, 0.002)
    q = np.tile([0.2, -1.2, 1.0, -0.5, 0.4, 0.1], (len(time_s), 1))
    q += eased(time_s[:, None], START_S + np.array(RISING), END_S) * travel_rad
    if wrist_turns:
        for joint, begin_s in ((3, 1.0), (4, 4.0), (5, 7.0)):
            q[:, joint] += 0.6 * (
                eased(time_s, begin_s, begin_s + 1) - eased(time_s, begin_s + 1, begin_s + 2)
            )
    return ThrownBy(time_s, arm.hand_path(q), (START_S, END_S))


@pytest.fixture(scope="module")
def thrown(project_root: Path) -> ThrownBy:
    """Return a motion of all joints by 0.4 to 1 rad."""
    return moved(project_root, TRAVEL_RAD)


def captured(thrown: ThrownBy) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times and places of body and tip in the capture; the body's with 0.3 mm of noise and a gap."""
    time_s = np.arange(thrown.time_s[0] + 0.1, 12.3, 0.005)
    place_m, along, normal = np.hsplit(thrown.at(time_s), 3)
    body = place_m + np.stack([along, normal, np.cross(along, normal)], axis=2) @ np.array(BODY_M)
    body = TURN.inv().apply(body - SHIFT_M) + np.random.default_rng(5).normal(0.0, 3e-4, body.shape)
    body[40:44] = np.nan
    return time_s - OFFSET_S, body, TURN.inv().apply(place_m + 0.4 * along - SHIFT_M)


@pytest.mark.parametrize("rest_s", [0.0, 30.0])
def test_the_capture_of_another_throw_is_refused_however_long_the_arm_rested(
    project_root: Path, rest_s: float
) -> None:
    played, other = (
        moved(project_root, travel, rest_s=rest_s)
        for travel in (TRAVEL_RAD, [0.9, -0.6, 0.8, -0.7, 1.0, 0.4])
    )
    with pytest.raises(StrandcastError, match="SC-I054"):
        place_capture(played, *captured(other), None, FILE)


def test_clock_and_place_are_found_wherever_arm_and_body_are(thrown: ThrownBy) -> None:
    found = place_capture(thrown, *captured(thrown), None, FILE)
    assert found.offset_s == pytest.approx(OFFSET_S, abs=2e-4)
    assert found.rms_m == pytest.approx(np.sqrt(3.0) * 3e-4, rel=0.15)
    assert placement_warnings(found) == []
    string_m = np.random.default_rng(6).uniform(-0.5, 1.0, (20, 3))
    np.testing.assert_allclose(found.placed(TURN.inv().apply(string_m - SHIFT_M)), string_m, atol=1e-3)
    alignment = supplied_clock("cast", 1, 100, thrown.motion_s, found.offset_s)
    assert alignment.robot_time_s(np.array([START_S - OFFSET_S]))[0] == pytest.approx(START_S, abs=2e-4)
    assert (alignment.motion_start_s, alignment.motion_end_s) == (START_S, END_S)


def test_a_given_offset_leaves_the_capture_in_the_arms_frame(thrown: ThrownBy) -> None:
    time_s, _, tip_m = captured(thrown)
    found = place_capture(thrown, time_s, None, tip_m, OFFSET_S, FILE)
    np.testing.assert_array_equal(found.placed(np.ones((2, 3))), np.ones((2, 3)))
    assert found[2:] == (OFFSET_S, None, None, None)


def test_a_body_that_is_loose_is_warned_of_and_one_elsewhere_refused(thrown: ThrownBy) -> None:
    time_s, body_m, tip_m = captured(thrown)
    swings = np.sin(40.0 * time_s)[:, None] * [0.0, 0.0, 1.0]
    [warning] = placement_warnings(
        place_capture(thrown, time_s, body_m + 0.008 * swings, tip_m, None, FILE)._replace(string_se_m=0.0)
    )
    assert "mm rms from the arm's: the capture of another throw, a loose marker" in warning
    with pytest.raises(StrandcastError, match=r"SC-I054.*hand.*mm rms from the arm's, wherever"):
        place_capture(thrown, time_s, body_m + 0.08 * swings, tip_m, None, FILE)


def test_what_leaves_clock_and_place_open_is_refused(thrown: ThrownBy) -> None:
    time_s, body_m, tip_m = captured(thrown)
    with pytest.raises(StrandcastError, match=r"SC-I054.*neither a tracked hand nor"):
        place_capture(thrown, time_s, None, tip_m, None, FILE)
    with pytest.raises(StrandcastError, match=r"SC-I054.*both are given"):
        place_capture(thrown, time_s, body_m, tip_m, OFFSET_S, FILE)
    half = slice(0, 120)
    with pytest.raises(StrandcastError, match=r"SC-I054.*0.80 s.*not seen as long"):
        place_capture(thrown, time_s[half], body_m[half], tip_m[half], None, FILE)


@pytest.mark.parametrize(
    "travel_rad", [[1.2, 0, 0, 0, 0, 0], [0, -0.6, 0.9, 0.7, 0, 0]], ids=["base", "parallel"]
)
def test_a_hand_that_turns_about_one_axis_needs_turns_about_others(
    project_root: Path, travel_rad: list[float]
) -> None:
    thrown = moved(project_root, travel_rad)
    with pytest.raises(StrandcastError, match=r"SC-I054.*hand.*placed to 1\d\d mm only.*one standard error"):
        place_capture(thrown, *captured(thrown), None, FILE)
    turned = moved(project_root, travel_rad, wrist_turns=True)
    time_s, body_m, tip_m = captured(turned)
    found = place_capture(turned, time_s, body_m, tip_m, None, FILE)
    assert placement_warnings(found) == []
    place_m, along, _ = np.hsplit(turned.at(time_s + OFFSET_S), 3)
    off_m = found.placed(tip_m) - place_m - 0.4 * along
    assert np.sqrt(np.mean(np.sum(off_m**2, axis=1))) < 2.0 * found.string_se_m < 1e-3


def test_a_hand_that_hardly_turns_about_a_second_axis_is_warned_of(project_root: Path) -> None:
    thrown = moved(project_root, [0.0, -0.6, 0.9, 0.7, 0.1, 0.0])
    found = place_capture(thrown, *captured(thrown), None, FILE)
    [warning] = placement_warnings(found)
    assert "hand and tip are placed to 3 mm only (one standard error): turn the hand slowly" in warning
    assert found.string_se_m == pytest.approx(3.4e-3, abs=2e-4)


def test_a_path_that_hardly_bends_is_not_fitted_half_a_turn_off(project_root: Path) -> None:
    thrown = moved(project_root, [0.0, 0.3, -0.5, -0.9, 0.1, 0.0])
    time_s, body_m, tip_m = captured(thrown)
    found = place_capture(thrown, time_s, body_m, tip_m, None, FILE)
    assert found.rms_m == pytest.approx(np.sqrt(3.0) * 3e-4, rel=0.15)
    np.testing.assert_allclose(found.turn, TURN.as_matrix(), atol=0.1)


def test_a_turn_that_does_not_move_the_string_does_not_count() -> None:
    about_z = np.zeros((6, 6))
    about_z[2, 2] = 1.0  # rad^2
    assert standard_error_m(np.array([[0.0, 0.0, 0.4], [0.0, 0.0, -0.2]]), about_z) == 0.0
    assert standard_error_m(np.array([[0.3, 0.0, 0.4], [0.0, np.nan, 0.0]]), about_z) == pytest.approx(0.3)
    about_z[3, 3] = 0.16  # m^2, along x
    assert standard_error_m(np.array([[0.3, 0.0, 0.4]]), about_z) == pytest.approx(0.5)
