"""Rehearse in the lab: plan the first motion, and play it with an empty clamp."""

from strandcast.lab.strings import physical_string
from strandcast.lab.throw import refuse_real_run, rehearse
from strandcast.records.files import remove_temporary_files
from strandcast.stages.arms import arm_of
from strandcast.stages.job import Files, Job
from strandcast.stages.plan import first_motion


def run(job: Job, files: Files) -> None:
    """Write the rehearsal's motion and joint log."""
    context, arm, path = job.context, arm_of(job.context), files.output("motion")
    physical_string(context.settings)
    refuse_real_run(path.parent)
    remove_temporary_files(path.parent)
    # One search is enough: where its motion is unlikely to hit, the plan after the rehearsal searches again.
    first_motion(context, arm, searches=1).write(path)
    rehearse(context.settings, context.name, arm, path, path.parent)
