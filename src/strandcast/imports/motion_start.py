"""Start of a played motion on the log's clock: its trajectory is matched with the logged joints."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy

from strandcast.arm.load import Arm
from strandcast.arm.servo import respond
from strandcast.core.interpolation import resampled
from strandcast.errors import StrandcastError
from strandcast.records.joint_log import JointLog
from strandcast.records.motion import Motion

# Chosen; not sensitive.
LARGEST_RMS_RAD = 0.1
LARGEST_LEFT_RAD = 0.01  # of commanded joints, unless a lag explains most of the rms
TAIL_S = 0.1  # the joints arrive after their command
# A log is another motion's if that one leaves less than this share of the rms; not below this rms.
CLEARLY_LESS, ALIKE_RAD = 0.5, 1e-3


class Match(NamedTuple):
    """Where a motion fits a log best: its start and end on the log's clock [s].

    `rms_rad` is how far the joints are off, `left_rad` without what a lag explains, of measured joints a lag
    and a constant offset of each; `is_whole` says whether the log has all of the motion. `offset_rad` (J,)
    are constant offsets of the joints, and `level_rad` is what these and a lag leave.
    """

    start_s: float
    end_s: float
    rms_rad: float
    left_rad: float
    is_whole: bool
    offset_rad: np.ndarray
    level_rad: float


def motion_times(
    log: JointLog,
    motion: Motion,
    arm: Arm,
    file: str | None = None,
    others: Mapping[str, Motion] | None = None,
) -> tuple[float, float, list[str]]:
    """Return the motion's start and end on the log's clock [s], and warnings.

    Commanded joints are compared with the trajectory itself; in a log without them, the measured joints are
    compared with the response of the arm's nominal servo to it. `others` are motions that may have been
    played instead, by the path of their files.

    Raises
    ------
    StrandcastError
        SC-I006 a joint of the motion is missing in the log; SC-I007 the motion's times do not rise; SC-I031
        no part of the log looks like the motion, or another motion fits the log clearly better.
    """
    missing = [name for name in motion.joint_names if name not in log.joint_names]
    if missing:
        raise StrandcastError(
            "SC-I006",
            f"the log has no {', '.join(missing)}, which motion.json moves",
            file=file,
            field="joints",
            fix="name the log's joints with --joint, from the base on",
        )
    _refuse_falling_times(motion, file)
    found = _match(log, motion, arm)
    if not found.rms_rad <= LARGEST_RMS_RAD:  # NaN too: numbers too large to compare
        raise _unlike(f"{found.rms_rad:.2f} rad off at best", found, motion, file)
    if found.left_rad > ALIKE_RAD:
        same = {path: each for path, each in (others or {}).items() if each.joint_names == motion.joint_names}
        matches = {path: _match(log, each, arm) for path, each in same.items()}
        left_rad = {path: match.left_rad for path, match in matches.items() if match.is_whole}
        _refuse_another_motion(found.left_rad, left_rad, file)
    if not _commanded(log, motion.joint_names).any():
        return _without_offsets(log, motion, arm, found)
    if found.left_rad <= ALIKE_RAD:
        return found.start_s, found.end_s, []
    if not _is_like(found):
        what = f"{found.left_rad:.3f} rad off, which no lag of commands explains"
        raise _unlike(what, found, motion, file)
    unlike = (
        f"the commanded joints stay {1e3 * found.left_rad:.1f} mrad rms from motion.json: the controller "
        "changes its commands, or another motion was played"
    )
    return found.start_s, found.end_s, [unlike]


def _unlike(what: str, found: Match, motion: Motion, file: str | None) -> StrandcastError:
    fix = (
        "put the motion that was played beside the raw files, and check the joints' order, units and zeros, "
        "and --rate"
    )
    if shifted := _shifted(found, motion):
        what += f", but for constant offsets they are the motion's: {shifted}"
        fix = (
            "give the arm's file and the controller the same zeros of the joints, and record the throw again"
        )
    return StrandcastError(
        "SC-I031",
        f"no part of the log looks like motion.json: the joints are {what}",
        file=file,
        cost="clock and fit would belong to another throw",
        fix=fix,
    )


def _shifted(found: Match, motion: Motion) -> str:
    """Return the constant offsets in words, if they explain by how much the joints are off."""
    if found.level_rad > LARGEST_LEFT_RAD:
        return ""
    pairs = zip(motion.joint_names, found.offset_rad, strict=True)
    large = [f"{name} by {1e3 * off:.1f} mrad" for name, off in pairs if abs(off) > LARGEST_LEFT_RAD]
    return ", ".join(large)


def _without_offsets(log: JointLog, motion: Motion, arm: Arm, found: Match) -> tuple[float, float, list[str]]:
    """Return start and end of a motion that measured joints follow but for constant offsets; a warning."""
    if not (shifted := _shifted(found, motion)):
        return found.start_s, found.end_s, []
    q_rad = log.q_rad.copy()
    q_rad[:, [log.joint_names.index(name) for name in motion.joint_names]] -= found.offset_rad
    again = _match(replace(log, q_rad=q_rad), motion, arm)
    warning = (
        f"the measured joints are the motion's but for constant offsets, {shifted}: the hand is placed by "
        "the log; compare the zeros of the joints in the arm's file and in the controller"
    )
    return again.start_s, again.end_s, [warning]


def played_plan(log: JointLog, beside: Motion | None, plans: Mapping[Path, Motion], arm: Arm) -> Path | None:
    """Return which of the motions planned for a throw was played, if the log's commands say so.

    None: the log has no commands; they are those of the motion `beside` it, or clearly those of no plan; or
    that motion is not among the plans, so that it must not be replaced.
    """
    hashes = {each.content_sha256() for each in plans.values()}
    if beside is not None and beside.content_sha256() not in hashes:
        return None
    moving = {path: each for path, each in plans.items() if {*each.joint_names} <= {*log.joint_names}}
    if not any(_commanded(log, each.joint_names).any() for each in moving.values()):
        return None
    if beside is not None and _left_rad(log, beside, arm) <= ALIKE_RAD:
        return None
    # Plans that differ in what is expected of them alone are one motion: the first of them.
    distinct = {each.trajectory().q_rad.tobytes(): path for path, each in reversed(moving.items())}
    left_rad = {path: _left_rad(log, moving[path], arm) for path in distinct.values()}
    best, *others = sorted(left_rad, key=lambda path: left_rad[path])
    clear = all(left_rad[best] < CLEARLY_LESS * left_rad[other] for other in others)
    same = (
        beside is not None
        and moving[best].trajectory().q_rad.tobytes() == beside.trajectory().q_rad.tobytes()
    )
    if same or not (left_rad[best] <= ALIKE_RAD or (clear and np.isfinite(left_rad[best]))):
        return None
    return best


def _left_rad(log: JointLog, motion: Motion, arm: Arm) -> float:
    """Return how far commanded joints are from a motion but for a lag; infinity if they are not its own."""
    if len(motion.points) < 2 or (np.diff(motion.trajectory().time_s) <= 0).any():
        return np.inf
    found = _match(log, motion, arm)
    return found.left_rad if found.is_whole and _is_like(found) else np.inf


def _is_like(found: Match) -> bool:
    """Return whether commanded joints may be those of a motion."""
    most_rad = max(LARGEST_LEFT_RAD, CLEARLY_LESS * found.rms_rad)
    return found.rms_rad <= LARGEST_RMS_RAD and found.left_rad <= most_rad


def _commanded(log: JointLog, names: list[str]) -> np.ndarray:
    """Return (T,) in which rows of a log all of some joints have a command."""
    columns = [log.joint_names.index(name) for name in names]
    return np.asarray(np.isfinite(log.q_cmd_rad[:, columns]).all(axis=1))


def _refuse_falling_times(motion: Motion, file: str | None) -> None:
    time_s = motion.trajectory().time_s
    back = np.flatnonzero(np.diff(time_s) <= 0)
    if len(back):
        k = int(back[0])
        raise StrandcastError(
            "SC-I007",
            f"point {k + 1} of motion.json is at {time_s[k + 1]:g} s, after {time_s[k]:g} s "
            f"({len(back)} such points)",
            file=file,
            field="points",
        )


def _refuse_another_motion(its_rad: float, left_rad: Mapping[str, float], file: str | None) -> None:
    other = min(left_rad, key=lambda path: left_rad[path], default=None)
    if other is not None and left_rad[other] < CLEARLY_LESS * its_rad:
        raise StrandcastError(
            "SC-I031",
            f"the log is that of {other}: it stays {1e3 * left_rad[other]:.1f} mrad rms from that motion, "
            f"and {1e3 * its_rad:.1f} from the motion.json beside the raw files",
            file=file,
            field="motion.json",
            cost="clock, fit and next motion would belong to another throw",
        )


def _match(log: JointLog, motion: Motion, arm: Arm) -> Match:
    """Return where a motion fits best, whether or not it was played."""
    columns = [log.joint_names.index(name) for name in motion.joint_names]
    step_s = 1.0 / arm.log_rate_hz
    planned = motion.trajectory()
    time_s = np.arange(round((planned.end_s + TAIL_S) / step_s) + 1) * step_s
    command = resampled(time_s, planned.time_s, planned.q_rad)
    commanded = _commanded(log, motion.joint_names)
    if commanded.any():
        rows, values, expected = commanded, log.q_cmd_rad, command
    else:
        rows, values, expected = (
            np.ones(len(log.time_s), bool),
            log.q_rad,
            respond(arm.servo, time_s, command),
        )
    logged_s, logged = log.time_s[rows], values[rows][:, columns]

    def off(start_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Return by how much the joints are off (T, J), and where the log has rows (T,)."""
        shifted = resampled(start_s + time_s, logged_s, logged)
        known = (start_s + time_s >= logged_s[0] - step_s) & (start_s + time_s <= logged_s[-1] + step_s)
        return shifted - expected, known

    def rms_rad(start_s: float) -> float:
        off_rad, known = off(start_s)
        return float(np.sqrt((off_rad[known] ** 2).mean())) if known.any() else np.inf

    even_s = np.arange(logged_s[0], logged_s[-1] + step_s, step_s)
    even = resampled(even_s, logged_s, logged)
    # Starts at which the log misses a part of the motion are included, so that this can be reported.
    misses = len(time_s) // 2
    best = float(logged_s[0] + step_s * (int(np.argmin(_squares(even, expected, misses))) - misses))
    # Relative to the best start: the search's tolerance is relative, and a clock may count from 1970.
    found = scipy.optimize.minimize_scalar(
        lambda shift_s: rms_rad(best + shift_s),
        bounds=(-step_s, step_s),
        method="bounded",
        options={"xatol": 1e-6},
    )
    start_s = best + float(found.x)
    off_rad, known = off(start_s)
    is_whole = bool(known[time_s <= planned.end_s].all())
    lag = _lag_terms(expected)[known]
    constants = np.broadcast_to(np.eye(len(columns)), (*lag.shape[:2], len(columns)))
    level, solved = _without(np.concatenate([lag, constants], axis=2), off_rad[known])
    if commanded.any():
        left = _without(lag, off_rad[known])[0]
    else:  # a lag and an offset of each joint
        joints = np.concatenate([lag, np.ones((*lag.shape[:2], 1))], axis=2).transpose(1, 0, 2)
        left = np.stack([_without(*joint)[0] for joint in zip(joints, off_rad[known].T, strict=True)])
    return Match(
        start_s,
        start_s + planned.end_s,
        float(found.fun),
        float(np.sqrt(np.mean(left**2))),
        is_whole,
        solved[2:],
        float(np.sqrt(np.mean(level**2))),
    )


