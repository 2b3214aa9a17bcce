"""The command that makes everything: run."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from strandcast.cli.common import ROOT, AsJson, Experiments, show
from strandcast.records.folders import parted
from strandcast.workflow.project import DEFAULT_PROFILE

if TYPE_CHECKING:
    from strandcast.workflow.events import StageRun
    from strandcast.workflow.runner import RunResult

RESUMING = (
    "After Ctrl-C, the same command goes on. "
    "With other programs running, use fewer --cores; with little memory, fewer --jobs."
)


def run(
    experiments: Experiments = None,
    cores: Annotated[
        int | None,
        typer.Option(
            min=1, help="Processor cores for all stages together.  [default: 2, or --jobs if higher]"
        ),
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(min=1, help="Stages at a time, each on one core or more.  [default: --cores]"),
    ] = None,
    until: Annotated[
        str | None,
        typer.Option(metavar="STAGE", help="Make only what this stage writes, and what that needs."),
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="List what would run, and why.")] = False,
    report_only: Annotated[
        bool,
        typer.Option("--report-only", help="Render all pages again from the results that there are."),
    ] = False,
    unlock: Annotated[
        bool,
        typer.Option("--unlock", help="Only remove the lease of a run that was killed."),
    ] = False,
    profile: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="Where stages run: a folder of workflow/profiles, or a path. `slurm` submits them to Slurm, "
            "at most --jobs at a time.",
        ),
    ] = DEFAULT_PROFILE,
    as_json: AsJson = False,
) -> None:
    """Make the reports of experiments (default: all under data/), and everything they need.

    Ends with the page of all experiments, results/report.html.
    """
    from strandcast.workflow.runner import RunOptions, run_experiments, table

    if unlock:
        if not experiments:
            raise typer.BadParameter("name the experiments", param_hint="--unlock")
        _remove_leases(experiments, as_json)
        return
    if jobs is not None and cores is not None and jobs > cores:
        raise typer.BadParameter(f"{jobs} jobs need at least {jobs} cores", param_hint="--jobs")
    if report_only and (dry_run or until is not None or profile != DEFAULT_PROFILE):
        raise typer.BadParameter("goes with no stage, profile or dry run", param_hint="--report-only")
    options = RunOptions(cores, jobs, until, dry_run, report_only, profile)
    done = run_experiments(ROOT, experiments or [], options)
    if dry_run:
        lines = list(planned_lines(done.jobs)) if done.jobs or not done.exit_code else []
    else:
        lines = [line for summary in done.summaries for line in table(ROOT, summary)]
        lines += failed_lines(done)
        lines += campaign_line(done)
    show(as_json, as_data(done), lines)
    raise typer.Exit(done.exit_code)


def _remove_leases(experiments: list[str], as_json: bool) -> None:
    """Remove the leases of runs that were killed; refused while such a run lives."""
    from strandcast.config.find import find_experiment
    from strandcast.workflow.locks import unlock

    for name in experiments:
        find_experiment(name, ROOT)
    found = {name: unlock(ROOT, name) for name in experiments}
    show(as_json, {"experiments": found}, found.values())


def as_data(done: "RunResult") -> dict[str, object]:
    """Return the result of a run as plain data."""
    return {
        "exit_code": done.exit_code,
        "jobs": [job.to_json() for job in done.jobs],
        "failed": [job.to_json() for job in done.failed],
        "refused": [problem.to_json() for problem in done.refused],
        "damaged": {name: [each._asdict() for each in wrong] for name, wrong in done.damaged.items()},
        "campaign": None
        if done.campaign is None
        else done.campaign[0].to_json() | {"page": done.campaign[1]},
        "experiments": {each.experiment: each.model_dump(mode="json") for each in done.summaries},
    }


def campaign_line(done: "RunResult") -> list[str]:
    """Return what all experiments come to, and their page; nothing if a single one was summarised above."""
    if done.campaign is None or (done.summaries and sum(done.campaign[0].experiments.values()) < 2):
        return []
    return [f"all experiments: {done.campaign[0]}; page: {done.campaign[1]}"]


def planned_lines(jobs: "list[StageRun]") -> Iterator[str]:
    """Yield the jobs that would run and why, trial by trial."""
    if not jobs:
        yield "nothing to do: all results are up to date"
    subjects = list(dict.fromkeys(sorted((job.experiment, job.trial or 0, job.subject) for job in jobs)))
    for experiment, trial, subject in subjects:
        yield subject
        for job in jobs:
            if (job.experiment, job.trial or 0) == (experiment, trial):
                yield f"  {job.stage.replace('_', '-'):15} {job.reason}"
    if any(job.stage in ("lab_throw", "lab_capture") for job in jobs):
        yield "the verdicts of the lab's throws decide what follows: estimates, reports, further trials"


def failed_lines(done: "RunResult") -> list[str]:
    """Return what failed, and how to go on."""
    if not done.failed:
        return []
    names = " ".join(dict.fromkeys(parted(job.experiment)[0] for job in done.failed))
    failed = [f"  {job.subject}: {job.stage}, see {ROOT / (job.log or '')}" for job in done.failed]
    count = f"{len(failed)} stage{'' if len(failed) == 1 else 's'} failed; all other results are kept:"
    return [count, *failed, f"correct what the messages name, then go on: strandcast run {names}"]
