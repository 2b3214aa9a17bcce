"""The table of all trials of a campaign, as rows of a page and as CSV."""

from collections.abc import Callable
from typing import Any
from urllib.parse import quote

from markupsafe import Markup

from strandcast.core.trial_names import trial_name
from strandcast.records.summary import TRIAL_COLUMNS, TrialSummary, too_near
from strandcast.report.campaign import RIG_QUANTITIES, Campaign, CampaignThrow
from strandcast.report.numbers import UNKNOWN, signed
from strandcast.report.pages import csv_link
from strandcast.report.text import NO_TARGET, Badge, verdict_badge


def page_link(experiment: str, trial: int | None = None, *, named: bool = False) -> Markup:
    """Return a link to the page of an experiment or of one of its trials; `named` shows both of them."""
    if trial is None:
        return Markup('<a href="{}/report.html">{}</a>').format(quote(experiment), experiment)
    page = f"{quote(experiment)}/{trial_name(trial)}/report.html"
    name = f"{experiment}, trial {trial}"
    return Markup('<a href="{}" aria-label="{}">{}</a>').format(page, name, name if named else trial)


def line_badge(line: TrialSummary, hit_radius_m: float) -> Badge:
    """Return the outcome of a trial, from its line of the summary."""
    uncertain = too_near(line, hit_radius_m)
    return verdict_badge(None if line.hit is None else line, line.excluded, uncertain=uncertain)


def chip(badge: Badge) -> Markup:
    """Return a badge as markup, for a cell of a table."""
    return Markup('<span class="chip {} small">{} {}</span>').format(badge.style, badge.shape, badge.word)


def trial_rows(campaign: Campaign) -> list[tuple[str, list[Any], str]]:
    """Return style, cells and remark of each row: unknown trials first, then those not seen, then others."""
    reasons = {(each.experiment, each.trial): each.reasons for each in campaign.outliers()}
    trials = sorted(campaign.trials(), key=_urgency)
    return [_row(each, reasons.get((each.experiment.name, each.line.trial), [])) for each in trials]


def _urgency(each: CampaignThrow) -> int:
    line = each.line
    if line.excluded is not None:
        return 2
    return 0 if each.is_unknown else 1 if line.miss_m is None and each.experiment.aimed else 2


def _row(each: CampaignThrow, reasons: list[str]) -> tuple[str, list[Any], str]:
    line = each.line
    cells = [cell(each) for cell in COLUMNS.values()]
    cells += [_number(quantity.of(line), 1.0, 2) for quantity in RIG_QUANTITIES]
    excluded = [f"excluded: {line.excluded}"] if line.excluded is not None else []
    unread = [f"{file}: {why}" for file, why in line.unread.items()]
    return "excluded" if excluded else "", cells, "; ".join([*excluded, *unread, *reasons])


def _outcome(each: CampaignThrow) -> Markup:
    captured = each.line.excluded is None and not each.experiment.aimed
    return chip(NO_TARGET if captured else line_badge(each.line, each.experiment.hit_radius_m))


def _predicted(line: TrialSummary) -> str:
    ends_m = (line.predicted_p10_m, line.predicted_p90_m)
    return UNKNOWN if None in ends_m else " to ".join(_number(end_m, 1e3, 1) for end_m in ends_m)


def _number(value: float | None, factor: float, digits: int, sigma: float | None = None) -> str:
    """Return a number in the unit of its column, to be sorted by."""
    if value is None:
        return UNKNOWN
    text = signed(f"{value * factor:.{digits}f}")
    return text if sigma is None else f"{text} ± {sigma * factor:.{digits}f}"


COLUMNS: dict[str, Callable[[CampaignThrow], Any]] = {
    "experiment": lambda each: page_link(each.experiment.name),
    "trial": lambda each: page_link(each.experiment.name, each.line.trial),
    "throw": lambda each: each.throw or UNKNOWN,
    "verdict": _outcome,
    "miss [mm]": lambda each: _number(each.line.miss_m, 1e3, 1, each.line.miss_sigma_m),
    "predicted [mm]": lambda each: _predicted(each.line),
    "E planned [mm]": lambda each: _number(each.line.E_planned_m, 1e3, 1),
    "E fit [mm]": lambda each: _number(each.line.E_m, 1e3, 1),
    "tracked [%]": lambda each: _number(each.line.tracked_fraction, 100.0, 1),
    "clock ± [ms]": lambda each: _number(each.line.alignment_offset_se_s, 1e3, 2),
}
HEADS = (*COLUMNS, *(f"{each.name} [{each.unit}]" for each in RIG_QUANTITIES), "remark")


def trials_csv(campaign: Campaign) -> Markup:
    """Return the table of trials as CSV, with the names and units of the summaries."""
    rows = [
        [each.experiment.name, each.throw, *(getattr(each.line, name) for name in TRIAL_COLUMNS)]
        for each in campaign.trials()
    ]
    return csv_link(rows, ["experiment", "throw", *TRIAL_COLUMNS], "campaign")
