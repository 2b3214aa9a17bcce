"""What a motion asks of the arm, against numbers that can be worked out by hand."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.limits import peaks, torques, violations
from strandcast.arm.load import Arm, Payload, load_arm


@pytest.fixture
def arm(project_root: Path) -> Arm:
    return load_arm(project_root / "config/arms/planar3.toml")


def still(arm: Arm, q: list[float], samples: int = 3) -> tuple[np.ndarray, ...]:
    rest = np.zeros((samples, 3))
    return np.arange(samples) * 0.002, rest + q, rest.copy(), rest.copy()


def test_holding_torque_is_weight_times_lever(arm: Arm) -> None:
    _, q, qd, qdd = still(arm, [0.0, 0.0, 0.0], 1)
    levers = [1.0 * 0.12 + 0.6 * 0.40 + 0.25 * 0.62, 0.6 * 0.10 + 0.25 * 0.32, 0.25 * 0.07]
    np.testing.assert_allclose(torques(arm, q, qd, qdd)[0], 9.81 * np.array(levers), rtol=1e-4)
    hanging = np.full((1, 3), [np.pi / 2, 0.0, 0.0])
    np.testing.assert_allclose(torques(arm, hanging, qd, qdd), 0.0, atol=1e-12)


def test_a_payload_weighs_on_every_joint(arm: Arm) -> None:
    _, q, qd, qdd = still(arm, [0.0, 0.0, 0.0], 1)
    burdened = dataclasses.replace(arm, payload=Payload(0.5, (0.02, 0.0, 0.0)))
    more = torques(burdened, q, qd, qdd) - torques(arm, q, qd, qdd)
    np.testing.assert_allclose(more[0], 0.5 * 9.81 * np.array([0.72, 0.42, 0.17]), rtol=1e-6)


def test_each_kind_is_found_with_joint_time_and_value(arm: Arm) -> None:
    time_s, q, qd, qdd = still(arm, [0.5, 0.0, 0.0], 5)
    assert violations(arm, time_s, q, qd, qdd) == []
    q[:, 1] = 2.39
    qd[3, 2] = -9.6
    qdd[2, 0] = 96.0
    found = {(v.joint, v.kind): v for v in violations(arm, time_s, q, qd, qdd)}
    assert found[("joint_2", "upper position")].limit == pytest.approx(2.38)
    assert found[("joint_3", "velocity")].value == pytest.approx(9.6)
    assert found[("joint_3", "velocity")].time_s == pytest.approx(0.006)
    assert found[("joint_1", "acceleration")].limit == pytest.approx(95.0)
    assert "joint_1: acceleration 96 rad/s² at 0.004 s, limit 95 rad/s²" in map(str, found.values())


def test_speed_is_also_taken_from_the_positions(arm: Arm) -> None:
    time_s, q, qd, qdd = still(arm, [0.5, 0.0, 0.0])
    q[1, 0] += 0.002 * 9.7
    kinds = {violation.kind for violation in violations(arm, time_s, q, qd, qdd)}
    assert kinds == {"velocity"}


def test_lower_position_is_told_as_the_angle(arm: Arm) -> None:
    (violation,) = violations(arm, *still(arm, [-0.34, 0.0, 0.0]))
    assert (violation.kind, violation.value, violation.limit) == (
        "lower position",
        -0.34,
        pytest.approx(-0.33),
    )


def test_torque_beyond_the_margin_is_refused(arm: Arm) -> None:
    time_s, q, qd, qdd = still(arm, [0.5, 0.0, 0.0])
    qdd[1] = [90.0, 90.0, 90.0]
    assert peaks(arm, time_s, q, qd, qdd)["torque_n_m"][0] > 30.0
    slack = {
        violation.joint
        for violation in violations(arm, time_s, q, qd, qdd * 3.0)
        if violation.kind == "torque"
    }
    assert "joint_1" in slack
