"""A goal of ROS' control_msgs/FollowJointTrajectory, as `ros2 action send_goal` and rosbridge take it.

Every joint of the arm is in it, the held ones at their angles: the joint trajectory controller refuses a part
of its joints. Numbers have a decimal point even where Python's shortest form has none (1.0e-05): the YAML 1.1
that ROS reads takes `1e-05` for a word.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from strandcast.exports.handover import APPROACH_RAD_S, HandOver, times_ns

LAGS = 2.0  # how many of the arm's nominal lags a joint may trail on the way
SLACK_RAD = 0.05
SETTLE_NS = 500_000_000
QUINTIC_PEAK = 1.875  # largest over mean speed of the quintic from rest to rest


def throw_goal(handover: HandOver, ros1: bool = False) -> str:
    """Return the motion as a goal: positions, velocities, accelerations at every point, times in nanoseconds.

    The path tolerance of a moving joint is 0.05 rad and twice its way in the nominal servo's lag at its
    largest speed; of a held joint 0.05 rad. The goal tolerance is the arm's start tolerance, to be reached
    within 0.5 s after the end. Speeds and accelerations have none (0): the controller's own hold.
    """
    motion, arm = handover.motion, handover.arm
    q, qd, qdd = motion.joints()
    # Rest is rest: the controller refuses an end that still moves by 1e-7 rad/s.
    qd[[0, -1]], qdd[[0, -1]] = 0.0, 0.0
    rows = zip(_all(handover, q, held=True), _all(handover, qd), _all(handover, qdd), strict=True)
    stamps = times_ns(motion).tolist()
    points = [_point(joints, ns, ros1) for joints, ns in zip(rows, stamps, strict=True)]
    path = np.full(len(arm.all_joints), SLACK_RAD)
    path[_moving(handover)] += LAGS * arm.servo.lag_s * np.abs(motion.joints()[1]).max(axis=0)
    return _goal(handover, points, path, ros1)


def start_goal(handover: HandOver, ros1: bool = False) -> str:
    """Return a goal of one point that brings the arm to the motion's start.

    It takes as long as the farthest posture that the joints' ranges allow needs at 0.25 rad/s: from nearer by
    it is slower. Nothing but the controller and the operator looks out for obstacles on the way; a joint that
    is kept from following by 0.05 rad ends it.
    """
    model = handover.arm.model()
    start = _all(handover, handover.motion.joints()[0][:1], held=True)[0]
    lower, upper = np.where(model.jnt_limited[:, None], model.jnt_range, start[:, None] + [-np.pi, np.pi]).T
    farthest = float(np.maximum(start - lower, upper - start).max())
    ns = int(np.ceil(QUINTIC_PEAK * farthest / APPROACH_RAD_S)) * 10**9
    still = np.zeros(len(start))
    return _goal(handover, [_point((start, still, still), ns, ros1)], np.full(len(start), SLACK_RAD), ros1)


def _all(handover: HandOver, rows: np.ndarray, held: bool = False) -> np.ndarray:
    """Return (T, J) of the moving joints among all joints; the others at their angles, or at 0."""
    arm = handover.arm
    everyone = np.array([arm.held.get(name, 0.0) if held else 0.0 for name in arm.all_joints])
    answer = np.tile(everyone, (len(rows), 1))
    answer[:, _moving(handover)] = rows
    return answer


def _moving(handover: HandOver) -> list[int]:
    return [handover.arm.all_joints.index(name) for name in handover.motion.joint_names]


def _point(joints: tuple[np.ndarray, np.ndarray, np.ndarray], ns: int, ros1: bool) -> dict[str, Any]:
    keys = ("positions", "velocities", "accelerations")
    rows = {key: row.tolist() for key, row in zip(keys, joints, strict=True)}
    return rows | {"time_from_start": _duration(ns, ros1)}


def _duration(ns: int, ros1: bool) -> dict[str, int]:
    sec, nanosec = ("secs", "nsecs") if ros1 else ("sec", "nanosec")
    return {sec: ns // 10**9, nanosec: ns % 10**9}


def _goal(handover: HandOver, points: list[dict[str, Any]], path: np.ndarray, ros1: bool) -> str:
    """Return the goal's text: JSON, which is YAML too, one point a line."""
    arm = handover.arm
    joints = list(arm.all_joints)
    near = np.full(len(joints), float(arm.start_tolerance_rad.min()))
    near[_moving(handover)] = arm.start_tolerance_rad
    # A stamp of zero is "now". The controller does not look at frame_id: it carries the motion's hash along.
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
    """Return JSON on one line whose numbers are numbers to YAML 1.1 too."""
    if isinstance(data, dict):
        return "{" + ", ".join(f"{json.dumps(key)}: {plain_text(value)}" for key, value in data.items()) + "}"
    if isinstance(data, list):
        return "[" + ", ".join(map(plain_text, data)) + "]"
    if isinstance(data, float):
        mantissa, e, exponent = repr(data).partition("e")
        return mantissa + ("" if "." in mantissa else ".0") + e + exponent
    return json.dumps(data)
