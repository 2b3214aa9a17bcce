"""The page of one trial: what happened, how well it is known, and what comes next."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from strandcast.records.summary import Verdict
from strandcast.report.checks import FAIL, PASS, run_checks
from strandcast.report.facts import Facts
from strandcast.report.figures.alignment import alignment
from strandcast.report.figures.calibration import calibration
from strandcast.report.figures.evaluation import evaluation
from strandcast.report.figures.hand_path import hand_path
from strandcast.report.figures.lab_truth import lab_truth
from strandcast.report.figures.next_motion import next_motion as next_motion_figure
from strandcast.report.figures.parameters import masses, parameters
from strandcast.report.figures.strobe import strobe
from strandcast.report.figures.strobe_picture import strobe_picture
from strandcast.report.figures.tip_path import tip_path
from strandcast.report.figures.tracking import tracking
from strandcast.report.numbers import UNKNOWN, millimetres, milliseconds, percent, place
from strandcast.report.pages import render
from strandcast.report.reportlet import Reportlet, attempt
from strandcast.report.results import Results, read_results
from strandcast.report.text import methods, provenance, verdict_chip, warnings_of

FROM_VIDEO = {"picture", "hand", "clocks", "camera"}


class Line(NamedTuple):
    """One line of the verdict's table: what, how much, and the anchor of its evidence."""

    name: str
    value: str
    anchor: str


def trial_page(
    folder: Path,
    *,
    trial: int,
    experiment: str,
    previous: Path | None = None,
    next_motion: Path | None = None,
    facts: Facts | None = None,
) -> str:
    """Return the HTML page of one trial.

    Parameters
    ----------
    folder
        The trial's folder of results.
    trial, experiment
        What the page is about, told also where no result can be read.
    previous
        The folder of the trial before, whose throw is drawn beside this one.
    next_motion
        The motion that was planned after this trial.
    facts
        What no result holds: title, exclusions, known weights, limits, settings.
    """
    facts = facts or Facts()
    results = read_results(folder)
    before = None if previous is None else read_results(previous)
    reportlets = _reportlets(results, before, next_motion, facts)
    checks = run_checks(results, next_motion)
    broken = [each for each in reportlets if each.problem is not None]
    return render(
        "trial.html.jinja",
        experiment=experiment,
        trial=trial,
        title=facts.title,
        excluded=facts.excluded.get(trial),
        chip=verdict_chip(results.get("verdict"), facts.excluded.get(trial)),
        verdict=results.get("verdict"),
        lines=_lines(results),
        reportlets=reportlets,
        broken=broken,
        checks=checks,
        failed=sum(check.state == FAIL for check in checks),
        passed=sum(check.state == PASS for check in checks),
        warnings=warnings_of(results),
        methods=methods(results),
        provenance=provenance(results, facts),
        previous=None if previous is None else previous.name,
    )


def _reportlets(
    results: Results, before: Results | None, next_motion: Path | None, facts: Facts
) -> list[Reportlet]:
    plan: list[tuple[Any, ...]] = [
        ("picture", "Strobe picture of the throw", strobe_picture, results),
        ("strobe", "The throw at equal steps of the tip’s path", strobe, results, before),
        ("tip", "Tip path, measured and simulated", tip_path, results),
        ("hand", "Hand path: commanded, measured, seen", hand_path, results),
        ("fit", "Evaluation value E and the search", evaluation, results),
        ("parameters", "String parameters", parameters, results),
        ("masses", "Masses along the string", masses, results, facts),
        (
            "next",
            "The next motion",
            next_motion_figure,
            next_motion,
            results.folder,
            results.get("motion"),
            facts,
        ),
        ("tracking", "Tracking quality", tracking, results),
        ("clocks", "Alignment of the clocks", alignment, results),
        ("camera", "Calibration", calibration, results),
    ]
    if results.path("lab_truth").exists():
        plan.append(("truth", "Lab truth", lab_truth, results))
    if results.supplied():
        there = next_motion is not None
        plan = [each for each in plan if each[0] not in FROM_VIDEO and (there or each[0] != "next")]
    return [attempt(*each) for each in plan]


def _missed(verdict: Verdict) -> str:
    """Return what a verdict's miss is from."""
    if verdict.wanted is not None:
        return f"{verdict.wanted}; what lacks of direction, speed or height counts as metres"
    if verdict.bar_m is None:
        return f"the target at {place(verdict.target_m)}"
    return f"the bar from {place(verdict.bar_m[0])} to {place(verdict.bar_m[1])}"


def _lines(results: Results) -> list[Line]:
    """Return the figures that decide, each with the way down to its evidence."""
    verdict, estimate = results.get("verdict"), results.get("estimate")
    summary, camera, clock = results.get("track_summary"), results.get("camera"), results.get("alignment")
    manifest = results.get("manifest")
    rows: list[tuple[str, Any, Any, str]] = [
        ("miss", verdict, lambda v: millimetres(v.miss_m, v.miss_sigma_m), "strobe"),
        ("missed is", verdict, _missed, "strobe"),
        ("hit radius", verdict, lambda v: millimetres(v.hit_radius_m), "strobe"),
        ("E, parameters that planned it", estimate, lambda e: millimetres(e.E_planned_m, digits=2), "fit"),
        ("E, after the fit", estimate, lambda e: millimetres(e.E_m, digits=2), "fit"),
        ("rms distance, fit", estimate, lambda e: millimetres(e.rmse_m, digits=2), "fit"),
        ("mean distance of the tip, fit", estimate, lambda e: millimetres(e.tip_error_m, digits=2), "tip"),
        ("points tracked", summary, lambda s: percent(s.tracked_fraction), "tracking"),
        (
            "frames decoded / expected",
            summary,
            lambda s: f"{s.decoded_frames} / {s.expected_frames}",
            "checks",
        ),
        ("lens, rms", camera, lambda c: f"{c.lens.rms_px:.3f} px", "camera"),
        ("plane of motion, rms", camera, lambda c: f"{c.plane_rms_px:.3f} px", "camera"),
        ("clock offset", clock, lambda a: milliseconds(a.offset_s, a.offset_se_s), "clocks"),
        ("video, sha256", manifest, lambda m: m.video.sha256[:16] + "…", "provenance"),
        (
            "joint log, sha256",
            manifest,
            lambda m: UNKNOWN if m.joint_log is None else m.joint_log.sha256[:16] + "…",
            "provenance",
        ),
    ]
    return [
        Line(name, UNKNOWN if record is None else tell(record), anchor) for name, record, tell, anchor in rows
    ]
