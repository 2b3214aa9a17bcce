"""A motion as a CSV table, for any controller that takes one."""

from __future__ import annotations

import numpy as np

from strandcast.exports.handover import HandOver, times_ns
from strandcast.player.checks import sample


def table_text(handover: HandOver, rate_hz: float | None = None) -> str:
    """Return the table: lines with # say what it is; then time_s, and q, qd, qdd of each joint.

    Parameters
    ----------
    rate_hz
        Rows per second, between the points by the quintic that controllers interpolate too; the last row is
        the end. By default the points themselves, every digit.
    """
    motion = handover.motion
    if rate_hz is None:
        ns, rows = times_ns(motion), np.hstack(motion.joints())
    else:
        command = sample(motion, 1.0 / rate_hz)
        ns = np.rint(command.time_s * 1e9).astype(np.int64)
        rows = np.hstack([command.q_rad, command.qd_rad_s, command.qdd_rad_s2])
    kinds = (("q", "rad"), ("qd", "rad_s"), ("qdd", "rad_s2"))
    names = ["time_s", *(f"{kind}_{joint}_{unit}" for kind, unit in kinds for joint in motion.joint_names)]
    lines = [f"# {line}" for line in handover.about()] + [",".join(names)]
    for time_ns, row in zip(ns.tolist(), rows.tolist(), strict=True):
        lines.append(",".join([f"{time_ns // 10**9}.{time_ns % 10**9:09d}", *map(repr, row)]))
    return "\n".join(lines) + "\n"
