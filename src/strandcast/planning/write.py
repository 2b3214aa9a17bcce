"""A plan as a motion record."""

from dataclasses import fields

import numpy as np

from strandcast.arm.joint_limits import Limits
from strandcast.planning.describe import PlannedMotion
from strandcast.planning.miss_calibration import LEVELS, rms_of
from strandcast.planning.task import PlanningTask
from strandcast.records.motion import (
    Bezier,
    Motion,
    Prediction,
    Provenance,
    Robot,
    StartPosture,
    StringSet,
    points_of,
)
from strandcast.records.record import finite


def to_record(
    plan: PlannedMotion,
    task: PlanningTask,
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
    planned_from
        Names and content hashes of the files that it was planned from.
    parent_motion_sha256
        Content hash of the motion that was altered.
    start_string
        For a first motion: what was assumed about the string.
    """
    curve, motion, arm = plan.curve, plan.motion, task.arm
    step_ns = round(1e9 * task.step_s)
    return Motion(
        experiment=experiment,
        trial=trial,
        target_m=[float(x) for x in task.target_m],
        robot=Robot(name=arm.name, file_sha256=arm.sha256, urdf_sha256=arm.urdf_sha256),
        joint_names=list(arm.joints),
        start=StartPosture(
            positions_rad=curve.q0_rad.tolist(), tolerance_rad=arm.start_tolerance_rad.tolist()
        ),
        bezier=Bezier(
            duration_s=curve.duration_s,
            heights_rad_s=curve.heights_rad_s.tolist(),
            stop_ramp_from_s=curve.duration_s if curve.ramp_s else None,
        ),
        points=points_of(
            np.arange(len(motion.time_s)) * step_ns, motion.q_rad, motion.qd_rad_s, motion.qdd_rad_s2
        ),
        predicted=_prediction(plan, task.hit_radius_m, arm.limits),
        provenance=Provenance(
            planner=plan.planner,
            objective=plan.objective,
            kind=plan.kind,
            seed=seed,
            planned_from=planned_from,
            parent_motion_sha256=parent_motion_sha256,
            simulations=plan.simulations,
            start_string=start_string,
            string=StringSet.first_of(plan.strings),
            flags=list(plan.flags),
        ),
    )


def _prediction(plan: PlannedMotion, hit_radius_m: float, limits: Limits) -> Prediction:
    peak_whole_arm = [finite(peak) for peak in plan.peaks["whole_arm"]]
    return Prediction(
        miss_m=plan.miss_m,
        ensemble_miss_m=plan.ensemble_miss_m.tolist(),
        hit_probability=plan.hit_probability(hit_radius_m),
        miss_quantiles_m={f"p{round(100 * level)}": plan.miss_quantile_m(level) for level in LEVELS},
        calibrated=plan.miss is not None,
        simulated_hit_probability=plan.simulated_hit_probability(hit_radius_m),
        miss_rms_m=rms_of(plan.throws.miss_m),
        hit_time_s=plan.hit_time_s,
        largest_bend_rad=plan.largest_bend_rad,
        peak_speed_rad_s=plan.peaks["velocity_rad_s"].tolist(),
        peak_acceleration_rad_s2=plan.peaks["acceleration_rad_s2"].tolist(),
        peak_jerk_rad_s3=plan.peaks["jerk_rad_s3"].tolist(),
        peak_torque_n_m=plan.peaks["torque_n_m"].tolist(),
        lowest_rad=plan.motion.q_rad.min(axis=0).tolist(),
        highest_rad=plan.motion.q_rad.max(axis=0).tolist(),
        limits={
            column.name: [finite(limit) for limit in getattr(limits, column.name)]
            for column in fields(limits)
            if column.name != "whole_arm" or limits.whole_arm_limited.any()
        },
        **({"peak_whole_arm": peak_whole_arm} if limits.whole_arm_limited.any() else {}),
        workspace_room_m=plan.room_m,
        peak_tip_speed_m_s=float(np.hypot.reduce(np.gradient(plan.tip_m, plan.time_s, axis=0), axis=1).max()),
        time_s=plan.time_s.tolist(),
        hand_m=plan.hand_m.tolist(),
        tip_m=plan.tip_m.tolist(),
    )
