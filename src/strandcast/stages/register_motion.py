"""Copy the motion that a real arm played, and what was expected of it, to the results of the trial."""

from strandcast.records.motion import Motion
from strandcast.records.predicted import UNPREDICTED, read_predicted, write_predicted
from strandcast.stages.job import Files, Job


def run(job: Job, files: Files) -> None:
    """Copy motion.json and predicted.parquet from data/ to results/ after a verified read.

    Where no predicted throws lie beside the motion, an empty table says so.
    """
    predicted = files.optional("predicted")
    write_predicted(
        files.output("predicted"), UNPREDICTED if predicted is None else read_predicted(predicted)
    )
    Motion.read(files.input("motion")).write(files.output("motion"))
