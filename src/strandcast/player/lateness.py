"""How late the host is: in the loop that played, and in a trial of it beforehand."""

from __future__ import annotations

import numpy as np

from strandcast.player.clock import Clock, HostClock
from strandcast.records.joint_log import Lateness

PREFLIGHT_S = 2.0
LATE_SHARE = 0.25  # of the period, which the 99th percentile must keep
MISSED_SHARE = 0.001
LAB_P99_MS = 0.25


def lateness_of(late_ns: np.ndarray, missed: int, scheduling: str) -> Lateness:
    """Return what (K,) delays of set points [ns] and a count of missed ones amount to."""
    p50, p99, worst = np.percentile(late_ns * 1e-6, [50, 99, 100]) if len(late_ns) else (0.0, 0.0, 0.0)
    degraded = p99 > LAB_P99_MS or missed > MISSED_SHARE * len(late_ns)
    return Lateness(
        cycles=len(late_ns),
        p50_ms=round(float(p50), 4),
        p99_ms=round(float(p99), 4),
        max_ms=round(float(worst), 4),
        missed=missed,
        scheduling=scheduling,
        degraded=bool(degraded),
    )


def keep_time(rate_hz: float, duration_s: float, clock: Clock) -> tuple[np.ndarray, int, str]:
    """Wake up at `rate_hz` for a while; return (K,) how late [ns], how many ticks were missed, scheduling."""
    period_ns = round(1e9 / rate_hz)
    count = max(1, round(duration_s * rate_hz))
    late_ns = np.zeros(count, np.int64)
    taken = tick = 0
    with clock.undisturbed() as scheduling:
        start_ns = clock.now_ns() + period_ns
        while tick < count:
            clock.sleep_until(start_ns + tick * period_ns)
            late_ns[taken] = clock.now_ns() - start_ns - tick * period_ns
            tick += 1 + int(late_ns[taken] // period_ns)
            taken += 1
    return late_ns[:taken], tick - taken, scheduling


def preflight(rate_hz: float, clock: Clock | None = None) -> tuple[Lateness, str | None]:
    """Try the host's timing for two seconds; return it, and why it does not do, or None."""
    late_ns, missed, scheduling = keep_time(rate_hz, PREFLIGHT_S, clock or HostClock())
    lateness = lateness_of(late_ns, missed, scheduling)
    allowed_ms = LATE_SHARE * 1e3 / rate_hz
    if lateness.p99_ms > allowed_ms:
        return lateness, f"one in a hundred is {lateness.p99_ms:.2f} ms late, allowed {allowed_ms:.2f} ms"
    if missed > MISSED_SHARE * PREFLIGHT_S * rate_hz:
        return lateness, f"{missed} of {PREFLIGHT_S * rate_hz:.0f} were missed, allowed one in 1000"
    return lateness, None
