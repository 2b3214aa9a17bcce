"""Facts for the paper's page that are not in any result: true strings, targets, settings, times."""

from dataclasses import dataclass, field
from typing import NamedTuple

from strandcast.core.box import Box
from strandcast_studies.paper.cases import PaperTarget
from strandcast_studies.paper.records import ErrorBudget


class AttachedWeight(NamedTuple):
    """A weight on a string: its place [m] and its mass in plain points."""

    place_m: float
    relative_mass: float


class AttachedPipe(NamedTuple):
    """A pipe on a string: from, to [m], and its mass in plain points."""

    from_m: float
    to_m: float
    relative_mass: float


class StringFacts(NamedTuple):
    """The truth about a string of the lab."""

    number: int
    length_m: float
    points: int
    weights: tuple[AttachedWeight, ...]
    pipes: tuple[AttachedPipe, ...]


class StageTime(NamedTuple):
    """Wall and processor time [s] of one job of one stage, from its log."""

    method: str
    stage: str
    wall_s: float
    processor_s: float | None


@dataclass(frozen=True)
class PaperFacts:
    """Facts for the page, collected by the caller."""

    strings: dict[int, StringFacts] = field(default_factory=dict)  # by number
    targets: list[PaperTarget] = field(default_factory=list)
    reach_m: float = 0.0  # from the arm's base to where the string leaves the outstretched hand
    workspace_m: Box | None = None
    times: list[StageTime] = field(default_factory=list)  # of every job with a log
    settings: dict[str, dict[str, str]] = field(default_factory=dict)  # by method and dotted name
    budget: ErrorBudget | None = None  # if one was measured
