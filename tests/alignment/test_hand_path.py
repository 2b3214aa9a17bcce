from __future__ import annotations

import dataclasses

import numpy as np

from strandcast.alignment.align import align
from strandcast.alignment.hand_path import hand_table
from strandcast.alignment.rig import Misfit, Seen, hand_poses, marker_poses, rig_of
from strandcast.arm.kinematics import hand_pose
from strandcast.records.alignment import HAND, read_hand
from strandcast.records.tables import write_table


def test_hand_poses_undo_marker_poses(arm):
    rig, draw = rig_of(arm), np.random.default_rng(2)
    q, marker = draw.uniform(-1, 1, (30, 3)), draw.integers(0, 2, 30)
    misfit = Misfit(np.array([0.004, -0.002]), 0.05, np.array([0.01, 0.02]), np.zeros(3))
    seen = Seen(np.arange(30.0), marker, marker_poses(rig, q, marker, misfit), np.ones(30))
    np.testing.assert_allclose(hand_poses(rig, seen, misfit), hand_pose(rig.chain, rig.clamp, q), atol=1e-12)


def test_a_joints_zero_counts_as_a_turn_of_the_joint(arm):
    rig, q = rig_of(arm), np.random.default_rng(3).uniform(-1, 1, (5, 3))
    zero, marker = np.array([0.01, -0.02, 0.03]), np.array([0, 1, 0, 1, 0])
    off = Misfit(np.zeros(2), 0.0, np.array([0.1, -0.2]), zero)
    exact = Misfit(np.zeros(2), 0.0, np.zeros(2), np.zeros(3))
    moved = marker_poses(rig, q, marker, off) - marker_poses(rig, q + zero, marker, exact)
    np.testing.assert_allclose(moved, np.tile([0.1, -0.2, 0.0], (5, 1)), atol=1e-12)


def test_a_marker_is_where_the_arms_file_puts_it(arm):
    """planar3 stretched along x: the hand at 0.70 m, marker 40 a twentieth of a metre behind it."""
    rig = rig_of(arm)
    nothing = Misfit(np.zeros(2), 0.0, np.zeros(2), np.zeros(3))
    reach = float(np.sum(rig.chain.lengths_m))
    pose = marker_poses(rig, np.zeros((2, 3)), np.array([0, 1]), nothing)
    np.testing.assert_allclose(
        pose[:, :2] - rig.chain.origin_m, [(reach - 0.05, 0.0), (reach - 0.115, 0.0)], atol=1e-9
    )


def test_seen_path_lies_on_the_measured_one(record, arm, tmp_path):
    recording = record(11, joint_noise_rad=0.0, joint_zero_rad=0.0, shift_m=2e-3)
    log = dataclasses.replace(recording.log, q_cmd_rad=recording.log.q_cmd_rad.copy())
    log.q_cmd_rad[:100] = np.nan
    found = align(recording.markers, log, arm, experiment="e", trial=1)
    write_table(tmp_path / "hand.parquet", HAND, hand_table(found, recording.markers, log, arm))
    seen_s, seen = read_hand(tmp_path / "hand.parquet", "seen")
    told_s, told = read_hand(tmp_path / "hand.parquet", "measured")
    commanded_s, commanded = read_hand(tmp_path / "hand.parquet", "commanded")
    assert len(seen_s) == 700
    assert len(commanded_s) == len(told_s) - 100
    np.testing.assert_allclose(commanded, told[100:], atol=1e-12)
    inside = (seen_s > told_s[0]) & (seen_s < told_s[-1])
    for axis, allowed in ((0, 1e-3), (1, 1e-3), (2, 1e-2)):
        off = seen[inside, axis] - np.interp(seen_s[inside], told_s, told[:, axis])
        assert np.sqrt((off**2).mean()) < allowed
    assert np.abs(np.diff(seen[:, 2])).max() < 0.2  # unwrapped
