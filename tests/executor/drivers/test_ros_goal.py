"""The exported goal as a ROS message, sent through both wire formats, is still the motion."""

import json

import numpy as np
import pytest

from strandcast.arm.load import load_arm
from strandcast.executor.handover.export import ExportForm, export_motion
from strandcast.executor.handover.handover import prepare
from strandcast.executor.preflight import times_ns

from ..motions import swing

pytest.importorskip("rosbags", reason="rosbags is not installed: make test-drivers")

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

GOAL = "control_msgs/msg/FollowJointTrajectoryGoal"
# The goal's fields in ROS 1, in their order; ROS 2 adds empty lists for joints of several degrees of freedom.
ROS_1 = """\
trajectory_msgs/JointTrajectory trajectory
control_msgs/JointTolerance[] path_tolerance
control_msgs/JointTolerance[] goal_tolerance
builtin_interfaces/Duration goal_time_tolerance
"""
ROS_2 = """\
trajectory_msgs/JointTrajectory trajectory
trajectory_msgs/MultiDOFJointTrajectory multi_dof_trajectory
control_msgs/JointTolerance[] path_tolerance
control_msgs/JointComponentTolerance[] component_path_tolerance
control_msgs/JointTolerance[] goal_tolerance
control_msgs/JointComponentTolerance[] component_goal_tolerance
builtin_interfaces/Duration goal_time_tolerance
"""
TOLERANCE = "string name\nfloat64 position\nfloat64 velocity\nfloat64 acceleration\n"
COMPONENT = f"string joint_name\nuint16 component\n{TOLERANCE.split(chr(10), 1)[1]}"


def store_of(ros1):
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    types = get_types_from_msg(TOLERANCE, "control_msgs/msg/JointTolerance")
    types |= get_types_from_msg(COMPONENT, "control_msgs/msg/JointComponentTolerance")
    types |= get_types_from_msg(ROS_1 if ros1 else ROS_2, GOAL)
    store.register(types)
    return store


def filled(store, kind, data):
    """Return a message from plain data; a key that the type has not, or a value of another kind, fails."""
    fields = dict(store.get_msgdef(kind).fields)
    assert set(data) <= set(fields), kind
    return store.types[kind](**{name: value_of(store, *fields[name], data.get(name)) for name in fields})


def value_of(store, node, desc, data):
    if int(node) == 1:  # a base type
        name = desc[0]
        if data is None:
            return {"string": ""}.get(name, 0)
        assert isinstance(data, {"string": str, "float64": float}.get(name, int)), (name, data)
        return data
    if int(node) == 2:  # another message
        kind = {"time": "builtin_interfaces/msg/Time", "duration": "builtin_interfaces/msg/Duration"}.get(
            desc, desc
        )
        rename = {"secs": "sec", "nsecs": "nanosec"}
        return filled(store, kind, {rename.get(key, key): value for key, value in (data or {}).items()})
    (inner, inner_desc), _ = desc
    items = [value_of(store, inner, inner_desc, item) for item in data or []]
    return np.array(items, float) if int(inner) == 1 and inner_desc[0] == "float64" else items


@pytest.mark.parametrize("kind", ["ros", "ros1"])
def test_the_goal_survives_the_wire_bit_for_bit(tmp_path, project_root, kind):
    arm = load_arm(project_root / "config" / "arms" / "planar3.toml").planar()
    motion = swing(arm, np.array([0.4, -0.6, -0.3]), np.array([0.7, 0.9, 1e-5]), 0.5)
    motion.write(tmp_path / "motion.json")
    export_motion(prepare(tmp_path / "motion.json", arm, 0.3), ExportForm(kind), tmp_path / "goal.json")
    store = store_of(kind == "ros1")
    goal = filled(store, GOAL, json.loads((tmp_path / "goal.json").read_text()))
    if kind == "ros1":
        again = store.deserialize_ros1(store.serialize_ros1(goal, GOAL), GOAL)
    else:
        again = store.deserialize_cdr(store.serialize_cdr(goal, GOAL), GOAL)
    points = again.trajectory.points
    assert again.trajectory.joint_names == motion.joint_names
    assert [p.time_from_start.sec * 10**9 + p.time_from_start.nanosec for p in points] == times_ns(
        motion
    ).tolist()
    planned = motion.trajectory()
    q, qd, qdd = planned.q_rad, planned.qd_rad_s, planned.qdd_rad_s2
    np.testing.assert_array_equal([p.positions for p in points], q)
    np.testing.assert_array_equal([p.velocities for p in points], qd)
    np.testing.assert_array_equal([p.accelerations for p in points], qdd)
    assert again.trajectory.header.stamp.sec == again.trajectory.header.stamp.nanosec == 0
    assert again.trajectory.header.frame_id.endswith(motion.content_sha256())
    assert [t.name for t in again.path_tolerance] == motion.joint_names
    assert all(0.05 <= t.position < 0.5 for t in again.path_tolerance)
    assert (again.goal_time_tolerance.sec, again.goal_time_tolerance.nanosec) == (0, 500_000_000)