def _squares(logged: np.ndarray, expected: np.ndarray, misses: int) -> np.ndarray:
    """Return the mean square of the differences for a motion (T, J) that begins at each row of a log (N, J).

    The first is for a motion that began `misses` rows before the log; at its end, as many may be missing.
    """
    logged, expected = logged - expected.mean(axis=0), expected - expected.mean(axis=0)
    pairs = (logged**2, np.ones_like(expected)), (np.ones_like(logged), expected**2), (logged, expected)
    first, second, both = (
        sum(scipy.signal.correlate(a, b, method="fft") for a, b in zip(left.T, right.T, strict=True))
        for left, right in pairs
    )
    rows = scipy.signal.correlate(np.ones(len(logged)), np.ones(len(expected)), method="direct")
    squares = (first + second - 2.0 * both) / rows
    return np.asarray(squares[len(expected) - 1 - misses : len(squares) - (len(expected) - 1 - misses)])


def _lag_terms(expected_rad: np.ndarray) -> np.ndarray:
    """Return (T, J, 2): what a lag changes in joints (T, J), shares of their velocity and acceleration."""
    velocity = np.gradient(expected_rad, axis=0)
    return np.stack([velocity, np.gradient(velocity, axis=0)], axis=2)


def _without(terms: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return values (N,) less what terms (..., K) explain of them, and the shares (K,)."""
    rows = terms.reshape(-1, terms.shape[-1])
    shares = np.linalg.lstsq(rows, values.ravel(), rcond=None)[0]
    return values.ravel() - rows @ shares, shares
