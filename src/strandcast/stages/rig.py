"""What all trials so far show of a rig; for `strandcast rig`."""

from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from strandcast.arm.load import load_arm
from strandcast.core.interpolation import resampled
from strandcast.errors import StrandcastError
from strandcast.planning.bias_correction import distance_rad_s
from strandcast.planning.past_trials import PastTrial
from strandcast.records.estimate import Estimate, RigOffsets
from strandcast.stages.context import Context
from strandcast.stages.declarations import STAGES
from strandcast.stages.files import filming
from strandcast.stages.job import Files, Job
from strandcast.stages.past_trials import read_trial
from strandcast.stages.plan_inputs import next_inputs, past_trial_of
from strandcast.stages.rig_offsets import rig_offsets_of

REPEATED_RAD_S = 1e-6  # rms over the heights: the same motion but for rounding


class Repeat(NamedTuple):
    """Two throws of one motion: the rms distance of their tips during it, where both were seen [m]."""

    trials: tuple[int, int]
    tip_m: float


class RigState(NamedTuple):
    """What the trials show of a rig.

    Attributes
    ----------
    trials
        Those that were used: with a fitted string, not excluded.
    offsets
        What the arm's file states wrongly, in the same way in all trials; None for fewer than two.
    repeats
        The motions that were thrown more than once.
    """

    trials: list[int]
    offsets: RigOffsets | None
    repeats: list[Repeat]


def rig_state(context: Context) -> RigState:
    """Return what an experiment's trials show of its rig.

    Raises
    ------
    StrandcastError
        SC-W030 no trial has a fitted string yet.
    """
    with threadpool_limits(1):  # as the stages: the last digits must not depend on the number of cores
        return _rig_state(context)


def _rig_state(context: Context) -> RigState:
    last = _newest_fit(context)
    files = Files(STAGES["plan"], Job(context, last + 1))
    arm = load_arm(files.input("arm")).planar()
    trials = [read_trial(files, number) for number in context.counted(range(1, last + 1))]
    task, _ = next_inputs(context, arm, files.input("ensemble"))
    estimate = Estimate.read(files.input("estimate"))
    cameras = filming(Job(context, last))
    return RigState(
        [trial.number for trial in trials],
        rig_offsets_of(arm, trials, cameras, estimate),
        repeats([past_trial_of(trial, task) for trial in trials if trial.motion is not None]),
    )


def _newest_fit(context: Context) -> int:
    """Return the newest trial with a fitted string."""
    numbers = context.counted(context.folder.thrown_trials())
    fitted = [n for n in numbers if (context.folder.trial(n).results / "ensemble.parquet").is_file()]
    if not fitted:
        raise StrandcastError(
            "SC-W030",
            "rig needs a fitted string, and no trial has one yet",
            file=context.folder.trial(max(numbers, default=1)).results / "ensemble.parquet",
            fix=f"throw once, then: strandcast run {context.name}",
        )
    return max(fitted)


def repeats(trials: list[PastTrial]) -> list[Repeat]:
    """Return every pair of neighbouring throws of one motion, and how far apart their tips were."""
    found = []
    for k, later in enumerate(trials):
        same = [
            one
            for one in trials[:k]
            if later.curve is not None and distance_rad_s(later.curve, [one]) < REPEATED_RAD_S
        ]
        if same:
            found.append(Repeat((same[-1].trial, later.trial), _tips_apart_m(same[-1], later)))
    return [repeat for repeat in found if np.isfinite(repeat.tip_m)]


def _tips_apart_m(one: PastTrial, other: PastTrial) -> float:
    assert one.curve is not None
    seen = np.isfinite(other.tip_m).all(axis=1)
    first_s = max(0.0, other.frame_s[seen].min(initial=np.inf))
    last_s = min(one.curve.end_s, other.frame_s[seen].max(initial=-np.inf))
    during = (one.frame_s >= first_s) & (one.frame_s <= last_s)
    during &= np.isfinite(one.tip_m).all(axis=1)
    if not during.any():
        return float("nan")
    apart = one.tip_m[during] - resampled(one.frame_s[during], other.frame_s[seen], other.tip_m[seen])
    return float(np.sqrt(np.mean((apart**2).sum(axis=1))))
