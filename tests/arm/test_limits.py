"""A motion's torques and limit violations, against numbers that can be computed by hand."""

import dataclasses
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest

from strandcast.arm.joint_limits import Stop
from strandcast.arm.limits import differences, peaks, torques, violations
from strandcast.arm.load import PlanarArm, load_arm
from strandcast.arm.settings import Payload
from strandcast.arm.stop import SoftStop, turned_in_stop
from strandcast.arm.urdf import posed
from strandcast.arm.whole_arm import whole_arm
from strandcast.core.trajectory import JointTrajectory
from strandcast.errors import StrandcastErrors
from strandcast.records.motion import WHOLE_ARM


@pytest.fixture
def arm(project_root: Path) -> PlanarArm:
    return load_arm(project_root / "config/arms/planar3.toml").planar()


def still(q: list[float], samples: int = 3) -> JointTrajectory:
    rest = np.zeros((samples, 3))
    return JointTrajectory(np.arange(samples) * 0.002, rest + q, rest.copy(), rest.copy())


def test_holding_torque_is_weight_times_lever(arm: PlanarArm) -> None:
    rest = np.zeros((1, 3))
    levers = [1.0 * 0.12 + 0.6 * 0.40 + 0.25 * 0.62, 0.6 * 0.10 + 0.25 * 0.32, 0.25 * 0.07]
    np.testing.assert_allclose(torques(arm, rest, rest, rest)[0], 9.81 * np.array(levers), rtol=1e-4)
    hanging = np.full((1, 3), [np.pi / 2, 0.0, 0.0])
    np.testing.assert_allclose(torques(arm, hanging, rest, rest), 0.0, atol=1e-12)


def test_a_payload_adds_torque_to_every_joint(arm: PlanarArm) -> None:
    rest = np.zeros((1, 3))
    with_payload = dataclasses.replace(arm, payload=Payload(mass_kg=0.5, centre_m=(0.02, 0.0, 0.0)))
    more = torques(with_payload, rest, rest, rest) - torques(arm, rest, rest, rest)
    np.testing.assert_allclose(more[0], 0.5 * 9.81 * np.array([0.72, 0.42, 0.17]), rtol=1e-6)


def test_each_kind_is_found_with_joint_time_and_value(arm: PlanarArm) -> None:
    assert violations(arm, still([0.5, 0.0, 0.0], 5)) == []
    motion = still([0.5, 0.0, 0.0], 5)
    motion.q_rad[:, 1] = 2.39
    motion.qd_rad_s[3, 2] = -9.6
    motion.qdd_rad_s2[2, 0] = 96.0
    found = {(v.joint, v.kind): v for v in violations(arm, motion)}
    assert found[("joint_2", "upper position")].limit == pytest.approx(2.38)
    assert found[("joint_3", "velocity")].value == pytest.approx(9.6)
    assert found[("joint_3", "velocity")].time_s == pytest.approx(0.006)
    assert found[("joint_1", "acceleration")].limit == pytest.approx(95.0)
    assert "joint_1: acceleration 96 rad/s² at 0.004 s, limit 95 rad/s²" in map(str, found.values())


def test_demands_are_also_computed_from_the_positions() -> None:
    motion = still([0.5, 0.0, 0.0])
    motion.q_rad[1:, 0] += 1e-4
    (_, speed), (when, acceleration), (_, jerk) = differences(motion)
    np.testing.assert_allclose(np.abs(speed).max(axis=0), [1e-4 / 2e-3, 0.0, 0.0])
    np.testing.assert_allclose(acceleration[np.argsort(when), 0], [0, 1e-4 / 2e-3**2, -1e-4 / 2e-3**2, 0, 0])
    np.testing.assert_allclose(np.abs(jerk).max(axis=0), [2e-4 / 2e-3**3, 0.0, 0.0])


def test_the_way_between_the_points_counts(arm: PlanarArm) -> None:
    motion = still([0.5, 0.0, 0.0])
    motion.qd_rad_s[1] = 0.1  # the arm turns there and back between three points that are the same
    assert {v.kind for v in violations(arm, motion)} == {"acceleration"}


def test_what_is_no_number_keeps_no_limit(arm: PlanarArm) -> None:
    unknown = dataclasses.replace(
        arm, limits=dataclasses.replace(arm.limits, velocity_rad_s=np.full(3, np.nan))
    )
    assert {v.kind for v in violations(unknown, still([0.5, 0.0, 0.0]))} == {"velocity"}


def test_a_lower_position_is_reported_as_the_angle(arm: PlanarArm) -> None:
    (violation,) = violations(arm, still([-0.34, 0.0, 0.0]))
    assert (violation.kind, violation.value, violation.limit) == (
        "lower position",
        -0.34,
        pytest.approx(-0.33),
    )


def test_torque_beyond_the_margin_is_refused(arm: PlanarArm) -> None:
    motion = still([0.5, 0.0, 0.0])
    motion.qdd_rad_s2[1] = 90.0
    assert peaks(arm, motion)["torque_n_m"][0] > 30.0
    motion.qdd_rad_s2[1] *= 3.0
    assert "joint_1" in {v.joint for v in violations(arm, motion) if v.kind == "torque"}


