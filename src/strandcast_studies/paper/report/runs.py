"""The runs of the paper's experiment and the results that its figures read."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strandcast.core.trial_names import trial_name
from strandcast.errors import StrandcastError
from strandcast.records.estimate import ENSEMBLE, Estimate
from strandcast.records.tables import read_table
from strandcast_studies.paper.figures.counts import NAMES
from strandcast_studies.paper.records import PaperRun, Transfer


@dataclass(frozen=True)
class RunResults:
    """A run and its folder of results."""

    run: PaperRun
    folder: Path

    def trial(self, number: int) -> Path:
        """Return the folder of a trial."""
        return self.folder / trial_name(number)

    def counted(self) -> list[int]:
        """Return the trials that are not excluded."""
        return [line.trial for line in self.run.trials if line.excluded is None]

    def last(self) -> int:
        """Return the trial that hit, or the last one not excluded; 0 before the first."""
        return self.run.hit_trial or max(self.counted(), default=0)

    def estimate(self) -> Estimate | None:
        """Return the last estimate, if there is one."""
        try:
            return Estimate.read(self.trial(self.last()) / "estimate.json")
        except StrandcastError:
            return None

    def ensemble(self) -> dict[str, np.ndarray] | None:
        """Return the columns of the last ensemble, each (members,), if there is one."""
        try:
            return read_table(self.trial(self.last()) / "ensemble.parquet", ENSEMBLE)
        except StrandcastError:
            return None

    def transfer(self) -> Transfer | None:
        """Return the predictions of the last throw by other fits, if there are any."""
        try:
            return Transfer.read(self.folder / "transfer.json")
        except StrandcastError:
            return None


def to_show(runs: Iterable[RunResults], string: int, method: str) -> RunResults:
    """Return the finished run of a string at its own target to show.

    Runs that did not hit with their first throw are preferred, then the lowest seed.

    Raises
    ------
    StrandcastError
        SC-H077 there is none.
    """
    wanted = (string, method, "done", True)
    mine = [
        each
        for each in runs
        if (each.run.string, each.run.method, each.run.state, each.run.own_target) == wanted and each.last()
    ]
    if not mine:
        what = f"there is no finished run of string {string} by {NAMES[method]}"
        raise StrandcastError("SC-H077", what, fix="make paper")
    return min(mine, key=lambda each: (each.run.hit_trial == 1, each.run.seed))
