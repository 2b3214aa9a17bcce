"""The start of a played motion is found on the log's clock, from commands or from the joints alone."""

from dataclasses import fields, replace

import numpy as np
import pytest

from strandcast.arm.load import load_arm
from strandcast.arm.servo import respond
from strandcast.errors import StrandcastError
from strandcast.imports.motion_start import motion_times
from strandcast.records.joint_log import JointLog
from strandcast.records.motion import Motion, Robot, StartPosture, points_of

START_S = 3.217
NAMES = ["joint_1", "joint_2", "joint_3"]


@pytest.fixture(scope="module")
def arm(project_root):
    return load_arm(project_root / "config" / "arms" / "planar3.toml").planar()


def swing(arm, travel=(0.7, 0.9, 0.8)) -> Motion:
    time_s = np.arange(201) * 0.002
    share = (time_s / 0.4)[:, None]
    q = np.array([0.3, -0.6, -0.5]) + np.array(travel) * share**3 * (10 - 15 * share + 6 * share**2)
    qd = np.gradient(q, time_s, axis=0)
    return Motion(
        experiment="e",
        trial=1,
        target_m=[0.5, 0.5],
        robot=Robot(name=arm.name, file_sha256=arm.sha256, urdf_sha256=arm.urdf_sha256),
        joint_names=NAMES,
        start=StartPosture(positions_rad=q[0].tolist(), tolerance_rad=[0.01] * 3),
        bezier=None,
        points=points_of(np.round(time_s * 1e9).astype(int), q, qd, np.gradient(qd, time_s, axis=0)),
        predicted=None,
        provenance=None,
    )


def log_of(arm, motion: Motion, commanded: bool) -> JointLog:
    """Return a log with a slow approach before the throw, as a real one has."""
    time_s = np.arange(2500) * 0.002 + 0.0007
    planned = motion.trajectory()
    command = np.stack(
        [np.interp(time_s - START_S, planned.time_s, joint) for joint in planned.q_rad.T], axis=1
    )
    command -= 0.5 * np.clip(1.0 - time_s, 0.0, 1.0)[:, None]
    q = respond(arm.servo, time_s, command) + np.random.default_rng(0).normal(0.0, 5e-4, command.shape)
    nothing = np.full_like(q, np.nan)
    return JointLog(
        NAMES,
        time_s,
        q,
        nothing,
        command if commanded else nothing,
        nothing,
        np.full(2500, np.nan),
        np.zeros(2500, np.int32),
    )


@pytest.mark.parametrize("epoch_s", [0.0, 1.7e9])
@pytest.mark.parametrize("commanded", [True, False])
def test_the_start_is_found_after_an_approach(arm, commanded, epoch_s):
    motion = swing(arm)
    log = log_of(arm, motion, commanded)
    log.time_s += epoch_s  # a controller's clock since it was switched on, or ROS' since 1970
    start_s, end_s, warnings = motion_times(log, motion, arm)
    assert warnings == []
    assert start_s - epoch_s == pytest.approx(START_S, abs=5e-4)
    assert end_s - epoch_s == pytest.approx(START_S + 0.4, abs=5e-4)


def test_the_log_of_another_throw_is_refused(arm):
    motion = swing(arm)
    log = log_of(arm, motion, False)
    log.q_rad[:, 1] *= -1
    with pytest.raises(StrandcastError, match="SC-I031"):
        motion_times(log, motion, arm)


def lagging(log: JointLog) -> JointLog:
    """Return the log of joints that come later, by 12 to 30 ms, and rest up to 8 mrad off."""
    later = [
        np.interp(log.time_s - s, log.time_s, q)
        for s, q in zip((0.012, 0.02, 0.03), log.q_rad.T, strict=True)
    ]
    return replace(log, q_rad=np.column_stack(later) + np.array([0.003, -0.008, 0.005]))


@pytest.mark.parametrize("commanded", [True, False])
def test_the_log_of_a_similar_motion_of_the_experiment_is_refused(arm, commanded):
    planned, other = swing(arm), swing(arm, (0.75, 0.82, 0.85))
    alike = swing(arm, (0.7001, 0.9, 0.8))
    log = lagging(log_of(arm, other, commanded))
    if commanded:
        with pytest.raises(StrandcastError, match="SC-I031.*no lag of commands explains"):
            motion_times(log, planned, arm)
    else:
        assert motion_times(log, planned, arm)[0] == pytest.approx(START_S, abs=0.03)  # without a message
    with pytest.raises(StrandcastError, match=r"SC-I031.*of trial-02.*mrad rms from that") as caught:
        motion_times(log, planned, arm, "log.csv", {"trial-02": other, "trial-03": alike})
    assert (caught.value.file, caught.value.field) == ("log.csv", "motion.json")
    # The motion's own log is accepted, however the joints lag, and beside whatever it resembles.
    own = lagging(log_of(arm, planned, commanded))
    assert motion_times(own, planned, arm, None, {"trial-02": other, "trial-03": alike})


def test_commands_that_are_near_those_of_the_motion_are_warned_of(arm):
    """The controller filters them, or another motion of the same kind was played that is kept nowhere."""
    motion = swing(arm)
    _, _, warnings = motion_times(log_of(arm, swing(arm, (0.71, 0.9, 0.8)), True), motion, arm)
    assert [warning.split(" rms ")[1] for warning in warnings] == [
        "from motion.json: the controller changes its commands, or another motion was played"
    ]


@pytest.mark.parametrize("off_rad", [0.03, -0.05])
def test_constant_offsets_of_commands_are_named(arm, off_rad):
    """The controller has other zeros than the arm's file."""
    motion = swing(arm)
    log = log_of(arm, motion, True)
    log.q_cmd_rad[:, 1] += off_rad
    log.q_cmd_rad[:, 2] += 0.001
    with pytest.raises(
        StrandcastError, match=f"SC-I031.* joint_2 by {1e3 * off_rad:.1f} mrad\n.*\n.*the same zeros"
    ):
        motion_times(log, motion, arm)


def test_constant_offsets_of_measured_joints_are_warned_of_and_move_no_start(arm):
    motion = swing(arm)
    log = log_of(arm, motion, False)
    log.q_rad[:, 1] += 0.05
    start_s, _, (warning,) = motion_times(log, motion, arm)
    assert start_s == pytest.approx(START_S, abs=5e-4)
    assert "constant offsets, joint_2 by 50" in warning


@pytest.mark.parametrize("commanded", [True, False])
@pytest.mark.parametrize(("begins_s", "ends_s"), [(0.0, 0.28), (0.06, 5.0), (0.05, 0.35)])
def test_the_start_is_found_in_a_log_that_lacks_a_part_of_the_throw(arm, commanded, begins_s, ends_s):
    motion = swing(arm)
    log = log_of(arm, motion, commanded)
    first = 0.0 if begins_s == 0.0 else START_S + begins_s
    kept = (log.time_s >= first) & (log.time_s <= START_S + ends_s)
    part = JointLog(NAMES, *(getattr(log, column.name)[kept] for column in fields(JointLog)[1:8]))
    assert motion_times(part, motion, arm)[0] == pytest.approx(START_S, abs=0.03)
