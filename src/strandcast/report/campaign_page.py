"""The page of a campaign: what failed first, then misses and hits over all experiments, and every trial."""

from collections import Counter
from collections.abc import Iterator
from typing import Any

from markupsafe import Markup

from strandcast.records.summary import VersionGroup, group_by_versions
from strandcast.report.campaign import (
    BEYOND_PREDICTION,
    MOST_ROBUST_Z,
    Campaign,
    CampaignExperiment,
    CampaignTally,
)
from strandcast.report.campaign_table import HEADS, chip, line_badge, page_link, trial_rows, trials_csv
from strandcast.report.numbers import UNKNOWN, counted, millimetres, percent, place
from strandcast.report.pages import render
from strandcast.report.panels.campaign import learning, rig_course, throw_misses
from strandcast.report.panels.content import Panel, PanelContent, Table, make_sections
from strandcast.report.provenance import mixed_versions, version_tables
from strandcast.report.text import CITATION, NO_TARGET, NOT_READ, Badge, software_sentence

MOST_OUTLIERS = 40  # listed by name; the remarks in the table of trials hold all
VERDICTS = {
    "hit": Badge("HIT", "●", "hit"),
    "no hit": Badge("NO HIT", "▲", "miss"),
    "unknown": NOT_READ,
    "no target": NO_TARGET,
}


def campaign_page(campaign: Campaign) -> str:
    """Return the HTML page of a campaign. It is made from the experiments' summaries alone."""
    tally = campaign.tally()
    troubles = list(_troubles(campaign))
    words = Counter(badge.word for _, badge, _ in troubles)
    groups = _version_groups(campaign)
    return render(
        "campaign.html.jinja",
        script="table.js.jinja",
        tally=tally,
        badge=_badge(tally),
        headline=headline(tally),
        troubles=troubles,
        trouble=", ".join(f"{count} {word.lower()}" for word, count in words.items()),
        experiments=_experiments(campaign),
        sections=make_sections(CAMPAIGN_PANELS, campaign),
        heads=HEADS,
        rows=trial_rows(campaign),
        csv=trials_csv(campaign),
        methods=campaign_methods(campaign, tally, groups),
        mixed_versions=mixed_versions(groups),
        provenance=[_hashes(campaign), *version_tables(groups)],
    )


def headline(tally: CampaignTally) -> str:
    """Return in a sentence what is known of a campaign."""
    hit, missed, unknown = (tally.experiments[name] for name in ("hit", "no hit", "unknown"))
    count = hit + missed + unknown
    have = "has" if 1 in (hit, count) else "have"
    text = f"{hit} of {count} experiment{'' if count == 1 else 's'} {have} hit"
    text += f", {missed} {'has' if missed == 1 else 'have'} not" if missed else ""
    if tally.captured:
        captured = f"{tally.captured} {'has' if tally.captured == 1 else 'have'} no target"
        text = f"{text}; {captured}" if count else f"{captured}: motion was captured and fitted"
    return text + (f"; {unknown} {'is' if unknown == 1 else 'are'} unknown." if unknown else ".")


def campaign_methods(campaign: Campaign, tally: CampaignTally, groups: list[VersionGroup]) -> str:
    """Return a paragraph for a paper: what was counted and how. Each trial's page has methods of its own."""
    sentences = list(_counted_throws(campaign, tally))
    if tally.captured:
        sentences.append(f"{counted(tally.captured, 'experiment')} without a target gave no throws.")
    sentences.append(f"The loop is that of {CITATION}, as implemented by strandcast.")
    sentences += [software_sentence(groups[0].versions)] if len(groups) == 1 else []
    return " ".join(sentences)


def _counted_throws(campaign: Campaign, tally: CampaignTally) -> Iterator[str]:
    """Yield in sentences how many throws and hits were counted, and by what rules."""
    throws = [each for each in campaign.trials() if each.throw is not None]
    if not throws:
        return
    thrown = len({each.experiment.name for each in throws})
    were = "was" if len(throws) == 1 else "were"
    text = f"{counted(len(throws), 'throw')} of {counted(thrown, 'experiment')} {were} counted"
    if tally.excluded:
        were = "was excluded, with a reason" if tally.excluded == 1 else "were excluded, with reasons"
        text += f"; {counted(tally.excluded, 'trial')} {were}"
    unknown = sum(each.is_unknown for each in throws)
    text += f"; the outcome of {counted(unknown, 'throw')} is unknown" if unknown else ""
    radii = {each.experiment.hit_radius_m for each in throws}
    limits = " or ".join(map(millimetres, sorted(radii))) + (" (by experiment)" if len(radii) > 1 else "")
    yield (
        f"{text}. The miss is the least distance between the tracked tip and the target, or how far a throw "
        f"with another objective fell short of it; a miss of at most {limits} is a hit."
    )
    last = next((each for each in reversed(campaign.hit_shares()) if each.known), None)
    if last is not None:
        yield (
            f"By throw {last.throw}, {last.hits} of {counted(last.known, 'experiment')} had hit (95 % Wilson "
            f"interval {percent(last.low)} to {percent(last.high)}); those of unknown outcome are left out, "
            "a tip that was not seen counts as a miss, and those that stopped without a hit count as not hit."
        )
    if tally.uncertain:
        yield (
            f"{counted(tally.uncertain, 'throw')} within two standard deviations of the tracked tip from the "
            f"hit radius {'counts' if tally.uncertain == 1 else 'count'} as measured."
        )


def _has_throws(campaign: Campaign) -> bool:
    return campaign.most_throws() > 0


