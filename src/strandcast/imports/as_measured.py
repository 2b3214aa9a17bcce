"""Logs and captures as measured: without whole turns that an angle jumped by, and without rows held over."""

from dataclasses import replace

import numpy as np

from strandcast.records.joint_log import JointLog
from strandcast.records.motion import Motion

TURN_RAD = 2.0 * np.pi
FAST = 0.25  # of a large change of a joint between two rows: smaller ones may be missing by chance
LARGE = 10  # the tenth largest: a spike or a gap is no motion
COUNTS = 10  # of the smallest change: a slow joint's counts change at random
HELD = 0.1  # chosen: share of fast changes after a row that was held


def as_measured(log: JointLog, motion: Motion | None) -> tuple[JointLog, list[str]]:
    """Return a log without whole turns and held rows, and notes of both.

    `motion` says in which turn each joint is. A row counts as held where no joint changes as long as usual: a
    recorder that is faster than the controller repeats each value, the later the farther from its time.
    """
    log, notes = _in_one_turn(log, motion)
    first, held = not_held(log.time_s, log.q_rad, "joints")
    if not held:
        return log, notes
    names = ("time_s", "q_rad", "qd_rad_s", "q_cmd_rad", "qd_cmd_rad_s", "since_start_s", "flags")
    return replace(log, **{name: getattr(log, name)[first] for name in names}), notes + held


def not_held(time_s: np.ndarray, values: np.ndarray, what: str) -> tuple[np.ndarray, list[str]]:
    """Return the rows at which values (T, n) at times (T,) come, and a note if others only repeat them."""
    usual, first = _held(values)
    if usual <= 1.0:
        return np.arange(len(values)), []
    rate_hz = 1.0 / float(np.median(np.diff(time_s)))
    return first, [
        f"the {what} change {rate_hz / usual:.4g} times per second, in {rate_hz:.4g} rows: each value is "
        f"taken at its first row, and {len(values) - len(first)} rows that repeat it are left out"
    ]


def _in_one_turn(log: JointLog, motion: Motion | None) -> tuple[JointLog, list[str]]:
    """Return the log with angles that do not jump, in the turn of the motion, or of their commands."""
    log = replace(log, q_rad=log.q_rad.copy(), q_cmd_rad=log.q_cmd_rad.copy())
    moved = np.zeros(len(log.joint_names), bool)
    for k, joint in enumerate(log.joint_names):
        level = None
        if motion is not None and joint in motion.joint_names:
            level = motion.trajectory().q_rad[:, motion.joint_names.index(joint)].mean()
        for angles in (log.q_cmd_rad, log.q_rad):
            known = np.isfinite(angles[:, k])
            if not known.any():
                continue
            path = np.unwrap(angles[known, k])
            if level is not None:
                path += TURN_RAD * np.round((level - np.median(path)) / TURN_RAD)
            level = np.median(path)
            # Rounding must not change the angles of other joints.
            shift = np.round((path - angles[known, k]) / TURN_RAD)
            moved[k] |= shift.any()
            angles[known, k] += TURN_RAD * shift
    if not moved.any():
        return log, []
    joints = ", ".join(name for name, any_moved in zip(log.joint_names, moved, strict=True) if any_moved)
    return log, [f"whole turns (2π) were added to {joints}: the same posture"]


def _held(values: np.ndarray) -> tuple[float, np.ndarray]:
    """Return for how many rows values (T, n) are held, 1 if they are not, and the rows at which they come."""
    every = 1.0, np.arange(len(values))
    steps = np.abs(np.diff(values, axis=0))
    at_gap = np.diff(np.isnan(values), axis=0).any(axis=1)
    steps[np.isnan(steps)] = 0.0
    smallest = np.where(steps > 0.0, steps, np.inf).min(axis=0, initial=np.inf)
    step, counts = steps.max(axis=1, initial=0.0), (steps / smallest).max(axis=1, initial=0.0)
    new = np.concatenate([[0], 1 + np.flatnonzero((step > 0.0) | at_gap)])
    if len(new) <= LARGE:
        return every
    rows, large = np.diff(new), np.sort(step)[-LARGE]
    fast = rows[((step > FAST * large) & (counts > COUNTS) & ~at_gap)[new[1:] - 1]]
    usually = fast[fast <= 2.0 * np.median(fast) + 1.0] if len(fast) >= LARGE else np.ones(1)
    if (usually > 1).mean() < HELD:
        return every
    usual = float(usually.mean())
    # At rest a value comes again without a change.
    again = np.maximum(np.round(np.append(rows, len(values) - new[-1]) / usual), 1).astype(int)
    first = [at + np.round(usual * np.arange(times)) for at, times in zip(new, again, strict=True)]
    return usual, np.minimum(np.concatenate(first), len(values) - 1).astype(int)
