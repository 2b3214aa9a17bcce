"""Whether this computer can run a workflow: results can be written, and there is room."""

from collections.abc import Iterable
from pathlib import Path

from strandcast.records.files import check_room
from strandcast.records.folders import ExperimentFolder

SCRATCH_BYTES = 400_000_000  # the frames of a trial of the demo, while it is tracked: 300 MB
LEAST_FREE_BYTES = 150_000_000  # a trial of the demo: a film of 45 MB, twice while it is written, and results


def check_host(root: Path, experiments: Iterable[str]) -> None:
    """Refuse to start a workflow that this computer could not finish.

    Raises
    ------
    StrandcastError
        SC-R041 the disk is full; SC-W002 results cannot be written.
    """
    folders = [ExperimentFolder(root, name) for name in experiments]
    for place in (root / ".snakemake", *(folder.results for folder in folders)):
        check_room(place, LEAST_FREE_BYTES)
