"""Clock and place of a capture in space are found from a body that is tracked on the arm's hand."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strandcast.arm.spatial import hand_path, load_spatial_arm
from strandcast.errors import StrandcastError
from strandcast.imports.throw_in_space import ThrownBy, place_capture, placement_warnings

ARM = "src/strandcast_studies/benchmarks/space/arms/ur5e-space.toml"
START_S, END_S = 11.0, 11.8
TURN, SHIFT_M, OFFSET_S = Rotation.from_euler("xyz", [0.3, -0.2, 2.0]), np.array([0.4, -1.2, 0.3]), 7.3
BODY_M = [0.02, -0.04, 0.03]  # in the hand's axes
FILE = Path("capture.csv")


@pytest.fixture(scope="module")
def thrown(project_root: Path) -> ThrownBy:
    """Return a motion of all joints by 0.4 to 1 rad, from rest to rest, in a log of 500 Hz."""
    arm = load_spatial_arm(project_root / ARM)
    time_s = np.arange(10.5, 12.4, 0.002)
    share = np.clip((time_s - START_S) / (END_S - START_S), 0.0, 1.0)
    eased = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    q = [0.2, -1.2, 1.0, -0.5, 0.4, 0.1] + eased[:, None] * [0.9, -0.6, 0.8, 0.7, -1.0, 0.4]
    return ThrownBy(time_s, hand_path(arm.chain, q), (START_S, END_S))


def captured(thrown: ThrownBy, body_m: list[float] = BODY_M) -> tuple[np.ndarray, np.ndarray]:
    """Return times and places of the body in the capture, with 0.3 mm of noise and a gap."""
    time_s = np.arange(10.6, 12.3, 0.005)
    place_m, along, normal = np.hsplit(thrown.at(time_s), 3)
    body = place_m + np.stack([along, normal, np.cross(along, normal)], axis=2) @ np.array(body_m)
    body = TURN.inv().apply(body - SHIFT_M) + np.random.default_rng(5).normal(0.0, 3e-4, body.shape)
    body[40:44] = np.nan
    return time_s - OFFSET_S, body


def test_clock_and_place_are_found_wherever_arm_and_body_are(thrown: ThrownBy) -> None:
    found = place_capture(thrown, *captured(thrown), None, FILE)
    assert found.offset_s == pytest.approx(OFFSET_S, abs=2e-4)
    assert found.rms_m == pytest.approx(np.sqrt(3.0) * 3e-4, rel=0.15)
    assert placement_warnings(found) == []
    string_m = np.random.default_rng(6).uniform(-0.5, 1.0, (20, 3))
    np.testing.assert_allclose(found.placed(TURN.inv().apply(string_m - SHIFT_M)), string_m, atol=1e-3)
    alignment = found.alignment("cast", 1, 100, thrown.motion_s)
    assert alignment.robot_time_s(np.array([START_S - OFFSET_S]))[0] == pytest.approx(START_S, abs=2e-4)
    assert (alignment.motion_start_s, alignment.motion_end_s) == (START_S, END_S)


def test_a_given_offset_leaves_the_capture_in_the_arms_frame(thrown: ThrownBy) -> None:
    found = place_capture(thrown, captured(thrown)[0], None, OFFSET_S, FILE)
    np.testing.assert_array_equal(found.placed(np.ones((2, 3))), np.ones((2, 3)))
    assert (found.offset_s, found.offset_se_s, found.rms_m) == (OFFSET_S, None, None)


def test_a_body_that_is_loose_is_warned_of_and_one_elsewhere_refused(thrown: ThrownBy) -> None:
    time_s, body_m = captured(thrown)
    swings = np.sin(40.0 * time_s)[:, None] * [0.0, 0.0, 1.0]
    [warning] = placement_warnings(place_capture(thrown, time_s, body_m + 0.008 * swings, None, FILE))
    assert "mm rms from the arm's: the capture of another throw, a loose marker" in warning
    with pytest.raises(StrandcastError, match=r"SC-I054.*hand.*mm rms from the arm's, wherever"):
        place_capture(thrown, time_s, body_m + 0.08 * swings, None, FILE)


def test_what_leaves_clock_and_place_open_is_refused(thrown: ThrownBy) -> None:
    time_s, body_m = captured(thrown)
    with pytest.raises(StrandcastError, match=r"SC-I054.*neither a tracked hand nor"):
        place_capture(thrown, time_s, None, None, FILE)
    with pytest.raises(StrandcastError, match=r"SC-I054.*both are given"):
        place_capture(thrown, time_s, body_m, OFFSET_S, FILE)
    half = slice(0, 120)
    with pytest.raises(StrandcastError, match=r"SC-I054.*0.80 s.*not seen as long"):
        place_capture(thrown, time_s[half], body_m[half], None, FILE)
