from __future__ import annotations

import dataclasses

import numpy as np

from strandcast.alignment.hand_path import hand_table
from strandcast.alignment.rig import (
    Seen,
    hand_poses,
    marker_poses,
    marker_slopes,
    misfit_of,
    no_misfit,
    rig_of,
)
from strandcast.arm.kinematics import hand_pose
from strandcast.evidence.clock_trials import Faults
from strandcast.records.alignment import HAND, read_hand
from strandcast.records.tables import write_table


def test_hand_poses_undo_marker_poses(arm):
    rig, draw = rig_of(arm), np.random.default_rng(2)
    q, marker = draw.uniform(-1, 1, (30, 3)), draw.integers(0, 2, 30)
    misfit = dataclasses.replace(
        no_misfit(rig),
        base_m=np.array([0.01, 0.02]),
        stretch=np.array([0.002, -0.001, 0.001]),
        shift_m=draw.normal(0, 0.004, (2, 2)),
        turn_rad=np.array([0.05, -0.03]),
    )
    seen = Seen(np.arange(30.0), marker, marker_poses(rig, q, marker, misfit), np.ones(30))
    told = hand_pose(rig.chain, rig.clamp, q)
    np.testing.assert_allclose(hand_poses(rig, seen, misfit), told, atol=2e-5)


def test_a_joints_zero_counts_as_a_turn_of_the_joint(arm):
    rig, q = rig_of(arm), np.random.default_rng(3).uniform(-1, 1, (5, 3))
    zero, marker = np.array([0.01, -0.02, 0.03]), np.array([0, 1, 0, 1, 0])
    off = dataclasses.replace(no_misfit(rig), base_m=np.array([0.1, -0.2]), zero_rad=zero)
    moved = marker_poses(rig, q, marker, off) - marker_poses(rig, q + zero, marker, no_misfit(rig))
    np.testing.assert_allclose(moved, np.tile([0.1, -0.2, 0.0], (5, 1)), atol=1e-12)


def test_a_marker_is_where_the_arms_file_puts_it(arm):
    """planar3 stretched along x: the hand at 0.70 m, marker 40 a twentieth of a metre behind it."""
    rig = rig_of(arm)
    reach = float(np.sum(rig.chain.lengths_m))
    pose = marker_poses(rig, np.zeros((2, 3)), np.array([0, 1]), no_misfit(rig))
    np.testing.assert_allclose(
        pose[:, :2] - rig.chain.origin_m, [(reach - 0.05, 0.0), (reach - 0.115, 0.0)], atol=1e-9
    )


def test_slopes_are_those_of_the_poses(arm):
    rig, draw = rig_of(arm), np.random.default_rng(4)
    q, marker = draw.uniform(-1, 1, (6, 3)), np.array([0, 1, 0, 1, 0, 1])
    size = len(no_misfit(rig).vector())
    at = misfit_of(np.where(np.arange(size) < 5, 0.0, draw.normal(0, 1e-3, size)), rig)
    joint, misfit = marker_slopes(rig, q, marker, at)
    small = 1e-6
    for k in range(3):
        step = q.copy()
        step[:, k] += small
        numeric = (marker_poses(rig, step, marker, at) - marker_poses(rig, q, marker, at)) / small
        np.testing.assert_allclose(joint[:, :, k], numeric, atol=1e-5)
    for k in range(size):
        step = at.vector()
        step[k] += small
        numeric = marker_poses(rig, q, marker, misfit_of(step, rig)) - marker_poses(rig, q, marker, at)
        np.testing.assert_allclose(misfit[:, :, k], numeric / small, atol=1e-5)


def test_seen_path_lies_on_the_measured_one(throw, fit, arm, tmp_path):
    """Markers 3 mm off their places: taken off again."""
    trial = throw(11, faults=Faults(glued_m=3e-3, misread=0.0, zero_rad=0.0, camera_m=0.0, lost=0.0))
    command = trial.log.q_rad.copy()
    command[:100] = np.nan
    log = dataclasses.replace(trial.log, q_cmd_rad=command)
    found = fit(trial, log=log)
    write_table(tmp_path / "hand.parquet", HAND, hand_table(found, trial.markers, log, arm))
    seen_s, seen = read_hand(tmp_path / "hand.parquet", "seen")
    told_s, told = read_hand(tmp_path / "hand.parquet", "measured")
    commanded_s, commanded = read_hand(tmp_path / "hand.parquet", "commanded")
    assert len(seen_s) == len(np.unique(trial.markers["camera_time_s"]))
    assert len(commanded_s) == len(told_s) - 100
    np.testing.assert_allclose(commanded, told[100:], atol=1e-12)
    inside = (seen_s > told_s[0]) & (seen_s < told_s[-1])
    for axis, allowed in ((0, 1.5e-3), (1, 1.5e-3), (2, 1.5e-2)):
        off = seen[inside, axis] - np.interp(seen_s[inside], told_s, told[:, axis])
        assert np.sqrt((off**2).mean()) < allowed
    assert np.abs(np.diff(seen[:, 2])).max() < 0.2  # unwrapped
