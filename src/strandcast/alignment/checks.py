"""Refusals before and after the fit, and the warnings of a good one."""

from collections.abc import Sequence

import numpy as np

from strandcast.alignment.changing_rate import LEAST_SAVED, MOST_SIGMAS, capped_cost, uneven_clock
from strandcast.alignment.coarse_search import LEAST_DETECTIONS, AlignmentData
from strandcast.alignment.diagnosis import truncated_log_error
from strandcast.alignment.events import FastestPoint
from strandcast.alignment.fine_fit import SHIFT_S, Candidate, ClockFit
from strandcast.alignment.frame_rate import rate_words
from strandcast.alignment.log_rows import MOVES, LogRows, hand_travel_m
from strandcast.arm.load import PlanarArm
from strandcast.errors import StrandcastError
from strandcast.records.record import RigFault
from strandcast.rig.model import Detections, Rig

# Chosen: what alignments of lab throws reach, with room; an offset of 2 ms costs 20 mm at 10 m/s.
LEAST_TRAVEL_M = 0.02
PLAIN_RESIDUAL_M = 0.001  # beyond it, something is slightly wrong
LARGEST_CI_S = 0.002  # half the 95 % interval
WEAK_CI_S = 0.0005
NORMAL = 1.96  # 95 % of a normal distribution
REPORTED_DRIFT = 1e-4
LARGEST_DRIFT = 0.03
LONGEST_UNLOGGED_S = 0.03  # of motion in the video without a log
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
    video_m = detections.travel_m()
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
    count = len(rows.time_s)
    if video_m < log_m:
        what = f"the hand moves {video_m * 1e3:.1f} mm in the video and {log_m * 1e3:.0f} mm by the log"
        fix = "the video begins after the throw or ends before it: use the one that shows it"
        return StrandcastError("SC-A007", what, cost=NO_CLOCK, fix=fix)
    if count < LEAST_DETECTIONS:
        what = f"the log has {count} rows, at least {LEAST_DETECTIONS} are needed"
        fix = "copy the whole log of this throw, and log at 50 Hz or more"
    else:
        length_s, moved_mm = rows.time_s[-1] - rows.time_s[0], video_m * 1e3
        what = f"the joints do not move in the log ({count} rows, {length_s:.2f} s) while the hand moves "
        what += f"{moved_mm:.0f} mm in the video"
        fix = "the log ends before the throw, or begins after it: copy the whole log of this throw"
    return StrandcastError("SC-A007", what, file=file, cost=NO_CLOCK, fix=fix)


def refuse_truncated_log(data: AlignmentData, offset_s: float) -> None:
    """Refuse a log that begins or ends in mid-throw while the video shows the rest (SC-A007)."""
    rows, robot_s, speed = data.rows, data.detections.time_s + offset_s, data.detections.speed_m_s()
    fast = speed > MOVES * data.detections.top_speed_m_s()
    unlogged = fast & ((robot_s < rows.time_s[0]) | (robot_s > rows.time_s[-1]))
    times = np.unique(robot_s[unlogged])
    if len(times) > 1 and np.ptp(times) > LONGEST_UNLOGGED_S:
        error = truncated_log_error(
            rows, data.log_file, f"; the video shows {np.ptp(times):.2f} s more of motion"
        )
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


def refuse_uneven_clock(best: Candidate, data: AlignmentData) -> None:
    """Refuse a film that plays in part at another speed than the rest (SC-V017)."""
    covered_cost = float(capped_cost(best.fit.residual[:, :2]).sum())
    outside = len(data.detections.time_s) - len(best.covered.time_s)
    if covered_cost + outside * MOST_SIGMAS**2 < LEAST_SAVED:
        return  # nothing to save
    clock = uneven_clock(data, best.fit.rig_error)
    if clock is not None:
        far_m = float(np.abs(best.fit.residual[:, :2]).max())
        off = f"the hand in the video is up to {far_m * 1e3:.0f} mm from where the log puts it"
        raise clock.error(off, "times, speeds and forces of these parts are wrong")


def warnings_of(
    best: Candidate, rig: Rig, rows: LogRows, faults: Sequence[RigFault], fastest: FastestPoint
) -> list[str]:
    """Return the warnings of a good fit, those of the rig's faults among them."""
    fit, detections = best.fit, best.covered
    far = f"the hand in the video stays {best.residual_m * 1e3:.1f} mm rms from where the log puts it"
    return [
        *([far] if best.residual_m > PLAIN_RESIDUAL_M else []),
        *_clock_warnings(fit, detections, fastest),
        *(fault.words for fault in faults),
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
