"""Throws of which the clocks are known: joint log and marker sightings as a rig of the lab would give them.

Nothing here comes from the alignment: the motion is the planner's draw, the arm follows through the lab's
servo, the lab's camera projects the corners of the markers, and a camera that is a little wrong maps them
back.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import Arm
from strandcast.experiment import Experiment
from strandcast.lab.scene import square_corners_m
from strandcast.lab.servo import CYCLE_S, PRESETS, drive_of, set_points
from strandcast.lab.strings import PAPER_STRINGS
from strandcast.lab.swing import simulate_swing
from strandcast.lab.variation import draw_variation
from strandcast.lab.view import View, make_view
from strandcast.motion.bezier import Curve, Samples, rest_heights, sample, whole_steps
from strandcast.player.protocol import Command
from strandcast.records.joint_log import JointLog

ARM_FILE = Path(__file__).resolve().parents[3] / "config" / "arms" / "planar3.toml"
COLUMNS = ("frame", "camera_time_s", "marker", "x_m", "y_m", "angle_rad", "sigma_m")
BEFORE_S, AFTER_S = 0.5, 0.6
FILMED_BEFORE_S, FILMED_AFTER_S = 0.25, 0.40
FREE_HEIGHTS, LARGEST_RAD_S2 = 6, 60.0
DURATIONS_S = (0.35, 0.9)
SLOWER = 0.999 * 0.995  # than the limits of the rates
ENCODER_STEPS = 65536
WORKSPACE = {"x_m": (-1.0, 1.0), "y_m": (-0.9, 1.0)}


@dataclass(frozen=True)
class Faults:
    """Standard deviations of what is wrong with a rig; the usual ones of a lab by default.

    Attributes
    ----------
    base_m, zero_rad, log_rad
        The arm in the world, zeros of its joints, noise of its encoders.
    glued_m, glued_rad
        Markers on the hand against the arm's file.
    camera_m, camera_rad, focal
        The calibrated camera against the real one: place, turn, focal length (a share).
    white_px, slow_px, slow_s
        Corners: noise of a frame, errors that follow each other, and for how long: each trial draws its own
        between the two numbers.
    pixel_px
        Corners: error that depends on where in a pixel they lie.
    blur_rad
        By how much a marker at 5 m/s seems turned.
    lost, misread
        Shares of the sightings.
    late_s, stale, gap_s
        Log: jitter of its stamps, share of rows that repeat the one before, and a hole in mid-throw.
    """

    base_m: float = 5e-4
    zero_rad: float = 1e-3
    log_rad: float = 5e-4
    glued_m: float = 1e-3
    glued_rad: float = 0.01
    camera_m: float = 1e-3
    camera_rad: float = 5e-4
    focal: float = 5e-4
    white_px: tuple[float, float] = (0.02, 0.12)
    slow_px: tuple[float, float] = (0.01, 0.10)
    slow_s: tuple[float, float] = (0.01, 0.08)
    pixel_px: float = 0.02
    blur_rad: float = 1e-3
    lost: float = 0.08
    misread: float = 0.01
    late_s: float = 0.0
    stale: float = 0.0
    gap_s: float = 0.0


@dataclass(frozen=True, eq=False)
class ClockTrial:
    """One throw: columns of markers.parquet, the log, and the truth.

    Attributes
    ----------
    offset_s, drift
        robot_time = camera_time · (1 + drift) + offset.
    hand_speed_m_s
        Greatest speed of the hand.
    """

    markers: dict[str, np.ndarray]
    log: JointLog
    offset_s: float
    drift: float
    hand_speed_m_s: float

    def robot_s(self, camera_s: float) -> float:
        """Return the robot's true time at a camera's time."""
        return camera_s * (1.0 + self.drift) + self.offset_s


@dataclass(frozen=True)
class Recipe:
    """What kind of throw is made.

    Attributes
    ----------
    frame_rate_hz
        Of the camera.
    drift
        Standard deviation of the clocks' drift.
    faults
        Of the rig.
    string
        Throw a string with the lab's physics, which pulls at the arm (slower); None: the servo alone.
    motion
        Angles of a motion of one's own, in place of the planner's draw.
    """

    frame_rate_hz: float = 500.0
    drift: float = 3e-5
    faults: Faults = field(default_factory=Faults)
    string: str | None = None
    motion: Samples | None = None


def clock_trial(arm: Arm, seed: int, recipe: Recipe | None = None) -> ClockTrial:
    """Make throw `seed` of a kind."""
    recipe = recipe or Recipe()
    rng = np.random.default_rng([20, seed])
    faults = recipe.faults
    zero_rad = faults.zero_rad * rng.standard_normal(len(arm.joints))
    time_s, q, motion_s = _played(arm, recipe, zero_rad, rng)
    start_s = float(rng.uniform(1.0, 2000.0))
    log = _log(arm, time_s + start_s, q - zero_rad, faults, rng)
    drift = recipe.drift * float(rng.standard_normal())
    lead_s = FILMED_BEFORE_S + float(rng.uniform(0.0, 0.1))
    frames = round((lead_s + motion_s + FILMED_AFTER_S) * recipe.frame_rate_hz)
    camera_s = np.arange(frames) / recipe.frame_rate_hz
    since_s = camera_s * (1.0 + drift) - lead_s
    seen_q = np.stack([np.interp(since_s, time_s, column) for column in q.T], axis=1)
    markers = _sightings(arm, camera_s, seen_q, faults, rng)
    hand_m = hand_pose(arm.chain, arm.clamp, q)[:, :2]
    speed = np.linalg.norm(np.diff(hand_m, axis=0), axis=1) / np.diff(time_s)
    return ClockTrial(markers, log, start_s - lead_s, drift, float(speed.max()))


def random_motion(arm: Arm, rng: np.random.Generator) -> Curve:
    """Return a random motion by eq. 1, from rest to rest, in the joints' range, slowed to their rates."""
    limits, step_s = arm.limits, 1.0 / arm.log_rate_hz
    joints = len(arm.joints)
    while True:
        time_s = whole_steps(rng.uniform(*DURATIONS_S), step_s)
        slopes = rng.uniform(-LARGEST_RAD_S2, LARGEST_RAD_S2, (joints, FREE_HEIGHTS))
        heights = rest_heights(np.cumsum(slopes * time_s / (FREE_HEIGHTS + 3), axis=1))
        motion = sample(Curve(np.zeros(joints), time_s, heights), step_s)
        room = np.minimum(
            limits.velocity_rad_s / np.abs(motion.qd).max(axis=0),
            limits.acceleration_rad_s2 / np.abs(motion.qdd).max(axis=0),
        )
        heights = heights * np.minimum(1.0, SLOWER * room)[:, None]
        motion = sample(Curve(np.zeros(joints), time_s, heights), step_s)
        low, high = limits.lower_rad - motion.q.min(axis=0), limits.upper_rad - motion.q.max(axis=0)
        if (low <= high).all():
            return Curve(rng.uniform(low, high), time_s, heights)


