"""The campaign: all experiments of a project that were begun, from their summaries."""

from collections.abc import Iterator
from pathlib import Path

from strandcast.errors import StrandcastError
from strandcast.records.files import content_sha256
from strandcast.records.folders import ExperimentFolder, known_experiments
from strandcast.records.page import is_made_from, write_page
from strandcast.records.provenance import current_versions
from strandcast.records.summary import ExperimentSummary
from strandcast.report.campaign import Campaign, CampaignExperiment, CampaignTally, WaitingTrial
from strandcast.stages.code_version import code_version
from strandcast.workflow.status import failure_in


def campaign_of(root: Path) -> Campaign:
    """Return all experiments that have results or throws.

    A summary is verified by its hash and its place; the results that it was made from are not hashed again:
    `verify` does that, which each run does first.
    """
    folders = (ExperimentFolder(root, name) for name in known_experiments(root))
    return Campaign([_experiment(each) for each in folders if each.results.is_dir() or each.thrown_trials()])


def write_campaign(root: Path) -> tuple[CampaignTally, Path]:
    """Write the page of the campaign unless it is there already; return what it counts, and its path."""
    campaign, page = campaign_of(root), root / "results" / "report.html"
    made_from = _made_from(campaign)
    if not is_made_from(page, made_from):
        from strandcast.report.campaign_page import campaign_page

        write_page(page, campaign_page(campaign), made_from)
    return campaign.tally(), page


def _made_from(campaign: Campaign) -> str:
    """Return a hash of all that the page is made from: summaries, failures, code, versions of libraries."""
    found = [
        [each.name, each.problem, each.waiting, each.summary and each.summary.content_sha256()]
        for each in campaign.experiments
    ]
    return content_sha256([found, code_version("strandcast.report.campaign_page"), current_versions()])


def _experiment(folder: ExperimentFolder) -> CampaignExperiment:
    summary, problem = None, None
    try:
        summary = ExperimentSummary.read(folder.results / "summary.json", inputs=False)
    except StrandcastError as error:
        problem = f"summary.json: {error.what}; {error.fix}"
    known = {line.trial for line in summary.trials} if summary is not None else set()
    missing = [number for number in folder.thrown_trials() if number not in known]
    of_all = next(_failures(folder.results, *sorted(folder.results.glob("cameras/*"))), None)
    waiting = [
        WaitingTrial(number, next(_failures(folder.trial(number).results), of_all)) for number in missing
    ]
    return CampaignExperiment(folder.name, summary, problem, waiting)


def _failures(*folders: Path) -> Iterator[str]:
    """Yield the stages of these folders whose logs end with an error, with its words."""
    for log in (path for folder in folders for path in sorted(folder.glob("logs/*.log"))):
        code, what = failure_in(log)
        if what is not None:
            yield f"{log.stem}: {f'{code} ' if code else ''}{what}"
