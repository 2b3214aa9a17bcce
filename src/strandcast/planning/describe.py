"""A motion with what the simulation predicts for it."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from strandcast.arm.limits import peaks, torque_gap, violations
from strandcast.arm.reach import outside_m, reach_of
from strandcast.core.strings import StringBatch
from strandcast.core.trajectory import JointTrajectory
from strandcast.errors import StrandcastError
from strandcast.planning.assessment import Assessment, assess_rollouts
from strandcast.planning.bezier import Curve, sample
from strandcast.planning.cost import start_cost
from strandcast.planning.miss_calibration import (
    IN_SPACE,
    NO_EVIDENCE,
    Evidence,
    MissDistribution,
    miss_distribution,
)
from strandcast.planning.rollouts import Rollouts
from strandcast.planning.search import SearchInputs, SearchResult
from strandcast.planning.task import PlanningTask
from strandcast.records.predicted import PredictedThrows

# Paths of predicted throws that are kept, and the time between their places; chosen for less than 100 kB.
MOST_PATHS = 32
PATH_STEP_S = 4e-3


@dataclass(frozen=True, eq=False)
class PlannedMotion:
    """A motion and the simulation's prediction of its throw.

    Attributes
    ----------
    planner, kind
        ``ensemble`` or ``paper``; ``first``, ``rehearsed`` (near a first one that was played without the
        string), ``refined`` (near a past motion), ``replanned`` (from scratch).
    curve, motion
        The velocity curves, and the motion's points.
    strings
        The strings that it was planned with, the best first.
    miss_m, ensemble_miss_m
        Predicted miss with the best string, and with every string (K,), undisturbed.
    throws
        Predicted throws of every string with every disturbance of the design.
    miss
        Distribution of the miss by how far such motions really missed (`miss_calibration`), None if that was
        not counted for this kind of motion.
    hit_time_s, tip_speed_m_s, largest_bend_rad
        When and how fast the best string's tip comes nearest, and its largest bend until then.
    time_s, hand_m, tip_m
        (T,), (T, 2 or 3), (T, 2 or 3) predicted paths until 0.3 s after the motion, with bias correction.
    peaks
        Largest speed, acceleration, jerk, torque of each joint, by name.
    room_m
        Least distance of the hand and the best string to the workspace's edges, below 0 outside.
    parent_trial
        The trial whose motion was altered, None for a motion planned from scratch.
    simulations
        Throws simulated by the search.
    """

    planner: str
    kind: str
    objective: str
    curve: Curve
    motion: JointTrajectory
    strings: StringBatch
    miss_m: float
    ensemble_miss_m: np.ndarray
    throws: PredictedThrows
    miss: MissDistribution | None
    hit_time_s: float
    tip_speed_m_s: float
    largest_bend_rad: float
    time_s: np.ndarray
    hand_m: np.ndarray
    tip_m: np.ndarray
    peaks: dict[str, np.ndarray]
    room_m: float
    parent_trial: int | None
    simulations: int
    flags: tuple[str, ...]

    def hit_probability(self, radius_m: float) -> float:
        """Return the probability to pass within a radius [m], calibrated if that was counted."""
        return self.miss.within(radius_m) if self.miss else self.simulated_hit_probability(radius_m)

    def simulated_hit_probability(self, radius_m: float) -> float:
        """Return the share of simulated throws that pass within a radius [m]."""
        return float(np.mean(self.throws.miss_m <= radius_m))

    def miss_quantile_m(self, share: float) -> float:
        """Return the miss [m] that a share of throws stays below, calibrated if that was counted."""
        return self.miss.quantile_m(share) if self.miss else float(np.quantile(self.throws.miss_m, share))


def describe(
    given: SearchInputs, found: SearchResult, rollouts: Rollouts, scattered: Rollouts
) -> PlannedMotion:
    """Return a motion with its prediction; refuse one that breaks the arm's limits.

    Parameters
    ----------
    rollouts
        The motion simulated with every string.
    scattered
        The motion simulated with every string and every disturbance, roughly (`PlanningTask.rough`).

    Raises
    ------
    StrandcastError
        SC-P004.
    """
    task = given.task
    motion = sample(found.curve, task.step_s)
    _refuse_violations(task, motion)
    assessment = assess_rollouts(task, rollouts)
    every = assess_rollouts(task.rough(), scattered)
    throws = _throws(scattered, every.miss_m)
    miss = _calibrated(task, given.planner, found.kind, throws.miss_m, given.evidence)
    flagged = every._replace(touch_m=touch_of_links_m(task, scattered))
    flags = [*found.flags, *prediction_flags(task, found.curve, flagged, miss)]
    count = rollouts.last[0] + 1
    path, time_s = rollouts.points_m[0, :count], np.arange(count) * task.step_s
    return PlannedMotion(
        planner=given.planner,
        kind=found.kind,
        objective=task.aim.description,
        curve=found.curve,
        motion=motion,
        strings=given.strings,
        miss_m=float(assessment.miss_m[0]),
        ensemble_miss_m=assessment.miss_m,
        throws=throws,
        miss=miss,
        hit_time_s=float(time_s[assessment.hit_index[0]]),
        tip_speed_m_s=float(assessment.tip_speed_m_s[0]),
        largest_bend_rad=float(np.arccos(np.clip(1.0 - assessment.fold[0], -1.0, 1.0))),
        time_s=time_s,
        hand_m=path[:, 0],
        tip_m=path[:, -1] + rollouts.tip_bias_m[0, :count],
        peaks=peaks(task.arm, motion),
        room_m=_room_m(task, path),
        parent_trial=found.parent_trial,
        simulations=found.simulations,
        flags=tuple(flags),
    )


def most_likely(task: PlanningTask, plan: PlannedMotion) -> float:
    """Return the probability of a hit that is stated of such a motion if no simulated throw misses."""
    miss = _calibrated(task, plan.planner, plan.kind, np.zeros(1), NO_EVIDENCE)
    return miss.within(task.hit_radius_m) if miss else 1.0


def _calibrated(
    task: PlanningTask, planner: str, kind: str, simulated_miss_m: np.ndarray, evidence: Evidence
) -> MissDistribution | None:
    """Return the distribution of the miss, None where such motions were not counted."""
    counted = f"{kind}{IN_SPACE}" if task.in_space else kind
    return miss_distribution(planner, counted, simulated_miss_m, evidence)


def _throws(scattered: Rollouts, miss_m: np.ndarray) -> PredictedThrows:
    """Return all misses, and the tip's paths of some throws: evenly from the best to the worst."""
    best_first = np.argsort(miss_m, kind="stable")
    evenly = np.linspace(0, len(miss_m) - 1, min(MOST_PATHS, len(miss_m))).round().astype(int)
    chosen = np.sort(best_first[evenly])
    samples = np.arange(0, scattered.last[0] + 1, max(1, round(PATH_STEP_S / scattered.step_s)))
    tip_m = scattered.tip_m()[chosen[:, None], samples].astype(float)
    return PredictedThrows(miss_m, chosen, samples * scattered.step_s, tip_m)