@pytest.mark.parametrize(
    ("name", "elbow"),
    [
        ("planar3", "joint_2"),
        ("ur5e-example", "elbow_joint"),
        ("ur5e-space", "elbow_joint"),
        ("fr3-space", "fr3_joint4"),
    ],
)
def test_flange_clamp_and_elbow_move_as_in_the_urdf(project_root: Path, name: str, elbow: str) -> None:
    arm = load_arm(project_root / f"config/arms/{name}.toml")
    model = arm.model()
    data = mujoco.MjData(model)
    q = 0.3 + np.outer(np.linspace(0.0, 0.2, 5), np.arange(1.0, len(arm.joints) + 1))
    places_m = arm.limited_places(q)
    for angles, found_m in zip(q, places_m, strict=True):
        data.qpos[:] = posed(arm.model(), arm.held | dict(zip(arm.joints, angles, strict=True))).qpos
        mujoco.mj_kinematics(model, data)
        true_m = np.array([data.body(arm.clamp.link).xpos, data.joint(elbow).xanchor])
        if arm.axes == 2:
            true_m = true_m @ arm.planar().plane.T
        np.testing.assert_allclose(found_m[[0, 2]], true_m, atol=1e-9)
    np.testing.assert_allclose(places_m[:, 1], arm.hand_m(q), atol=1e-12)


def limited(arm: PlanarArm, **limits: float) -> PlanarArm:
    """Return the arm with limits of `WHOLE_ARM`, by name with underscores."""
    values = [limits.get(name.replace(" ", "_"), np.inf) for name in WHOLE_ARM]
    return dataclasses.replace(arm, limits=dataclasses.replace(arm.limits, whole_arm=np.array(values)))


def test_a_limit_of_the_whole_arm_that_is_exceeded_is_a_violation(arm: PlanarArm) -> None:
    motion = still([0.5, 0.0, 0.0], 5)
    motion.q_rad[:, 0] += 2.0 * motion.time_s
    motion.qd_rad_s[:, 0] = 2.0
    tool_m_s = 2.0 * np.linalg.norm(arm.hand_m(motion.q_rad[0]) - arm.chain.origin_m)
    elbow_m_s = 2.0 * arm.chain.lengths_m[0]
    assert peaks(arm, motion)["whole_arm"][:3] == pytest.approx([tool_m_s, tool_m_s, elbow_m_s], rel=1e-4)
    assert whole_arm(arm, np.stack([motion.q_rad] * 2), motion.time_s).shape == (2, 4, 8)

    def of_arm(**limits: float) -> list[str]:
        return [str(one) for one in violations(limited(arm, **limits), motion) if one.joint == "arm"]

    assert of_arm() == []
    (found,) = of_arm(clamp_speed=1.0)
    assert found.startswith(f"arm: clamp speed {tool_m_s:.3g} m/s at ")
    assert found.endswith(" s, limit 1 m/s")
    (found,) = of_arm(elbow_speed=0.5, momentum=9.0)
    assert found.startswith("arm: elbow speed ")


@pytest.mark.parametrize("name", ["planar3", "ur5e-space", "fr3-space"])
def test_power_and_momentum_are_those_of_mujoco(project_root: Path, name: str) -> None:
    arm = load_arm(project_root / f"config/arms/{name}.toml")
    arm = dataclasses.replace(arm, payload=Payload(mass_kg=0.5, centre_m=(0.02, 0.01, 0.03)))
    time_s, phase = np.arange(40) * 1e-3, np.arange(1.0, len(arm.joints) + 1)
    middle = 0.5 * (
        arm.limits.lower_rad + arm.limits.upper_rad
    )  # beyond its range, MuJoCo pushes a joint back
    q = middle + 0.2 * np.sin(np.outer(9.0 * time_s, phase))
    found = whole_arm(arm, q, time_s)
    model = arm.model_with_payload()
    data = mujoco.MjData(model)
    at = [int(model.joint(joint).dofadr[0]) for joint in arm.joints]
    moving = model.body_rootid[model.body(arm.clamp.link).id]
    qd = np.diff(q, axis=0) / 1e-3
    qdd = np.gradient(qd, axis=0) / 1e-3
    for k in range(1, len(qd) - 1):
        data.qpos[:] = posed(
            arm.model(), arm.held | dict(zip(arm.joints, 0.5 * (q[k] + q[k + 1]), strict=True))
        ).qpos
        data.qvel[at], data.qacc[at] = qd[k], qdd[k]
        mujoco.mj_inverse(model, data)
        mujoco.mj_subtreeVel(model, data)
        momentum = np.linalg.norm(data.subtree_linvel[moving] * model.body_subtreemass[moving])
        power = abs(sum(data.qfrc_inverse[at] * qd[k]))
        assert found[k, 4] == pytest.approx(momentum, rel=1e-4)
        assert found[k, 3] == pytest.approx(power, rel=1e-4, abs=1e-3)


