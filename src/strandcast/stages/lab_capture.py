"""Throw in the lab in space: play, log and capture the planned motion, and import the capture."""

from strandcast.lab import throw as lab
from strandcast.lab.capture import capture_mapping
from strandcast.records.files import remove_temporary_files
from strandcast.stages import import_track
from strandcast.stages.arms import arm_of
from strandcast.stages.context import free_length_m
from strandcast.stages.job import Files, Job


def run(job: Job, files: Files) -> None:
    """Write the trial's raw files, the track that is imported from them, and the truth."""
    context, name, arm = job.context, job.context.name, arm_of(job.context)
    remove_temporary_files(job.folder.data)
    motion, truth = files.input("motion"), files.output("truth")
    lab.throw(context.settings, name, arm, job.trial, motion, context.folder.data, truth)
    mapping = capture_mapping(free_length_m(context, arm.clamp.clamped_length_m))
    import_track.run(context.folder.root, name, job.trial, files.output("capture"), mapping, replace=True)
