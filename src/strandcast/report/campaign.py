"""A campaign: the summaries of many experiments, and what can be counted over all of their throws."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple

import numpy as np

from strandcast.core.shares import wilson
from strandcast.records.summary import ExperimentSummary, TrialSummary, too_near
from strandcast.report import rig_limits
from strandcast.report.numbers import counted, millimetres, scaled

# Iglewicz & Hoaglin, "How to Detect and Handle Outliers", 1993: |robust z| > 3.5, σ = 1.4826 · MAD.
MOST_ROBUST_Z, SIGMA_PER_MAD = 3.5, 1.4826
LEAST_THROWS = 8  # to say which of them stands out; chosen
BEYOND_PREDICTION = 3.0  # times the predicted p90, which one throw in ten exceeds anyway; chosen


class WaitingTrial(NamedTuple):
    """A throw whose experiment's summary does not have it; `failure`: why, if a stage failed."""

    trial: int
    failure: str | None = None


@dataclass(frozen=True)
class CampaignExperiment:
    """One experiment: its summary, or why it could not be read, and throws that are not in it."""

    name: str
    summary: ExperimentSummary | None
    problem: str | None = None
    waiting: Sequence[WaitingTrial] = ()

    @property
    def aimed(self) -> bool:
        """Return whether the experiment has a target, as far as its summary can be read."""
        return self.summary is None or self.summary.target_m is not None

    @property
    def trials(self) -> list[TrialSummary]:
        """Return the trials in the summary."""
        return [] if self.summary is None else self.summary.trials

    @property
    def throws(self) -> list[TrialSummary]:
        """Return the trials that count, in order: the first is throw 1, whatever its trial's number."""
        return [] if self.summary is None else self.summary.counted()

    @property
    def begun(self) -> bool:
        """Return whether anything was thrown, as far as it can be read."""
        return bool(self.trials or self.waiting) or self.summary is None

    @property
    def hit_radius_m(self) -> float:
        """Return the radius of a hit; 0 without a summary, which has no trials either."""
        return 0.0 if self.summary is None else self.summary.hit_radius_m

    @property
    def verdict(self) -> str:
        """Return "hit", "no hit", "unknown" or "no target".

        A summary that lacks a throw cannot say that none has hit.
        """
        known = "unknown" if self.summary is None else self.summary.verdict
        return "unknown" if known == "no hit" and self.waiting else known

    def has_hit_by(self, throw: int) -> bool | None:
        """Return whether one of the first throws hit; None if one that is unknown comes before the hit."""
        throws = self.throws
        decisive = next((line.hit for line in throws[:throw] if line.hit is not False), False)
        lacking = any(len(throws) < throw or each.trial < throws[throw - 1].trial for each in self.waiting)
        if self.summary is None or decisive is None:
            return None
        return True if decisive else None if lacking else False


@dataclass(frozen=True)
class CampaignTally:
    """Trials of a campaign by what became of them."""

    scored: int
    excluded: int
    failed: int  # unknown, as a result could not be read, or a stage failed
    left: int  # thrown, but not processed yet
    hits: int  # throws that hit
    uncertain: int  # hits and misses too near to the hit radius to be certain
    experiments: dict[str, int]  # by verdict
    unread: int  # experiments without a readable summary: their trials are not counted
    captured: int = 0  # experiments without a target

    def to_json(self) -> dict[str, Any]:
        """Return the counts as plain data."""
        counts = asdict(self)
        if not self.captured:
            del counts["captured"]
        return counts | {"done": self.done}

    @property
    def done(self) -> int:
        """Return the trials that need no more work."""
        return self.scored + self.excluded

    def __str__(self) -> str:
        text = f"{counted(self.done, 'trial')} done, {self.failed} failed, {self.left} left"
        experiments = f"{self.experiments['hit']} of {counted(sum(self.experiments.values()), 'experiment')}"
        text += f"; hits: {counted(self.hits, 'throw')}, in {experiments}"
        near = f"{counted(self.uncertain, 'throw')} too near to the hit radius to be certain"
        text += f"; {near}" if self.uncertain else ""
        text += f"; without a target: {self.captured}" if self.captured else ""
        text += f"; excluded: {self.excluded}" if self.excluded else ""
        return text + (f"; without a readable summary: {self.unread}" if self.unread else "")


