"""A goal of ROS' control_msgs/FollowJointTrajectory, as `ros2 action send_goal` and rosbridge accept it.

It contains every joint of the arm, the held ones at their angles: the joint trajectory controller refuses a
subset of its joints. Every number has a decimal point (1.0e-05): the YAML 1.1 parser of ROS reads `1e-05` as
a string.
"""

import json
from typing import Any

import numpy as np

from strandcast.executor.handover.handover import Handover
from strandcast.executor.move_to_start import SPEED_RAD_S
from strandcast.executor.preflight import times_ns

LAGS = 2.0  # chosen: allowed lag along the path, in nominal lags of the arm
SLACK_RAD = 0.05  # chosen
SETTLE_NS = 500_000_000
QUINTIC_PEAK = 1.875  # largest over mean speed of the quintic from rest to rest


def throw_goal(handover: Handover, ros1: bool = False) -> str:
    """Return the motion as a goal: positions, velocities, accelerations at every point, times in nanoseconds.

    The path tolerance of a moving joint is 0.05 rad and twice its way in the nominal servo's lag at its
    largest speed; of a held joint 0.05 rad. The goal tolerance is the arm's start tolerance, to be reached
    within 0.5 s after the end. Speeds and accelerations have none (0): the controller's own apply.
    """
    arm, joints = handover.arm, handover.joints
    planned = handover.motion.trajectory()
    # Exactly at rest: the controller refuses an end speed of even 1e-7 rad/s.
    qd, qdd = planned.qd_rad_s.copy(), planned.qdd_rad_s2.copy()
    qd[[0, -1]], qdd[[0, -1]] = 0.0, 0.0
    rows = zip(joints.all_angles(planned.q_rad), joints.all_rates(qd), joints.all_rates(qdd), strict=True)
    stamps = times_ns(handover.motion).tolist()
    points = [_point(row, ns, ros1) for row, ns in zip(rows, stamps, strict=True)]
    path = np.full(len(joints.names), SLACK_RAD)
    path[joints.moving_index] += LAGS * arm.servo.lag_s * np.abs(planned.qd_rad_s).max(axis=0)
    return _goal(handover, points, path, ros1)


def start_goal(handover: Handover, ros1: bool = False) -> str:
    """Return a goal of one point that brings the arm to the motion's start.

    It takes as long as the farthest posture within the joints' ranges needs at 0.25 rad/s, so it is slower
    from a nearer one. Only the controller and the operator watch for obstacles; a joint that deviates
    by 0.05 rad ends the move.
    """
    model = handover.arm.model()
    start = handover.joints.all_angles(handover.motion.trajectory().q_rad[0])
    lower, upper = np.where(model.jnt_limited[:, None], model.jnt_range, start[:, None] + [-np.pi, np.pi]).T
    farthest = float(np.maximum(start - lower, upper - start).max())
    ns = int(np.ceil(QUINTIC_PEAK * farthest / SPEED_RAD_S)) * 10**9
    still = np.zeros(len(start))
    return _goal(handover, [_point((start, still, still), ns, ros1)], np.full(len(start), SLACK_RAD), ros1)


def _point(joints: tuple[np.ndarray, np.ndarray, np.ndarray], ns: int, ros1: bool) -> dict[str, Any]:
    keys = ("positions", "velocities", "accelerations")
    rows = {key: row.tolist() for key, row in zip(keys, joints, strict=True)}
    return rows | {"time_from_start": _duration(ns, ros1)}


def _duration(ns: int, ros1: bool) -> dict[str, int]:
    sec, nanosec = ("secs", "nsecs") if ros1 else ("sec", "nanosec")
    return {sec: ns // 10**9, nanosec: ns % 10**9}


def _goal(handover: Handover, points: list[dict[str, Any]], path: np.ndarray, ros1: bool) -> str:
    """Return the goal's text: JSON, which is also YAML, one point per line."""
    arm, joints = handover.arm, list(handover.arm.all_joints)
    near = np.full(len(joints), float(arm.start_tolerance_rad.min()))
    near[handover.joints.moving_index] = arm.start_tolerance_rad
    # A stamp of zero means "now". The controller ignores frame_id, which carries the motion's hash.
    header = {"stamp": _duration(0, ros1), "frame_id": f"strandcast:{handover.sha256}"}
    lines = ",\n".join(f"  {plain_text(point)}" for point in points)
    return (
        f'{{"trajectory": {{"header": {plain_text(header)},\n'
        f' "joint_names": {plain_text(joints)},\n'
        f' "points": [\n{lines}]}},\n'
        f' "path_tolerance": {plain_text(_tolerances(joints, path))},\n'
        f' "goal_tolerance": {plain_text(_tolerances(joints, near))},\n'
        f' "goal_time_tolerance": {plain_text(_duration(SETTLE_NS, ros1))}}}\n'
    )


def _tolerances(joints: list[str], position: np.ndarray) -> list[dict[str, Any]]:
    return [
        {"name": name, "position": round(float(value), 4), "velocity": 0.0, "acceleration": 0.0}
        for name, value in zip(joints, position, strict=True)
    ]


def plain_text(data: Any) -> str:
    """Return JSON on one line whose numbers YAML 1.1 reads as numbers."""
    if isinstance(data, dict):
        return "{" + ", ".join(f"{json.dumps(key)}: {plain_text(value)}" for key, value in data.items()) + "}"
    if isinstance(data, list):
        return "[" + ", ".join(map(plain_text, data)) + "]"
    if isinstance(data, float):
        mantissa, e, exponent = repr(data).partition("e")
        return mantissa + ("" if "." in mantissa else ".0") + e + exponent
    return json.dumps(data)
