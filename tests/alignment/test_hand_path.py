import dataclasses

import numpy as np

from strandcast.alignment.hand_path import hand_table
from strandcast.arm.kinematics import hand_pose
from strandcast.records.alignment import HAND, read_hand
from strandcast.records.tables import write_table
from strandcast.rig.model import (
    Detections,
    RigError,
    hand_poses,
    marker_jacobian,
    marker_poses,
    rig_of,
)
from strandcast_studies.evidence.clock_trials import Faults


def test_hand_poses_undo_marker_poses(arm):
    rig, draw = rig_of(arm), np.random.default_rng(2)
    q, marker = draw.uniform(-1, 1, (30, 3)), draw.integers(0, 2, 30)
    error = dataclasses.replace(
        RigError.none(rig),
        base_m=np.array([0.01, 0.02]),
        stretch=np.array([0.002, -0.001, 0.001]),
        shift_m=draw.normal(0, 0.004, (2, 2)),
        turn_rad=np.array([0.05, -0.03]),
    )
    detections = Detections(np.arange(30.0), marker, marker_poses(rig, q, marker, error), np.ones(30))
    expected = hand_pose(rig.chain, rig.clamp, q).array()
    np.testing.assert_allclose(hand_poses(rig, detections, error).array(), expected, atol=2e-5)


def test_a_joints_zero_counts_as_a_turn_of_the_joint(arm):
    rig, q = rig_of(arm), np.random.default_rng(3).uniform(-1, 1, (5, 3))
    zero, marker = np.array([0.01, -0.02, 0.03]), np.array([0, 1, 0, 1, 0])
    off = dataclasses.replace(RigError.none(rig), base_m=np.array([0.1, -0.2]), zero_rad=zero)
    moved = marker_poses(rig, q, marker, off).array()
    expected = marker_poses(rig, q + zero, marker, RigError.none(rig)).array()
    np.testing.assert_allclose(moved - expected, np.tile([0.1, -0.2, 0.0], (5, 1)), atol=1e-12)


def test_a_marker_is_where_the_arms_file_puts_it(arm):
    """planar3 stretched along x: the hand at 0.70 m, marker 40 a twentieth of a metre behind it."""
    rig = rig_of(arm)
    reach = float(np.sum(rig.chain.lengths_m))
    pose = marker_poses(rig, np.zeros((2, 3)), np.array([0, 1]), RigError.none(rig))
    np.testing.assert_allclose(
        pose.position_m - rig.chain.origin_m, [(reach - 0.05, 0.0), (reach - 0.115, 0.0)], atol=1e-9
    )


def test_the_jacobian_is_that_of_the_poses(arm):
    rig, draw = rig_of(arm), np.random.default_rng(4)
    q, marker = draw.uniform(-1, 1, (6, 3)), np.array([0, 1, 0, 1, 0, 1])
    size = len(RigError.none(rig).vector())
    at = RigError.from_vector(np.where(np.arange(size) < 5, 0.0, draw.normal(0, 1e-3, size)), rig)
    joint, error = marker_jacobian(rig, q, marker, at)
    small, before = 1e-6, marker_poses(rig, q, marker, at).array()
    for k in range(3):
        step = q.copy()
        step[:, k] += small
        numeric = (marker_poses(rig, step, marker, at).array() - before) / small
        np.testing.assert_allclose(joint[:, :, k], numeric, atol=1e-5)
    for k in range(size):
        step = at.vector()
        step[k] += small
        numeric = marker_poses(rig, q, marker, RigError.from_vector(step, rig)).array() - before
        np.testing.assert_allclose(error[:, :, k], numeric / small, atol=1e-5)


def test_the_path_in_the_video_lies_on_the_measured_one(throw, fit, arm, tmp_path):
    """Markers 3 mm off their places: the fit corrects them."""
    trial = throw(11, faults=Faults(glued_m=3e-3, misread=0.0, zero_rad=0.0, camera_m=0.0, lost=0.0))
    command = trial.log.q_rad.copy()
    command[:100] = np.nan
    log = dataclasses.replace(trial.log, q_cmd_rad=command)
    found = fit(trial, log=log)
    write_table(tmp_path / "hand.parquet", HAND, hand_table(found, trial.markers, log, arm))
    seen_s, seen = read_hand(tmp_path / "hand.parquet", "seen")
    measured_s, measured = read_hand(tmp_path / "hand.parquet", "measured")
    commanded_s, commanded = read_hand(tmp_path / "hand.parquet", "commanded")
    assert len(seen_s) == len(np.unique(trial.markers["camera_time_s"]))
    assert len(commanded_s) == len(measured_s) - 100
    seen, measured = seen.array(), measured.array()
    np.testing.assert_allclose(commanded.array(), measured[100:], atol=1e-12)
    inside = (seen_s > measured_s[0]) & (seen_s < measured_s[-1])
    for axis, allowed in ((0, 1.5e-3), (1, 1.5e-3), (2, 1.5e-2)):
        off = seen[inside, axis] - np.interp(seen_s[inside], measured_s, measured[:, axis])
        assert np.sqrt((off**2).mean()) < allowed
    assert np.abs(np.diff(seen[:, 2])).max() < 0.2  # unwrapped
