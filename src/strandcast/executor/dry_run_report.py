"""The dry run's report, which a person reads before a motion is played."""

import numpy as np

from strandcast.arm.limits import torque_gap
from strandcast.arm.load import Arm
from strandcast.arm.urdf import massless
from strandcast.executor.checks import box_words
from strandcast.executor.preflight import Preflight
from strandcast.executor.streaming.safety_monitor import GAP_TICKS
from strandcast.records.motion import WHOLE_ARM

PEAKS = (
    ("velocity_rad_s", "speed", "rad/s"),
    ("acceleration_rad_s2", "acceleration", "rad/s²"),
    ("jerk_rad_s3", "jerk", "rad/s³"),
    ("torque_n_m", "torque", "N m"),
)


def dry_run_report(preflight: Preflight) -> list[str]:
    """Return the report's lines: the motion's demands against the arm's limits, and where it goes."""
    arm, motion, reach, options = preflight.arm, preflight.motion, preflight.reach, preflight.options
    slower = "" if options.time_scale == 1.0 else f", {options.time_scale:g} times slower than planned"
    lines = [
        f"motion {preflight.short_hash} of {motion.experiment} trial {motion.trial} on {arm.name}: "
        f"{motion.trajectory().end_s:.3f} s{slower}"
    ]
    q = motion.trajectory().q_rad
    start = [*zip(arm.joints, q[0], strict=True), *arm.held.items()]
    lines.append(f"  from {', '.join(f'{name} {angle:.3f}' for name, angle in start)} rad")
    span = [f"{low:.2f} to {high:.2f}" for low, high in zip(q.min(axis=0), q.max(axis=0), strict=True)]
    limits = arm.limits
    room = [f"{low:.2f} to {high:.2f}" for low, high in zip(limits.lower_rad, limits.upper_rad, strict=True)]
    lines += [f"  {name} turns {a} rad, range {b}" for name, a, b in zip(arm.joints, span, room, strict=True)]
    for key, word, unit in PEAKS:
        most = getattr(limits, key)
        of = [_share(peak, limit) for peak, limit in zip(preflight.peaks[key], most, strict=True)]
        known = key != "torque_n_m" or not massless(arm.model(), arm.joints)
        lines.append(
            f"  peak {word} [{unit}] (share of the limit): {', '.join(of) if known else 'not known'}"
        )
    of_arm = zip(WHOLE_ARM.items(), preflight.peaks["whole_arm"], limits.whole_arm, strict=True)
    lines += [
        f"  peak {name} [{unit}] (share of the limit): {_share(peak, limit)}"
        for (name, unit), peak, limit in of_arm
    ]
    string = f"with {options.hanging_m:.2f} m of string" if options.hanging_m else "without a string"
    lines += [
        f"  hand: {box_words(reach.hand_m)}",
        f"  hand {string}, if stopped at any instant: "
        f"{box_words(reach.swept_m)}; workspace {box_words(arm.box_m)}",
        f"  a stop turns the joints further by up to {', '.join(f'{x:.2f}' for x in reach.stop_rad)} rad",
    ]
    return lines + _warnings(preflight)


def _share(peak: float, limit: float) -> str:
    """Return a peak and its share of the limit; NaN: not known."""
    if np.isnan(peak):
        return "not known"
    return f"{peak:.3g} ({100 * peak / limit:.0f} %)" if np.isfinite(limit) else f"{peak:.3g} (no limit)"


def _warnings(preflight: Preflight) -> list[str]:
    arm, reach, late = preflight.arm, preflight.reach, preflight.jitter
    lines = []
    if late is not None:
        lines.append(
            f"  host timing: {late.p50_ms:.2f} ms late (p50), {late.p99_ms:.2f} ms (p99), "
            f"{late.max_ms:.2f} ms (max), {late.missed} of {late.cycles + late.missed} set points missed; "
            f"{late.scheduling}; more than {GAP_TICKS} missed in a row would stop the arm"
        )
        if preflight.refused_live is not None:
            lines.append(
                f"warning: {preflight.refused_live.what}: a live run would be refused now "
                f"({preflight.refused_live.code}); {preflight.refused_live.fix}"
            )
        elif late.degraded:
            lines.append("warning: timing degraded; the run will be marked as such")
    lines += unchecked_limits(arm)
    if reach.beyond_rad.any():
        worst = int(np.argmax(reach.beyond_rad))
        lines.append(
            f"warning: if stopped at the worst instant, {arm.joints[worst]} would turn "
            f"{reach.beyond_rad[worst]:.2f} rad beyond its range (less margins)"
        )
    return lines


def unchecked_limits(arm: Arm) -> list[str]:
    """Return warnings about limits that are not checked because the arm's files do not give them."""
    lines = []
    gap = torque_gap(arm)
    if gap is not None:
        lines.append(f"warning: {gap}")
    if not arm.stop.distance_rad.any():
        lines.append(
            f"warning: the stopping distance of the controller is not known: {arm.path} has no "
            "stop.distance_rad; only the soft stop is considered"
        )
    return lines
