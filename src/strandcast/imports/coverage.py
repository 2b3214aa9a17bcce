"""Coverage of the motion by an imported log: refusals and warnings about its times."""

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.joint_log import timing_of

# The same as for the player's own logs.
TAIL_S = 0.5
LONGEST_GAP = 6.5  # steps
# A hand that accelerates at 20 m/s² is up to 20 mm off a straight line across a gap of 90 ms (a·t²/8).
LONGEST_BRIDGED_S = 0.09


def timing_warnings(time_s: np.ndarray) -> list[str]:
    """Return warnings of gaps, doubled rows and uneven steps; run.json's timing has all of them."""
    timing = timing_of(time_s)
    warnings = []
    if timing.gaps:
        longest = max(timing.gaps, key=lambda gap: gap.duration_s)
        missing = sum(gap.missing for gap in timing.gaps)
        warnings.append(
            f"{len(timing.gaps)} gaps, {missing} samples missing; the longest is "
            f"{longest.duration_s * 1e3:.1f} ms, after {time_s[longest.index]:.3f} s"
        )
    if timing.duplicates:
        first = float(time_s[int(np.flatnonzero(np.diff(time_s) == 0)[0])])
        warnings.append(
            f"{timing.duplicates} rows repeat a time and were left out, the first at {first:.3f} s"
        )
    step_ms = np.diff(time_s) * 1e3
    if timing.uneven > 0.01 * len(step_ms):
        warnings.append(
            f"{timing.uneven} of {len(step_ms)} steps are not of the usual {1e3 / timing.rate_hz:.1f} ms "
            f"({step_ms.min():.1f} to {step_ms.max():.1f} ms): {1e3 / step_ms.mean():.1f} Hz on average"
        )
    return warnings


def check_coverage(time_s: np.ndarray, start_s: float, end_s: float, file: str) -> list[str]:
    """Return warnings where a log covers the motion less well than the player's logs must.

    Raises
    ------
    StrandcastError
        SC-I032 it misses more than a few cycles of the motion's beginning or end, or much within it.
    """
    steps = np.diff(time_s)
    longest_gap_s = LONGEST_GAP * np.median(steps)
    moving = (time_s[1:] > start_s) & (time_s[:-1] < end_s)
    missed_s = float(steps[moving & (steps > longest_gap_s)].max(initial=0.0))
    if missed_s > LONGEST_BRIDGED_S:
        raise StrandcastError(
            "SC-I032",
            f"the log misses {1e3 * missed_s:.0f} ms within the motion",
            file=file,
            cost="the hand's path is not known there: it may be off by more than 20 mm",
            fix="throw again, and find out why rows were lost: load of the computer, network",
        )
    early_s, late_s = time_s[0] - start_s, end_s - time_s[-1]
    missing = [
        f"{1e3 * missing_s:.0f} ms of the motion's {where}"
        for missing_s, where in ((early_s, "beginning"), (late_s, "end"))
        if missing_s > longest_gap_s
    ]
    if missing:
        raise StrandcastError(
            "SC-I032",
            f"the log misses {' and '.join(missing)}",
            file=file,
            cost="a trial needs the log of its whole throw: nothing was imported",
            fix=f"record from before the motion until {TAIL_S} s after it, and throw again",
        )
    warnings = []
    if early_s > 0.0:
        warnings.append(f"the log begins {1e3 * early_s:.0f} ms after the motion")
    if time_s[-1] < end_s + TAIL_S:
        warnings.append(
            f"the log ends {1e3 * (time_s[-1] - end_s):.0f} ms after the motion; the joints arrive late, and "
            f"the string keeps moving: record {TAIL_S} s more"
        )
    if missed_s:
        warnings.append(
            f"the log misses {1e3 * missed_s:.0f} ms of the motion itself: throw again if possible"
        )
    return warnings