@pytest.mark.parametrize("name", ["planar3", "fr3-space"])
def test_dry_friction_costs_power_where_one_joint_brakes_another(
    project_root: Path, tmp_path: Path, name: str
) -> None:
    arms, dry_n_m, time_s = project_root / "config/arms", 3.0, np.arange(5) * 1e-3
    smooth = load_arm(arms / f"{name}.toml")
    shutil.copy(arms / f"{name}.toml", tmp_path / "arm.toml")
    urdf = (arms / f"{name}.urdf").read_text(encoding="utf-8")
    urdf = urdf.replace("<limit", f'<dynamics friction="{dry_n_m}"/><limit')
    (tmp_path / f"{name}.urdf").write_text(urdf, encoding="utf-8")
    turning_rad_s = np.resize([1.0, -2.0], len(smooth.joints))
    middle = 0.5 * (smooth.limits.lower_rad + smooth.limits.upper_rad)
    q = middle + np.outer(time_s, turning_rad_s)
    more_w = whole_arm(load_arm(tmp_path / "arm.toml"), q, time_s)[:, 3] - whole_arm(smooth, q, time_s)[:, 3]
    np.testing.assert_allclose(more_w, dry_n_m * np.abs(turning_rad_s).sum(), rtol=1e-6)


def test_a_stop_takes_the_longer_of_soft_stop_and_the_controllers_own(arm: PlanarArm) -> None:
    time_s = np.arange(5) * 1e-3
    q = np.array([0.3, 0.0, 0.0]) + np.outer(time_s, [3.0, 0.0, 0.0])
    radii_m = np.linalg.norm(arm.hand_m(q[0]) - arm.chain.origin_m), arm.chain.lengths_m[0]

    def stopped(distance_rad: float, seconds: float) -> np.ndarray:
        own = np.array([distance_rad, 0.0, 0.0]), np.array([seconds, 0.0, 0.0])
        stop = Stop(np.full(3, 30.0), np.full(3, 600.0), *own)
        return whole_arm(dataclasses.replace(arm, stop=stop), q, time_s)[2, 5:]

    # 3 rad/s ends in 3 / 30 + 30 / 600 s, on average at half of the speed.
    assert stopped(0.0, 0.0) == pytest.approx((0.15, 0.225 * radii_m[0], 0.225 * radii_m[1]), rel=2e-3)
    share = 3.0 / arm.limits.velocity_rad_s[0]
    slow = 0.5 * share, 0.9 * share * radii_m[0], 0.9 * share * radii_m[1]
    assert stopped(0.9, 0.5) == pytest.approx(slow, rel=2e-3)
    assert whole_arm(arm, np.repeat(q[:1], 5, axis=0), time_s).max() == 0.0


def test_the_bound_of_a_soft_stop_is_close_to_it(arm: PlanarArm) -> None:
    random = np.random.default_rng(4)
    qd, qdd = random.uniform(-5.0, 5.0, (200, 3)), random.uniform(-60.0, 60.0, (200, 3))
    qd[0] = 0.0
    stop = Stop(np.full(3, 90.0), np.full(3, 4000.0), np.zeros(3), np.zeros(3))
    turned, seconds = turned_in_stop(stop, arm.limits.velocity_rad_s, qd, qdd)
    soft = SoftStop(stop.acceleration_rad_s2, stop.jerk_rad_s3)
    true = soft.resting_place(np.zeros_like(qd), qd, qdd)
    onward = np.sign(true) == np.sign(turned)  # not where it swings back
    assert onward.mean() > 0.9
    assert (np.abs(turned) >= np.abs(true) - 1e-9)[onward].all()
    assert np.median(np.abs(turned) / np.abs(true)) < 1.2
    longest = np.array([soft.begin(np.zeros(3), *row) for row in zip(qd, qdd, strict=True)])
    assert np.median(seconds.max(axis=1) / longest) == pytest.approx(1.0, abs=0.1)


def test_the_limits_of_the_whole_arm_are_read_each_at_its_place(project_root: Path, tmp_path: Path) -> None:
    arms = project_root / "config/arms"
    text = (arms / "ur5e-space.toml").read_text(encoding="utf-8")
    given = ("tool_speed_m_s = 1", "elbow_speed_m_s = 2", "power_w = 3", "momentum_kg_m_s = 4")
    own = "\n".join(("[limits]", *given, "stopping_time_s = 5", "stopping_distance_m = 6"))
    (tmp_path / "arm.toml").write_text(text.replace("[limits]", own), encoding="utf-8")
    for name in ("ur5e-space", "ur5e-example"):
        shutil.copy(arms / f"{name}.urdf", tmp_path)
    arm = load_arm(tmp_path / "arm.toml")
    assert arm.limits.whole_arm / arm.limits.whole_arm[0] == pytest.approx([1, 1, 2, 3, 4, 5, 6, 6])
    massless = text.replace("ur5e-space.urdf", "ur5e-example.urdf").replace("[limits]", own)
    (tmp_path / "arm.toml").write_text(massless, encoding="utf-8")
    with pytest.raises(StrandcastErrors, match="limits.power_w: not known: the URDF gives no mass"):
        load_arm(tmp_path / "arm.toml")
