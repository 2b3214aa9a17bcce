"""The page of one experiment: whether and when the tip hit, and how the throws changed on the way."""

import base64
import io
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from PIL import Image

from strandcast.records.estimate import UNDER_PREVIOUS, Estimate
from strandcast.records.summary import TRIAL_COLUMNS, ExperimentSummary, TrialSummary
from strandcast.records.verdict import Verdict
from strandcast.report.facts import Facts
from strandcast.report.first_screen import doubts, first_figures, next_step, readable_motion
from strandcast.report.numbers import counted, millimetres
from strandcast.report.pages import csv_link, render
from strandcast.report.panels.content import make_sections
from strandcast.report.panels.page_data import ExperimentPageData
from strandcast.report.panels.registry import panels_of
from strandcast.report.provenance import experiment_provenance, mixed_versions
from strandcast.report.results import TrialResults, read_results
from strandcast.report.text import CITATION, NO_TARGET, NOT_READ, Badge, uncertain_verdict, verdict_badge

THUMBNAIL_PX = 320
MOST_PIXELS = 40_000_000  # as of a video's frame


class TrialRow(NamedTuple):
    """One trial in the table and among the thumbnails."""

    line: TrialSummary
    predicted_m: float | None  # E under the string that was fitted to the trials before
    folder: str
    badge: Badge
    remark: str
    thumbnail: str | None


def experiment_page(
    summary: ExperimentSummary,
    trials: Mapping[int, Path],
    *,
    next_motion: Path | None = None,
    facts: Facts | None = None,
) -> str:
    """Return the HTML page of one experiment from its summary and the folders of all its trials' results."""
    facts = facts or Facts()
    results = {trial: read_results(folder) for trial, folder in sorted(trials.items())}
    folder = next(iter(results.values())).folder.parent if results else Path()
    uncertain = summary.hit_trial is not None and uncertain_verdict(results[summary.hit_trial])
    page = ExperimentPageData(summary, results, folder, next_motion, facts)
    last, upcoming = page.last_counted, readable_motion(next_motion)
    found = {f"trial {line.trial}": page.checks[line.trial] for line in summary.counted()}
    return render(
        "experiment.html.jinja",
        summary=summary,
        aimed=page.aimed,
        title=facts.title,
        badge=_badge(summary, uncertain=uncertain),
        headline=_headline(summary, uncertain=uncertain),
        unread=summary.all_unread(),
        figures=[] if last is None else first_figures(last, upcoming),
        doubts=doubts(found) if found else None,
        next_step=next_step(last, upcoming, facts.play_command),
        csv=csv_link(
            [[getattr(line, name) for name in TRIAL_COLUMNS] for line in summary.trials],
            TRIAL_COLUMNS,
            "trials",
        ),
        rows=[_row(line, results[line.trial]) for line in summary.trials],
        sections=make_sections(panels_of("experiment"), page),
        citation=CITATION,
        mixed_versions=mixed_versions(summary.made_with),
        provenance=experiment_provenance(results, summary.made_with, facts),
    )


def _badge(summary: ExperimentSummary, *, uncertain: bool) -> Badge:
    if summary.verdict == "unknown":
        return NOT_READ
    if summary.target_m is None:
        return NO_TARGET
    if summary.hit_trial is not None and uncertain:
        return Badge(f"HIT? AT TRIAL {summary.hit_trial}", "◐", "doubtful")
    if summary.hit_trial is not None:
        return Badge(f"HIT AT TRIAL {summary.hit_trial}", "●", "hit")
    return Badge("NO HIT YET", "▲", "miss")


def _headline(summary: ExperimentSummary, *, uncertain: bool) -> str:
    excluded = len(summary.trials) - len(summary.counted())
    trials = counted(len(summary.trials), "trial")
    trials += f", {excluded} of them excluded" if excluded else ""
    if summary.verdict == "unknown":
        return f"Whether the tip hit the target is unknown: results could not be read ({trials})."
    if summary.target_m is None:
        fitted = [line.E_m for line in summary.counted() if line.E_m is not None]
        best = f", fitted to E {millimetres(min(fitted))}" if fitted else ", none of them fitted yet"
        spread = f" to {millimetres(max(fitted))}" if len(fitted) > 1 else ""
        return f"Captured motion without a target: {trials}{best}{spread}."
    if summary.hit_trial is None:
        return f"The tip has not hit the target in {trials}."
    hit = next(line for line in summary.trials if line.trial == summary.hit_trial)
    near = millimetres(hit.miss_m)
    edge = ", too near to the hit radius to be certain" if uncertain else ""
    return f"The tip hit the target at trial {hit.trial}, {near} from its middle{edge} ({trials})."


def _row(line: TrialSummary, results: TrialResults) -> TrialRow:
    verdict: Verdict | None = results.get("verdict")
    remark = f"excluded: {line.excluded}" if line.excluded is not None else ""
    if not remark and verdict is None:
        remark = f"failed: {results.problems['verdict'].what}"
    if not remark and verdict is not None and verdict.reason and verdict.target_m is not None:
        remark = verdict.reason
    badge = verdict_badge(verdict, line.excluded, uncertain=uncertain_verdict(results))
    estimate: Estimate | None = results.get("estimate")
    predicted_m = None if estimate is None else estimate.held_out_m(UNDER_PREVIOUS)
    return TrialRow(line, predicted_m, results.folder.name, badge, remark, _thumbnail(results.get("strobe")))


def _thumbnail(picture: bytes | None) -> str | None:
    """Return a thumbnail as base64, or None if there is no readable picture."""
    if picture is None:
        return None
    out = io.BytesIO()
    try:
        image: Image.Image = Image.open(io.BytesIO(picture), formats=["WEBP"])
        if image.width * image.height > MOST_PIXELS:
            return None
        image = image.convert("RGB")
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return None
    image.thumbnail((THUMBNAIL_PX, THUMBNAIL_PX))
    image.save(out, "WEBP", quality=60, method=4)
    return base64.b64encode(out.getvalue()).decode()
