"""What became of a run: is its log whole, how did the joints follow, what run.json says."""

from __future__ import annotations

import numpy as np

from strandcast.errors import ABORTED, LOG_INCOMPLETE, STOPPED_BY_CONTROLLER
from strandcast.player.protocol import Driver, Recording
from strandcast.player.rehearsal import Rehearsal
from strandcast.player.watch import GAP_TICKS
from strandcast.records.joint_log import Following, JointLog, Run, Timing, timing_of

TAIL_S = 0.5
LONGEST_LAG_S = 0.15
LAG_STEP_S = 0.001
EXIT_CODES = {"aborted": ABORTED, "fault": STOPPED_BY_CONTROLLER, "incomplete": LOG_INCOMPLETE}


def run_of(rehearsal: Rehearsal, driver: Driver, recording: Recording, joints_sha256: str) -> Run:
    """Return run.json for what a driver brought back; `complete`: played to its end and logged whole."""
    log, played = recording.log, recording.status == "ok"
    missing = lacks(recording, driver.rate_hz)
    timing = (
        timing_of(log.time_s, driver.rate_hz)
        if (np.diff(log.time_s) > 0).any()
        else _no_timing(driver.rate_hz)
    )
    late = recording.lateness
    warnings = [] if played and not missing else [f"the log is not whole: {lack}" for lack in missing]
    if timing.gaps or timing.duplicates:
        warnings.append(f"{len(timing.gaps)} gaps and {timing.duplicates} duplicates in the joint log")
    if late is not None and late.degraded:
        warnings.append(f"timing: degraded, {late.p99_ms:.2f} ms late at p99, {late.missed} missed")
    return Run(
        complete=played and not missing,
        status="incomplete" if played and missing else recording.status,
        reason=missing[0] if played and missing else recording.reason,
        joints_sha256=joints_sha256,
        rows=len(log.time_s),
        motion_sha256=rehearsal.motion.content_sha256(),
        arm_sha256=rehearsal.arm.sha256,
        driver=driver.name,
        controller=recording.controller,
        joint_names=log.joint_names,
        clock=recording.clock,
        motion_start_s=_finite(recording.motion_start_s),
        motion_end_s=_finite(recording.motion_end_s),
        sync_events=recording.sync_events,
        timing=timing,
        video=recording.video,
        warnings=warnings,
        time_scale=rehearsal.terms.time_scale,
        lateness=late,
        following=following(recording) if played and not missing else None,
    )


def lacks(recording: Recording, rate_hz: float) -> list[str]:
    """Return what is missing in a log that should reach from before the motion to 0.5 s after it."""
    time_s, start_s, end_s = recording.log.time_s, recording.motion_start_s, recording.motion_end_s
    if len(time_s) < 2:
        return ["it has no rows"]
    found = []
    if time_s[0] > start_s + 1e-6:
        found.append(f"it begins {1e3 * (time_s[0] - start_s):.0f} ms after the motion did")
    if time_s[-1] < end_s + TAIL_S - 1e-6:
        found.append(f"it ends less than {TAIL_S} s after the motion")
    if not (np.isfinite(recording.log.q_rad).all() and np.isfinite(time_s).all()):
        found.append("times or joint positions are missing in it")
    steps = np.where(time_s[1:] > start_s, np.diff(time_s), 0.0)
    if steps.max() > (GAP_TICKS + 0.5) / rate_hz:
        found.append(f"it has a gap of {1e3 * steps.max():.0f} ms")
    return found


def following(recording: Recording) -> Following | None:
    """Return by how much each joint lagged behind its command, and what that leaves; None if not logged."""
    log = recording.log
    if not np.isfinite(log.q_cmd_rad).any(axis=0).all():
        return None
    moving = (log.time_s >= recording.motion_start_s) & (log.time_s <= recording.motion_end_s)
    lags = np.arange(0.0, LONGEST_LAG_S, LAG_STEP_S)
    best, peak = [], []
    for j in range(len(log.joint_names)):
        left = np.stack([_left(log, moving, j, lag) for lag in lags])
        k = int(np.argmin(np.square(left).sum(axis=1)))
        best.append(round(float(lags[k]), 6))
        peak.append(round(float(np.abs(left[k]).max()), 6))
    return Following(lag_s=best, peak_error_rad=peak)


def _left(log: JointLog, moving: np.ndarray, joint: int, lag_s: float) -> np.ndarray:
    known = np.isfinite(log.q_cmd_rad[:, joint])
    wanted = np.interp(log.time_s[moving] - lag_s, log.time_s[known], log.q_cmd_rad[known, joint])
    left = log.q_rad[moving, joint] - wanted
    return np.asarray(left - left.mean())


def _no_timing(rate_hz: float) -> Timing:
    return Timing(nominal_rate_hz=rate_hz, rate_hz=rate_hz, gaps=[], duplicates=0)


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