def _badge(tally: CampaignTally) -> Badge:
    unknown, hit = tally.experiments["unknown"], tally.experiments["hit"]
    count = sum(tally.experiments.values())
    if not count and tally.captured:
        return NO_TARGET
    if unknown or not count:
        return NOT_READ._replace(word=f"{unknown} UNKNOWN" if count else "NO EXPERIMENT")
    return VERDICTS["hit" if hit == count else "no hit"]._replace(word=f"{hit} OF {count} HIT")


def _troubles(campaign: Campaign) -> Iterator[tuple[Markup, Badge, str]]:
    """Yield what failed or is unknown, experiments first: the experiment or its trial, its state, and why."""
    for each in campaign.experiments:
        if each.summary is None:
            yield Markup("{}").format(each.name), NOT_READ, each.problem or "no summary"
        for file, why in each.summary.unread.items() if each.summary is not None else ():
            yield page_link(each.name), NOT_READ, f"{file}: {why}"
    for each in campaign.experiments:
        for line in each.throws:
            if line.unread or (line.hit is None and each.aimed):
                why = "; ".join(f"{file}: {reason}" for file, reason in line.unread.items())
                badge = line_badge(line, each.hit_radius_m) if line.hit is not None else NOT_READ
                yield page_link(each.name, line.trial, named=True), badge, why or "no verdict"
        for trial in each.waiting:
            where = Markup("{}").format(f"{each.name}, trial {trial.trial}")
            waits = Badge("WAITING", "◌", "excluded")
            badge = waits if trial.failure is None else NOT_READ._replace(word="FAILED")
            yield where, badge, trial.failure or "thrown, but not in the experiment’s summary"


def _experiments(campaign: Campaign) -> Table:
    heads = ["experiment", "verdict", "hit at trial", "best miss", "trials", "unknown", "excluded", "waiting"]
    return Table([*heads, "string", "target"], [_experiment_row(each) for each in campaign.experiments])


def _experiment_badge(each: CampaignExperiment) -> Badge:
    hit = next((line for line in each.throws if each.verdict == "hit" and line.hit), None)
    return VERDICTS[each.verdict] if hit is None else line_badge(hit, each.hit_radius_m)


def _experiment_row(each: CampaignExperiment) -> list[Any]:
    summary, badge = each.summary, chip(_experiment_badge(each))
    if summary is None:
        return [each.name, badge, *[UNKNOWN] * 5, len(each.waiting), UNKNOWN, UNKNOWN]
    best = min((line.miss_m for line in each.throws if line.miss_m is not None), default=None)
    return [
        page_link(each.name),
        badge,
        summary.hit_trial or UNKNOWN,
        millimetres(best),
        len(summary.trials),
        sum(line.hit is None and (each.aimed or bool(line.unread)) for line in each.throws),
        len(summary.trials) - len(each.throws),
        len(each.waiting),
        millimetres(summary.string_length_m, digits=0),
        UNKNOWN if summary.target_m is None else place(summary.target_m),
    ]


def _outliers(campaign: Campaign) -> PanelContent:
    found = campaign.outliers()
    throws = sum(each.throw is not None for each in campaign.trials())
    rows = [
        [page_link(each.experiment, each.trial, named=True), "; ".join(each.reasons)]
        for each in found[:MOST_OUTLIERS]
    ]
    named = "" if len(found) <= MOST_OUTLIERS else f" The worst {MOST_OUTLIERS} are named here."
    return PanelContent(
        f"{len(found)} of {throws} throws stand out.{named}",
        tables=[Table(["trial", "stands out by"], rows)] if rows else [],
    )


def _version_groups(campaign: Campaign) -> list[VersionGroup]:
    return group_by_versions(
        (f"{each.name}: {len(group.files)} files", group.versions)
        for each in campaign.experiments
        for group in (each.summary.made_with if each.summary is not None else ())
    )


def _hashes(campaign: Campaign) -> Table:
    rows = [
        [f"{each.name}/summary.json", UNKNOWN if each.summary is None else each.summary.content_sha256()]
        for each in campaign.experiments
    ]
    return Table(["summary", "content sha256"], rows)


CAMPAIGN_PANELS = [
    Panel(
        "misses",
        "Misses by throw",
        throw_misses,
        caption="Within a throw, the experiments stand in the order of the table. Excluded trials are not "
        "throws; a throw with an unknown miss has no mark. Experiments that stop at a hit have no later "
        "throws: those are of the harder ones.",
        good="the band falls from throw to throw.",
        bad="it stays: what is learned from a throw does not help the next; see E of the experiments.",
        shown=_has_throws,
    ),
    Panel(
        "learning",
        "Hits and best miss by throw",
        learning,
        caption="Bars: Wilson’s 95 % interval. An experiment that stopped without a hit counts as one that "
        "has not hit; one that may have, as a result could not be read, is left out.",
        good="the share rises to 100 %, the best miss falls below the hit radius.",
        bad="both are flat from some throw on.",
        shown=_has_throws,
    ),
    Panel(
        "outliers",
        "Trials that stand out",
        _outliers,
        caption="By a miss far above those of the same throw (robust z of its logarithm over "
        f"{MOST_ROBUST_Z:g}), by one over {BEYOND_PREDICTION:g} times what nine of ten were predicted "
        "within, or by a quantity of the rig beyond its limit. The remarks in the table of trials name all.",
        shown=_has_throws,
    ),
    Panel(
        "rig",
        "The rig over the campaign",
        rig_course,
        caption="By experiment, in the order of the table: the summaries hold no dates. Disc: median of its "
        "throws; bar: least to largest; dotted: the limit; cross: an experiment with a throw beyond it.",
        good="flat and within the limits.",
        bad="a trend: the rig changes, e.g. the camera was moved.",
        shown=_has_throws,
    ),
]
