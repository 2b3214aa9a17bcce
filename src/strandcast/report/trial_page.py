"""The page of one trial: what happened, how certain it is, and what comes next."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from strandcast.records.estimate import UNDER_PREVIOUS
from strandcast.records.manifest import Manifest
from strandcast.report.causes import probable_causes
from strandcast.report.checks import PASS, STATES, run_checks
from strandcast.report.facts import Facts
from strandcast.report.first_screen import doubts, first_figures, next_step, readable_motion
from strandcast.report.measures import best_guess_m, fit_window
from strandcast.report.numbers import UNKNOWN, fine_millimetres, millimetres, milliseconds, percent
from strandcast.report.pages import render
from strandcast.report.panels.content import make_sections, without_lead
from strandcast.report.panels.page_data import TrialPageData
from strandcast.report.panels.registry import panels_of
from strandcast.report.provenance import mixed_versions, trial_provenance, version_groups
from strandcast.report.results import TrialResults, read_results
from strandcast.report.text import (
    methods,
    missed_from,
    outcome,
    uncertain_verdict,
    verdict_badge,
    warnings_of,
)


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
    excluded = facts.excluded.get(trial)
    results = read_results(folder, excluded=excluded is not None)
    before = None if previous is None else read_results(previous)
    page = TrialPageData(results, before, next_motion, facts)
    causes = probable_causes(results)
    named = {cause.anchor for cause in causes}
    made = make_sections(panels_of("trial"), page, unfolded=named)
    lead, sections = without_lead([each for each in made if excluded is None or not each.optional])
    checks = run_checks(results, next_motion, before)
    verdict, upcoming = results.get("verdict"), readable_motion(next_motion)
    groups = version_groups({folder.name: results})
    return render(
        "trial.html.jinja",
        script="space.js.jinja" if results.in_space() else "viewer.js.jinja",
        experiment=experiment,
        trial=trial,
        title=facts.title,
        excluded=excluded,
        badge=verdict_badge(verdict, excluded, uncertain=uncertain_verdict(results)),
        outcome=outcome(results),
        causes=causes,
        unread=results.unread(),
        figures=first_figures(results, upcoming),
        doubts=doubts({"": checks}),
        next_step=None if excluded else next_step(results, upcoming, facts.play_command, neighbours[1]),
        lead=lead,
        key_figures=_key_figures(results),
        sections=sections,
        broken=[each for each in sections if each.problem is not None],
        checks=sorted(checks, key=lambda check: STATES.index(check.state)),
        passed=sum(check.state == PASS for check in checks),
        warnings=warnings_of(results),
        methods=methods(results),
        mixed_versions=mixed_versions(groups),
        provenance=trial_provenance(results, groups, facts),
        neighbours=neighbours,
    )


def _key_figures(results: TrialResults) -> list[tuple[str, str]]:
    """Return the quantities of all stages, each with its value."""
    figures = [
        (name, UNKNOWN if (record := results.get(source)) is None else text_of(record))
        for name, source, text_of in (KEY_FIGURES if results.aimed() else CAPTURE_FIGURES)
        if source in results.pieces or source not in results.not_made()
    ]
    if results.get("estimate") is not None:
        figures.append(("E and both distances are over", fit_window(results)))
    return figures


def _log_sha(manifest: Manifest) -> str:
    return UNKNOWN if manifest.joint_log is None else manifest.joint_log.sha256[:16] + "…"


# Quantity, the result that gives it, and its text.
KEY_FIGURES: tuple[tuple[str, str, Callable[[Any], str]], ...] = (
    ("miss", "verdict", lambda v: millimetres(v.miss_m, v.miss_sigma_m)),
    ("measured from", "verdict", missed_from),
    ("hit radius", "verdict", lambda v: millimetres(v.hit_radius_m)),
    ("E, with the parameters that planned it", "estimate", lambda e: fine_millimetres(e.E_planned_m)),
    ("E, after the fit", "estimate", lambda e: fine_millimetres(e.E_m)),
    ("rms distance, fit", "estimate", lambda e: fine_millimetres(e.rmse_m)),
    ("mean distance of the tip, fit", "estimate", lambda e: fine_millimetres(e.tip_error_m)),
    ("points tracked", "track_summary", lambda t: percent(t.tracked_fraction)),
    ("frames / expected", "track_summary", lambda t: f"{t.decoded_frames} / {t.expected_frames}"),
    ("lens, rms", "camera", lambda c: f"{c.lens.rms_px:.3f} px"),
    ("plane of motion, rms", "camera", lambda c: f"{c.plane_rms_px:.3f} px"),
    ("clock offset", "alignment", lambda a: milliseconds(a.offset_s, a.offset_se_s)),
    ("video, sha256", "manifest", lambda m: m.video.sha256[:16] + "…"),
    ("joint log, sha256", "manifest", _log_sha),
)
CAPTURE_FIGURES = (
    (
        "E, predicted from the trials before",
        "estimate",
        lambda e: fine_millimetres(e.held_out_m(UNDER_PREVIOUS)),
    ),
    ("E, better guess without a model", "estimate", lambda e: fine_millimetres(best_guess_m(e))),
    *KEY_FIGURES[4:],
)
