"""The log while it is being taken: rows that are there before the motion begins."""

from __future__ import annotations

import numpy as np

from strandcast.records.joint_log import AFTER_DUPLICATE, LATE, SYNC_HIGH, JointLog


class Rows:
    """Up to `capacity` cycles of J joints; the memory is touched once, so that no page is missing later."""

    def __init__(self, capacity: int, joints: int) -> None:
        self.count = 0
        self.host_ns = np.zeros(capacity, np.int64)
        self.late_ns = np.zeros(capacity, np.int64)
        self.controller_s = np.zeros(capacity)
        self.elapsed_s = np.zeros(capacity)
        self.since_start_s = np.full(capacity, np.nan)
        self.q = np.zeros((capacity, joints))
        self.qd = np.zeros((capacity, joints))
        self.q_cmd = np.zeros((capacity, joints))
        self.qd_cmd = np.zeros((capacity, joints))
        self.flags = np.zeros(capacity, np.int32)
        for array in vars(self).values():
            if isinstance(array, np.ndarray):
                array[...] = array.copy()

    @property
    def left(self) -> int:
        """How many further rows have room."""
        return len(self.host_ns) - self.count

    def flag(self, late: bool, sync_high: bool) -> None:
        """Set the flags of the row that is being taken."""
        self.flags[self.count] = (LATE if late else 0) | (SYNC_HIGH if sync_high else 0)

    def command_of(self, elapsed_s: np.ndarray, reach: int) -> np.ndarray:
        """Return (J,) what was commanded at elapsed times (J,), from the last `reach` rows."""
        first = max(0, self.count - reach)
        times, commands = self.elapsed_s[first : self.count], self.q_cmd[first : self.count]
        return np.array([np.interp(t, times, commands[:, j]) for j, t in enumerate(elapsed_s)])

    def log(self, joint_names: list[str], every_cycle: bool) -> JointLog:
        """Return the joint log: one row for each state that the controller told, or for `every_cycle`."""
        taken = slice(0, self.count)
        time_s = self.controller_s[taken]
        keep = np.concatenate([[True], (np.diff(time_s) > 0) | every_cycle])[: self.count]
        flags = self.flags[taken].copy()
        dropped = np.flatnonzero(~keep)
        flags[np.minimum(dropped + 1, self.count - 1)] |= AFTER_DUPLICATE
        return JointLog(
            joint_names=list(joint_names),
            time_s=time_s[keep],
            q_rad=self.q[taken][keep],
            qd_rad_s=self.qd[taken][keep],
            q_cmd_rad=self.q_cmd[taken][keep],
            qd_cmd_rad_s=self.qd_cmd[taken][keep],
            since_start_s=self.since_start_s[taken][keep],
            flags=flags[keep],
            host_time_ns=self.host_ns[taken][keep],
        )
