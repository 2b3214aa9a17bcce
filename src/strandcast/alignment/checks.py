"""Refusals before and after the fit, and the warnings of a good one."""

from typing import NamedTuple

import numpy as np

from strandcast.alignment.cost import FastestPoint
from strandcast.alignment.diagnosis import (
    UNUSUAL_SD,
    clamp_words,
    length_words,
    truncated_log_error,
    wrong_arm_error,
)
from strandcast.alignment.fine_fit import SHIFT_S, Candidate, ClockFit
from strandcast.alignment.frame_rate import rate_words
from strandcast.alignment.log_rows import MOVES, LogRows, hand_travel_m
from strandcast.alignment.problem import Priors
from strandcast.alignment.rig_error import Detections, Rig
from strandcast.arm.load import PlanarArm
from strandcast.errors import StrandcastError
from strandcast.records.record import ARM_FILE, RigFault

# Chosen: what alignments of lab throws reach, with room; an offset of 2 ms costs 20 mm at 10 m/s.
LEAST_DETECTIONS = 20
LEAST_TRAVEL_M = 0.02
PLAIN_RESIDUAL_M = 0.001  # beyond it, something is slightly wrong
LARGEST_CI_S = 0.002  # half the 95 % interval
WEAK_CI_S = 0.0005
NORMAL = 1.96  # 95 % of a normal distribution
REPORTED_DRIFT = 1e-4
LARGEST_DRIFT = 0.03
LONGEST_UNLOGGED_S = 0.03  # of motion in the video without a log
LARGEST_LENGTH_M = 0.010
LARGEST_TURN_RAD = 0.15
OUTLIER_SHARE = 0.10  # of a marker's detections
WRONG_ROWS = 0.01  # of a log's rows; the splines bridge fewer without harm
NOISY = 4.0  # times as noisy as the best marker
NO_CLOCK = "the clocks cannot be aligned"


def refuse_few_detections(detections: Detections) -> None:
    """Refuse a video that hardly shows the hand (SC-A004)."""
    if len(detections.time_s) < LEAST_DETECTIONS:
        raise StrandcastError(
            "SC-A004",
            f"the video shows the hand's markers {len(detections.time_s)} times, at least {LEAST_DETECTIONS} "
            "are needed",
        )


def no_motion_error(
    detections: Detections, rows: LogRows, arm: PlanarArm, file: str | None
) -> StrandcastError | None:
    """Return the refusal of a throw without motion in the video, in the log, or in both."""
    markers = np.unique(detections.marker)
    video_m = max(_travel_m(detections.where(detections.marker == marker)) for marker in markers)
    log_m = hand_travel_m(rows, arm) if len(rows.time_s) >= LEAST_DETECTIONS else 0.0
    if min(video_m, log_m) >= LEAST_TRAVEL_M:
        return None
    if max(video_m, log_m) < LEAST_TRAVEL_M:
        return StrandcastError(
            "SC-A008",
            f"the hand moves {video_m * 1e3:.1f} mm in the video and {log_m * 1e3:.1f} mm by the log, "
            f"at least {LEAST_TRAVEL_M * 1e3:.0f} mm are needed",
            file=file,
            cost=NO_CLOCK,
        )
    if video_m < log_m:
        return StrandcastError(
            "SC-A007",
            f"the hand moves {video_m * 1e3:.1f} mm in the video and {log_m * 1e3:.0f} mm by the log",
            cost=NO_CLOCK,
            fix="the video begins after the throw or ends before it: use the one that shows it",
        )
    return StrandcastError(
        "SC-A007",
        f"the joints do not move in the log ({len(rows.time_s)} rows, "
        f"{rows.time_s[-1] - rows.time_s[0]:.2f} s) while the hand moves {video_m * 1e3:.0f} mm in the video",
        file=file,
        cost=NO_CLOCK,
        fix="the log ends before the throw, or begins after it: copy the whole log of this throw",
    )


def _travel_m(detections: Detections) -> float:
    low, high = np.quantile(detections.pose.position_m, (0.02, 0.98), axis=0)
    return float(np.linalg.norm(high - low))


def no_overlap_error(file: str | None) -> StrandcastError:
    """Return the refusal of a video that lies outside the log's time."""
    return StrandcastError(
        "SC-A007",
        f"fewer than {LEAST_DETECTIONS} detections of the hand's markers lie within the joint log's time",
        file=file,
    )