def touch_of_links_m(task: PlanningTask, scattered: Rollouts) -> NDArray[np.float64]:
    """Return (B,) how deep the string comes into the links' capsules until the hit [m].

    The plate with the hand's markers lies behind the string: over it, only detection is worse.
    """
    links = np.ascontiguousarray(scattered.capsules_m[:, :, : len(task.arm.joints)])
    return assess_rollouts(task.rough(), scattered._replace(capsules_m=links)).touch_m


def prediction_flags(
    task: PlanningTask, curve: Curve, throws: Assessment, miss: MissDistribution | None
) -> list[str]:
    """Return the faults of a throw that are more likely than not.

    Parameters
    ----------
    throws
        Throws of every string with every disturbance, which must keep `CLEARANCE_M` from the arm's links;
        touches of the plate with the hand's markers do not count.
    miss
        The calibrated distribution of the miss, None without one.
    """
    flags = _arm_flags(task, curve)
    usual_m = miss.quantile_m(0.5) if miss else float(np.median(throws.miss_m))
    if usual_m > task.hit_radius_m:
        by = f"half the throws miss by more than {1000 * usual_m:.0f} mm"
        flags.append(f"not expected to hit: {by}, and nothing better was found within the arm's limits")
    for depth_m, words in (
        (throws.outside_m, "will probably leave the workspace, by {} mm"),
        (throws.touch_m, "the string will probably come too near to a link, by {} mm"),
        (throws.hidden_m, "at the closest approach the tip will probably lie over the arm, by {} mm"),
    ):
        # One wild string of the ensemble says little of the throw.
        usual_m = float(np.median(depth_m))
        if usual_m > 0.0:
            share = f" (in {100 * np.mean(depth_m > 0.0):.0f} % of the simulated throws)"
            flags.append(words.format(math.ceil(1000 * usual_m)) + share)
    if start_cost(task, curve.q0_rad[None])[0] > 0.0:
        flags.append("at the start the string hangs over the arm, out of the workspace or at the target")
    return flags


def stopped_outside_m(task: PlanningTask, curve: Curve) -> float:
    """Return how far out of the arm's workspace arm or string may be if stopped at the worst instant [m]."""
    motion = sample(curve, task.step_s)
    return outside_m(task.arm, reach_of(task.arm, motion, task.hanging_m).swept_m)


def _arm_flags(task: PlanningTask, curve: Curve) -> list[str]:
    """Return the flags for a motion that the player will refuse, and for torque limits without effect."""
    flags = []
    out_m = stopped_outside_m(task, curve)
    if out_m != 0.0:
        out = f"{1000 * out_m:.0f} mm out of the arm's workspace"
        flags.append(f"stopped at the worst instant, arm or string may be {out}")
    gap = torque_gap(task.arm) if np.isfinite(task.arm.limits.torque_n_m).any() else None
    return flags if gap is None else [*flags, gap]


def _room_m(task: PlanningTask, points_m: np.ndarray) -> float:
    low, high = task.box().T
    room = np.minimum(points_m - low, high - points_m)
    return float(room.min()) if np.isfinite(room).all() else 0.0


def _refuse_violations(task: PlanningTask, motion: JointTrajectory) -> None:
    found = violations(task.arm, motion)
    if found:
        raise StrandcastError(
            "SC-P004",
            "the motion that was found breaks the arm's limits: " + "; ".join(map(str, found)),
            file=task.arm.path,
            cost="the search found nothing within the limits: no motion is written",
            fix="allow longer motions (plan.duration_s) or more evaluations",
        )
