"""All checks of one trial, each with its result."""

from collections.abc import Callable
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.motion import Motion
from strandcast.report import rig_limits
from strandcast.report.causes import arm_faults, caveat, length_fault, slip_in_clamp, slip_words
from strandcast.report.measures import fitted_rows
from strandcast.report.numbers import fine_millimetres, millimetres, milliseconds, percent, scaled
from strandcast.report.results import FILES, TrialResults
from strandcast.report.text import warnings_of

STATES = FAIL, WARN, NOT_RUN, PASS = "FAIL", "WARN", "NOT RUN", "PASS"  # the gravest first
# The numbers of the first screen that a check may doubt, in the order in which a reader meets them.
MISS, PREDICTION, NEXT_THROW = NUMBERS = "the miss", "the predicted miss", "the next throw"
OF_A_CAPTURE = {MISS: "the measured motion", NEXT_THROW: "the fit"}
NEXT_MOTION = "next motion"
LEAST_ROOM_M = 0.01  # chosen: throws of one motion differ by millimetres


class CheckResult(NamedTuple):
    """One check on the page: its name, its state, what was found, what is expected, what it would doubt.

    `otherwise` is what to do if it does not pass.
    """

    name: str
    state: str
    found: str
    expected: str
    doubted: str = MISS
    otherwise: str = ""


CheckOutcome = tuple[bool, str, str]  # whether it is good, what was found, what is expected
TrialCheck = Callable[[TrialResults], CheckOutcome | None]  # None: there is nothing to check


def run_checks(
    results: TrialResults, next_motion: Path | None, previous: TrialResults | None = None
) -> list[CheckResult]:
    """Return the checks of one trial; a check that could not run gives the reason.

    `previous` is the trial before, in which the string may have been longer.
    """
    aimed = results.aimed()
    tests = [each for each in CHECKS if aimed or each.test not in AIMED]
    if previous is not None:
        name, since = "grasp: slipped since the trial before", partial(_slipped_since, previous)
        tests.append(Check(NEXT_THROW, name, since, f"{HARDER}, or exclude the trial"))
    checks = [_read(results), *_warned(results), *(_run(each, results) for each in tests)]
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


def _run(check: "Check", results: TrialResults) -> CheckResult:
    of = {"doubted": check.doubted, "otherwise": check.otherwise}
    try:
        outcome = check.test(results)
    except StrandcastError as problem:
        return CheckResult(check.name, NOT_RUN, problem.what, "", **of)
    if outcome is None:
        return CheckResult(check.name, NOT_RUN, "nothing to check", "", **of)
    good, found, expected = outcome
    return CheckResult(check.name, PASS if good else check.severity, found, expected, **of)


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


def _at_most(record: str, field: str, most: float, text: Callable[[float], str], unit: str) -> TrialCheck:
    """Return the check of a number of a record."""

    def check(results: TrialResults) -> CheckOutcome | None:
        found = attrgetter(field)(results.need(record))
        return None if found is None else (found <= most, text(found), f"≤ {most:g}{unit}")

    return check


def _share(field: str, least: float) -> TrialCheck:
    """Return the check of a share of points without a flag, or of the frames of a film."""
    of = "points without a flag" if field == "tracked_fraction" else "frames"

    def check(results: TrialResults) -> CheckOutcome | None:
        found = getattr(results.need("track_summary"), field)
        if of == "frames" and results.supplied():
            return None
        return found >= least, percent(found), f"≥ {100 * least:g} % of {of}"

    return check


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
    expected = (
        f"≤ {millimetres(slip.least_m)}: the tip is never farther from the clamp than the string is long"
    )
    return not slip.is_real, found, expected


def _tip(results: TrialResults) -> CheckOutcome:
    verdict = results.need("verdict")
    found = verdict.reason or f"detected, miss {millimetres(verdict.miss_m, verdict.miss_sigma_m)}"
    return verdict.miss_m is not None, found, "tip detected at the closest approach"


def _drift(results: TrialResults) -> CheckOutcome:
    fit = results.need("alignment")
    found = scaled(fit.drift, 1e6, 1, "ppm", fit.drift_se)
    return abs(fit.drift) <= rig_limits.MOST_DRIFT, found, f"≤ {rig_limits.MOST_DRIFT * 1e6:g} ppm"


def _arm_and_files(results: TrialResults) -> CheckOutcome | None:
    if results.need("alignment").source != "fit":
        return None
    faults = arm_faults(results)
    found = "; ".join(f"{fault.what}: {fault.fix}" for fault in faults) or "as the video shows the hand"
    return not faults, found, "no number contradicts the video"


def _moved(results: TrialResults) -> CheckOutcome | None:
    shift_m = results.need("alignment").base_shift_m
    if shift_m is None:
        return None
    found = ", ".join(millimetres(value, digits=2) for value in shift_m) + " in x, y"
    return float(np.hypot(*shift_m)) <= 2e-3, found, "≤ 2 mm since the calibration"


