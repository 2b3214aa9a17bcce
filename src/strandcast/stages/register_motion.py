"""Copy the motion that a real arm played to the results as the trial's motion."""

from strandcast.records.motion import Motion
from strandcast.stages.job import Files, Job


def run(job: Job, files: Files) -> None:
    """Copy motion.json from data/ to results/ after a verified read."""
    Motion.read(files.input("motion")).write(files.output("motion"))