class HitShare(NamedTuple):
    """How many of the experiments of known outcome have hit by a throw, with the 95 % Wilson interval."""

    throw: int
    hits: int
    known: int
    unknown: int
    low: float
    high: float


class RigQuantity(NamedTuple):
    """A quantity of the rig: its field, the unit on the page and the factor to it, the limit in SI units."""

    name: str
    field: str
    unit: str
    factor: float
    limit: float
    is_least: bool = False  # whether the limit is the least good value, not the most

    def of(self, line: TrialSummary) -> float | None:
        """Return the value of a trial in the unit of the page, None if it is unknown."""
        value: float | None = getattr(line, self.field)
        return None if value is None else value * self.factor

    def is_good(self, line: TrialSummary) -> bool | None:
        """Return whether a trial's value is within the limit; None if it is unknown."""
        value: float | None = getattr(line, self.field)
        if value is None:
            return None
        return value >= self.limit if self.is_least else abs(value) <= self.limit


RIG_QUANTITIES = (
    RigQuantity("clock drift", "clock_drift", "ppm", 1e6, rig_limits.MOST_DRIFT),
    RigQuantity("lens, rms", "lens_rms_px", "px", 1.0, rig_limits.MOST_LENS_RMS_PX),
    RigQuantity("plane of motion, rms", "plane_rms_px", "px", 1.0, rig_limits.MOST_PLANE_RMS_PX),
    RigQuantity("hand's markers seen", "marker_fraction", "%", 100.0, rig_limits.LEAST_MARKER_FRACTION, True),
    RigQuantity("servo, unexplained", "servo_residual_rad", "mrad", 1e3, rig_limits.MOST_SERVO_RESIDUAL_RAD),
)


class CampaignThrow(NamedTuple):
    """One trial of a campaign; `throw` counts from 1 and is None for an excluded trial and for a capture."""

    experiment: CampaignExperiment
    line: TrialSummary
    throw: int | None

    @property
    def is_unknown(self) -> bool:
        """Return whether a hit or a miss should be known, and is not; of a capture, whether a result is."""
        return self.line.hit is None and (self.experiment.aimed or bool(self.line.unread))

    @property
    def is_uncertain(self) -> bool:
        """Return whether a counted throw is too near to the hit radius to be a certain hit or miss."""
        return self.throw is not None and too_near(self.line, self.experiment.hit_radius_m)


class Outlier(NamedTuple):
    """A trial that stands out, and by what: a sentence for each reason, the worst trial first."""

    experiment: str
    trial: int
    reasons: list[str]
    severity: float  # the largest of its values over their limits


