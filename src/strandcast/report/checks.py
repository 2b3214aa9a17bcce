"""Every check of one trial with its result: "all passed" is proven by the list."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.motion import Motion
from strandcast.report.numbers import millimetres, milliseconds, percent
from strandcast.report.results import FILES, Results

PASS, WARN, FAIL, NOT_RUN = "PASS", "WARN", "FAIL", "NOT RUN"
OPTIONAL = {"lab_truth"}


class Check(NamedTuple):
    """One check: what is asked, how it came out, what was found, what was wanted."""

    name: str
    state: str
    found: str
    wanted: str


class Outcome(NamedTuple):
    """What one check found: whether it is good, in words what was found, and in words what was wanted."""

    good: bool
    found: str
    wanted: str


def run_checks(results: Results, next_motion: Path | None) -> list[Check]:
    """Return the checks of one trial, those that could not run among them with the reason."""
    checks = [
        _readable(results, name)
        for name in FILES
        if name not in results.problems or name not in OPTIONAL | results.not_made()
    ]
    checks += [_run(name, severity, check, results) for name, severity, check in CHECKS]
    checks.append(_next_motion(next_motion))
    return checks


def _readable(results: Results, name: str) -> Check:
    problem = results.problems.get(name)
    what = f"{FILES[name].removeprefix('../')} can be read and is unchanged"
    if problem is None:
        return Check(what, PASS, "read and verified", "there, whole, of this version")
    return Check(what, FAIL, problem.what, "there, whole, of this version")


def _run(name: str, severity: str, check: Callable[[Results], Outcome | None], results: Results) -> Check:
    try:
        outcome = check(results)
    except StrandcastError as problem:
        return Check(name, NOT_RUN, problem.what, "")
    if outcome is None:
        return Check(name, NOT_RUN, "nothing to check", "")
    return Check(name, PASS if outcome.good else severity, outcome.found, outcome.wanted)


def _next_motion(path: Path | None) -> Check:
    name = "next motion: planned, whole, without flags"
    if path is None:
        return Check(name, NOT_RUN, "none was given", "")
    try:
        motion = Motion.read(path)
    except StrandcastError as problem:
        return Check(name, FAIL, problem.what, "readable, its hash right")
    flags = motion.provenance.flags if motion.provenance is not None else []
    return Check(name, WARN if flags else PASS, ", ".join(flags) or "no flags", "no flags of the planner")


def _frames(results: Results) -> Outcome:
    summary = results.need("track_summary")
    found = f"{summary.decoded_frames} decoded, {summary.expected_frames} expected"
    return Outcome(summary.decoded_frames == summary.expected_frames, found, "as many as the manifest says")


def _header(results: Results) -> Outcome | None:
    video = results.need("manifest").video
    if video.header_frames is None:
        return None
    found = f"{video.packets} packets, {video.header_frames} in the header"
    return Outcome(video.packets == video.header_frames, found, "the same number")


def _video_gaps(results: Results) -> Outcome:
    video = results.need("manifest").video
    missing = sum(gap.missing for gap in video.gaps)
    found = f"{len(video.gaps)} gaps ({missing} frames), {video.duplicates} duplicates"
    return Outcome(not video.gaps and not video.duplicates, found, "none")


def _log_gaps(results: Results) -> Outcome | None:
    log = results.need("manifest").joint_log
    if log is None:
        return None
    longest = max((gap.duration_s for gap in log.gaps), default=0.0)
    found = f"{len(log.gaps)} gaps (longest {milliseconds(longest, digits=0)}), {log.duplicates} duplicates"
    return Outcome(not log.gaps and not log.duplicates, found, "none")


def _played(results: Results) -> Outcome | None:
    planned, played = results.need("motion").content_sha256(), results.need("manifest").motion_sha256
    if played is None:
        return None
    return Outcome(planned == played, f"planned {planned[:12]}…, played {played[:12]}…", "the same hash")


def _lens(results: Results) -> Outcome:
    rms_px = results.need("camera").lens.rms_px
    return Outcome(rms_px <= 0.5, f"{rms_px:.3f} px", "≤ 0.5 px rms")


def _plane(results: Results) -> Outcome:
    rms_px = results.need("camera").plane_rms_px
    return Outcome(rms_px <= 1.0, f"{rms_px:.3f} px", "≤ 1 px rms")


def _tracked(results: Results) -> Outcome:
    fraction = results.need("track_summary").tracked_fraction
    return Outcome(fraction >= 0.8, percent(fraction), "≥ 80 % of points without a flag")


def _sigma(results: Results) -> Outcome:
    sigma_m = results.need("track_summary").median_sigma_m
    return Outcome(sigma_m <= 0.003, millimetres(sigma_m, digits=2), "≤ 3 mm (median σ)")


def _length(results: Results) -> Outcome | None:
    length_m = results.need("track_summary").length_m
    measured_m = np.linalg.norm(np.diff(results.need("track").points_m, axis=1), axis=2).sum(axis=1)
    if not np.isfinite(measured_m).any():
        return None
    median_m = float(np.nanmedian(measured_m))
    good = abs(median_m / length_m - 1.0) <= 0.03
    return Outcome(good, f"{millimetres(median_m)} measured", f"{millimetres(length_m)} ± 3 %")


def _tip(results: Results) -> Outcome:
    verdict = results.need("verdict")
    found = verdict.reason or f"seen, miss {millimetres(verdict.miss_m, verdict.miss_sigma_m)}"
    return Outcome(verdict.miss_m is not None, found, "tip seen at the closest approach")


def _offset(results: Results) -> Outcome | None:
    error_s = results.need("alignment").offset_se_s
    if error_s is None:
        return None
    return Outcome(error_s <= 0.002, f"± {milliseconds(error_s)}", "≤ 2 ms (standard error)")


def _drift(results: Results) -> Outcome:
    drift = results.need("alignment").drift
    return Outcome(abs(drift) <= 1e-4, f"{drift * 1e6:.1f} ppm".replace("-", "−"), "≤ 100 ppm")


def _hand(results: Results) -> Outcome | None:
    residual_m = results.need("alignment").residual_rms_m
    if residual_m is None:
        return None
    return Outcome(residual_m <= 0.005, millimetres(residual_m, digits=2), "≤ 5 mm rms")


def _fit(results: Results) -> Outcome:
    error_m = results.need("estimate").E_m
    return Outcome(
        error_m <= 0.008, millimetres(error_m, digits=2), "≤ 8 mm; beyond it the next throw often misses"
    )


def _bounds(results: Results) -> Outcome:
    estimate = results.need("estimate")
    names = [fit.name for fit in estimate.parameters if fit.at_bound]
    names += [f"mass at {weight.place_m * 1e3:.0f} mm" for weight in estimate.weights if weight.at_bound]
    return Outcome(not names, ", ".join(names) or "none", "no estimate at a bound")


def _bend(results: Results) -> Outcome | None:
    predicted = results.need("motion").predicted
    if predicted is None:
        return None
    bend_deg = float(np.degrees(predicted.largest_bend_rad))
    return Outcome(
        bend_deg <= 57.0, f"{bend_deg:.0f}°", "≤ 57° between neighbours: beyond it the model is wrong"
    )


CHECKS: list[tuple[str, str, Callable[[Results], Outcome | None]]] = [
    ("video: frames decoded", FAIL, _frames),
    ("video: packets against header", WARN, _header),
    ("video: gaps and duplicates", WARN, _video_gaps),
    ("joint log: gaps and duplicates", WARN, _log_gaps),
    ("played motion is the planned one", FAIL, _played),
    ("calibration: lens", WARN, _lens),
    ("calibration: plane of motion", WARN, _plane),
    ("track: points seen", WARN, _tracked),
    ("track: σ", WARN, _sigma),
    ("track: length of the string", WARN, _length),
    ("track: tip at the closest approach", WARN, _tip),
    ("alignment: offset's error", WARN, _offset),
    ("alignment: drift", WARN, _drift),
    ("alignment: hand's residual", WARN, _hand),
    ("estimate: E after the fit", WARN, _fit),
    ("estimate: bounds", WARN, _bounds),
    ("motion played: folding", WARN, _bend),
]
