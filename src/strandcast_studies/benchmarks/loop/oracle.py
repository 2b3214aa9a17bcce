"""A lower bound for the miss of second throws: motions corrected with the lab's own physics, same scatter.

    python -m strandcast_studies.benchmarks.loop.oracle WORK/default/usual --seeds 2001-2003

WORK is the folder made by `loop.run --work WORK`. The oracle plays the second motion in the lab without
scatter or noise, plans again with the bias correction from that throw, and repeats this. It removes the
model's errors; robustness and limits are still the planner's. Then the planner's and the oracle's motions are
thrown with the same random variations.
"""

from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.arm.load import PlanarArm, load_arm
from strandcast.core.interpolation import resampled
from strandcast.core.strings import StringBatch
from strandcast.core.trajectory import JointTrajectory
from strandcast.lab.strings import physical_string
from strandcast.lab.swing import simulate_swing
from strandcast.lab.truth import true_miss
from strandcast.lab.variation import ThrowVariation, draw_variation
from strandcast.planning.bezier import Curve, sample
from strandcast.planning.past_trials import PastTrial, curve_of, start_shape
from strandcast.planning.plan import plan_next
from strandcast.planning.rollouts import AFTER_END_S
from strandcast.planning.task import PlanningTask
from strandcast.records.motion import Motion
from strandcast.seeds import rng
from strandcast.stages.context import Context
from strandcast.stages.plan_inputs import next_inputs
from strandcast.stages.run import files_of
from strandcast_studies.benchmarks.loop.follow_up import follow_up
from strandcast_studies.benchmarks.loop.throw import filmed_points, no_variation

ROUNDS = 3  # of planning and playing
DRAWS = 8  # throws per motion


def missed_m(context: Context, arm: PlanarArm, motion: JointTrajectory, variation: ThrowVariation) -> float:
    """Return the true miss of one throw [m]."""
    return _play(context, arm, motion, variation)[1]


def played(context: Context, arm: PlanarArm, curve: Curve, step_s: float) -> PastTrial:
    """Play a motion in the lab without scatter, track it without noise, and return it with its true miss."""
    motion = sample(curve, step_s)
    swing, miss_m = _play(context, arm, motion, no_variation(len(arm.joints)))
    motion_s = float(motion.time_s[-1])
    frame_s, points_m = filmed_points(context, swing, motion_s)
    time_s = np.arange(round((motion_s + AFTER_END_S) / step_s) + 1) * step_s
    return PastTrial(
        trial=1,
        curve=curve,
        q_command_rad=resampled(time_s, motion.time_s, motion.q_rad),
        q_rad=resampled(time_s, swing.time_s, swing.q_rad),
        frame_s=frame_s,
        tip_m=points_m[:, -1],
        start_m=start_shape(frame_s, points_m[:, 1:]),
        sway_rad_s=0.0,
        miss_m=miss_m,
    )


def _play(
    context: Context, arm: PlanarArm, motion: JointTrajectory, variation: ThrowVariation
) -> tuple[Any, float]:
    settings = context.settings
    assert settings.lab is not None
    string = physical_string(settings).clamped(arm.clamp.clamped_length_m)
    swing = simulate_swing(arm, settings.lab.servo, string, variation, motion)
    return swing, true_miss(swing, np.array(settings.target_m), float(motion.time_s[-1]))[0]


def corrected(
    context: Context, arm: PlanarArm, task: PlanningTask, strings: StringBatch, first: Curve
) -> tuple[Curve, float]:
    """Return the motion corrected with the lab's physics, and its miss without scatter [m]."""
    random = rng(context.name, context.settings.seed, 2, "oracle")
    best = now = played(context, arm, first, task.step_s)
    for _ in range(ROUNDS):
        plan = plan_next(task, strings, [now], context.settings.plan, random)
        now = played(context, arm, plan.curve, task.step_s)
        best = min(best, now, key=attrgetter("miss_m"))
    assert best.curve is not None
    assert best.miss_m is not None
    return best.curve, best.miss_m


def rows_of(root: Path, name: str) -> list[dict[str, Any]]:
    """Return the misses of one experiment's second motion and of the oracle's [m], in one row."""
    files = files_of("plan", root, name, 2)
    context = files.job.context
    arm = load_arm(context.arm_file).planar()
    task, strings = next_inputs(context, arm, files.input("ensemble"))
    curve = curve_of(Motion.read(context.folder.trial(2).results / "motion.json"))
    assert curve is not None
    oracle, oracle_m = corrected(context, arm, task, strings, curve)
    draws = [draw_variation(np.random.default_rng(k), len(arm.joints), 1.0) for k in range(DRAWS)]
    ours, theirs = sample(curve, task.step_s), sample(oracle, task.step_s)
    row = {
        "experiment": name,
        "planned_m": missed_m(context, arm, ours, no_variation(len(arm.joints))),
        "oracle_m": oracle_m,
        "planned_scattered_m": [missed_m(context, arm, ours, draw) for draw in draws],
        "oracle_scattered_m": [missed_m(context, arm, theirs, draw) for draw in draws],
    }
    return [row]


def summary_of(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Return medians and 90 % quantiles over all throws, and the ratios of the planner to the oracle."""
    answer = {"experiments": float(len(rows)), "draws": float(DRAWS)}
    for which in ("planned", "oracle"):
        misses = np.concatenate([r[f"{which}_scattered_m"] for r in rows])
        answer[f"{which}_median_m"], answer[f"{which}_p90_m"] = map(float, np.quantile(misses, (0.5, 0.9)))
        answer[f"{which}_rms_m"] = float(np.sqrt(np.mean(misses**2)))
        answer[f"{which}_unscattered_median_m"] = float(np.median([r[f"{which}_m"] for r in rows]))
    for of in ("median", "p90", "rms"):
        answer[f"ratio_{of}"] = answer[f"planned_{of}_m"] / answer[f"oracle_{of}_m"]
    return answer


def main(arguments: list[str] | None = None) -> None:
    """Compare the planner and the oracle on the experiments one by one."""
    follow_up(__doc__, "results/bench-oracle.json", rows_of, summary_of, arguments)


if __name__ == "__main__":
    main()
