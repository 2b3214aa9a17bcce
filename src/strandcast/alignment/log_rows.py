"""The rows of a joint log for the alignment: the arm's joints, in order of time, each instant once."""

from dataclasses import dataclass

import numpy as np

from strandcast.alignment.joints import STIRRING
from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import PlanarArm
from strandcast.errors import StrandcastError
from strandcast.records.joint_log import JointLog

# Chosen; not sensitive.
MOST_OUT_OF_ORDER = 0.05  # of the rows
BLOCK_S = 0.016  # length of the blocks over which medians are taken
LONGEST_GAP_S = 0.010  # detections within longer gaps of the log are not used
MOVES = 0.1  # of the greatest speed: above it, joints are in motion


@dataclass(frozen=True, eq=False)
class LogRows:
    """The rows of a log.

    Attributes
    ----------
    time_s
        (T,) strictly rising [s].
    q_rad
        (T, J) angles of the moving joints [rad].
    unsorted, doubled
        How many rows were out of order, and how many had the time of another.
    """

    time_s: np.ndarray
    q_rad: np.ndarray
    unsorted: int = 0
    doubled: int = 0

    def blocks(self) -> tuple[np.ndarray, np.ndarray]:
        """Return medians over blocks of rows: times (B,), joints (B, J). Single wrong rows have no effect."""
        step_s = max(float(np.median(np.diff(self.time_s))), 1e-6)
        rows = max(1, round(BLOCK_S / step_s))
        count = max(1, len(self.time_s) // rows)
        cut = slice(0, count * rows) if len(self.time_s) >= rows else slice(None)
        times = self.time_s[cut].reshape(count, -1)
        joints = self.q_rad[cut].reshape(count, -1, self.q_rad.shape[1])
        return np.median(times, axis=1), np.median(joints, axis=1)

    def covers(self, robot_s: np.ndarray) -> np.ndarray:
        """Return which instants (m,) lie within the log, away from its ends and from its gaps."""
        step_s = np.diff(self.time_s)
        usual = float(np.median(step_s))
        after = np.clip(np.searchsorted(self.time_s, robot_s), 1, len(self.time_s) - 1)
        inside = (robot_s > self.time_s[0] + 2 * usual) & (robot_s < self.time_s[-1] - 2 * usual)
        return np.asarray(inside & (step_s[after - 1] < max(4 * usual, LONGEST_GAP_S)))


def log_rows_of(log: JointLog, arm: PlanarArm, file: str | None = None) -> LogRows:
    """Return the rows of a log for the arm's moving joints.

    SC-A012: a joint of the arm is not in the log; SC-J001: its time stamps are not in order.
    """
    missing = [name for name in arm.joints if name not in log.joint_names]
    if missing:
        raise StrandcastError(
            "SC-A012",
            f"the joint log has no {', '.join(missing)}; it has {', '.join(log.joint_names)}",
            file=file,
        )
    unsorted = int((log.time_s < np.maximum.accumulate(log.time_s)).sum())
    if unsorted > MOST_OUT_OF_ORDER * len(log.time_s):
        raise StrandcastError(
            "SC-J001",
            f"{unsorted} of the log's {len(log.time_s)} time stamps run backwards",
            file=file,
            field="controller_time_s",
            cost="the time of each row is not known",
            fix="log the controller's own clock, and write the rows in the order of time",
        )
    time_s, q_rad = log.in_order(arm.joints)
    return LogRows(time_s, q_rad, unsorted, len(log.time_s) - len(time_s))


def motion_span(rows: LogRows) -> tuple[float, float]:
    """Return when the joints start and stop moving [s]: beyond 5 % of the greatest speed."""
    time_s, q = rows.blocks()
    if len(time_s) < 3 or not np.ptp(q, axis=0).any():
        return float(rows.time_s[0]), float(rows.time_s[-1])
    speed = np.abs(np.gradient(q, time_s, axis=0))
    places = np.flatnonzero((speed > STIRRING * speed.max()).any(axis=1))
    return float(time_s[places[0]]), float(time_s[places[-1]])


def hand_travel_m(rows: LogRows, arm: PlanarArm) -> float:
    """Return how far the hand moves in the log [m]."""
    hand = hand_pose(arm.chain, arm.clamp, rows.blocks()[1]).position_m
    return float(np.linalg.norm(np.ptp(hand, axis=0)))


def end_speeds(rows: LogRows) -> tuple[float, float]:
    """Return the joints' speed where the log begins and where it ends, over their greatest speed."""
    time_s, q = rows.blocks()
    if len(time_s) < 4:
        return 0.0, 0.0
    speed = np.abs(np.diff(q, axis=0) / np.diff(time_s)[:, None]).max(axis=1)
    return float(speed[0] / speed.max()), float(speed[-1] / speed.max())
