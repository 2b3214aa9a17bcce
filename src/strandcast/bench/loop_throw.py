"""One throw of the lab with its track supplied: everything of a trial's raw folder but the video."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from strandcast.alignment.rows import rows_of
from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import Arm, load_arm
from strandcast.lab.capture import SeenNoise, points_at, seen
from strandcast.lab.driver import joint_log
from strandcast.lab.strings import thread_of
from strandcast.lab.swing import BEFORE_S, Swing, simulate_swing
from strandcast.lab.truth import true_miss
from strandcast.lab.variation import Clocks, Variation, draw_variation
from strandcast.player.checks import sample
from strandcast.records.alignment import HAND, Alignment
from strandcast.records.joint_log import JointLog, Run, timing_of, write_joint_log
from strandcast.records.motion import Motion
from strandcast.records.tables import write_table
from strandcast.records.track import SUPPLIED, TRACK, Track, TrackSummary
from strandcast.seeds import rng
from strandcast.stages.context import Context, context_of, free_length_m

FRAME_RATE_HZ = 500.0
SEEN_BEFORE_S, SEEN_AFTER_S = 0.22, 0.45  # around the motion
LOG_START_S = 1.0


def same(variation: Variation) -> Variation:
    """Leave a throw's deviations as they were drawn."""
    return variation


@dataclass(frozen=True)
class Rig:
    """What errs in a throw: the noise of track and clocks, and which of a throw's deviations there are."""

    noise: SeenNoise = field(default_factory=SeenNoise)
    vary: Callable[[Variation], Variation] = same


def throw(root: Path, name: str, trial: int, rig: Rig) -> float:
    """Throw a trial's motion and write its raw folder, the track supplied; return the true miss [m]."""
    context = context_of(root, name)
    settings, arm = context.settings, load_arm(context.arm_file)
    folder = context.folder.trial(trial)
    folder.data.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(folder.results / "motion.json", folder.data / "motion.json")
    motion = Motion.read(folder.data / "motion.json")
    assert settings.lab is not None
    drawn = draw_variation(rng(name, settings.seed, trial, "lab-throw"), len(arm.joints), settings.lab.noise)
    variation = rig.vary(drawn)
    swing = swung(context, arm, motion, variation)
    motion_s = float(motion.time_s()[-1])
    log = joint_log(
        arm,
        swing,
        variation,
        Clocks(LOG_START_S, 0.0, 0.0),
        motion_s,
        rng(name, settings.seed, trial, "lab-log"),
    )
    span_s = (LOG_START_S + BEFORE_S, LOG_START_S + BEFORE_S + motion_s)
    _write_log(folder.data, arm, motion, log, span_s)
    _write_hand(folder.data, arm, log)
    _write_track(context, arm, trial, swing, span_s, rig.noise)
    return true_miss(swing, np.array(settings.target_m), motion_s)[0]


def swung(context: Context, arm: Arm, motion: Motion, variation: Variation) -> Swing:
    """Return what happens in the lab when a motion is played."""
    assert context.settings.lab is not None
    command = sample(motion, 1.0 / arm.log_rate_hz)
    return simulate_swing(arm, context.settings.lab.servo, thread_of(context.settings), variation, command)


def seen_points(context: Context, swing: Swing, motion_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times (F,) since the motion's start [s] and the mass points (F, n+1, 2) [m], without noise.

    As the tracker's do, they divide evenly what hangs out of the hand, not what is told of it.
    """
    n = context.settings.string.n
    time_s = np.arange(-SEEN_BEFORE_S, motion_s + SEEN_AFTER_S, 1.0 / FRAME_RATE_HZ)
    return time_s, points_at(swing, np.linspace(0.0, swing.places_m[-1], n + 1), time_s)


def still(joints: int) -> Variation:
    """Return the deviations of a throw without any."""
    return draw_variation(np.random.default_rng(0), joints, 0.0)


def without_scatter(variation: Variation) -> Variation:
    """Return a throw grasped, hung and zeroed as nominal; the joint log's noise stays."""
    return replace(
        still(len(variation.joint_zero_rad)),
        servo_gain=variation.servo_gain,
        log_noise_rad=variation.log_noise_rad,
    )


def _write_log(folder: Path, arm: Arm, motion: Motion, log: JointLog, span_s: tuple[float, float]) -> None:
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


def _write_hand(folder: Path, arm: Arm, log: JointLog) -> None:
    rows = rows_of(log, arm)
    told = np.isfinite(log.q_cmd_rad).all(axis=1)
    paths = {"measured": (rows.time_s, rows.q_rad), "commanded": (log.time_s[told], log.q_cmd_rad[told])}
    pose = np.concatenate([hand_pose(arm.chain, arm.clamp, q) for _, q in paths.values()])
    columns = {
        "source": np.repeat(np.array(list(paths), dtype=object), [len(t) for t, _ in paths.values()]),
        "robot_time_s": np.concatenate([t for t, _ in paths.values()]),
        "x_m": pose[:, 0],
        "y_m": pose[:, 1],
        "angle_rad": pose[:, 2],
    }
    write_table(folder / "hand.parquet", HAND, columns, {"source": "lab"})


def _write_track(
    context: Context, arm: Arm, trial: int, swing: Swing, span_s: tuple[float, float], noise: SeenNoise
) -> None:
    folder = context.folder.trial(trial).data
    random = rng(context.name, context.settings.seed, trial, "lab-sensor")
    since_s, points_m = seen_points(context, swing, span_s[1] - span_s[0])
    found = seen(points_m, 1.0 / FRAME_RATE_HZ, noise, random)
    sigma_m = np.full(found.shape[:2], max(float(np.hypot(noise.white_m, noise.slow_m)), 1e-6))
    flags = np.full(found.shape[:2], SUPPLIED, np.int32)
    track = Track(np.arange(len(since_s)), since_s + span_s[0], found, sigma_m, flags)
    write_table(folder / "track.parquet", TRACK, track.columns(), {"source": "lab"})
    there = track.seen()
    TrackSummary(
        experiment=context.name,
        trial=trial,
        source="supplied",
        points=context.settings.string.n,
        length_m=free_length_m(context, arm.clamp.swallowed_m),
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
