"""The page of one trial: what happened, how certain it is, and what comes next."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from strandcast.records.estimate import UNDER_PREVIOUS
from strandcast.records.manifest import Manifest
from strandcast.records.verdict import Verdict
from strandcast.report.causes import probable_causes
from strandcast.report.checks import FAIL, PASS, run_checks
from strandcast.report.facts import Facts
from strandcast.report.measures import best_guess_m, fit_window
from strandcast.report.numbers import UNKNOWN, millimetres, milliseconds, percent, place
from strandcast.report.pages import render
from strandcast.report.panels.content import make_sections
from strandcast.report.panels.page_data import TrialPageData
from strandcast.report.panels.registry import panels_of
from strandcast.report.provenance import mixed_versions, trial_provenance, version_groups
from strandcast.report.results import TrialResults, read_results
from strandcast.report.text import methods, outcome, uncertain_verdict, verdict_badge, warnings_of


class KeyFigure(NamedTuple):
    """One row of the table at the top: a quantity, its value, and the anchor of its evidence."""

    name: str
    value: str
    anchor: str


def trial_page(
    folder: Path,
    *,
    trial: int,
    experiment: str,
    previous: Path | None = None,
    neighbours: tuple[int | None, int | None] = (None, None),
    next_motion: Path | None = None,
    facts: Facts | None = None,
) -> str:
    """Return the HTML page of one trial from its folder of results.

    `trial` and `experiment` are shown even if no result can be read. `previous` is the folder of the trial
    before, drawn beside this one; `next_motion` was planned after this trial. `neighbours` are the trials
    before and after this one that have pages, too.
    """
    facts = facts or Facts()
    results = read_results(folder)
    before = None if previous is None else read_results(previous)
    page = TrialPageData(results, before, next_motion, facts)
    sections = make_sections(panels_of("trial"), page)
    causes = probable_causes(results)
    checks = run_checks(results, next_motion)
    verdict = results.get("verdict")
    groups = version_groups({folder.name: results})
    return render(
        "trial.html.jinja",
        script="space.js.jinja" if results.in_space() else "viewer.js.jinja",
        experiment=experiment,
        trial=trial,
        title=facts.title,
        excluded=facts.excluded.get(trial),
        badge=verdict_badge(verdict, facts.excluded.get(trial), uncertain=uncertain_verdict(results)),
        outcome=outcome(results),
        causes=causes,
        unread=results.unread(),
        key_figures=_key_figures(results),
        sections=sections,
        sound=not causes and not results.unread() and not any(check.state == FAIL for check in checks),
        broken=[each for each in sections if each.problem is not None],
        checks=checks,
        failed=sum(check.state == FAIL for check in checks),
        passed=sum(check.state == PASS for check in checks),
        warnings=warnings_of(results),
        methods=methods(results),
        mixed_versions=mixed_versions(groups),
        provenance=trial_provenance(results, groups, facts),
        neighbours=neighbours,
    )


def _missed(verdict: Verdict) -> str:
    """Return in words what the miss is measured from."""
    if verdict.wanted is not None:
        return f"{verdict.wanted}; a shortfall in direction, speed or height counts as metres"
    if verdict.bar_m is None:
        return f"the target at {place(verdict.target_m)}"
    return f"the bar from {place(verdict.bar_m[0])} to {place(verdict.bar_m[1])}"


def _key_figures(results: TrialResults) -> list[KeyFigure]:
    """Return the most important numbers, each with a link to its evidence."""
    figures = [
        KeyFigure(name, UNKNOWN if (record := results.get(source)) is None else text_of(record), anchor)
        for name, source, text_of, anchor in (KEY_FIGURES if results.aimed() else CAPTURE_FIGURES)
        if source not in results.not_made()
    ]
    if results.in_space():  # the throw is drawn from two sides
        figures = [figure._replace(anchor=IN_SPACE.get(figure.anchor, figure.anchor)) for figure in figures]
    if results.get("estimate") is not None:
        after = next(k for k, figure in enumerate(figures) if figure.anchor == "tracking")
        figures.insert(after, KeyFigure("E and both distances are over", fit_window(results), "fit"))
    return figures


def _fine(length_m: float | None) -> str:
    return millimetres(length_m, digits=2)


def _log_sha(manifest: Manifest) -> str:
    return UNKNOWN if manifest.joint_log is None else manifest.joint_log.sha256[:16] + "…"


IN_SPACE = {"strobe": "views"}  # anchor of a panel in the plane -> of the one in space
# Quantity, the result that gives it, its text, and the anchor of its evidence.
KEY_FIGURES: tuple[tuple[str, str, Callable[[Any], str], str], ...] = (
    ("miss", "verdict", lambda v: millimetres(v.miss_m, v.miss_sigma_m), "strobe"),
    ("measured from", "verdict", _missed, "strobe"),
    ("hit radius", "verdict", lambda v: millimetres(v.hit_radius_m), "strobe"),
    ("E, with the parameters that planned it", "estimate", lambda e: _fine(e.E_planned_m), "fit"),
    ("E, after the fit", "estimate", lambda e: _fine(e.E_m), "fit"),
    ("rms distance, fit", "estimate", lambda e: _fine(e.rmse_m), "fit"),
    ("mean distance of the tip, fit", "estimate", lambda e: _fine(e.tip_error_m), "fit"),
    ("points tracked", "track_summary", lambda t: percent(t.tracked_fraction), "tracking"),
    (
        "frames / expected",
        "track_summary",
        lambda t: f"{t.decoded_frames} / {t.expected_frames}",
        "checks",
    ),
    ("lens, rms", "camera", lambda c: f"{c.lens.rms_px:.3f} px", "camera"),
    ("plane of motion, rms", "camera", lambda c: f"{c.plane_rms_px:.3f} px", "camera"),
    ("clock offset", "alignment", lambda a: milliseconds(a.offset_s, a.offset_se_s), "clocks"),
    ("video, sha256", "manifest", lambda m: m.video.sha256[:16] + "…", "provenance"),
    ("joint log, sha256", "manifest", _log_sha, "provenance"),
)
CAPTURE_FIGURES = (
    ("E, predicted from the trials before", "estimate", lambda e: _fine(e.held_out_m(UNDER_PREVIOUS)), "fit"),
    ("E, better guess without a model", "estimate", lambda e: _fine(best_guess_m(e)), "fit"),
    *KEY_FIGURES[4:],
)
