"""A plan as a motion record."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from strandcast.arm.limits import Limits
from strandcast.motion.describe import Plan
from strandcast.motion.strings import Strings
from strandcast.motion.task import Task
from strandcast.records.motion import (
    Bezier,
    Motion,
    Prediction,
    Provenance,
    Robot,
    Start,
    StringSet,
    points_of,
)
from strandcast.string.parameters import PARAMETERS


def to_record(
    plan: Plan,
    task: Task,
    experiment: str,
    trial: int,
    seed: int,
    planned_from: dict[str, str],
    parent_motion_sha256: str | None = None,
    start_string: str | None = None,
) -> Motion:
    """Return the motion record of a plan.

    Parameters
    ----------
    experiment, trial
        Which throw the motion is for.
    seed
        What the planner's chance came from.
    planned_from
        Names and content hashes of the files that it was planned from.
    parent_motion_sha256
        Content hash of the motion that was altered.
    start_string
        For a first motion: what was assumed of the string.
    """
    curve, motion, arm = plan.curve, plan.motion, task.arm
    step_ns = round(1e9 * task.step_s)
    return Motion(
        experiment=experiment,
        trial=trial,
        target_m=[float(x) for x in task.target_m],
        robot=Robot(name=arm.name, file_sha256=arm.sha256, urdf_sha256=arm.urdf_sha256),
        joint_names=list(arm.joints),
        start=Start(positions_rad=curve.q0_rad.tolist(), tolerance_rad=arm.start_tolerance_rad.tolist()),
        bezier=Bezier(
            duration_s=curve.duration_s,
            heights_rad_s=curve.heights_rad_s.tolist(),
            stop_ramp_from_s=curve.duration_s if curve.ramp_s else None,
        ),
        points=points_of(np.arange(len(motion.q)) * step_ns, motion.q, motion.qd, motion.qdd),
        predicted=_prediction(plan, arm.limits),
        provenance=Provenance(
            planner=plan.planner,
            objective=plan.objective,
            kind=plan.kind,
            seed=seed,
            planned_from=planned_from,
            parent_motion_sha256=parent_motion_sha256,
            simulations=plan.simulations,
            start_string=start_string,
            string=StringSet(
                parameters=dict(zip(PARAMETERS, plan.strings.parameters[0].tolist(), strict=True)),
                masses=plan.strings.masses[0].tolist(),
                options=_options(plan.strings),
            ),
            flags=list(plan.flags),
        ),
    )


def _options(strings: Strings) -> dict[str, float]:
    """Return the best string's numbers beside parameters and masses, by their names in the estimate."""
    options = {
        "rest_curl_rad_m": float(strings.curl_rad_m[0]),
        "clamp_offset_rad": float(strings.clamp_offset_rad[0]),
    }
    if (strings.bend_factor[0] != 1.0).any():
        options["stiff_bend_factor"] = float(strings.bend_factor[0].max())
    if strings.bend_friction[0] > 0.0:
        options["bend_friction"] = float(strings.bend_friction[0])
    return options


QUANTILES = (0.1, 0.5, 0.9)


def _prediction(plan: Plan, limits: Limits) -> Prediction:
    return Prediction(
        miss_m=plan.miss_m,
        ensemble_miss_m=plan.ensemble_miss_m.tolist(),
        hit_probability=plan.hit_probability,
        disturbed_throws=len(plan.disturbed_miss_m),
        miss_quantiles_m={
            f"p{round(100 * share)}": float(np.quantile(plan.disturbed_miss_m, share)) for share in QUANTILES
        },
        hit_time_s=plan.hit_time_s,
        largest_bend_rad=plan.largest_bend_rad,
        peak_speed_rad_s=plan.peaks["velocity_rad_s"].tolist(),
        peak_acceleration_rad_s2=plan.peaks["acceleration_rad_s2"].tolist(),
        peak_jerk_rad_s3=plan.peaks["jerk_rad_s3"].tolist(),
        peak_torque_n_m=plan.peaks["torque_n_m"].tolist(),
        lowest_rad=plan.motion.q.min(axis=0).tolist(),
        highest_rad=plan.motion.q.max(axis=0).tolist(),
        limits={
            column.name: [float(x) if np.isfinite(x) else None for x in getattr(limits, column.name)]
            for column in fields(limits)
        },
        workspace_room_m=plan.room_m,
        peak_tip_speed_m_s=float(np.hypot(*np.gradient(plan.tip_m, plan.time_s, axis=0).T).max()),
        time_s=plan.time_s.tolist(),
        hand_m=plan.hand_m.tolist(),
        tip_m=plan.tip_m.tolist(),
    )
