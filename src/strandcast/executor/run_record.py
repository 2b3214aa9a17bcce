"""The record of a run: whether its log is complete, and how the joints followed."""

import numpy as np

from strandcast.errors import ABORTED, LOG_INCOMPLETE, STOPPED_BY_CONTROLLER
from strandcast.executor.drivers.protocol import Driver, Recording
from strandcast.executor.preflight import Preflight
from strandcast.executor.streaming.safety_monitor import GAP_TICKS
from strandcast.records.joint_log import Following, JointLog, LogTiming, Run, timing_of
from strandcast.records.record import finite

TAIL_S = 0.5  # the miss counts until 0.3 s after the motion
MAX_LAG_S = 0.15  # chosen; servo lags are 5 to 35 ms
LAG_STEP_S = 0.001
EXIT_CODES = {"aborted": ABORTED, "fault": STOPPED_BY_CONTROLLER, "incomplete": LOG_INCOMPLETE}


def run_record(preflight: Preflight, driver: Driver, recording: Recording, joints_sha256: str) -> Run:
    """Return run.json for a driver's recording; `complete` means played to its end and logged completely."""
    log, played = recording.log, recording.status == "ok"
    defects = log_defects(recording, driver.rate_hz)
    if (np.diff(log.time_s) > 0).any():
        timing = timing_of(log.time_s, driver.rate_hz)
    else:
        timing = LogTiming(nominal_rate_hz=driver.rate_hz, rate_hz=driver.rate_hz, gaps=[], duplicates=0)
    late = recording.jitter
    warnings = [] if played and not defects else [f"the log is incomplete: {defect}" for defect in defects]
    if timing.gaps or timing.duplicates:
        warnings.append(f"{len(timing.gaps)} gaps and {timing.duplicates} duplicates in the joint log")
    if late is not None and late.degraded:
        warnings.append(f"timing: degraded, {late.p99_ms:.2f} ms late at p99, {late.missed} missed")
    return Run(
        complete=played and not defects,
        status="incomplete" if played and defects else recording.status,
        reason=defects[0] if played and defects else recording.reason,
        joints_sha256=joints_sha256,
        rows=len(log.time_s),
        motion_sha256=preflight.motion.content_sha256(),
        arm_sha256=preflight.arm.sha256,
        driver=driver.name,
        controller=recording.controller,
        joint_names=log.joint_names,
        clock=recording.clock,
        motion_start_s=finite(recording.motion_start_s),
        motion_end_s=finite(recording.motion_end_s),
        sync_events=recording.sync_events,
        timing=timing,
        video=recording.video,
        warnings=warnings,
        time_scale=preflight.options.time_scale,
        lateness=late,
        following=following(recording) if played and not defects else None,
    )


def log_defects(recording: Recording, rate_hz: float) -> list[str]:
    """Return the defects of a log, which must reach from before the motion to 0.5 s after it."""
    time_s, start_s, end_s = recording.log.time_s, recording.motion_start_s, recording.motion_end_s
    if len(time_s) < 2:
        return ["it has no rows"]
    found = []
    if time_s[0] > start_s + 1e-6:
        found.append(f"it begins {1e3 * (time_s[0] - start_s):.0f} ms after the motion")
    if time_s[-1] < end_s + TAIL_S - 1e-6:
        found.append(f"it ends less than {TAIL_S} s after the motion")
    if not (np.isfinite(recording.log.q_rad).all() and np.isfinite(time_s).all()):
        found.append("it has missing times or joint positions")
    steps = np.where(time_s[1:] > start_s, np.diff(time_s), 0.0)
    if steps.max() > (GAP_TICKS + 0.5) / rate_hz:
        found.append(f"it has a gap of {1e3 * steps.max():.0f} ms")
    return found


def following(recording: Recording) -> Following | None:
    """Return each joint's lag behind its command and the remaining error; None if no command was logged."""
    log = recording.log
    if not np.isfinite(log.q_cmd_rad).any(axis=0).all():
        return None
    moving = (log.time_s >= recording.motion_start_s) & (log.time_s <= recording.motion_end_s)
    lags = np.arange(0.0, MAX_LAG_S, LAG_STEP_S)
    best, peak = [], []
    for j in range(len(log.joint_names)):
        errors = np.stack([_remaining_error(log, moving, j, lag) for lag in lags])
        k = int(np.argmin(np.square(errors).sum(axis=1)))
        best.append(round(float(lags[k]), 6))
        peak.append(round(float(np.abs(errors[k]).max()), 6))
    return Following(lag_s=best, peak_error_rad=peak)


def _remaining_error(log: JointLog, moving: np.ndarray, joint: int, lag_s: float) -> np.ndarray:
    known = np.isfinite(log.q_cmd_rad[:, joint])
    command = np.interp(log.time_s[moving] - lag_s, log.time_s[known], log.q_cmd_rad[known, joint])
    error = log.q_rad[moving, joint] - command
    return np.asarray(error - error.mean())
