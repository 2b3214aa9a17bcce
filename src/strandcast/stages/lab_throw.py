"""Throw in the lab: play, film and log the planned motion."""

from strandcast.arm.load import load_arm
from strandcast.lab import throw as lab
from strandcast.records.files import remove_temporary_files
from strandcast.stages.job import Files, Job


def run(job: Job, files: Files) -> None:
    """Write the trial's raw files and, for tests and the lab's section of the report, the truth."""
    context = job.context
    remove_temporary_files(job.folder.data)
    lab.throw(
        context.settings,
        context.name,
        load_arm(files.input("arm")).planar(),
        job.trial,
        files.input("motion"),
        context.folder.data,
        files.output("truth"),
    )
