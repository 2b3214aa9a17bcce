"""One throw in the lab with a supplied track: all of a trial's raw folder except the video."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from strandcast.alignment.hand_path import hand_columns
from strandcast.alignment.log_rows import log_rows_of
from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import PlanarArm, load_arm
from strandcast.lab.driver import joint_log
from strandcast.lab.strings import physical_string
from strandcast.lab.swing import BEFORE_S, LabSwing, simulate_swing
from strandcast.lab.tracked_points import TrackerNoise, points_at, with_tracker_noise
from strandcast.lab.truth import true_miss
from strandcast.lab.variation import LabClocks, ThrowVariation, draw_variation, scatter_of
from strandcast.records.alignment import HAND, Alignment
from strandcast.records.joint_log import JointLog, Run, timing_of, write_joint_log
from strandcast.records.lab_truth import LAB_TRUTH
from strandcast.records.motion import Motion
from strandcast.records.tables import read_facts, write_table
from strandcast.records.track import SUPPLIED, TRACK, Track, TrackSummary
from strandcast.seeds import rng
from strandcast.stages.context import Context, context_of, free_length_m
from strandcast.stages.run import run_stage

FRAME_RATE_HZ = 500.0
FILMED_BEFORE_S, FILMED_AFTER_S = 0.22, 0.45  # the motion; chosen
LOG_START_S = 1.0


@dataclass(frozen=True)
class LoopRig:
    """The errors of a rig: the noise of track and clocks, and a change to the variation of every throw."""

    noise: TrackerNoise = field(default_factory=TrackerNoise)
    vary: Callable[[ThrowVariation], ThrowVariation] = lambda drawn: drawn


def throw_filmed(root: Path, name: str, trial: int) -> float:
    """Throw and film a trial's motion and track it in the video; return the true miss [m]."""
    if trial == 1:
        run_stage("lab_calibrate", root, name)
        run_stage("calibrate", root, name)
    for stage in ("lab_throw", "ingest", "track", "reconstruct", "align"):
        run_stage(stage, root, name, trial)
    truth = context_of(root, name).folder.trial(trial).results / "lab_truth.parquet"
    return float(read_facts(truth, LAB_TRUTH)["miss_m"])


def throw(root: Path, name: str, trial: int, rig: LoopRig) -> float:
    """Throw a trial's motion and write its raw folder with a supplied track; return the true miss [m]."""
    context = context_of(root, name)
    settings, arm = context.settings, load_arm(context.arm_file).planar()
    assert settings.lab is not None
    folder = context.folder.trial(trial)
    folder.data.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(folder.results / "motion.json", folder.data / "motion.json")
    motion = Motion.read(folder.data / "motion.json")
    drawn = draw_variation(
        rng(name, settings.seed, trial, "lab-throw"),
        len(arm.joints),
        1.0,
        scatter_of(name, settings.seed, settings.lab),
    )
    variation = rig.vary(drawn)
    swing = swung(context, arm, motion, variation)
    motion_s = motion.trajectory().end_s
    clocks, random = LabClocks(LOG_START_S, 0.0, 0.0), rng(name, settings.seed, trial, "lab-log")
    log = joint_log(arm, swing, variation, clocks, motion_s, random)
    span_s = (LOG_START_S + BEFORE_S, LOG_START_S + BEFORE_S + motion_s)
    _write_log(folder.data, arm, motion, log, span_s)
    _write_hand(folder.data, arm, log)
    _write_track(context, arm, trial, swing, span_s, rig.noise)
    return true_miss(swing, np.array(settings.target_m), motion_s)[0]


def swung(context: Context, arm: PlanarArm, motion: Motion, variation: ThrowVariation) -> LabSwing:
    """Return the lab's simulation of a played motion."""
    assert context.settings.lab is not None
    command = motion.trajectory().resampled(1.0 / arm.log_rate_hz)
    thread = physical_string(context.settings).clamped(arm.clamp.clamped_length_m)
    return simulate_swing(arm, context.settings.lab.servo, thread, variation, command)


