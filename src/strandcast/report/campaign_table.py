"""The table of all trials of a campaign, as rows of a page and as CSV."""

from typing import Any, NamedTuple
from urllib.parse import quote

from markupsafe import Markup

from strandcast.core.trial_names import trial_name
from strandcast.records.summary import TRIAL_COLUMNS, TrialSummary, too_near
from strandcast.report.campaign import RIG_QUANTITIES, Campaign, CampaignThrow
from strandcast.report.numbers import UNKNOWN, signed
from strandcast.report.pages import csv_link
from strandcast.report.text import NO_TARGET, Badge, verdict_badge

HEADS = (
    *(
        "experiment",
        "trial",
        "throw",
        "verdict",
        "miss [mm]",
        "predicted [mm]",
        "E planned [mm]",
        "E fit [mm]",
    ),
    *("tracked [%]", "clock ± [ms]", *(f"{each.name} [{each.unit}]" for each in RIG_QUANTITIES), "remark"),
)


class CampaignRow(NamedTuple):
    """One trial in the table: the style of its row, its verdict, its cells, its remark."""

    style: str
    cells: list[Any]
    remark: str


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


def trial_rows(campaign: Campaign) -> list[CampaignRow]:
    """Return the rows of the table: unknown trials first, then those not seen, then all others in order."""
    reasons = {(each.experiment, each.trial): each.reasons for each in campaign.outliers()}
    trials = sorted(campaign.trials(), key=_urgency)
    return [_row(each, reasons.get((each.experiment, each.line.trial), [])) for each in trials]


def _urgency(each: CampaignThrow) -> int:
    line = each.line
    if line.excluded is not None:
        return 2
    return 0 if each.is_unknown else 1 if line.miss_m is None and each.aimed else 2


def _row(each: CampaignThrow, reasons: list[str]) -> CampaignRow:
    line = each.line
    captured = line.excluded is None and not each.aimed
    predicted = (line.predicted_p10_m, line.predicted_p90_m)
    cells = [
        page_link(each.experiment),
        page_link(each.experiment, line.trial),
        each.throw or UNKNOWN,
        chip(NO_TARGET if captured else line_badge(line, each.hit_radius_m)),
        _number(line.miss_m, 1e3, 1, line.miss_sigma_m),
        UNKNOWN if None in predicted else " to ".join(_number(value, 1e3, 1) for value in predicted),
        _number(line.E_planned_m, 1e3, 1),
        _number(line.E_m, 1e3, 1),
        _number(line.tracked_fraction, 100.0, 1),
        _number(line.alignment_offset_se_s, 1e3, 2),
        *(_number(quantity.of(line), 1.0, 2) for quantity in RIG_QUANTITIES),
    ]
    excluded = [f"excluded: {line.excluded}"] if line.excluded is not None else []
    unread = [f"{file}: {why}" for file, why in line.unread.items()]
    return CampaignRow("excluded" if excluded else "", cells, "; ".join([*excluded, *unread, *reasons]))


def _number(value: float | None, factor: float, digits: int, sigma: float | None = None) -> str:
    """Return a number in the unit of its column, to be sorted by."""
    if value is None:
        return UNKNOWN
    text = signed(f"{value * factor:.{digits}f}")
    return text if sigma is None else f"{text} ± {sigma * factor:.{digits}f}"


def trials_csv(campaign: Campaign) -> Markup:
    """Return the table of trials as CSV, with the names and units of the summaries."""
    rows = [
        [each.experiment, each.throw, *(getattr(each.line, name) for name in TRIAL_COLUMNS)]
        for each in campaign.trials()
    ]
    return csv_link(rows, ["experiment", "throw", *TRIAL_COLUMNS], "campaign")
