"""A motion as a CSV table, for any controller that accepts one."""

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.executor.checks import CHECK_STEP_S
from strandcast.executor.handover.handover import Handover
from strandcast.executor.preflight import times_ns
from strandcast.records.motion import Motion, points_of

COARSE_RAD = 1e-3  # chosen


def table_text(handover: Handover, rate_hz: float | None = None) -> str:
    """Return the table: header lines with #, then time_s and q, qd, qdd of each joint.

    With `rate_hz`, the quintic through the points is sampled, the last row at the end, and rows too far apart
    to reproduce the motion are refused (SC-E004). By default the points themselves, with all digits.
    """
    motion = handover.motion
    if rate_hz is None:
        ns, played = times_ns(motion), motion.trajectory()
        rows = np.hstack([played.q_rad, played.qd_rad_s, played.qdd_rad_s2])
    else:
        command = handover.command(rate_hz)
        ns = np.rint(command.time_s * 1e9).astype(np.int64)
        rows = np.hstack([command.q_rad, command.qd_rad_s, command.qdd_rad_s2])
        _refuse_coarse(motion, ns, rows, rate_hz)
    kinds = (("q", "rad"), ("qd", "rad_s"), ("qdd", "rad_s2"))
    names = ["time_s", *(f"{kind}_{joint}_{unit}" for kind, unit in kinds for joint in motion.joint_names)]
    lines = [f"# {line}" for line in handover.about()] + [",".join(names)]
    for time_ns, row in zip(ns.tolist(), rows.tolist(), strict=True):
        lines.append(",".join([f"{time_ns // 10**9}.{time_ns % 10**9:09d}", *map(repr, row)]))
    return "\n".join(lines) + "\n"


def _refuse_coarse(motion: Motion, ns: np.ndarray, rows: np.ndarray, rate_hz: float) -> None:
    """Refuse rows so far apart that the quintic through them deviates from the checked motion."""
    through = motion.model_copy(update={"points": points_of(ns, *np.split(rows, 3, axis=1))})
    coarse, planned = (each.trajectory().resampled(CHECK_STEP_S) for each in (through, motion))
    off_rad = np.abs(coarse.q_rad - planned.q_rad).max()
    if off_rad > COARSE_RAD:
        raise StrandcastError(
            "SC-E004",
            f"at {rate_hz:g} rows per second the path is up to {off_rad:.2g} rad from the motion",
            field="rate",
            cost="the arm would not play the checked motion; nothing was written",
            fix="give more rows per second, or leave the rate out for the points as planned",
        )
