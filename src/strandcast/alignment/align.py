"""Align one trial: joint log and hand markers to offset, drift and their certainty, or a refusal."""

from __future__ import annotations

import numpy as np

from strandcast.alignment.fit import ClockFit, Priors, fit_clock, smooth_joints
from strandcast.alignment.rig import Seen, rig_of, seen_of
from strandcast.alignment.search import APART_S, candidate_offsets
from strandcast.arm.load import Arm
from strandcast.errors import StrandcastError
from strandcast.records.alignment import Alignment
from strandcast.records.joint_log import JointLog

LEAST_SIGHTINGS = 20
LEAST_TRAVEL_M = 0.02
LARGEST_RESIDUAL_M = 0.005
LARGEST_SE_S = 0.002
LARGEST_COARSE_M = 0.05
RIVAL_RATIO = 1.5
MOVING_S = 0.01  # half the time over which a joint's step is its speed
WIGGLE = "play a sync wiggle first: three quick moves of the hand, some centimetres, in both directions"


def align(
    markers: dict[str, np.ndarray],
    log: JointLog,
    arm: Arm,
    *,
    experiment: str,
    trial: int,
    motion_s: tuple[float, float] | None = None,
    priors: Priors | None = None,
    largest_offset_s: float | None = None,
    sync_s: tuple[float, float] | None = None,
    log_file: str | None = None,
) -> Alignment:
    """Fit the camera's clock to the robot's.

    Parameters
    ----------
    markers
        Columns of markers.parquet: the hand's markers as the video saw them, in the motion plane.
    log
        The joint log, on the controller's clock.
    arm
        Kinematics, and the markers' places on the hand.
    experiment, trial
        Whose record it is.
    motion_s
        Start and end of the motion on the robot's clock; found from the measured joints if not given.
    priors
        Of drift and of the rig's constant errors.
    largest_offset_s
        How far the video's first frame may lie from the log's first row; None: anywhere they can overlap.
    sync_s
        An event's camera time and robot time, to hold against the fit.
    log_file
        For messages.

    Raises
    ------
    StrandcastError
        No markers, no motion, two offsets that fit alike, a log that does not fit, an offset too unsure.
    """
    rig, seen = rig_of(arm), seen_of(markers, arm)
    time_s, q_rad = log_of(log, arm, log_file)
    _refuse_stillness(seen, time_s, q_rad, log_file)
    offsets, coarse_m = candidate_offsets(rig, time_s, q_rad, seen, _window(seen, time_s, largest_offset_s))
    fits = []
    if coarse_m[0] > LARGEST_COARSE_M:
        raise _misfit(coarse_m[0], log_file)
    for offset_s in offsets[coarse_m <= max(3.0 * coarse_m[0], 0.01)]:
        covered = _within_log(seen, time_s, offset_s)
        if len(covered.time_s) >= LEAST_SIGHTINGS:
            fit = fit_clock(rig, time_s, q_rad, covered, offset_s, priors or Priors())
            fits.append((moving_rms_m(fit, covered), fit, covered))
    if not fits:
        raise StrandcastError(
            "SC-A003",
            f"fewer than {LEAST_SIGHTINGS} sightings of the hand lie within the joint log's time",
            file=log_file,
            fix="is it this trial's log? record both from before the motion to after it",
        )
    fits.sort(key=lambda found: found[0])
    residual_m, fit, covered = fits[0]
    _refuse_misfit(residual_m, fit, log_file)
    _refuse_rivals(fits)
    start_s, end_s = motion_s or motion_span(time_s, q_rad)
    return Alignment(
        experiment=experiment,
        trial=trial,
        source="fit",
        offset_s=fit.offset_s(),
        offset_se_s=fit.offset_se_s(),
        drift=fit.drift,
        drift_se=fit.drift_se,
        drift_prior=(priors or Priors()).drift,
        residual_rms_m=residual_m,
        frames=len(np.unique(covered.time_s)),
        motion_start_s=start_s,
        motion_end_s=end_s,
        marker_shift_m=fit.misfit.shift_m.tolist(),
        marker_turn_rad=fit.misfit.turn_rad,
        base_shift_m=fit.misfit.base_m.tolist(),
        joint_zero_rad=fit.misfit.zero_rad.tolist(),
        sync_event=_sync_event(fit, sync_s),
        middle_se_s=fit.middle_se_s,
        middle_camera_time_s=fit.middle_camera_s,
        warnings=_warnings(fit, priors or Priors(), sync_s),
    )


