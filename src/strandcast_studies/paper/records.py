"""Results of the paper's experiment, predictions of throws with fits at other targets, the error budget."""

from typing import ClassVar

from strandcast.records.record import Part, Record
from strandcast.records.summary import TrialSummary


class TransferPrediction(Part):
    """E (w = 0) of a throw with the strings fitted in one experiment; null where the simulation diverged."""

    experiment: str
    target_m: list[float]
    trial: int  # after which the strings were fitted
    E_m: float | None  # of the best
    ensemble_E_m: list[float | None]


class Transfer(Record):
    """transfer.json: one throw with the fits of several runs of the same string, including its own."""

    SCHEMA: ClassVar[str] = "strandcast/transfer"

    experiment: str
    trial: int
    target_m: list[float]
    fits: list[TransferPrediction]
    planned_from: dict[str, str]  # files read -> content hash


class PaperRun(Part):
    """One experiment: a string thrown at a target until it hits, with one seed, by one method."""

    experiment: str
    string: int
    target: int
    own_target: bool  # the string's own in Fig. 5, or another as in section VIII
    target_m: list[float]
    seed: int
    method: str  # "paper" or "default"
    state: str  # "done", "failed" or "unfinished"
    reason: str | None  # why it is not done
    hit_trial: int | None
    trials: list[TrialSummary]


class RateLine(Part):
    """The number of a method's runs within a radius by a trial, with Wilson's 95 % interval."""

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
    """Misses of a method by trial: of that trial's throws, or of every run's nearest throw so far."""

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
    """All runs in numbers; rates and misses include failed runs but not unfinished ones."""

    SCHEMA: ClassVar[str] = "strandcast/paper-summary"

    hit_radius_m: float
    experiments: list[PaperRun]
    rates: list[RateLine]
    misses: list[MissLine]


class MissWithout(Part):
    """The misses of all throws at one trial with one cause of error switched off."""

    cause: str  # "none": all causes act
    trial: int
    throws: int
    median_m: float
    p90_m: float
    rms_m: float
    cause_rms_m: float  # root of the cause's share of the mean square; negative if throws were better with it


class BudgetThrow(Part):
    """One experiment's throw at one trial: its true miss by switched-off cause."""

    experiment: str
    string: int
    target: int
    seed: int
    trial: int
    miss_m: dict[str, float]


class ErrorBudget(Record):
    """error-budget.json: every throw with all causes, and with each switched off."""

    SCHEMA: ClassVar[str] = "strandcast/error-budget"

    without: list[MissWithout]
    throws: list[BudgetThrow]
