"""What throws miss by, cause by cause, measured by switching causes off in the lab."""

from __future__ import annotations

from typing import ClassVar

from strandcast.records.record import Part, Record


class Without(Part):
    """The misses of all throws at one trial with one cause switched off; rest: what is missed still."""

    cause: str  # "none": all causes act
    trial: int
    throws: int
    median_m: float
    p90_m: float
    rms_m: float
    cause_rms_m: float  # what the cause adds in squares; below 0 where throws were better with it


class BudgetThrow(Part):
    """One experiment's throw at one trial: its true miss by the cause that was switched off."""

    experiment: str
    string: int
    target: int
    seed: int
    trial: int
    miss_m: dict[str, float]


class ErrorBudget(Record):
    """error-budget.json: every throw with all causes, and with each switched off."""

    SCHEMA: ClassVar[str] = "strandcast/error-budget"

    without: list[Without]
    throws: list[BudgetThrow]
