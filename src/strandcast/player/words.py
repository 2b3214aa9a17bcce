"""What a person is shown before a motion is played."""

from __future__ import annotations

import numpy as np

from strandcast.arm.load import Arm
from strandcast.arm.weight import torque_gap, weightless
from strandcast.player.rehearsal import Rehearsal
from strandcast.player.watch import GAP_TICKS

PEAKS = (
    ("velocity_rad_s", "speed", "rad/s"),
    ("acceleration_rad_s2", "acceleration", "rad/s²"),
    ("jerk_rad_s3", "jerk", "rad/s³"),
    ("torque_n_m", "torque", "N m"),
)


def lines_of(rehearsal: Rehearsal) -> list[str]:
    """Return what a motion asks of its arm against what the arm may give, and where it goes."""
    arm, motion, reach, terms = rehearsal.arm, rehearsal.motion, rehearsal.reach, rehearsal.terms
    slower = "" if terms.time_scale == 1.0 else f", {terms.time_scale:g} times slower than planned"
    lines = [
        f"motion {rehearsal.short_hash} of {motion.experiment} trial {motion.trial} on {arm.name}: "
        f"{motion.time_s()[-1]:.3f} s{slower}"
    ]
    q = motion.joints()[0]
    start = [*zip(arm.joints, q[0], strict=True), *arm.held.items()]
    lines.append(f"  from {', '.join(f'{name} {angle:.3f}' for name, angle in start)} rad")
    span = [f"{low:.2f} to {high:.2f}" for low, high in zip(q.min(axis=0), q.max(axis=0), strict=True)]
    limits = arm.limits
    room = [f"{low:.2f} to {high:.2f}" for low, high in zip(limits.lower_rad, limits.upper_rad, strict=True)]
    lines += [f"  {name} turns {a} rad, may {b}" for name, a, b in zip(arm.joints, span, room, strict=True)]
    for key, word, unit in PEAKS:
        most = getattr(limits, key)
        of = [_share(peak, limit) for peak, limit in zip(rehearsal.peaks[key], most, strict=True)]
        known = key != "torque_n_m" or not weightless(arm)
        lines.append(f"  peak {word} [{unit}], of the limit: {', '.join(of) if known else 'not known'}")
    lines += [
        f"  the hand goes {_box(reach.hand_m)}",
        f"  with {terms.hanging_m:.2f} m hanging from it, stopped at any instant: {_box(reach.swept_m)}; "
        f"workspace {_box(np.array([arm.workspace.x_m, arm.workspace.y_m]))}",
        f"  a stop turns the joints on by up to {', '.join(f'{x:.2f}' for x in reach.stop_rad)} rad",
    ]
    return lines + _warnings(rehearsal)


def _share(peak: float, limit: float) -> str:
    return f"{peak:.3g} ({100 * peak / limit:.0f} %)" if np.isfinite(limit) else f"{peak:.3g} (not limited)"


def _box(box: np.ndarray) -> str:
    (x_low, x_high), (y_low, y_high) = box
    return f"x {x_low:.2f} to {x_high:.2f}, y {y_low:.2f} to {y_high:.2f} m"


def _warnings(rehearsal: Rehearsal) -> list[str]:
    arm, reach, late = rehearsal.arm, rehearsal.reach, rehearsal.lateness
    lines = []
    if late is not None:
        lines.append(
            f"  host timing: late {late.p50_ms:.2f} ms (p50), {late.p99_ms:.2f} ms (p99), "
            f"{late.max_ms:.2f} ms at most, {late.missed} of {late.cycles + late.missed} set points missed; "
            f"{late.scheduling}; more than {GAP_TICKS} missed running would stop the arm"
        )
        if late.degraded:
            lines.append("warning: timing degraded; the run will be marked so")
    lines += unchecked(arm)
    if reach.beyond_rad.any():
        worst = int(np.argmax(reach.beyond_rad))
        lines.append(
            f"warning: stopped at the worst instant, {arm.joints[worst]} would turn "
            f"{reach.beyond_rad[worst]:.2f} rad past its range, margins taken off"
        )
    return lines


def unchecked(arm: Arm) -> list[str]:
    """Return warnings of what is not checked because the arm's files do not tell it."""
    lines = []
    gap = torque_gap(arm)
    if gap is not None:
        lines.append(f"warning: {gap}")
    if not arm.stop.distance_rad.any():
        lines.append(
            f"warning: how far the controller's own stop turns each joint is not known: {arm.path} says no "
            "stop.distance_rad; only the soft stop is reckoned with"
        )
    return lines
