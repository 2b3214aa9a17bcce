"""Take the calibration photos of a lab experiment."""

from strandcast.arm.load import load_arm
from strandcast.lab.throw import photograph_boards
from strandcast.records.files import remove_temporary_files
from strandcast.stages.job import Files, Job


def run(job: Job, files: Files) -> None:
    """Write the calibration photos."""
    context = job.context
    remove_temporary_files(files.output("plane").parent)
    photograph_boards(
        context.settings, context.name, load_arm(files.input("arm")).planar(), context.folder.data
    )
