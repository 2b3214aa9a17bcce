"""All checks of one trial, each with its result."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.motion import Motion
from strandcast.report.causes import (
    caveat,
    least_slip_m,
    length_fault,
    slip_in_clamp,
    slip_words,
    slipped,
)
from strandcast.report.measures import fitted_rows
from strandcast.report.numbers import millimetres, milliseconds, percent
from strandcast.report.results import FILES, TrialResults
from strandcast.report.rig_limits import MOST_DRIFT, MOST_LENS_RMS_PX, MOST_PLANE_RMS_PX
from strandcast.report.text import warnings_of

STATES = FAIL, WARN, NOT_RUN, PASS = "FAIL", "WARN", "NOT RUN", "PASS"  # the gravest first
# The numbers of the first screen that a check may doubt, in the order in which a reader meets them.
MISS, PREDICTION, NEXT_THROW = NUMBERS = "the miss", "the predicted miss", "the next throw"
OF_A_CAPTURE = {MISS: "the measured motion", NEXT_THROW: "the fit"}
NEXT_MOTION = "next motion"
LEAST_ROOM_M = 0.01  # chosen: throws of one motion differ by millimetres


class CheckResult(NamedTuple):
    """One check on the page: its name, its state, what was found, what is expected, what it would doubt."""

    name: str
    state: str
    found: str
    expected: str
    doubted: str = MISS


CheckOutcome = tuple[bool, str, str]  # whether it is good, what was found, what is expected
TrialCheck = Callable[[TrialResults], CheckOutcome | None]  # None: there is nothing to check


def run_checks(results: TrialResults, next_motion: Path | None) -> list[CheckResult]:
    """Return the checks of one trial; a check that could not run gives the reason."""
    aimed = results.aimed()
    checks = [_read(results), *_warned(results)]
    checks += [
        _run(name, severity, check, results)._replace(doubted=doubted)
        for doubted, name, severity, check in CHECKS
        if aimed or check not in AIMED
    ]
    if not aimed:
        return [each._replace(doubted=OF_A_CAPTURE.get(each.doubted, each.doubted)) for each in checks]
    found = _next_motion(next_motion, caveat(results))
    return [*checks, found._replace(doubted=NEXT_THROW)]


def _read(results: TrialResults) -> CheckResult:
    """Return whether all results could be read."""
    needed = [name for name in FILES if name not in results.not_made() or name in results.pieces]
    bad = [
        f"{results.file(name).removeprefix('../')}: {results.problems[name].what}"
        for name in needed
        if name in results.problems
    ]
    found = "; ".join(bad) or f"{len(needed)} files"
    return CheckResult(
        "results can be read", FAIL if bad else PASS, found, "complete, unchanged, of this version"
    )


def _warned(results: TrialResults) -> list[CheckResult]:
    """Return whether no stage warned, by the number that its warnings doubt."""
    doubted: dict[str, list[str]] = {}
    for file, text in warnings_of(results):
        doubted.setdefault(DOUBTED_BY.get(file, MISS), []).append(text)
    name = "warnings of the stages"
    found = [CheckResult(name, WARN, "; ".join(texts), "none", of) for of, texts in doubted.items()]
    return found or [CheckResult(name, PASS, "none", "none")]


def _run(name: str, severity: str, check: TrialCheck, results: TrialResults) -> CheckResult:
    try:
        outcome = check(results)
    except StrandcastError as problem:
        return CheckResult(name, NOT_RUN, problem.what, "")
    if outcome is None:
        return CheckResult(name, NOT_RUN, "nothing to check", "")
    good, found, expected = outcome
    return CheckResult(name, PASS if good else severity, found, expected)


def _next_motion(path: Path | None, caveat: str | None) -> CheckResult:
    name = NEXT_MOTION
    if path is None:
        return CheckResult(name, NOT_RUN, "none was given", "")
    try:
        motion = Motion.read(path)
    except StrandcastError as problem:
        return CheckResult(name, FAIL, problem.what, "readable, with the right hash")
    flags = [] if caveat is None else [caveat]
    flags += motion.provenance.flags if motion.provenance is not None else []
    room_m = motion.predicted.workspace_room_m if motion.predicted is not None else None
    if room_m is not None and room_m < LEAST_ROOM_M:
        flags.append(
            f"{millimetres(room_m, digits=0)} to the workspace's edge: widen workspace_m or aim elsewhere"
        )
    found = ", ".join(flags) or "no flags"
    expected = f"no flags of the planner, ≥ {millimetres(LEAST_ROOM_M, digits=0)} to the workspace's edge"
    return CheckResult(name, WARN if flags else PASS, found, expected)


def _frames(results: TrialResults) -> CheckOutcome | None:
    if results.supplied():  # there is no video
        return None
    summary = results.need("track_summary")
    found = f"{summary.decoded_frames} decoded, {summary.expected_frames} expected"
    return summary.decoded_frames == summary.expected_frames, found, "as many as the manifest says"


def _header(results: TrialResults) -> CheckOutcome | None:
    video = results.need("manifest").video
    if video.header_frames is None:
        return None
    held = video.packets + video.discarded_packets
    found = f"{held} packets, {video.header_frames} in the header"
    # A container that states a duration only may be one frame off.
    return abs(held - video.header_frames) <= 1, found, "the same number, or one more or less"


def _video_gaps(results: TrialResults) -> CheckOutcome:
    video = results.need("manifest").video
    missing = sum(gap.missing for gap in video.gaps)
    found = f"{len(video.gaps)} gaps ({missing} frames), {video.duplicates} duplicates"
    return not video.gaps and not video.duplicates, found, "none"


def _log_gaps(results: TrialResults) -> CheckOutcome | None:
    log = results.need("manifest").joint_log
    if log is None:
        return None
    longest = max((gap.duration_s for gap in log.gaps), default=0.0)
    found = f"{len(log.gaps)} gaps (longest {milliseconds(longest, digits=0)}), {log.duplicates} duplicates"
    return not log.gaps and not log.duplicates, found, "none"


def _played(results: TrialResults) -> CheckOutcome | None:
    planned, played = results.need("motion").content_sha256(), results.need("manifest").motion_sha256
    if played is None:
        return None
    return planned == played, f"planned {planned[:12]}…, played {played[:12]}…", "the same hash"


def _lens(results: TrialResults) -> CheckOutcome:
    rms_px = results.need("camera").lens.rms_px
    return rms_px <= MOST_LENS_RMS_PX, f"{rms_px:.3f} px", f"≤ {MOST_LENS_RMS_PX:g} px rms"


def _plane(results: TrialResults) -> CheckOutcome:
    rms_px = results.need("camera").plane_rms_px
    return rms_px <= MOST_PLANE_RMS_PX, f"{rms_px:.3f} px", f"≤ {MOST_PLANE_RMS_PX:g} px rms"


def _tracked(results: TrialResults) -> CheckOutcome:
    fraction = results.need("track_summary").tracked_fraction
    return fraction >= 0.8, percent(fraction), "≥ 80 % of points without a flag"


def _sigma(results: TrialResults) -> CheckOutcome:
    sigma_m = results.need("track_summary").median_sigma_m
    return sigma_m <= 0.003, millimetres(sigma_m, digits=2), "≤ 3 mm (median σ)"


def _length(results: TrialResults) -> CheckOutcome | None:
    length_m = results.need("track_summary").length_m
    measured_m = np.linalg.norm(np.diff(results.need("track").points_m, axis=1), axis=2).sum(axis=1)
    if not np.isfinite(measured_m).any():
        return None
    median_m = float(np.nanmedian(measured_m))
    expected = f"{millimetres(length_m)}, as declared"
    if (words := slip_words(results)) is not None:
        return False, words, f"{expected}, before and after the throw"
    return length_fault(results) is None, f"{millimetres(median_m)} measured", expected


def _slip(results: TrialResults) -> CheckOutcome | None:
    slip = slip_in_clamp(results)
    if slip is None:
        return None
    found = f"{millimetres(slip.rise_m)} beyond the {millimetres(slip.at_rest_m)} at rest"
    least = millimetres(least_slip_m(slip))
    expected = f"≤ {least}: the tip is never farther from the clamp than the string is long"
    return not slipped(slip), found, expected


def _tip(results: TrialResults) -> CheckOutcome:
    verdict = results.need("verdict")
    found = verdict.reason or f"detected, miss {millimetres(verdict.miss_m, verdict.miss_sigma_m)}"
    return verdict.miss_m is not None, found, "tip detected at the closest approach"


def _offset(results: TrialResults) -> CheckOutcome | None:
    error_s = results.need("alignment").offset_se_s
    if error_s is None:
        return None
    return error_s <= 0.002, f"± {milliseconds(error_s)}", "≤ 2 ms (standard error)"


def _drift(results: TrialResults) -> CheckOutcome:
    drift = results.need("alignment").drift
    found = f"{drift * 1e6:.1f} ppm".replace("-", "−")
    return abs(drift) <= MOST_DRIFT, found, f"≤ {MOST_DRIFT * 1e6:g} ppm"


def _hand(results: TrialResults) -> CheckOutcome | None:
    residual_m = results.need("alignment").residual_rms_m
    if residual_m is None:
        return None
    return residual_m <= 0.005, millimetres(residual_m, digits=2), "≤ 5 mm rms"


def _fit(results: TrialResults) -> CheckOutcome:
    error_m = results.need("estimate").E_m
    found = f"{millimetres(error_m, digits=2)}{_points_counted(results)}"
    next_throw = "; beyond it the next throw often misses" if results.aimed() else ""
    return error_m <= 0.008, found, f"≤ 8 mm{next_throw}"


def _points_counted(results: TrialResults) -> str:
    """Return in words how many points of the frames of the fit were tracked without a flag, in a video."""
    track = results.get("track")
    if track is None or results.supplied() or results.get("alignment") is None:
        return ""
    rows = fitted_rows(results)
    if not rows.any():
        return ""
    points_m, flags = track.points_m[rows, 1:], track.flags[rows, 1:]
    sure = np.isfinite(points_m).all(axis=2) & (flags == 0)
    return f"; {percent(sure.sum() / max(sure.size, 1))} of the points in these frames without a flag"


def _bend(results: TrialResults) -> CheckOutcome | None:
    predicted = results.need("motion").predicted
    if predicted is None:
        return None
    bend_deg = float(np.degrees(predicted.largest_bend_rad))
    return bend_deg <= 57.0, f"{bend_deg:.1f}°", "≤ 57° between neighbours: the model is wrong beyond"


# Files with warnings that doubt another number than the miss.
DOUBTED_BY = {
    FILES["alignment"]: NEXT_THROW,
    FILES["estimate"]: NEXT_THROW,
    FILES["motion"]: PREDICTION,
}

CHECKS: list[tuple[str, str, str, TrialCheck]] = [
    (MISS, "video: frames decoded", FAIL, _frames),
    (MISS, "video: packets against header", WARN, _header),
    (MISS, "video: gaps and duplicates", WARN, _video_gaps),
    (NEXT_THROW, "joint log: gaps and duplicates", WARN, _log_gaps),
    (PREDICTION, "played motion is the planned one", FAIL, _played),
    (MISS, "calibration: lens", WARN, _lens),
    (MISS, "calibration: plane of motion", WARN, _plane),
    (MISS, "track: points detected", WARN, _tracked),
    (MISS, "track: σ", WARN, _sigma),
    (NEXT_THROW, "track: length of the string", WARN, _length),
    (NEXT_THROW, "track: string held by the clamp", WARN, _slip),
    (MISS, "track: tip at the closest approach", WARN, _tip),
    (NEXT_THROW, "alignment: offset's error", WARN, _offset),
    (NEXT_THROW, "alignment: drift", WARN, _drift),
    (MISS, "alignment: hand's residual", WARN, _hand),
    (NEXT_THROW, "estimate: E after the fit", WARN, _fit),
    (PREDICTION, "motion played: folding", WARN, _bend),
]

AIMED = (_tip, _played, _bend)  # checks of a throw at a target
