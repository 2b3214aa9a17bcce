"""The arm's file is compared with tracks and logs as they come: noisy rows, columns in any order."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import PlanarArm, load_arm
from strandcast.core.strings import CLAMP_OFFSET
from strandcast.records.joint_log import JointLog
from strandcast.stages.rig_offsets import rig_offsets_of

STEP_S = 0.002


@pytest.fixture(scope="module")
def arm(project_root: Path) -> PlanarArm:
    return load_arm(project_root / "config/arms/planar3.toml").planar()


def trial(arm: PlanarArm, number: int, longer_m: float, *, logged: bool = True) -> Any:
    """Return a trial of an arm with a longer link 2; the log has its columns reversed, and 0.3 mrad noise."""
    random = np.random.default_rng(number)
    time_s = np.arange(600) * STEP_S
    phase = 2.0 * np.pi * np.clip(time_s - 0.2, 0.0, 0.7) / 0.7
    q_rad = random.uniform([0.5, -1.0, -1.0], [2.0, 1.0, 1.0]) + random.uniform(0.5, 1.0, 3) * (
        1.0 - np.cos(phase[:, None] * random.uniform(0.7, 1.0, 3))
    )
    hand = hand_pose(arm.chain, arm.clamp, q_rad)
    link_rad = hand.angle_rad - q_rad[:, 2] * arm.chain.signs[2]
    hand_m = hand.position_m + longer_m * np.column_stack([np.cos(link_rad), np.sin(link_rad)])
    hand_m = hand_m + 1e-4 * random.standard_normal(hand_m.shape)
    hand_m[300:310] = np.nan  # not seen
    time_s[450] = time_s[449]  # a frame twice
    noisy = q_rad + 3e-4 * random.standard_normal(q_rad.shape)
    rows = np.append(np.arange(600), 599)  # the last one twice
    names, log_s, none = list(arm.joints[::-1]), np.arange(600)[rows] * STEP_S + 5.0, np.zeros((601, 3))
    log = JointLog(names, log_s, noisy[rows][:, ::-1], none, none, none, log_s, none[:, 0])
    return SimpleNamespace(
        number=number,
        frame_time_s=time_s + 5.0,
        track=SimpleNamespace(detected_m=lambda: np.stack([hand_m, hand_m], axis=1)),
        log=log if logged else None,
        summary=SimpleNamespace(
            choices={"lateral_offset_m": 1e-4 * number, "lateral_offset_sigma_m": 1e-4},
            length_m=0.3,
            points=10,
        ),
    )


def test_a_link_is_found_through_noisy_logs_with_columns_in_another_order(arm: PlanarArm) -> None:
    found = rig_offsets_of(arm, [trial(arm, k, 0.004) for k in (1, 2, 3)], [], None)
    assert found is not None
    assert found.trials == [1, 2, 3]
    assert [one.name for one in found.numbers if one.state == "wrong"] == ["link 2"]
    assert found.numbers[1].value is not None
    assert found.numbers[1].sd is not None
    assert abs(found.numbers[1].value - 0.004) < 3.0 * found.numbers[1].sd < 0.003
    assert found.numbers[-1].name == "string, across"
    (warning,) = found.warnings
    assert warning.startswith("link 2 is")


def test_an_arm_as_its_file_says_passes(arm: PlanarArm) -> None:
    found = rig_offsets_of(arm, [trial(arm, k, 0.0) for k in (1, 2, 3)], [], None)
    assert found is not None
    assert found.warnings == []
    assert found.right_probability > 0.7


def test_trials_without_a_log_or_a_tracked_hand_do_not_count(arm: PlanarArm) -> None:
    trials = [trial(arm, 1, 0.0), trial(arm, 2, 0.0, logged=False)]
    assert rig_offsets_of(arm, trials, [], None) is None
    unseen = trial(arm, 4, 0.0)
    unseen.track = SimpleNamespace(detected_m=lambda: np.full((600, 2, 2), np.nan))
    slow = trial(arm, 5, 0.0)
    slow.log.time_s, slow.log.q_rad = slow.log.time_s[::40], slow.log.q_rad[::40]
    assert rig_offsets_of(arm, [trials[0], unseen, slow], [], None) is None
    both = rig_offsets_of(arm, [*trials, trial(arm, 3, 0.0)], [], None)
    assert both is not None
    assert both.trials == [1, 3]


def test_a_fitted_turn_in_the_clamp_is_reported(arm: PlanarArm) -> None:
    uncertainty = SimpleNamespace(unknowns=["k_s", CLAMP_OFFSET], marginal_sd=[0.1, 0.01])
    fitted: Any = SimpleNamespace(options={CLAMP_OFFSET: 0.30}, uncertainty=uncertainty)
    found = rig_offsets_of(arm, [trial(arm, k, 0.0) for k in (1, 2, 3)], [], fitted)
    assert found is not None
    direction = found.numbers[-1]
    assert (direction.name, direction.state) == ("string, direction", "wrong")
    assert "clamp.angle_rad in planar3.toml is 0.000" in direction.fix
    fitted.options = {}
    unfitted = rig_offsets_of(arm, [trial(arm, k, 0.0) for k in (1, 2, 3)], [], fitted)
    assert unfitted is not None
    assert unfitted.numbers[-1].name == "string, across"
