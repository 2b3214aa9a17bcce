"""The experiment's page and its summary in numbers, from results only."""

from strandcast.records.page import write_page
from strandcast.report.experiment_page import experiment_page
from strandcast.report.summary import summarise
from strandcast.stages.job import Files, Job
from strandcast.stages.pages import facts_of, no_such_trial, refuse_unread


def run(job: Job, files: Files) -> None:
    """Write the summary and the page of an experiment for the trials of the job."""
    context, settings = job.context, job.context.settings
    for number in set(job.trials) - set(context.folder.reported_trials()):
        raise no_such_trial(context, number)
    folders = {number: context.folder.trial(number).results for number in job.trials}
    next_motion = files.optional("planned")
    summary = summarise(
        context.name,
        folders,
        string_length_m=settings.string.length_m,
        target_m=None if settings.target_m is None else list(settings.target_m),
        hit_radius_m=settings.hit_radius_m,
        excluded=settings.excluded_reasons,
        next_motion=next_motion,
    )
    page = experiment_page(summary, folders, next_motion=next_motion, facts=facts_of(context, next_motion))
    summary.write(files.output("summary"))
    write_page(files.output("page"), page)
    refuse_unread(context, files.output("page"), summary.all_unread())