@dataclass(frozen=True)
class Campaign:
    """Many experiments, by name."""

    experiments: Sequence[CampaignExperiment] = field(default_factory=list)

    def trials(self) -> Iterator[CampaignThrow]:
        """Yield all trials in the summaries, by experiment and number."""
        for each in self.experiments:
            throw = 0
            for line in each.trials:
                throw += line.excluded is None
                number = throw if line.excluded is None and each.aimed else None
                yield CampaignThrow(each, line, number)

    def tally(self) -> CampaignTally:
        """Count the trials."""
        trials = list(self.trials())
        lines = [each.line for each in trials]
        thrown = [line for line in lines if line.excluded is None]
        waiting = [trial for each in self.experiments for trial in each.waiting]
        verdicts = [each.verdict for each in self.experiments if each.begun]
        failed = sum(each.line.excluded is None and each.is_unknown for each in trials)
        return CampaignTally(
            scored=len(thrown) - failed,
            excluded=len(lines) - len(thrown),
            failed=failed + sum(trial.failure is not None for trial in waiting),
            left=sum(trial.failure is None for trial in waiting),
            hits=sum(line.hit is True for line in thrown),
            uncertain=sum(each.is_uncertain for each in trials),
            experiments={verdict: verdicts.count(verdict) for verdict in ("hit", "no hit", "unknown")},
            unread=sum(each.summary is None for each in self.experiments),
            captured=verdicts.count("no target"),
        )

    def most_throws(self) -> int:
        """Return the number of throws of the experiment with the most; captures are no throws."""
        return max((len(each.throws) for each in self.experiments if each.aimed), default=0)

    def hit_shares(self) -> list[HitShare]:
        """Return by throw how many experiments have hit.

        One that stopped without a hit has not hit; one that may have is unknown and not in the share.
        """
        shares = []
        for throw in range(1, self.most_throws() + 1):
            outcomes = [each.has_hit_by(throw) for each in self.experiments if each.aimed and each.begun]
            hits, known = outcomes.count(True), len(outcomes) - outcomes.count(None)
            shares.append(HitShare(throw, hits, known, outcomes.count(None), *wilson(hits, known)))
        return shares

    def misses_by_throw(self) -> dict[int, list[tuple[int, float]]]:
        """Return by throw the known misses [m], each with the position of its experiment."""
        found: dict[int, list[tuple[int, float]]] = {}
        for position, each in enumerate(self.experiments):
            for throw, line in enumerate(each.throws, 1):
                if line.miss_m is not None:
                    found.setdefault(throw, []).append((position, line.miss_m))
        return dict(sorted(found.items()))

    def best_so_far(self) -> dict[int, list[float]]:
        """Return by throw the least known miss [m] of each experiment so far; a stopped one keeps its own."""
        misses_m = [[line.miss_m for line in each.throws] for each in self.experiments]
        return {
            throw: [min(known) for each in misses_m if (known := [m for m in each[:throw] if m is not None])]
            for throw in range(1, self.most_throws() + 1)
        }

    def outliers(self) -> list[Outlier]:
        """Return the counted trials that stand out, the worst first."""
        usual = {
            throw: _robust([math.log10(miss) for _, miss in misses if miss > 0.0])
            for throw, misses in self.misses_by_throw().items()
        }
        found = []
        for each in self.trials():
            if each.throw is not None:
                reasons = sorted(_reasons(each, usual.get(each.throw)), reverse=True)
                if reasons:
                    texts = [text for _, text in reasons]
                    found.append(Outlier(each.experiment.name, each.line.trial, texts, reasons[0][0]))
        return sorted(found, key=lambda outlier: -outlier.severity)


def _robust(values: list[float]) -> tuple[float, float] | None:
    """Return the median and a robust σ of values; None for too few, or if most are the same."""
    if len(values) < LEAST_THROWS:
        return None
    middle = float(np.median(values))
    sigma = SIGMA_PER_MAD * float(np.median(np.abs(np.array(values) - middle)))
    return (middle, sigma) if sigma > 0.0 else None


def _reasons(each: CampaignThrow, usual: tuple[float, float] | None) -> Iterator[tuple[float, str]]:
    """Yield by what a throw stands out: how far over the limit, and a sentence."""
    line = each.line
    if line.miss_m and usual is not None:
        over = (math.log10(line.miss_m) - usual[0]) / usual[1] / MOST_ROBUST_Z
        if over > 1.0:
            median = millimetres(10.0 ** usual[0])
            yield over, f"miss of {millimetres(line.miss_m)}; the median of throw {each.throw} is {median}"
    if line.miss_m is not None and line.predicted_p90_m:
        over = line.miss_m / line.predicted_p90_m / BEYOND_PREDICTION
        if over > 1.0:
            predicted = millimetres(line.predicted_p90_m)
            yield over, f"miss of {millimetres(line.miss_m)}; nine of ten were predicted within {predicted}"
    for quantity in RIG_QUANTITIES:
        value, limit = quantity.of(line), quantity.limit * quantity.factor
        if value is not None and not quantity.is_good(line):
            over = limit / max(value, 1e-9) if quantity.is_least else abs(value) / limit
            shown = scaled(value, 1.0, 2, quantity.unit)
            bound = f"{'at least' if quantity.is_least else 'at most'} {limit:g} {quantity.unit} is good"
            yield over, f"{quantity.name}: {shown}; {bound}"
