"""Import motion capture into a trial's folder as track, hand and alignment."""

from pathlib import Path

from threadpoolctl import threadpool_limits

from strandcast.arm.load import load_arm
from strandcast.imports.capture import CapturedTrial, import_capture
from strandcast.imports.capture_mapping import CaptureMapping
from strandcast.imports.throw_in_space import ThrownBy
from strandcast.records.joint_log import read_run
from strandcast.records.record import refusal
from strandcast.records.track import TrackSummary
from strandcast.stages.arms import arm_of
from strandcast.stages.context import (
    Context,
    context_of,
    free_length_m,
    refuse_other_target,
    refuse_replacing,
)
from strandcast.stages.past_trials import smooth_joints
from strandcast.stages.trials_in_space import length_in_space_m


def run(
    root: Path,
    name: str,
    trial: int,
    capture: Path,
    mapping: CaptureMapping,
    replace: bool = False,
    offset_s: float | None = None,
) -> TrackSummary:
    """Import a capture; `register_track` copies it to the results.

    `offset_s` is the robot's time less the capture's, of a throw in space.
    """
    context = context_of(root, name)
    folder = context.folder.trial(trial)
    refuse_replacing(folder.data / "track.json", replace)
    refuse_other_target(context, mapping.in_space)
    known = CapturedTrial(
        name, trial, length_in_space_m(context), context.settings.string.n, offset_s=offset_s
    )
    with threadpool_limits(1):  # as the stages: the last digits must not depend on the number of cores
        if context.settings.aims_in_space:
            known = known._replace(thrown=_thrown(context, trial))
        elif not mapping.in_space:
            arm = load_arm(context.arm_file).planar()
            length_m, aimed = free_length_m(context, arm.clamp.clamped_length_m), context.settings.target_m
            known = known._replace(length_m=length_m, arm=arm, aimed=aimed is not None)
        return import_capture(capture, folder.data, mapping, known)


def _thrown(context: Context, trial: int) -> ThrownBy:
    """Return the hand's path of a throw in space, by the joint log."""
    arm = arm_of(context)
    folder = context.folder.trial(trial).data
    record, command = folder / "run.json", f"strandcast import joints {context.name} {trial} LOG"
    if not record.is_file():
        what = "the arm's hand drives the string of a throw in space, and the trial has no joint log"
        fix = f"play the motion into this folder, or import its log first: {command}"
        raise refusal("SC-I056", record, None, what, fix)
    played, log = read_run(folder)
    if played.motion_start_s is None or played.motion_end_s is None:
        what = "is not known: the log has no commands, and the motion was not beside it"
        fix = f"put the motion.json that was played there, and import the log again: {command} --replace"
        raise refusal("SC-I056", record, "motion_start_s", what, fix)
    if missing := [name for name in arm.joints if name not in log.joint_names]:
        what = f"the log has no {', '.join(missing)}, which the arm's file moves"
        fix = f"name its joints, from the base on: {command} --replace --joint NAME …"
        raise refusal("SC-I056", record, "joint_names", what, fix)
    motion_s = played.motion_start_s, played.motion_end_s
    time_s, q_rad = smooth_joints(log, arm.joints, motion_s)
    poses = arm.hand_path(q_rad)
    return ThrownBy(time_s, poses, motion_s)
