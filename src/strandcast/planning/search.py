"""Inputs and result of a search for a motion."""

from dataclasses import dataclass, field

import numpy as np

from strandcast.config.plan import PlanSettings
from strandcast.core.disturbances import TYPICAL_SIZES
from strandcast.core.strings import StringBatch
from strandcast.planning.bezier import Curve
from strandcast.planning.miss_calibration import COUNTED, NO_EVIDENCE, Evidence
from strandcast.planning.rollouts import RolloutConditions
from strandcast.planning.task import PlanningTask


@dataclass(frozen=True, eq=False)
class SearchInputs:
    """The task, the strings and the conditions to simulate motions with, the settings, random numbers.

    ``sizes`` (1, 5) are those of the disturbances, see `planning.scenarios.disturbed`; ``evidence`` is what
    past trials say of the prediction; ``planner`` is ``ensemble`` or ``paper``.
    """

    task: PlanningTask
    strings: StringBatch
    conditions: RolloutConditions
    settings: PlanSettings
    rng: np.random.Generator
    sizes: np.ndarray = field(default_factory=lambda: TYPICAL_SIZES)
    evidence: Evidence = NO_EVIDENCE
    planner: str = COUNTED


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The motion that a search found, and how."""

    kind: str
    curve: Curve
    simulations: int
    flags: list[str]
    parent_trial: int | None = None
