"""The runs of the paper's experiment with their folders: what its figures read, and no more of it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.estimate import ENSEMBLE, Estimate
from strandcast.records.paper import PaperRun, Transfer
from strandcast.records.tables import read_table


@dataclass(frozen=True)
class RunResults:
    """A run and its folder of results."""

    run: PaperRun
    folder: Path

    def trial(self, number: int) -> Path:
        """Return the folder of a trial."""
        return self.folder / f"trial-{number:02d}"

    def counted(self) -> list[int]:
        """Return the trials that are not excluded."""
        return [line.trial for line in self.run.trials if line.excluded is None]

    def last(self) -> int | None:
        """Return the trial that hit, or the last that counts; None before the first."""
        counted = self.counted()
        return self.run.hit_trial or (counted[-1] if counted else None)

    def estimate(self) -> Estimate | None:
        """Return the last estimate, if there is one."""
        last = self.last()
        try:
            return None if last is None else Estimate.read(self.trial(last) / "estimate.json")
        except StrandcastError:
            return None

    def ensemble(self) -> dict[str, np.ndarray] | None:
        """Return the columns of the last ensemble, each (members,), if there is one."""
        last = self.last()
        try:
            return None if last is None else read_table(self.trial(last) / "ensemble.parquet", ENSEMBLE)
        except StrandcastError:
            return None

    def transfer(self) -> Transfer | None:
        """Return how other fits predict the last throw, where that was computed."""
        try:
            return Transfer.read(self.folder / "transfer.json")
        except StrandcastError:
            return None


def to_show(runs: Iterable[RunResults], string: int, method: str) -> RunResults | None:
    """Return the done run of a string at its own target that shows a before and an after, or None.

    That is the one with the least seed among those that did not hit at once; if all did, among all.
    """
    mine = [
        each
        for each in runs
        if (each.run.string, each.run.method, each.run.state) == (string, method, "done")
        and each.run.own_target
    ]
    return min(mine, key=lambda each: (each.run.hit_trial == 1, each.run.seed), default=None)
