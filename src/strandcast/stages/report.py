"""The page of one trial, from results only."""

from contextlib import suppress

from strandcast.errors import StrandcastError
from strandcast.records.listing import folder_exists
from strandcast.records.page import write_page
from strandcast.records.verdict import Verdict
from strandcast.report.results import read_results
from strandcast.report.trial_page import trial_page
from strandcast.stages.files import past
from strandcast.stages.job import Files, Job
from strandcast.stages.pages import facts_of, no_such_trial, refuse_unread


def run(job: Job, files: Files) -> None:
    """Write the page of a trial."""
    context, folder = job.context, job.folder
    known = folder.results.is_dir() or folder_exists(folder.data)
    if not known and context.settings.excluded_reason(job.trial) is None:
        raise no_such_trial(context, job.trial)
    before = past(job)
    next_motion = files.optional("planned")
    page = trial_page(
        folder.results,
        trial=job.trial,
        experiment=context.name,
        previous=context.folder.trial(before[-1]).results if before else None,
        neighbours=_neighbours(job, files),
        next_motion=next_motion,
        facts=facts_of(context, next_motion),
    )
    write_page(files.output("page"), page)
    if context.settings.excluded_reason(job.trial) is None:
        refuse_unread(context, files.output("page"), read_results(folder.results).unread())


def _neighbours(job: Job, files: Files) -> tuple[int | None, int | None]:
    """Return the trials before and after this one, excluded ones too; None where there is none.

    The lab throws until the tip hits, so that its next trial may be thrown only after this page is made.
    """
    context, trial = job.context, job.trial
    if job.is_lab:
        hit = False
        with suppress(StrandcastError):
            hit = bool(Verdict.read(files.input("verdict")).hit)
        return trial - 1 or None, None if context.is_last(trial, hit) else trial + 1
    recorded = context.folder.recorded_trials()
    before, after = ([n for n in recorded if n < trial], [n for n in recorded if n > trial])
    return max(before, default=None), min(after, default=None)
