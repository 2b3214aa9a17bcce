"""The rows of a joint log as the alignment takes them: in order of time, each instant once, by name."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strandcast.alignment.joints import STIRRING
from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import Arm
from strandcast.errors import StrandcastError
from strandcast.records.joint_log import JointLog

MOST_OUT_OF_ORDER = 0.05  # of the rows
BLOCK_S = 0.016  # rows are judged by medians over so long
LONGEST_GAP_S = 0.010  # sightings within longer holes tell nothing
MOVES = 0.1  # of the greatest speed: above it, joints are in motion


@dataclass(frozen=True, eq=False)
class Rows:
    """time_s (T,), strictly rising; q_rad (T, J) of the moving joints; rows out of order and doubled."""

    time_s: np.ndarray
    q_rad: np.ndarray
    unsorted: int = 0
    doubled: int = 0

    def blocks(self) -> tuple[np.ndarray, np.ndarray]:
        """Return medians over blocks of some rows: times (B,), joints (B, J). Single wrong rows vanish."""
        step_s = max(float(np.median(np.diff(self.time_s))), 1e-6)
        rows = max(1, round(BLOCK_S / step_s))
        count = max(1, len(self.time_s) // rows)
        cut = slice(0, count * rows) if len(self.time_s) >= rows else slice(None)
        times = self.time_s[cut].reshape(count, -1)
        joints = self.q_rad[cut].reshape(count, -1, self.q_rad.shape[1])
        return np.median(times, axis=1), np.median(joints, axis=1)

    def covers(self, robot_s: np.ndarray) -> np.ndarray:
        """Tell which instants (m,) lie within the log, away from its ends and from its holes."""
        step_s = np.diff(self.time_s)
        usual = float(np.median(step_s))
        after = np.clip(np.searchsorted(self.time_s, robot_s), 1, len(self.time_s) - 1)
        inside = (robot_s > self.time_s[0] + 2 * usual) & (robot_s < self.time_s[-1] - 2 * usual)
        return np.asarray(inside & (step_s[after - 1] < max(4 * usual, LONGEST_GAP_S)))


def rows_of(log: JointLog, arm: Arm, file: str | None = None) -> Rows:
    """Return the rows of a log.

    Raises
    ------
    StrandcastError
        SC-A002 a joint of the arm is not in the log; SC-A021 its time stamps run back and forth.
    """
    missing = [name for name in arm.joints if name not in log.joint_names]
    if missing:
        raise StrandcastError(
            "SC-A002",
            f"the joint log has no {', '.join(missing)}; it has {', '.join(log.joint_names)}",
            file=file,
            fix="import the log with the arm's joint names",
        )
    columns = [log.joint_names.index(name) for name in arm.joints]
    unsorted = int((log.time_s < np.maximum.accumulate(log.time_s)).sum())
    if unsorted > MOST_OUT_OF_ORDER * len(log.time_s):
        raise StrandcastError(
            "SC-A021",
            f"{unsorted} of the log's {len(log.time_s)} time stamps run backwards",
            file=file,
            field="controller_time_s",
            cost="which row belongs to which instant is not known",
            fix="log the controller's own clock, and write the rows in its order",
        )
    time_s, first = np.unique(log.time_s, return_index=True)
    return Rows(time_s, log.q_rad[first][:, columns], unsorted, len(log.time_s) - len(time_s))


def motion_span(rows: Rows) -> tuple[float, float]:
    """Return when the joints begin and cease to move [s]: beyond 5 % of the greatest speed."""
    time_s, q = rows.blocks()
    if len(time_s) < 3 or not np.ptp(q, axis=0).any():
        return float(rows.time_s[0]), float(rows.time_s[-1])
    speed = np.abs(np.gradient(q, time_s, axis=0))
    places = np.flatnonzero((speed > STIRRING * speed.max()).any(axis=1))
    return float(time_s[places[0]]), float(time_s[places[-1]])


def hand_travel_m(rows: Rows, arm: Arm) -> float:
    """Return how far the hand comes in the log [m]."""
    hand = hand_pose(arm.chain, arm.clamp, rows.blocks()[1])[:, :2]
    return float(np.linalg.norm(np.ptp(hand, axis=0)))


def end_speeds(rows: Rows) -> tuple[float, float]:
    """Return how fast the joints still move where the log begins and ends, over their greatest speed."""
    time_s, q = rows.blocks()
    if len(time_s) < 4:
        return 0.0, 0.0
    speed = np.abs(np.diff(q, axis=0) / np.diff(time_s)[:, None]).max(axis=1)
    return float(speed[0] / speed.max()), float(speed[-1] / speed.max())
