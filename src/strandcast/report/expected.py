"""What was expected of a throw before it: the only words and numbers that pages and commands give of it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strandcast.records.motion import Motion
from strandcast.report.numbers import millimetres, percent

LOW, MIDDLE, HIGH = "p10", "p50", "p90"  # four of five throws lie between the outer two
NEARLY = 0.99  # of some hundred counted throws of a kind, one is a per cent; chosen


class ExpectedMiss(NamedTuple):
    """The predicted miss of a throw, and how likely it hits.

    Attributes
    ----------
    low_m, middle_m, high_m
        The misses that 10, 50 and 90 % of throws stay below.
    hit_probability
        Of the same distribution.
    """

    low_m: float
    middle_m: float
    high_m: float
    hit_probability: float

    def __str__(self) -> str:
        return f"{self.middle()} ({self.interval()}), {self.likely()}"

    def middle(self) -> str:
        """Return the median in words."""
        return millimetres(self.middle_m)

    def interval(self) -> str:
        """Return in words where four of five throws lie."""
        return f"{millimetres(self.low_m)} to {millimetres(self.high_m)} in four of five throws"

    def likely(self) -> str:
        """Return in words how likely a hit is."""
        return f"{probable(self.hit_probability)} likely to hit"

    def compared(self, miss_m: float) -> str:
        """Return in words how a measured miss compares with four of five throws."""
        if self.low_m <= miss_m <= self.high_m:
            return "within the predicted range"
        return f"{'more' if miss_m > self.high_m else 'less'} than predicted"


def expected_miss(motion: Motion | None) -> ExpectedMiss | None:
    """Return what was expected of a motion; None if nothing was predicted."""
    predicted = None if motion is None else motion.predicted
    known = {} if predicted is None else predicted.miss_quantiles_m
    if predicted is None or not {LOW, MIDDLE, HIGH} <= known.keys():
        return None
    return ExpectedMiss(known[LOW], known[MIDDLE], known[HIGH], predicted.hit_probability)


def expected_shares(motion: Motion) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return predicted misses (L,) [m] and the share of throws (L,) that stay below each, rising."""
    known = {} if motion.predicted is None else motion.predicted.miss_quantiles_m
    pairs = sorted((int(name.removeprefix("p")) / 100.0, miss_m) for name, miss_m in known.items())
    shares, misses_m = np.array(pairs).reshape(-1, 2).T
    return misses_m, shares


def probable(probability: float) -> str:
    """Return a probability in whole per cent; none is certain."""
    if probability > NEARLY:
        return f"over {percent(NEARLY, digits=0)}"
    if probability < 1.0 - NEARLY:
        return f"under {percent(1.0 - NEARLY, digits=0)}"
    return percent(probability, digits=0)
