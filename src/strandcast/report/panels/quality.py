"""All checks of all trials in one table: which trial failed what."""

from urllib.parse import quote

from markupsafe import Markup

from strandcast.report.checks import FAIL, NEXT_MOTION, NOT_RUN, PASS, WARN
from strandcast.report.panels.content import PanelContent, Table
from strandcast.report.panels.page_data import ExperimentPageData

MARKS = {PASS: "✓", WARN: "▲", FAIL: "✕", NOT_RUN: "–"}


def quality(page: ExperimentPageData) -> PanelContent:
    """Return the matrix of trials and checks; a mark leads to the checks on the trial's page."""
    trials = list(page.trials)
    by_check: dict[str, dict[int, str]] = {}
    for trial, checks in page.checks.items():
        for check in checks:
            if check.name != NEXT_MOTION:  # it has its own section
                by_check.setdefault(check.name, {})[trial] = check.state
    rows = [
        [name, *(_mark(page, trial, states.get(trial, NOT_RUN)) for trial in trials)]
        for name, states in by_check.items()
        if set(states.values()) != {PASS}
    ]
    states = [state for each in by_check.values() for state in each.values()]
    warned, failed = states.count(WARN), states.count(FAIL)
    finding = f"{states.count(PASS)} of {len(states)} checks passed, {warned} warned, {failed} failed."
    left_out = f"{len(by_check) - len(rows)} checks that every trial passed are left out."
    return PanelContent(
        finding, tables=[Table(["check", *(f"trial {trial}" for trial in trials)], rows, left_out)]
    )


def _mark(page: ExperimentPageData, trial: int, state: str) -> Markup:
    """Return the mark of a check with its state in words, as a link to the trial's checks."""
    folder = quote(page.trials[trial].folder.name)
    return Markup('<a class="state {}" href="{}/report.html#checks" aria-label="{}">{}</a>').format(
        state, folder, f"trial {trial}: {state.lower()}", MARKS[state]
    )
