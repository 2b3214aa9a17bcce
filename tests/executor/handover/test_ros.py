"""The goal, read back by the YAML and JSON readers that ROS' tools use, is the motion bit for bit."""

import json
import re

import numpy as np
import pytest
from ruamel.yaml import YAML

from strandcast.executor.handover.ros_goal import plain_text
from strandcast.executor.preflight import times_ns
from strandcast.records.motion import Motion

HELD = {"shoulder_pan_joint": 3.141592653589793, "wrist_2_joint": 1.5707963267948966, "wrist_3_joint": 0.0}


@pytest.fixture
def written(export):
    """Return what writes a goal and reads it as YAML 1.1 (ROS' tools do), which must be what JSON has."""

    def write(path, arm, kind, name, **options):
        text = export(path, arm, kind, name, **options).read_text()
        goal = yaml_1_1(text)
        assert goal == json.loads("".join(line for line in text.splitlines(True) if not line.startswith("#")))
        return goal

    return write


def yaml_1_1(text):
    reader = YAML(typ="safe", pure=True)
    reader.version = (1, 1)
    return reader.load(text)


def rows(goal, key):
    return np.array([point[key] for point in goal["trajectory"]["points"]])


@pytest.mark.parametrize("name", ["goal.yaml", "goal.json"])
def test_the_goal_is_the_motion_bit_for_bit(written, planar3, planar_file, name):
    motion = Motion.read(planar_file)
    goal = written(planar_file, planar3, "ros", name)
    trajectory = goal["trajectory"]
    assert trajectory["header"]["stamp"] == {"sec": 0, "nanosec": 0}
    assert trajectory["header"]["frame_id"] == f"strandcast:{motion.content_sha256()}"
    assert trajectory["joint_names"] == motion.joint_names
    stamps = [point["time_from_start"] for point in trajectory["points"]]
    assert all(type(part) is int for stamp in stamps for part in stamp.values())
    assert [s["sec"] * 10**9 + s["nanosec"] for s in stamps] == times_ns(motion).tolist()
    planned = motion.trajectory()
    q, qd, qdd = planned.q_rad, planned.qd_rad_s, planned.qdd_rad_s2
    np.testing.assert_array_equal(rows(goal, "positions"), q)
    np.testing.assert_array_equal(rows(goal, "velocities"), qd)
    np.testing.assert_array_equal(rows(goal, "accelerations"), qdd)


def test_all_joints_of_the_controller_are_in_the_goal(written, ur5e, ur_file):
    motion = Motion.read(ur_file)
    goal = written(ur_file, ur5e, "ros", "goal.yaml")
    names = goal["trajectory"]["joint_names"]
    assert names == [
        "shoulder_pan_joint",
        "shoulder_lift_joint",
        "elbow_joint",
        "wrist_1_joint",
        "wrist_2_joint",
        "wrist_3_joint",
    ]
    at = [names.index(joint) for joint in motion.joint_names]
    np.testing.assert_array_equal(rows(goal, "positions")[:, at], motion.trajectory().q_rad)
    np.testing.assert_array_equal(rows(goal, "accelerations")[:, at], motion.trajectory().qdd_rad_s2)
    for joint, angle in HELD.items():
        column = names.index(joint)
        assert (rows(goal, "positions")[:, column] == angle).all()
        assert (rows(goal, "velocities")[:, column] == 0).all()
    text = ur_file.with_name("goal.yaml").read_text()
    assert re.search(r"\.\d+e-\d", text)  # small numbers are there …
    assert not re.search(r"[ \[-]\d+e-\d", text)  # … none as a word of YAML 1.1


def test_tolerances_are_set_for_every_joint(written, ur5e, ur_file):
    motion = Motion.read(ur_file)
    goal = written(ur_file, ur5e, "ros", "goal.json")
    path = {t["name"]: t["position"] for t in goal["path_tolerance"]}
    assert list(path) == goal["trajectory"]["joint_names"]
    speed = np.abs(motion.trajectory().qd_rad_s).max(axis=0)
    assert path["shoulder_lift_joint"] == pytest.approx(
        0.05 + 2 * (0.004 + 2 * 0.9 / 60) * speed[0], abs=1e-4
    )
    assert path["wrist_3_joint"] == 0.05
    assert [t["position"] for t in goal["goal_tolerance"]] == [0.01] * 6
    assert goal["goal_time_tolerance"] == {"sec": 0, "nanosec": 500_000_000}


def test_the_ends_are_at_rest_exactly(written, planar3, planar_file):
    motion = Motion.read(planar_file)
    motion.points[-1].velocities[1] = 5e-7  # the player lets this pass; ROS' controller does not
    motion.points[0].accelerations[0] = -5e-4
    motion.write(planar_file)
    goal = written(planar_file, planar3, "ros", "goal.json")
    for end in (0, -1):
        assert rows(goal, "velocities")[end].tolist() == [0, 0, 0]
        assert rows(goal, "accelerations")[end].tolist() == [0, 0, 0]
    assert goal["trajectory"]["points"][1]["accelerations"] == motion.points[1].accelerations


def test_ros_1_has_its_own_names_for_seconds(written, planar3, planar_file):
    goal = written(planar_file, planar3, "ros1", "goal.json", time_scale=4.0)
    assert goal["trajectory"]["points"][-1]["time_from_start"] == {"secs": 2, "nsecs": 44_000_000}
    assert goal["trajectory"]["header"]["stamp"] == {"secs": 0, "nsecs": 0}


def test_the_move_to_the_start_is_slow_from_any_posture(written, ur5e, ur_file):
    goal = written(ur_file, ur5e, "ros-start", "start.yaml")
    (point,) = goal["trajectory"]["points"]
    assert point["positions"] == [HELD["shoulder_pan_joint"], -1.2, 1.0, -0.4, HELD["wrist_2_joint"], 0.0]
    assert point["velocities"] == [0.0] * 6
    lower, upper = ur5e.model().jnt_range.T
    way = np.maximum(np.array(point["positions"]) - lower, upper - np.array(point["positions"])).max()
    s = np.linspace(0, 1, 1001)
    quintic = np.gradient(s**3 * (10 - 15 * s + 6 * s**2), s).max()
    fastest = quintic * way / point["time_from_start"]["sec"]
    assert 0.23 < fastest <= 0.25


@pytest.mark.parametrize("value", [0.0, -0.0, 1e-5, -1.5e-300, 1e16, 0.1, 123456.789, 5e-324])
def test_numbers_survive_and_are_numbers_in_yaml(value):
    text = plain_text(value)
    assert "." in text
    for read in (json.loads(text), yaml_1_1(text)):
        assert isinstance(read, float)
        assert read == value
