"""Logs and captures as measured: without whole turns that an angle jumped by, and without rows held over."""

from dataclasses import replace

import numpy as np

from strandcast.records.joint_log import JointLog
from strandcast.records.motion import Motion

TURN_RAD = 2.0 * np.pi
# Held values last the same number of rows each time, two or more; a slow joint's counts change at random.
FAST = 0.25  # of the largest change of a joint between two rows: smaller ones may be missing by chance
ALIKE = 0.9  # of the fast changes come after as many rows as usual, or one more or less: clocks that beat
FEWEST = 10


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
    usual, first = _held(np.where(np.isfinite(values), values, 0.0))
    if usual < 2.0:
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


def _held(q_rad: np.ndarray) -> tuple[float, np.ndarray]:
    """Return for how many rows values (T, J) are held, 1 if they are not, and the rows at which they come."""
    step = np.abs(np.diff(q_rad, axis=0)).max(axis=1, initial=0.0)
    new = np.concatenate([[0], 1 + np.flatnonzero(step)])
    rows = np.diff(new)
    fast = rows[step[new[1:] - 1] > FAST * step.max(initial=0.0)]
    alike = np.abs(fast - np.median(fast)) <= 1 if len(fast) >= FEWEST else np.zeros(0, bool)
    if not len(alike) or min(alike.mean(), (fast >= 2).mean()) < ALIKE:
        return 1.0, np.arange(len(q_rad))
    usual = float(fast[alike].mean())
    # At rest a value comes again without a change.
    again = np.maximum(np.round(np.append(rows, len(q_rad) - new[-1]) / usual), 1).astype(int)
    first = [at + np.round(usual * np.arange(times)) for at, times in zip(new, again, strict=True)]
    return usual, np.minimum(np.concatenate(first), len(q_rad) - 1).astype(int)
