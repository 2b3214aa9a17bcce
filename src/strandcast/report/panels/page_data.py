"""The data that the two kinds of pages pass to their panels."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from strandcast.records.motion import Motion
from strandcast.records.summary import ExperimentSummary
from strandcast.report.causes import caveat
from strandcast.report.checks import NEXT_MOTION, CheckResult, run_checks
from strandcast.report.facts import Facts
from strandcast.report.results import TrialResults


@dataclass(frozen=True)
class TrialPageData:
    """The data of a trial's page."""

    results: TrialResults
    previous: TrialResults | None = None  # of the trial before, drawn beside this one
    next_motion: Path | None = None  # planned after the trial
    facts: Facts = field(default_factory=Facts)

    @property
    def folder(self) -> Path:
        """Return the page's folder."""
        return self.results.folder

    @property
    def played(self) -> Motion | None:
        """Return the motion of the trial."""
        return self.results.get("motion")

    @property
    def caveat(self) -> str | None:
        """Return what to say of all that follows from this throw if it has a fault."""
        return caveat(self.results)

    def need(self, name: str) -> Any:
        """Return a result of the trial, or raise the problem that kept it from being read."""
        return self.results.need(name)


@dataclass(frozen=True)
class ExperimentPageData:
    """The data of an experiment's page."""

    summary: ExperimentSummary
    trials: Mapping[int, TrialResults]
    folder: Path = Path()  # of the page
    next_motion: Path | None = None
    facts: Facts = field(default_factory=Facts)

    @property
    def aimed(self) -> bool:
        """Return whether the experiment has a target."""
        return self.summary.target_m is not None

    @property
    def in_space(self) -> bool:
        """Return whether a trial's track is in space."""
        return any(results.in_space() for results in self.trials.values())

    @property
    def camera_record(self) -> Path:
        """Return the record of the camera that filmed the trials."""
        records = (each.path("camera") for each in self.trials.values() if not each.supplied())
        return next(records, self.folder / "cameras" / "main.json")

    @property
    def played(self) -> Motion | None:
        """Return the motion of the last trial that counts."""
        return None if self.last_counted is None else self.last_counted.get("motion")

    @property
    def caveat(self) -> str | None:
        """Return what to say of the next motion if the last trial that counts has a fault."""
        return None if self.last_counted is None else caveat(self.last_counted)

    @property
    def last_counted(self) -> TrialResults | None:
        """Return the results of the last trial that counts."""
        counted = self.summary.counted()
        return self.trials[counted[-1].trial] if counted else None

    @cached_property
    def checks(self) -> dict[int, list[CheckResult]]:
        """The checks by trial; the next motion is checked with the last trial that counts.

        The trial before is the last that counts, as on the page of a trial.
        """
        last, found, before = self.last_counted, {}, None
        counted = {line.trial for line in self.summary.counted()}
        for trial, results in self.trials.items():
            checks = run_checks(results, self.next_motion, before)
            found[trial] = [each for each in checks if results is last or each.name != NEXT_MOTION]
            before = results if trial in counted else before
        return found

    def need(self, name: str) -> Any:
        """Return a result of every trial that has it; raise the first problem if none has."""
        found = {trial: results.get(name) for trial, results in self.trials.items()}
        if self.trials and all(piece is None for piece in found.values()):
            next(iter(self.trials.values())).need(name)
        return found


def with_caveat(page: TrialPageData | ExperimentPageData, sentence: str) -> str:
    """Return a finding that opens with the page's caveat if there is one."""
    caveat = page.caveat
    return sentence if caveat is None else f"{caveat[0].upper()}{caveat[1:]}. {sentence}"