def _played(
    arm: Arm, recipe: Recipe, zero_rad: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return time from the motion's start (K,), true joint angles (K, J), and how long the motion is."""
    drawn = random_motion(arm, rng)
    motion = recipe.motion or sample(drawn, CYCLE_S)
    if recipe.string is not None:
        command = Command(motion.time_s, motion.q, motion.qd, motion.qdd)
        variation = draw_variation(rng, len(arm.joints), 1.0)
        swing = simulate_swing(arm, "servoj", PAPER_STRINGS[recipe.string], variation, command)
        return swing.time_s, swing.q_rad - variation.joint_zero_rad + zero_rad, float(motion.time_s[-1])
    before, after = round(BEFORE_S / CYCLE_S), round(AFTER_S / CYCLE_S)
    around = ((before, after), (0, 0))
    q = np.pad(motion.q, around, "edge")
    qd, qdd = (np.pad(part, around, "constant") for part in (motion.qd, motion.qdd))
    preset = PRESETS["servoj"]
    aims = set_points(arm, preset, drive_of(arm, preset), q, qd, qdd)
    return (np.arange(len(q)) - before) * CYCLE_S, aims.q_rad + zero_rad, float(motion.time_s[-1])


def _log(arm: Arm, time_s: np.ndarray, q: np.ndarray, faults: Faults, rng: np.random.Generator) -> JointLog:
    every = round(1.0 / (arm.log_rate_hz * CYCLE_S))
    time_s, q = time_s[::every].copy(), q[::every]
    step = 2.0 * np.pi / ENCODER_STEPS
    q = np.round((q + faults.log_rad * rng.standard_normal(q.shape)) / step) * step
    # A stamp may be late or early by less than a row; rows that are repeated keep their own stamps.
    time_s += (
        np.clip(faults.late_s * rng.standard_normal(len(time_s)), -0.45, 0.45)
        / arm.log_rate_hz
        * (faults.late_s > 0)
    )
    stale = np.flatnonzero(rng.uniform(size=len(q)) < faults.stale)
    stale = stale[stale > 0]
    q[stale] = q[stale - 1]
    keep = np.ones(len(q), bool)
    if faults.gap_s > 0:
        middle = float(rng.uniform(BEFORE_S + 0.1, BEFORE_S + 0.4)) + time_s[0]
        keep = np.abs(time_s - middle) > 0.5 * faults.gap_s
    time_s, q = time_s[keep], q[keep]
    nothing = np.full(q.shape, np.nan)
    return JointLog(
        joint_names=list(arm.joints),
        time_s=np.round(time_s, 6),
        q_rad=q,
        qd_rad_s=nothing,
        q_cmd_rad=nothing,
        qd_cmd_rad_s=nothing,
        since_start_s=np.full(len(q), np.nan),
        flags=np.zeros(len(q), np.int32),
    )


def _sightings(
    arm: Arm, camera_s: np.ndarray, q: np.ndarray, faults: Faults, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Return the columns of markers.parquet."""
    view = _view(arm, int(rng.integers(1, 2**31)))
    wrong = _miscalibrated(view, faults, rng)
    hand = hand_pose(arm.chain, arm.clamp, q)
    base = faults.base_m * rng.standard_normal(2)
    speed = np.linalg.norm(np.gradient(hand[:, :2], camera_s, axis=0), axis=1)
    white, slow = rng.uniform(*faults.white_px), rng.uniform(*faults.slow_px)
    slow_s = rng.uniform(*faults.slow_s)
    phase = rng.uniform(0, 2 * np.pi, (4, 2))
    columns: dict[str, list[np.ndarray]] = {name: [] for name in COLUMNS}
    for marker in arm.markers:
        place = np.array(marker.place_m) + faults.glued_m * rng.standard_normal(2)
        turned = marker.angle_rad + faults.glued_rad * rng.standard_normal()
        corners = square_corners_m(place, turned, marker.size_m)
        cos, sin = np.cos(hand[:, 2]), np.sin(hand[:, 2])
        turn = np.stack([np.stack([cos, sin], axis=1), np.stack([-sin, cos], axis=1)], axis=1)
        world = hand[:, None, :2] + base + corners @ turn
        uv = view.pixels(world, marker.offset_m)
        follow = np.exp(-np.diff(camera_s, prepend=camera_s[0] - 1.0) / slow_s)
        # A marker's corners mostly err together; a quarter of the power is each one's own.
        own, shared = _following(follow, (4, 2), rng), _following(follow, (1, 2), rng)
        uv = uv + slow * (0.5 * own + np.sqrt(0.75) * shared) + white * rng.standard_normal(uv.shape)
        uv = uv + faults.pixel_px * np.sin(2 * np.pi * uv + phase)
        pose, sigma_m = _pose_of(wrong, uv, marker.size_m, marker.offset_m)
        pose[:, 2] += faults.blur_rad * speed / 5.0
        misread = rng.uniform(size=len(pose)) < faults.misread
        pose[misread] += rng.uniform(-1, 1, (int(misread.sum()), 3)) * (0.1, 0.1, 1.5)
        kept = np.flatnonzero(rng.uniform(size=len(pose)) >= faults.lost)
        rows = (kept, camera_s, np.full(len(pose), marker.id), *pose.T, sigma_m)
        for name, column in zip(COLUMNS, rows, strict=True):
            columns[name].append(column if name == "frame" else column[kept])
    return {name: np.concatenate(parts) for name, parts in columns.items()}


def _following(follow: np.ndarray, shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Return noise (F, *shape) of size 1 that follows itself by shares (F,) from frame to frame."""
    noise = rng.standard_normal((len(follow), *shape))
    for k in range(1, len(noise)):
        noise[k] = follow[k] * noise[k - 1] + np.sqrt(1.0 - follow[k] ** 2) * noise[k]
    return noise


def _view(arm: Arm, seed: int) -> View:
    settings = {
        "string": {"length_m": 0.3},
        "target_m": (0.5, 0.3),
        "workspace_m": WORKSPACE,
        "seed": seed,
        "lab": {},
    }
    return make_view(Experiment.model_validate(settings), "clock-trials", arm)


def _miscalibrated(view: View, faults: Faults, rng: np.random.Generator) -> View:
    """Return the camera as its calibration has it: turned about the plane's middle, so markers stay near."""
    turn, _ = cv2.Rodrigues(faults.camera_rad * rng.standard_normal(3))
    matrix = view.matrix.copy()
    matrix[0, 0] *= 1.0 + faults.focal * rng.standard_normal()
    matrix[1, 1] *= 1.0 + faults.focal * rng.standard_normal()
    moved = view.translation_m + faults.camera_m * rng.standard_normal(3)
    return View(view.width_px, view.height_px, matrix, view.distortion, view.rotation @ turn, moved)


def _pose_of(view: View, uv: np.ndarray, size_m: float, height_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return poses (F, 3) and what the tracker would say of their error (F,) from corners (F, 4, 2)."""
    rays = view.rays(uv)
    rays = np.concatenate([rays, np.ones((*rays.shape[:-1], 1))], axis=-1) @ view.rotation
    eye = -view.rotation.T @ view.translation_m
    world = eye[:2] + rays[..., :2] * ((height_m - eye[2]) / rays[..., 2:])
    centre = world.mean(axis=1)
    model = square_corners_m(np.zeros(2), 0.0, size_m)
    about = world - centre[:, None]
    along = (about * model).sum(axis=(1, 2))
    across = (model[:, 0] * about[..., 1] - model[:, 1] * about[..., 0]).sum(axis=1)
    angle = np.arctan2(across, along)
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.stack([np.stack([cos, sin], axis=1), np.stack([-sin, cos], axis=1)], axis=1)
    rms_m = np.sqrt(((about - model @ turn) ** 2).sum(axis=(1, 2)) / 5.0)
    floor_m = 0.1 / view.scale_px_m(centre.mean(axis=0), height_m)
    return np.column_stack([centre, angle]), np.maximum(rms_m, floor_m) / 2.0