def _misread(results: TrialResults) -> CheckOutcome | None:
    markers = results.need("alignment").markers
    wrong, sightings = (sum(getattr(each, name) for each in markers) for name in ("wrong", "sightings"))
    found = f"{wrong} of {sightings} detections rejected"
    return (wrong <= 0.05 * sightings, found, "≤ 5 %") if sightings else None


def _slipped_since(previous: TrialResults, results: TrialResults) -> CheckOutcome | None:
    summaries = (each.get("track_summary") for each in (previous, results))
    before_m, length_m = (None if one is None else one.choices.get("length_m") for one in summaries)
    if not (isinstance(before_m, float) and isinstance(length_m, float)):
        return None
    return abs(length_m - before_m) <= 5e-3, millimetres(length_m - before_m), "≤ 5 mm"


def _servo(results: TrialResults) -> CheckOutcome | None:
    servo = results.need("estimate").servo
    left = [] if servo is None else [value for value in servo.residual_rad if value is not None]
    if not left:
        return None
    lags = "" if servo.lag_s is None else f"lag {', '.join(f'{1e3 * lag:.0f}' for lag in servo.lag_s)} ms; "
    what = "mrad rms unexplained"
    found = f"{lags}{max(left) * 1e3:.1f} {what} at worst"
    most_rad = rig_limits.MOST_SERVO_RESIDUAL_RAD
    return max(left) <= most_rad, found, f"≤ {1e3 * most_rad:g} {what}"


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
DOUBTED_BY = {FILES["alignment"]: NEXT_THROW, FILES["estimate"]: NEXT_THROW, FILES["motion"]: PREDICTION}


class Check(NamedTuple):
    """A check: what it may doubt, its name, the test, what to do if it fails, and how grave that is."""

    doubted: str
    name: str
    test: TrialCheck
    otherwise: str = ""
    severity: str = WARN


LIGHT, HARDER = "more light, shorter exposure, larger markers", "clamp the string harder"
LENS = _at_most("camera", "lens.rms_px", rig_limits.MOST_LENS_RMS_PX, "{:.3f} px".format, " px rms")
PLANE = _at_most("camera", "plane_rms_px", rig_limits.MOST_PLANE_RMS_PX, "{:.3f} px".format, " px rms")
OFFSET = _at_most("alignment", "offset_se_s", 0.002, lambda s: f"± {milliseconds(s)}", " s (standard error)")
SIGMA = _at_most("track_summary", "median_sigma_m", 0.003, fine_millimetres, " m (median σ)")
HAND = _at_most("alignment", "residual_rms_m", 0.005, fine_millimetres, " m rms")

CHECKS = [
    Check(MISS, "video: frames decoded", _frames, severity=FAIL),
    Check(MISS, "video: packets against header", _header),
    Check(MISS, "video: gaps and duplicates", _video_gaps, "a faster disk or link, a lower frame rate"),
    Check(NEXT_THROW, "joint log: gaps and duplicates", _log_gaps),
    Check(PREDICTION, "played motion is the planned one", _played, severity=FAIL),
    Check(MISS, "calibration: lens", LENS),
    Check(MISS, "calibration: plane of motion", PLANE),
    Check(MISS, "hand's markers: seen", _share("marker_fraction", rig_limits.LEAST_MARKER_FRACTION), LIGHT),
    Check(MISS, "hand's markers: misread", _misread, LIGHT),
    Check(MISS, "track: points detected", _share("tracked_fraction", 0.8)),
    Check(MISS, "track: tip seen", _share("tip_fraction", 0.9), "a plain background, a brighter string"),
    Check(MISS, "track: σ", SIGMA),
    Check(NEXT_THROW, "track: length of the string", _length),
    Check(NEXT_THROW, "track: string held by the clamp", _slip, HARDER),
    Check(MISS, "track: tip at the closest approach", _tip),
    Check(NEXT_THROW, "alignment: offset's error", OFFSET, "a faster motion of the hand, or a lit LED"),
    Check(NEXT_THROW, "alignment: drift", _drift, "check the frame rate that the camera reports"),
    Check(MISS, "alignment: hand's residual", HAND),
    Check(NEXT_THROW, "alignment: arm and its files", _arm_and_files),
    Check(MISS, "alignment: camera or base moved", _moved, "photograph the plane again"),
    Check(NEXT_THROW, "estimate: E after the fit", _fit),
    Check(NEXT_THROW, "servo", _servo, "check payload and limits: a joint may have saturated"),
    Check(PREDICTION, "motion played: folding", _bend),
]

AIMED = (_tip, _played, _bend)  # checks of a throw at a target