def refuse_truncated_log(
    rows: LogRows, detections: Detections, robot_s: np.ndarray, file: str | None
) -> None:
    """Refuse a log that begins or ends in mid-throw while the video shows the rest (SC-A007)."""
    speed = detections.speed_m_s()
    fast = speed > MOVES * float(np.quantile(speed, 0.98))
    unlogged = fast & ((robot_s < rows.time_s[0]) | (robot_s > rows.time_s[-1]))
    times = np.unique(robot_s[unlogged])
    if len(times) > 1 and np.ptp(times) > LONGEST_UNLOGGED_S:
        error = truncated_log_error(rows, file, f"; the video shows {np.ptp(times):.2f} s more of motion")
        if error is not None:
            raise error


def refuse_uncertain(best: Candidate, fastest: FastestPoint) -> None:
    """Refuse an offset that the motion does not determine, or not well enough (SC-A008)."""
    half_s, unaided_s = NORMAL * best.fit.middle_se_s, NORMAL * best.fit.unaided_se_s
    if best.determined and max(half_s, unaided_s) <= LARGEST_CI_S:
        return
    cost = f"{fastest.error_mm(max(half_s, unaided_s)):.0f} mm at {fastest}"
    if not best.determined or half_s <= LARGEST_CI_S:
        raise StrandcastError(
            "SC-A008",
            "the motion does not determine the offset: the hand moves too evenly, or along one line only; "
            f"{SHIFT_S * 1e3:.0f} ms more would change its path by {best.shape_m * 1e3:.1f} mm besides a "
            f"displacement, and from the motion alone the offset is known to ± "
            f"{unaided_s * 1e3:.1f} ms at best",
            cost=f"at least {cost}",
        )
    raise StrandcastError(
        "SC-A008",
        f"the offset is known to ± {half_s * 1e3:.1f} ms only (95 %), ± {LARGEST_CI_S * 1e3:.0f} ms are "
        "needed",
        cost=cost,
    )


def implausible_dimensions(fit: ClockFit, priors: Priors) -> bool:
    """Return whether lengths of the arm or positions on the hand are unusually far off."""
    error = fit.rig_error
    return bool(
        np.abs(error.length_m).max() > 3 * priors.link_length_m
        or np.abs(error.shift_m.mean(axis=0)).max() > 3 * priors.marker_shift_m
        or abs(float(error.turn_rad.mean())) > 3 * priors.marker_turn_rad
    )


def refuse_wrong_dimensions(wide: ClockFit, rig: Rig, names: tuple[str, ...], arm_file: str | None) -> None:
    """Refuse an arm's file whose lengths contradict the video though the paths agree (SC-A015).

    In the fit `wide` these lengths are almost free.
    """
    error, joints = wide.rig_error, len(names)
    inner_m, inner_se_m = error.length_m[:-1], wide.rig_error_se[5 + joints : 5 + 2 * joints - 1]
    hand_m = error.mean_hand_shift_m()
    wrong_m = float(
        max(np.abs(inner_m * (np.abs(inner_m) > 3 * inner_se_m)).max(initial=0.0), np.linalg.norm(hand_m))
    )
    if wrong_m > LARGEST_LENGTH_M or abs(float(error.turn_rad.mean())) > LARGEST_TURN_RAD:
        cost = f"the hand's position is wrong by {wrong_m * 1e3:.0f} mm"
        raise wrong_arm_error(length_words(rig, names, error), "", cost, arm_file)


def refuse_frame_rate(fit: ClockFit, detections: Detections) -> None:
    """Refuse a camera's clock that does not fit the throw (SC-V017)."""
    if abs(fit.drift) > LARGEST_DRIFT:
        what, fix = rate_words(detections, 1.0 + fit.drift)
        raise StrandcastError(
            "SC-V017",
            f"the log fits {what}",
            field="camera.frame_rate_hz",
            fix=fix,
            cost=f"{abs(fit.drift):.1%} of every speed",
        )


def warnings_of(best: Candidate, rig: Rig, rows: LogRows, priors: Priors, fastest: FastestPoint) -> list[str]:
    """Return the warnings of a good fit."""
    fit, detections = best.fit, best.covered
    far = f"the hand in the video stays {best.residual_m * 1e3:.1f} mm rms from where the log puts it"
    return [
        *([far] if best.residual_m > PLAIN_RESIDUAL_M else []),
        *_clock_warnings(fit, detections, fastest),
        *(fault.words for fault in rig_faults(fit, rig, priors)),
        *_marker_warnings(fit, rig, detections),
        *_row_warnings(rows, int(best.path.outlier.sum())),
    ]


def _clock_warnings(fit: ClockFit, detections: Detections, fastest: FastestPoint) -> list[str]:
    found = []
    half_s = NORMAL * fit.middle_se_s
    if half_s > WEAK_CI_S:
        found.append(
            f"the offset is known to ± {half_s * 1e3:.2f} ms (95 %): {fastest.error_mm(half_s):.1f} mm at "
            f"{fastest}; a sync wiggle before the throw determines it better"
        )
    if abs(fit.drift) > REPORTED_DRIFT:
        steep = abs(fit.drift) > 1e-3
        rate = rate_words(detections, 1.0 + fit.drift)[1] if steep else "check the camera's rate"
        found.append(
            f"the clocks drift by {fit.drift * 1e6:+.0f} ± {fit.drift_se * 1e6:.0f} ppm "
            f"({fit.drift * 1e3:+.2f} ms in a second): {rate}"
        )
    return found


