"""A motion as a CSV table, for any controller that takes one."""

from __future__ import annotations

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.exports.handover import HandOver, times_ns
from strandcast.player.checks import CHECK_STEP_S, sample
from strandcast.records.motion import Motion, points_of

COARSE_RAD = 1e-3


def table_text(handover: HandOver, rate_hz: float | None = None) -> str:
    """Return the table: lines with # say what it is; then time_s, and q, qd, qdd of each joint.

    Parameters
    ----------
    rate_hz
        Rows per second, between the points by the quintic that controllers interpolate too; the last row is
        the end. By default the points themselves, every digit.

    Raises
    ------
    StrandcastError
        SC-E003: what goes through the rows is another motion.
    """
    motion = handover.motion
    if rate_hz is None:
        ns, rows = times_ns(motion), np.hstack(motion.joints())
    else:
        command = sample(motion, 1.0 / rate_hz)
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
    """Refuse rows so far apart that the quintic through them leaves the motion that was checked."""
    through = motion.model_copy(update={"points": points_of(ns, *np.split(rows, 3, axis=1))})
    off_rad = np.abs(sample(through, CHECK_STEP_S).q_rad - sample(motion, CHECK_STEP_S).q_rad).max()
    if off_rad > COARSE_RAD:
        raise StrandcastError(
            "SC-E003",
            f"at {rate_hz:g} rows per second the path is up to {off_rad:.2g} rad off the motion",
            field="rate",
            cost="what was checked is not what would be played: nothing was written",
            fix="more rows per second, or none given: the points as planned",
        )
