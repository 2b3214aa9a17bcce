"""The rig in one table: clocks, video, markers, camera, servo and grasp, each with what is good."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from markupsafe import Markup

from strandcast.report import drawing as draw
from strandcast.report.causes import arm_faults, clamp_to_tip_m, length_fault, slip_in_clamp, slip_words
from strandcast.report.numbers import millimetres, milliseconds, percent, scaled
from strandcast.report.panels.content import PanelContent, Table
from strandcast.report.panels.page_data import TrialPageData
from strandcast.report.results import TrialResults
from strandcast.report.rig_limits import LEAST_MARKER_FRACTION, MOST_DRIFT, MOST_SERVO_RESIDUAL_RAD

STATES = {True: ("PASS", "✓ good"), False: ("WARN", "▲ look"), None: ("NONE", "– unknown")}


class RigCheck(NamedTuple):
    """One row: a part of the rig, what was found, what is good, what to do otherwise; None is unknown."""

    part: str
    good: bool | None
    found: str
    good_is: str
    otherwise: str


def rig(page: TrialPageData) -> PanelContent:
    """Return the health of the rig during this throw."""
    readings = [each for part in PARTS for each in part(page)]
    bad = [reading.part for reading in readings if reading.good is False]
    unknown = sum(reading.good is None for reading in readings)
    finding = f"To look at: {', '.join(bad)}." if bad else "Nothing about the rig stands out."
    finding += f" {unknown} of {len(readings)} could not be read." if unknown else ""
    rows = [
        [
            each.part,
            Markup('<span class="state {}">{}</span>').format(*STATES[each.good]),
            each.found,
            each.good_is,
            each.otherwise,
        ]
        for each in readings
    ]
    heads = ["part of the rig", "state", "found", "good looks like", "otherwise"]
    sources = ["manifest.json", "track.json", "alignment.json", "estimate.json"]
    figure = _clamp_to_tip(page.results) if slip_words(page.results) is not None else None
    return PanelContent(finding, figure, [Table(heads, rows)], sources)


def _clamp_to_tip(results: TrialResults) -> draw.Drawing:
    """Return the distance from the clamp to the tip over time; a held string cannot exceed its length."""
    slip, start_s = slip_in_clamp(results), results.need("alignment").motion_start_s
    assert slip is not None
    figure = draw.new_figure(10.0, 2.6, left=0.07, top=0.96, bottom=0.22)
    axes = figure.add_subplot()
    before = results.robot_time_s() <= results.window_s()[1]
    since_ms = 1e3 * (results.robot_time_s()[before] - start_s)
    axes.plot(since_ms, 1e3 * clamp_to_tip_m(results.need("track"))[before], **draw.MEASURED)
    axes.axhline(1e3 * slip.at_rest_m, **draw.dashes(draw.FITTED), label="length at rest")
    axes.axvline(1e3 * slip.since_start_s, color=draw.INK, linewidth=1.0, label="slip")
    lowest_mm = 800.0 * slip.at_rest_m  # a slip is a few per cent of the length
    axes.set(xlabel=draw.SINCE_START, ylabel="clamp to tip [mm]", ylim=(lowest_mm, None))
    axes.legend(loc="lower right")
    return draw.Drawing(figure, "Distance from the clamp to the tip over time.", (axes,))


def _unread(part: str, results: TrialResults, name: str) -> RigCheck:
    return RigCheck(part, None, results.problems[name].what, "", "")


def _clock(page: TrialPageData) -> Iterator[RigCheck]:
    fit = page.results.get("alignment")
    if fit is None:
        yield _unread("clocks", page.results, "alignment")
        return
    error_s = fit.offset_se_s
    yield RigCheck(
        "clocks: offset",
        None if error_s is None else error_s <= 1e-3,
        milliseconds(fit.offset_s, error_s),
        "± ≤ 1 ms",
        "a faster motion of the hand, a lit LED, or a marker in view all the time",
    )
    yield RigCheck(
        "clocks: drift",
        abs(fit.drift) <= MOST_DRIFT,
        scaled(fit.drift, 1e6, 0, "ppm", fit.drift_se),
        f"within ± {MOST_DRIFT * 1e6:g} ppm",
        "check the frame rate: the camera may not run at the one it reports",
    )
    if fit.source == "fit":
        faults = arm_faults(page.results)
        yield RigCheck(
            "arm and its files",
            not faults,
            "; ".join(fault.what for fault in faults) or "as the video shows the hand",
            "no number contradicts the video",
            "; ".join(fault.fix for fault in faults),
        )
    if fit.base_shift_m is not None:
        yield RigCheck(
            "camera or base moved",
            float(np.hypot(*fit.base_shift_m)) <= 2e-3,
            ", ".join(millimetres(value, digits=2) for value in fit.base_shift_m) + " in x, y",
            "≤ 2 mm since the calibration",
            "photograph the plane again",
        )
    wrong = sum(marker.wrong for marker in fit.markers)
    detections = sum(marker.sightings for marker in fit.markers)
    if detections:
        yield RigCheck(
            "hand's markers: misread",
            wrong <= 0.05 * detections,
            f"{wrong} of {detections} detections rejected",
            "≤ 5 %",
            "more light, shorter exposure, larger markers",
        )


def _video(page: TrialPageData) -> Iterator[RigCheck]:
    manifest, track = page.results.get("manifest"), page.results.get("track_summary")
    if manifest is not None:
        missing = sum(gap.missing for gap in manifest.video.gaps)
        yield RigCheck(
            "video: frames",
            not missing and not manifest.video.duplicates,
            f"{missing} missing, {manifest.video.duplicates} twice",
            "none",
            "a faster disk or link, a lower frame rate",
        )
    if track is None:
        yield _unread("tracking", page.results, "track_summary")
        return
    yield RigCheck(
        "hand's markers: seen",
        track.marker_fraction >= LEAST_MARKER_FRACTION,
        f"{percent(track.marker_fraction)} of frames",
        f"≥ {100 * LEAST_MARKER_FRACTION:g} %",
        "more light, a place on the hand that never turns away",
    )
    yield RigCheck(
        "tip: seen",
        track.tip_fraction >= 0.9,
        f"{percent(track.tip_fraction)} of frames",
        "≥ 90 %",
        "a plain background, a shorter exposure, a brighter string",
    )


def _grasp(page: TrialPageData) -> Iterator[RigCheck]:
    track = page.results.get("track_summary")
    length_m, sigma_m = (
        None if track is None else track.choices.get(k) for k in ("length_m", "length_sigma_m")
    )
    if track is None or not isinstance(length_m, float):
        return
    slip, fault = slip_words(page.results), length_fault(page.results)
    yield RigCheck(
        "grasp: length out of the clamp",
        slip is None and fault is None,
        slip or millimetres(length_m, sigma_m if isinstance(sigma_m, float) else None),
        f"{millimetres(track.length_m)}, as declared",
        "clamp the string harder" if slip is not None else "" if fault is None else fault.fix,
    )
    before = None if page.previous is None else page.previous.get("track_summary")
    before_m = None if before is None else before.choices.get("length_m")
    if isinstance(before_m, float):
        yield RigCheck(
            "grasp: slipped since the trial before",
            abs(length_m - before_m) <= 5e-3,
            millimetres(length_m - before_m),
            "≤ 5 mm",
            "clamp the string harder; exclude the trial in which it slipped",
        )


def _servo(page: TrialPageData) -> Iterator[RigCheck]:
    estimate = page.results.get("estimate")
    servo = None if estimate is None else estimate.servo
    left = [] if servo is None else [value for value in servo.residual_rad if value is not None]
    if servo is None or not left:
        return
    lags = "" if servo.lag_s is None else ", ".join(f"{1e3 * lag:.0f}" for lag in servo.lag_s)
    yield RigCheck(
        "servo",
        max(left) <= MOST_SERVO_RESIDUAL_RAD,
        f"lag {lags} ms; " * bool(lags) + f"{max(left) * 1e3:.1f} mrad rms unexplained at worst",
        f"≤ {1e3 * MOST_SERVO_RESIDUAL_RAD:g} mrad rms unexplained",
        "check payload and limits: a joint may have saturated",
    )


PARTS: tuple[Callable[[TrialPageData], Iterator[RigCheck]], ...] = (_clock, _video, _grasp, _servo)