def filmed_points(context: Context, swing: LabSwing, motion_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times (F,) since the motion's start [s] and the mass points (F, n+1, 2) [m], without noise.

    Like the tracker's points, they divide the true free length evenly, not the length in the settings.
    """
    n = context.settings.string.n
    time_s = np.arange(-FILMED_BEFORE_S, motion_s + FILMED_AFTER_S, 1.0 / FRAME_RATE_HZ)
    return time_s, points_at(swing, np.linspace(0.0, swing.places_m[-1], n + 1), time_s)


def no_variation(joints: int) -> ThrowVariation:
    """Return the variation of a perfectly nominal throw."""
    return draw_variation(np.random.default_rng(0), joints, 0.0)


def without_scatter(variation: ThrowVariation) -> ThrowVariation:
    """Return a throw with nominal grasp, start shape and joint zeros; servo gain and log noise stay."""
    return replace(
        no_variation(len(variation.joint_zero_rad)),
        servo_gain=variation.servo_gain,
        log_noise_rad=variation.log_noise_rad,
    )


def _write_log(
    folder: Path, arm: PlanarArm, motion: Motion, log: JointLog, span_s: tuple[float, float]
) -> None:
    sha256 = write_joint_log(folder / "joints.csv", log)
    Run(
        complete=True,
        status="ok",
        reason=None,
        joints_sha256=sha256,
        rows=len(log.time_s),
        motion_sha256=motion.content_sha256(),
        arm_sha256=arm.sha256,
        driver="lab",
        controller={},
        joint_names=log.joint_names,
        clock="virtual controller",
        motion_start_s=span_s[0],
        motion_end_s=span_s[1],
        sync_events=[],
        timing=timing_of(log.time_s, arm.log_rate_hz),
        video={},
        warnings=[],
    ).write(folder / "run.json")


def _write_hand(folder: Path, arm: PlanarArm, log: JointLog) -> None:
    rows = log_rows_of(log, arm)
    has_command = np.isfinite(log.q_cmd_rad).all(axis=1)
    joints = {
        "measured": (rows.time_s, rows.q_rad),
        "commanded": (log.time_s[has_command], log.q_cmd_rad[has_command]),
    }
    paths = {source: (time_s, hand_pose(arm.chain, arm.clamp, q)) for source, (time_s, q) in joints.items()}
    write_table(folder / "hand.parquet", HAND, hand_columns(paths), {"source": "lab"})


def _write_track(
    context: Context,
    arm: PlanarArm,
    trial: int,
    swing: LabSwing,
    span_s: tuple[float, float],
    noise: TrackerNoise,
) -> None:
    folder = context.folder.trial(trial).data
    random = rng(context.name, context.settings.seed, trial, "lab-sensor")
    since_s, points_m = filmed_points(context, swing, span_s[1] - span_s[0])
    tracked = with_tracker_noise(points_m, 1.0 / FRAME_RATE_HZ, noise, random)
    sigma_m = np.full(tracked.shape[:2], max(float(np.hypot(noise.white_m, noise.slow_m)), 1e-6))
    flags = np.full(tracked.shape[:2], SUPPLIED, np.int32)
    track = Track(np.arange(len(since_s)), since_s + span_s[0], tracked, sigma_m, flags)
    write_table(folder / "track.parquet", TRACK, track.columns(), {"source": "lab"})
    there = track.detected()
    TrackSummary(
        experiment=context.name,
        trial=trial,
        source="supplied",
        points=context.settings.string.n,
        length_m=free_length_m(context, arm.clamp.clamped_length_m),
        decoded_frames=len(since_s),
        expected_frames=len(since_s),
        tracked_fraction=float(there.mean()),
        tip_fraction=float(there[:, -1].mean()),
        marker_fraction=1.0,
        median_sigma_m=float(np.median(sigma_m)),
        choices={},
        warnings=[],
    ).write(folder / "track.json")
    Alignment(
        experiment=context.name,
        trial=trial,
        source="supplied",
        offset_s=float(noise.offset_s * random.standard_normal()),
        offset_se_s=noise.offset_s or None,
        drift=0.0,
        drift_se=None,
        drift_prior=None,
        residual_rms_m=None,
        frames=len(since_s),
        motion_start_s=span_s[0],
        motion_end_s=span_s[1],
    ).write(folder / "alignment.json")
