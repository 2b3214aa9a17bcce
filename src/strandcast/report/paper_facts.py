"""What the paper's page tells that no result holds: strings and targets as they are, settings, wall times."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from strandcast.records.budget import ErrorBudget


class Hung(NamedTuple):
    """A weight on a string: its place [m] and its mass in plain points."""

    place_m: float
    relative_mass: float


class Pipe(NamedTuple):
    """A pipe on a string: from, to [m], and its mass in plain points."""

    from_m: float
    to_m: float
    relative_mass: float


class StringFacts(NamedTuple):
    """A string of the lab, as it truly is."""

    number: int
    length_m: float
    points: int
    weights: tuple[Hung, ...]
    pipes: tuple[Pipe, ...]


class TargetFacts(NamedTuple):
    """A target, and whether the paper prints its place."""

    number: int
    target_m: tuple[float, float]
    printed: bool


class StageTime(NamedTuple):
    """Wall and processor time [s] of one job of one stage, from its log."""

    method: str
    stage: str
    wall_s: float
    processor_s: float | None


@dataclass(frozen=True)
class PaperFacts:
    """Plain values that the caller knows.

    Attributes
    ----------
    strings, targets
        By number.
    reach_m
        From the arm's base to where the string leaves the outstretched hand [m].
    workspace_m
        Least and greatest x, least and greatest y [m].
    times
        Of every job that has left a log.
    settings
        Method -> its settings by dotted name.
    software
        Name -> version.
    budget
        The error budget, where one was measured.
    """

    strings: dict[int, StringFacts] = field(default_factory=dict)
    targets: dict[int, TargetFacts] = field(default_factory=dict)
    reach_m: float = 0.0
    workspace_m: tuple[float, float, float, float] | None = None
    times: list[StageTime] = field(default_factory=list)
    settings: dict[str, dict[str, str]] = field(default_factory=dict)
    software: dict[str, str] = field(default_factory=dict)
    budget: ErrorBudget | None = None
