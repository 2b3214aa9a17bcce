"""How near a second throw could come: motions mended with the lab's own physics, under the same scatter.

    python -m strandcast.bench.loop_oracle WORK/default/usual --seeds 2001-2003

WORK is the folder that `strandcast.bench.loop --work WORK` has left. The oracle starts from the second
motion, plays it in the lab without any scatter or noise, plans again around it by what the simulation missed
by, and so on: the model's errors are gone, robustness, limits and all else are the planner's own. Then both
motions, the planner's and the oracle's, are thrown with the same draws of what differs from throw to throw.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.arm.load import Arm, load_arm
from strandcast.bench.loop import cases_of, numbers
from strandcast.bench.loop_throw import seen_points, still
from strandcast.lab.strings import thread_of
from strandcast.lab.swing import simulate_swing
from strandcast.lab.truth import true_miss
from strandcast.lab.variation import Variation, draw_variation
from strandcast.motion.bezier import Curve, Samples, sample
from strandcast.motion.earlier import Earlier, curve_of, resampled, start_shape
from strandcast.motion.plan import plan_next
from strandcast.motion.strings import Strings
from strandcast.motion.task import Options, Task
from strandcast.motion.throws import AFTER_END_S
from strandcast.paper.cases import FILE, load_plan
from strandcast.player.protocol import Command
from strandcast.records.motion import Motion
from strandcast.seeds import rng
from strandcast.stages import plan as plan_stage
from strandcast.stages.context import Context, context_of

ROUNDS = 3
DRAWS = 8


@dataclass(frozen=True, eq=False)
class Played:
    """A motion as it goes in the lab without scatter: what a trial of it teaches, and its true miss [m]."""

    earlier: Earlier
    miss_m: float


def missed_m(context: Context, arm: Arm, motion: Samples, variation: Variation) -> float:
    """Return the true miss of one throw [m]."""
    return _play(context, arm, motion, variation)[1]


def played(context: Context, arm: Arm, curve: Curve, step_s: float) -> Played:
    """Play a motion in the lab without scatter, and see it without noise."""
    motion = sample(curve, step_s)
    swing, miss_m = _play(context, arm, motion, still(len(arm.joints)))
    motion_s = float(motion.time_s[-1])
    seen_s, points_m = seen_points(context, swing, motion_s)
    time_s = np.arange(round((motion_s + AFTER_END_S) / step_s) + 1) * step_s
    earlier = Earlier(
        trial=1,
        curve=curve,
        q_command=resampled(time_s, motion.time_s, motion.q),
        q=resampled(time_s, swing.time_s, swing.q_rad),
        seen_s=seen_s,
        tip_m=points_m[:, -1],
        start_m=start_shape(seen_s, points_m[:, 1:]),
        sway_rad_s=0.0,
        miss_m=miss_m,
    )
    return Played(earlier, miss_m)


def _play(context: Context, arm: Arm, motion: Samples, variation: Variation) -> tuple[Any, float]:
    settings = context.settings
    assert settings.lab is not None
    command = Command(motion.time_s, motion.q, motion.qd, motion.qdd)
    swing = simulate_swing(arm, settings.lab.servo, thread_of(settings), variation, command)
    return swing, true_miss(swing, np.array(settings.target_m), float(motion.time_s[-1]))[0]


def mended(
    context: Context, arm: Arm, task: Task, strings: Strings, options: Options, first: Curve
) -> tuple[Curve, float]:
    """Return the motion that the lab itself has mended, and its miss without scatter [m]."""
    random = rng(context.name, context.settings.seed, 2, "oracle")
    best = now = played(context, arm, first, task.step_s)
    for _ in range(ROUNDS):
        plan = plan_next(task, strings, [now.earlier], options, random)
        now = played(context, arm, plan.curve, task.step_s)
        best = min(best, now, key=lambda one: one.miss_m)
    assert best.earlier.curve is not None
    return best.earlier.curve, best.miss_m


def row(root: Path, name: str) -> dict[str, Any]:
    """Return the misses of the second motion of one experiment and of the oracle's [m]."""
    context = context_of(root, name)
    arm = load_arm(context.arm_file)
    task, strings, options = plan_stage.known_after(context, arm, 1)
    curve = curve_of(Motion.read(context.folder.trial(2).results / "motion.json"))
    assert curve is not None
    oracle, oracle_m = mended(context, arm, task, strings, options, curve)
    draws = [draw_variation(np.random.default_rng(k), len(arm.joints), 1.0) for k in range(DRAWS)]
    ours, theirs = sample(curve, task.step_s), sample(oracle, task.step_s)
    return {
        "experiment": name,
        "planned_m": missed_m(context, arm, ours, still(len(arm.joints))),
        "oracle_m": oracle_m,
        "planned_scattered_m": [missed_m(context, arm, ours, draw) for draw in draws],
        "oracle_scattered_m": [missed_m(context, arm, theirs, draw) for draw in draws],
    }


def summary_of(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Return medians and 90 % quantiles over all throws, and the ratios of planner to oracle."""
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
    """Compare planner and oracle, experiment by experiment."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("root", type=Path)
    parser.add_argument("--seeds", type=numbers, default=[2001, 2002, 2003])
    parser.add_argument("--strings", type=numbers, default=[])
    parser.add_argument("--out", type=Path, default=Path("results/bench-oracle.json"))
    told = parser.parse_args(arguments)
    paper = load_plan(Path(__file__).resolve().parents[3] / FILE)
    rows: list[dict[str, Any]] = []
    told.out.parent.mkdir(parents=True, exist_ok=True)
    for case in cases_of(paper, told.strings, told.seeds, "default"):
        rows.append(row(told.root, case.name))
        told.out.write_text(
            json.dumps({"summary": summary_of(rows), "rows": rows}, indent=1), encoding="utf-8"
        )
        ours, theirs = 1e3 * rows[-1]["planned_m"], 1e3 * rows[-1]["oracle_m"]
        print(f"{case.name}: {ours:.1f} mm, oracle {theirs:.1f} mm", file=sys.stderr)
    print(json.dumps(summary_of(rows), indent=1))


if __name__ == "__main__":
    main()
