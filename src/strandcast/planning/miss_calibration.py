"""From simulated misses to a probability that holds: calibrated on throws in the lab.

The simulated misses of a motion come from strings and disturbances that the planner thinks of; the real
string, the rig and the model differ in other ways too, and the search chooses the motion that looks best. How
much larger misses really are was counted: `miss_calibration.json`, made by
`strandcast_studies.benchmarks.loop.calibration` from drawn strings, targets and rigs, kind of motion by kind,
in the plane and in space.

The miss is s r with s = floor + gain * rms of the simulated misses, and r distributed as it was seen. Beyond
the rms that nine in ten counted motions stay below, s grows at least as the rms.

What the experiment itself has shown widens or narrows that, see `Evidence`.
"""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from strandcast.records.record import Part

FILE = Path(__file__).with_name("miss_calibration.json")
FAILED_M = 1.0  # miss of a simulation that failed (see `assessment.assess`)
FEW_FAIL = 0.05  # share of failed simulations that does not change what is stated; chosen
FITTED = ("refined", "replanned")  # kinds of motions that are planned with strings fitted to throws
COUNTED = "ensemble"  # the planner of the throws that were counted
IN_SPACE = " in space"  # after the kinds of motions in space
# A motion from scratch after a throw is searched for as a first one, and is counted as one.
COUNTED_AS = {"replanned": "first", f"replanned{IN_SPACE}": f"first{IN_SPACE}"}
LEVELS = tuple(np.round(np.arange(0.05, 0.951, 0.05), 2).tolist())  # shares whose ratios are kept
# Above the last level the ratio's tail is a power law: the exponent of Student's t with four degrees of
# freedom; below the first it falls linearly to zero, as distances in a plane at most do. Such a tail arises
# where the scale of normal errors differs from experiment to experiment as much as a variance estimated with
# four degrees of freedom does, and this is the prior of `Evidence.scale`.
TAIL_EXPONENT = 4.0
# A motion near a trial's changes where the tip passes by as much as the trial missed; the model's error makes
# this share of the change wrong.
UNTESTED_SHARE = 0.1
COORDINATES = 2  # degrees of freedom that a miss adds
RAYLEIGH_MEDIAN_SQUARED = math.log(2.0)  # of the mean square


class KindCalibration(Part):
    """Misses of one kind of motion.

    Attributes
    ----------
    made_from
        The runs with the throws that were counted.
    floor_m, gain
        s = floor + gain * rms of the simulated misses [m].
    counted_m
        The rms that nine in ten of the counted motions stay below [m].
    ratios
        Quantiles of miss / s at `LEVELS`.
    """

    made_from: str
    throws: int
    floor_m: float
    gain: float
    counted_m: float
    ratios: list[float]

    def distribution(self, rms_m: float, evidence: Evidence) -> MissDistribution:
        """Return the distribution of the miss of a motion, by the rms of its simulated misses [m]."""
        rms_m = math.hypot(rms_m, evidence.untested_m)
        beyond_m = max(rms_m - self.counted_m, 0.0)
        scale_m = self.floor_m + self.gain * rms_m + max(1.0 - self.gain, 0.0) * beyond_m
        return MissDistribution(evidence.scale() * scale_m * np.array(self.ratios))


class MissCalibration(Part):
    """Calibration by kind of motion."""

    kinds: dict[str, KindCalibration]


class Evidence(NamedTuple):
    """What the throws of an experiment say of its next prediction.

    Attributes
    ----------
    untested_m
        Error of the model that no string of the ensemble shows, as the motion differs from those that were
        thrown [m]: it adds to the rms of the simulated misses, as an independent error does.
    surprises
        Past throws that were planned with a fitted string: each miss over the median that was stated.
    """

    untested_m: float = 0.0
    surprises: tuple[float, ...] = ()

    def scale(self) -> float:
        """Return how much larger than elsewhere this experiment's misses are.

        It is the root of the posterior mean-square, 1 before any throw. What was stated of a throw had the
        scale by the throws before it.
        """
        scale, square, freedom = 1.0, TAIL_EXPONENT, TAIL_EXPONENT
        for surprise in self.surprises:
            square += COORDINATES * RAYLEIGH_MEDIAN_SQUARED * (scale * surprise) ** 2
            freedom += COORDINATES
            scale = math.sqrt(square / freedom)
        return scale


NO_EVIDENCE = Evidence()


class MissDistribution(NamedTuple):
    """Distribution of a throw's miss: its quantiles (L,) at `LEVELS` [m], increasing."""

    quantiles_m: np.ndarray

    def quantile_m(self, share: float) -> float:
        """Return the miss [m] that a share of throws stays below."""
        last = self.quantiles_m[-1]
        if share > LEVELS[-1]:
            return float(last * ((1.0 - LEVELS[-1]) / (1.0 - share)) ** (1.0 / TAIL_EXPONENT))
        return float(np.interp(share, (0.0, *LEVELS), (0.0, *self.quantiles_m)))

    def within(self, radius_m: float) -> float:
        """Return the probability that a throw passes within a radius [m]."""
        last = self.quantiles_m[-1]
        if radius_m > last:
            return float(1.0 - (1.0 - LEVELS[-1]) * (last / radius_m) ** TAIL_EXPONENT)
        return float(np.interp(radius_m, (0.0, *self.quantiles_m), (0.0, *LEVELS)))


def miss_distribution(
    planner: str, kind: str, simulated_miss_m: np.ndarray, evidence: Evidence = NO_EVIDENCE
) -> MissDistribution | None:
    """Return the distribution of the miss of a motion; None if such motions were not counted.

    Parameters
    ----------
    planner, kind
        ``ensemble`` or ``paper``, which was not counted; ``first``, ``rehearsed``, ``refined`` or
        ``replanned``, in space with `IN_SPACE`.
    simulated_miss_m
        Misses simulated with strings and disturbances [m].
    evidence
        What the experiment's throws say.
    """
    known = calibration().kinds.get(COUNTED_AS.get(kind, kind))
    if known is None or planner != COUNTED:
        return None
    return known.distribution(rms_of(simulated_miss_m), evidence)


def rms_of(simulated_miss_m: np.ndarray) -> float:
    """Return the rms of simulated misses [m], without simulations that failed if these are few.

    Each counts as a miss of `FAILED_M`, so that three of 192 would make 125 mm of 5 mm.
    """
    failed = simulated_miss_m >= FAILED_M
    counted_m = simulated_miss_m[~failed] if failed.mean() <= FEW_FAIL else simulated_miss_m
    return float(np.sqrt(np.mean(counted_m**2)))


@cache
def calibration() -> MissCalibration:
    """Return the calibration that the package carries."""
    return MissCalibration.model_validate_json(FILE.read_text(encoding="utf-8"))
