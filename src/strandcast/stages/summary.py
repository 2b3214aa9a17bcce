"""The experiment's page and its summary in numbers, from results only."""

from __future__ import annotations

from pathlib import Path

from strandcast.records.files import write_text
from strandcast.report.experiment_page import experiment_page
from strandcast.report.summary import summarise
from strandcast.stages.context import context_of
from strandcast.stages.pages import facts_of, next_motion_of, no_such_trial


def run(root: Path, name: str, trials: list[int] | None = None) -> None:
    """Write {summary.json, report.html} of results/<experiment>; by default for all trials with a page."""
    context = context_of(root, name)
    settings, results = context.settings, context.folder.results
    numbers = trials or _with_results(results)
    for number in set(numbers) - set(_with_results(results)):
        raise no_such_trial(context, number)
    folders = {number: context.folder.trial(number).results for number in numbers}
    next_motion = next_motion_of(context, numbers[-1] if numbers else 0)
    summary = summarise(
        name,
        folders,
        string_length_m=settings.string.length_m,
        target_m=list(settings.target_m),
        hit_radius_m=settings.hit_radius_m,
        excluded={exclusion.trial: exclusion.reason for exclusion in settings.excluded},
        next_motion=next_motion,
    )
    page = experiment_page(summary, folders, next_motion=next_motion, facts=facts_of(context, next_motion))
    summary.write(results / "summary.json")
    write_text(results / "report.html", page)


def _with_results(results: Path) -> list[int]:
    """Return the trials that have a page of their own."""
    pages = results.glob("trial-[0-9][0-9]/report.html")
    return sorted(int(page.parent.name.removeprefix("trial-")) for page in pages)
