"""What the paper's experiment comes to, and how one target's fit predicts another's throw."""

from __future__ import annotations

from typing import ClassVar

from strandcast.records.record import Part, Record
from strandcast.records.summary import TrialSummary


class Foretold(Part):
    """E (w = 0) of a throw under the strings that were fitted in one experiment; null where one blows up."""

    experiment: str
    target_m: list[float]
    trial: int  # after which the strings were fitted
    E_m: float | None  # of the best
    ensemble_E_m: list[float | None]


class Transfer(Record):
    """transfer.json: one throw under the fits of several runs of the same string, its own among them."""

    SCHEMA: ClassVar[str] = "strandcast/transfer"

    experiment: str
    trial: int
    target_m: list[float]
    fits: list[Foretold]
    planned_from: dict[str, str]  # files read -> content hash


class PaperRun(Part):
    """One experiment: a string thrown at a target until it hits, with one seed, by one method."""

    experiment: str
    string: int
    target: int
    own_target: bool  # the string's own by Fig. 5, or another one as in section VIII
    target_m: list[float]
    seed: int
    method: str  # "paper" or "default"
    state: str  # "done", "failed" or "unfinished"
    reason: str | None  # why it is not done
    hit_trial: int | None
    trials: list[TrialSummary]


class RateLine(Part):
    """How many runs of a method came within a radius by a trial; the interval is Wilson's, 95 %."""

    method: str
    over: str  # "own" targets, or "all"
    radius_m: float
    trial: int
    hits: int
    runs: int
    share: float
    low: float
    high: float


class MissLine(Part):
    """Misses of a method by trial: of the throws made then, or the nearest so far of every run."""

    method: str
    over: str
    of: str  # "thrown" or "nearest"
    trial: int
    known: int
    unknown: int
    median_m: float | None
    p90_m: float | None
    max_m: float | None


class PaperSummary(Record):
    """All runs in numbers; unfinished ones count in no line of rates or misses, failed ones do."""

    SCHEMA: ClassVar[str] = "strandcast/paper-summary"

    hit_radius_m: float
    experiments: list[PaperRun]
    rates: list[RateLine]
    misses: list[MissLine]