class _Place(NamedTuple):
    """Where a constant of the rig is stated: what a wrong one costs, and what to do."""

    field: str
    cost: str
    fix: str


ARM = _Place(
    ARM_FILE,
    "plans aim with a wrong arm: hand and tip pass beside where they were planned",
    "check the arm's and the experiment's files",
)
PLANE = _Place(
    "camera.plane",
    "the camera's places are not the robot's: the string, and the miss, are seen elsewhere",
    "measure size and places of the plane's markers, and where the arm's base is among them",
)
HAND = _Place(
    "markers.hand", "the hand is seen elsewhere", "measure place_m of markers.hand in the arm's file"
)


def rig_faults(fit: ClockFit, rig: Rig, priors: Priors) -> list[RigFault]:
    """Return the rig's constants that deviate by more than three standard deviations of their priors."""
    error = fit.rig_error
    base_m, reach_m = float(np.linalg.norm(error.base_m)), float(rig.chain.lengths_m.sum())
    zero_rad, longer_m = error.zero_rad, error.length_m
    joint, link = int(np.argmax(np.abs(zero_rad))), int(np.argmax(np.abs(longer_m)))
    stretch = float(np.abs(error.stretch).max())
    found = [
        (
            base_m,
            priors.base_shift_m,
            f"the arm's base lies {base_m * 1e3:.1f} mm from the world's origin",
            PLANE,
        ),
        (
            float(np.abs(zero_rad[joint])),
            priors.joint_zero_rad,
            f"the zero of joint {joint + 1} is off by {zero_rad[joint] * 1e3:+.1f} mrad"
            f"{', or the world is rotated' if joint == 0 else ''} "
            f"({abs(zero_rad[joint]) * reach_m * 1e3:.1f} mm at the hand)",
            ARM,
        ),
        (
            float(np.abs(longer_m[link])),
            priors.link_length_m,
            f"the link after joint {link + 1} is {longer_m[link] * 1e3:+.1f} mm longer than in the "
            "arm's file",
            ARM,
        ),
        (stretch, priors.stretch, f"the camera's scale is off by {stretch:.2%}", PLANE),
    ]
    moved = np.linalg.norm(error.shift_m, axis=1) / priors.marker_shift_m
    together = float(np.maximum(moved, np.abs(error.turn_rad) / priors.marker_turn_rad).min())
    found.append((together, 1.0, clamp_words(rig, error), ARM))
    for index, name in enumerate(rig.ids if together <= UNUSUAL_SD else ()):
        shift_m = float(np.linalg.norm(error.shift_m[index]))
        turn_rad = float(error.turn_rad[index])
        found += [
            (
                shift_m,
                priors.marker_shift_m,
                f"marker {name} sits {shift_m * 1e3:.1f} mm from its place",
                HAND,
            ),
            (abs(turn_rad), priors.marker_turn_rad, f"marker {name} is turned by {turn_rad:+.3f} rad", HAND),
        ]
    return [
        RigFault(what=words, cost=place.cost, fix=place.fix, field=place.field)
        for size, sd, words, place in found
        if size > UNUSUAL_SD * sd > 0
    ]


def _marker_warnings(fit: ClockFit, rig: Rig, detections: Detections) -> list[str]:
    found = []
    best = float(np.nanmin(fit.noise_scale[:, 0]))
    for index, name in enumerate(rig.ids):
        mine = detections.marker == index
        if not mine.any():
            found.append(f"marker {name} is never detected")
            continue
        share = float(fit.outlier[mine].mean())
        if share > OUTLIER_SHARE:
            found.append(f"{share:.0%} of marker {name}'s detections are wrong and were left out")
        if fit.noise_scale[index, 0] > NOISY * best:
            found.append(
                f"marker {name} is {fit.noise_scale[index, 0] / best:.0f} times as noisy as the best: is it "
                "loose, or misread?"
            )
    return found


def _row_warnings(rows: LogRows, outliers: int) -> list[str]:
    found = []
    if rows.unsorted:
        found.append(f"{rows.unsorted} rows of the log were out of order and were sorted")
    if rows.doubled:
        found.append(f"{rows.doubled} rows of the log have the time of another and were left out")
    if outliers > WRONG_ROWS * len(rows.time_s):
        found.append(f"{outliers} rows of the log are late, repeated or wrong and were left out")
    return found