def log_of(log: JointLog, arm: Arm, file: str | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return time (T,), strictly rising, and the moving joints (T, J) of a log, by the joints' names."""
    missing = [name for name in arm.joints if name not in log.joint_names]
    if missing:
        raise StrandcastError(
            "SC-A002",
            f"the joint log has no {', '.join(missing)}; it has {', '.join(log.joint_names)}",
            file=file,
            fix="import the log with the arm's joint names",
        )
    columns = [log.joint_names.index(name) for name in arm.joints]
    order = np.argsort(log.time_s, kind="stable")
    time_s, first = np.unique(log.time_s[order], return_index=True)
    return time_s, log.q_rad[order][first][:, columns]


def motion_span(time_s: np.ndarray, q_rad: np.ndarray) -> tuple[float, float]:
    """Return when the joints begin and cease to move [s]: beyond 5 % of the greatest joint speed."""
    joints = smooth_joints(time_s, q_rad)
    step = np.abs(joints(time_s + MOVING_S) - joints(time_s - MOVING_S))
    step[(time_s < time_s[0] + MOVING_S) | (time_s > time_s[-1] - MOVING_S)] = 0.0
    moving = np.flatnonzero(step.max(axis=1) > 0.05 * step.max())
    return float(time_s[moving[0]]), float(time_s[moving[-1]])


def moving_rms_m(fit: ClockFit, seen: Seen) -> float:
    """Return the residual's rms over the faster half of the hand's way, the worst twentieth left out [m].

    Frames at rest fit any log; single misread markers should not condemn a good one.
    """
    step_m = np.zeros(len(seen.time_s))
    for marker in np.unique(seen.marker):
        mine = np.flatnonzero(seen.marker == marker)
        if len(mine) > 1:
            step_m[mine] = np.linalg.norm(np.gradient(seen.pose[mine, :2], axis=0), axis=1)
    moving = step_m >= 0.2 * np.quantile(step_m, 0.98)
    square = np.sort((fit.residual[moving, :2] ** 2).sum(axis=1))
    return float(np.sqrt(square[: max(1, int(0.95 * len(square)))].mean()))


def _window(seen: Seen, time_s: np.ndarray, largest_offset_s: float | None) -> tuple[float, float]:
    least, greatest = time_s[0] - seen.time_s[-1], time_s[-1] - seen.time_s[0]
    if largest_offset_s is None:
        return float(least), float(greatest)
    same_start = time_s[0] - seen.time_s[0]
    return float(max(least, same_start - largest_offset_s)), float(
        min(greatest, same_start + largest_offset_s)
    )


def _within_log(seen: Seen, time_s: np.ndarray, offset_s: float) -> Seen:
    """Return the sightings within the log, away from its ends and from its long gaps."""
    robot_s = seen.time_s + offset_s
    after = np.clip(np.searchsorted(time_s, robot_s), 1, len(time_s) - 1)
    step_s = np.diff(time_s)
    usual = float(np.median(step_s))
    inside = (robot_s > time_s[0] + 2 * usual) & (robot_s < time_s[-1] - 2 * usual)
    return seen.where(inside & (step_s[after - 1] < max(4 * usual, 0.01)))


def _refuse_stillness(seen: Seen, time_s: np.ndarray, q_rad: np.ndarray, log_file: str | None) -> None:
    if len(seen.time_s) < LEAST_SIGHTINGS:
        raise StrandcastError(
            "SC-A004",
            f"the video shows the hand's markers {len(seen.time_s)} times, at least {LEAST_SIGHTINGS} are "
            "needed",
            fix="check the marker ids in the arm's file, light, focus and exposure",
        )
    if len(time_s) < LEAST_SIGHTINGS or np.ptp(q_rad, axis=0).max() < 1e-3:
        raise StrandcastError(
            "SC-A005",
            f"the joints do not move in the log ({len(time_s)} rows)",
            file=log_file,
            cost="the clocks cannot be told from each other",
            fix=WIGGLE,
        )
    travel_m = max(_travel_m(seen.where(seen.marker == marker)) for marker in np.unique(seen.marker))
    if travel_m < LEAST_TRAVEL_M:
        raise StrandcastError(
            "SC-A006",
            f"the hand moves {travel_m * 1e3:.1f} mm in the video, at least {LEAST_TRAVEL_M * 1e3:.0f} mm "
            "are needed",
            cost="the clocks cannot be told from each other",
            fix=WIGGLE,
        )


def _travel_m(seen: Seen) -> float:
    low, high = np.quantile(seen.pose[:, :2], (0.02, 0.98), axis=0)
    return float(np.linalg.norm(high - low))


def _misfit(residual_m: float, log_file: str | None) -> StrandcastError:
    return StrandcastError(
        "SC-A007",
        f"the hand in the video stays {residual_m * 1e3:.1f} mm rms from where this log puts it, at "
        f"the best offset; at most {LARGEST_RESIDUAL_M * 1e3:.0f} mm are believed",
        file=log_file,
        cost=f"the string's fit would be off by about {residual_m * 1e3:.0f} mm",
        fix="is it the log of another trial? are the joints in order and in radians? is it this arm's?",
    )


def _refuse_misfit(residual_m: float, fit: ClockFit, log_file: str | None) -> None:
    if residual_m > LARGEST_RESIDUAL_M:
        raise _misfit(residual_m, log_file)
    if fit.middle_se_s > LARGEST_SE_S:
        raise StrandcastError(
            "SC-A008",
            f"the offset is known to {fit.middle_se_s * 1e3:.1f} ms only",
            cost="10 ms at 8 m/s: 80 mm",
            fix=WIGGLE,
        )


def _refuse_rivals(fits: list[tuple[float, ClockFit, Seen]]) -> None:
    best_m, best, _ = fits[0]
    for rival_m, rival, _ in fits[1:]:
        apart_s = abs(rival.offset_s() - best.offset_s())
        if apart_s > APART_S and rival_m < RIVAL_RATIO * best_m:
            raise StrandcastError(
                "SC-A009",
                f"two offsets, {best.offset_s():.3f} and {rival.offset_s():.3f} s, fit alike "
                f"({best_m * 1e3:.1f} "
                f"and {rival_m * 1e3:.1f} mm): the motion repeats itself",
                fix=WIGGLE,
            )


def _sync_event(fit: ClockFit, sync_s: tuple[float, float] | None) -> dict[str, float] | None:
    if sync_s is None:
        return None
    camera_s, robot_s = sync_s
    told_s = fit.middle_robot_s + (1 + fit.drift) * (camera_s - fit.middle_camera_s)
    return {"camera_time_s": camera_s, "robot_time_s": robot_s, "difference_s": told_s - robot_s}


def _warnings(fit: ClockFit, priors: Priors, sync_s: tuple[float, float] | None) -> list[str]:
    """Tell which of the rig's constants lie beyond three standard deviations of what was expected."""
    shift_m, base_m = float(np.linalg.norm(fit.misfit.shift_m)), float(np.linalg.norm(fit.misfit.base_m))
    zero_rad = float(np.abs(fit.misfit.zero_rad).max())
    found: list[tuple[float, float, str]] = [
        (abs(fit.drift), priors.drift, f"the clocks drift by {fit.drift * 1e6:+.0f} ppm"),
        (shift_m, priors.marker_shift_m, f"the hand's marker sits {shift_m * 1e3:.1f} mm from its place"),
        (
            abs(fit.misfit.turn_rad),
            priors.marker_turn_rad,
            f"the hand's marker is turned by {fit.misfit.turn_rad:+.3f} rad",
        ),
        (base_m, priors.base_shift_m, f"the arm's base lies {base_m * 1e3:.1f} mm from the world's origin"),
        (zero_rad, priors.joint_zero_rad, f"a joint's zero is off by {zero_rad * 1e3:.1f} mrad"),
    ]
    warnings = [
        f"{words}: check the arm's and the experiment's files"
        for size, sd, words in found
        if size > 3 * sd > 0
    ]
    event = _sync_event(fit, sync_s)
    if event is not None and abs(event["difference_s"]) > 3 * fit.middle_se_s + 1e-3:
        warnings.append(f"the sync event lies {event['difference_s'] * 1e3:+.1f} ms from the fit")
    return warnings
