"""The host's delays: in the streaming loop, and in a test beforehand."""

import numpy as np

from strandcast.executor.streaming.clock import Clock, HostClock
from strandcast.records.joint_log import StreamingJitter

# Chosen.
TIMING_TEST_S = 2.0
MAX_P99_SHARE = 0.25  # of the period
MAX_MISSED_SHARE = 0.001
DEGRADED_P99_MS = 0.25


def jitter_of(late_ns: np.ndarray, missed: int, scheduling: str) -> StreamingJitter:
    """Return the statistics of (K,) delays of set points [ns] and a number of missed ones."""
    p50, p99, worst = np.percentile(late_ns * 1e-6, [50, 99, 100]) if len(late_ns) else (0.0, 0.0, 0.0)
    degraded = p99 > DEGRADED_P99_MS or missed > MAX_MISSED_SHARE * len(late_ns)
    return StreamingJitter(
        cycles=len(late_ns),
        p50_ms=round(float(p50), 4),
        p99_ms=round(float(p99), 4),
        max_ms=round(float(worst), 4),
        missed=missed,
        scheduling=scheduling,
        degraded=bool(degraded),
    )


def measure_wakeups(rate_hz: float, duration_s: float, clock: Clock) -> tuple[np.ndarray, int, str]:
    """Wake up at `rate_hz` for a while; return (K,) delays [ns], the missed ticks and the scheduling."""
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


def check_timing(rate_hz: float, clock: Clock | None = None) -> tuple[StreamingJitter, str | None]:
    """Test the host's timing for two seconds; return it, and why it is insufficient, or None."""
    jitter = jitter_of(*measure_wakeups(rate_hz, TIMING_TEST_S, clock or HostClock()))
    allowed_ms, ticks = MAX_P99_SHARE * 1e3 / rate_hz, TIMING_TEST_S * rate_hz
    if jitter.p99_ms > allowed_ms:
        return jitter, f"p99 is {jitter.p99_ms:.2f} ms late, allowed {allowed_ms:.2f} ms"
    if jitter.missed > MAX_MISSED_SHARE * ticks:
        return jitter, f"{jitter.missed} of {ticks:.0f} set points were missed, allowed one in 1000"
    return jitter, None
