"""The log during streaming: rows that are allocated before the motion begins."""

import numpy as np

from strandcast.records.joint_log import AFTER_DUPLICATE, JointLog


class LogBuffer:
    """Up to `capacity` cycles of J joints; the memory is touched once, to avoid page faults later."""

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
        """Number of free rows."""
        return len(self.host_ns) - self.count

    def command_of(self, elapsed_s: np.ndarray, reach: int) -> np.ndarray:
        """Return (J,) the commands at elapsed times (J,), from the last `reach` rows."""
        first = max(0, self.count - reach)
        times, commands = self.elapsed_s[first : self.count], self.q_cmd[first : self.count]
        return np.array([np.interp(t, times, commands[:, j]) for j, t in enumerate(elapsed_s)])

    def log(self, joint_names: list[str], every_cycle: bool) -> JointLog:
        """Return the joint log: one row per state reported by the controller, or per cycle."""
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
