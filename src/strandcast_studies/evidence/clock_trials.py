"""Synthetic throws with known clocks: the joint log and marker detections that a rig would deliver.

Independent of the alignment: a random motion by the planner's curve is followed by the lab's servo; the lab's
camera projects the markers' corners, and a slightly miscalibrated camera maps them back.
"""

from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import PlanarArm
from strandcast.config.experiment import Experiment
from strandcast.core.trajectory import JointTrajectory
from strandcast.lab.scene import square_corners_m
from strandcast.lab.servo import CYCLE_S, SERVO_PRESETS, joint_drives, set_points
from strandcast.lab.strings import PAPER_STRINGS
from strandcast.lab.swing import simulate_swing
from strandcast.lab.variation import draw_variation
from strandcast.lab.view import LabView, make_view
from strandcast.planning.bezier import Curve, rest_heights, sample, whole_steps
from strandcast.records.alignment import Alignment
from strandcast.records.joint_log import JointLog

ARM_FILE = Path(__file__).resolve().parents[3] / "config" / "arms" / "planar3.toml"
COLUMNS = ("frame", "camera_time_s", "marker", "x_m", "y_m", "angle_rad", "sigma_m")
BEFORE_S, AFTER_S = 0.5, 0.6
FILMED_BEFORE_S, FILMED_AFTER_S = 0.25, 0.40
FREE_HEIGHTS, LARGEST_RAD_S2 = 6, 60.0
DURATIONS_S = (0.35, 0.9)
SLOWER = 0.999 * 0.995  # share of the rate limits that motions use
ENCODER_STEPS = 65536
WORKSPACE = {"x_m": (-1.0, 1.0), "y_m": (-0.9, 1.0)}


@dataclass(frozen=True)
class Faults:
    """Standard deviations of a rig's errors; typical values of a lab by default."""

    base_m: float = 5e-4  # the arm's place in the world
    zero_rad: float = 1e-3  # joint zeros
    log_rad: float = 5e-4  # encoder noise
    glued_m: float = 1e-3  # placement of the markers on the hand, relative to the arm's file
    glued_rad: float = 0.01
    camera_m: float = 1e-3  # calibration errors of the camera
    camera_rad: float = 5e-4
    focal: float = 5e-4  # a share
    white_px: tuple[float, float] = (0.02, 0.12)  # white noise of the corners: a range, drawn for each trial
    slow_px: tuple[float, float] = (0.01, 0.10)  # their correlated errors; a range, too
    slow_s: tuple[float, float] = (0.01, 0.08)  # correlation time; a range, too
    pixel_px: float = 0.02  # error of the corners that depends on their place within a pixel
    blur_rad: float = 1e-3  # apparent rotation of a marker at 5 m/s
    lost: float = 0.08  # share of the detections
    misread: float = 0.01  # share of the detections
    late_s: float = 0.0  # jitter of the log's time stamps
    stale: float = 0.0  # share of repeated rows in the log
    gap_s: float = 0.0  # length of a gap in the log in mid-throw


@dataclass(frozen=True, eq=False)
class TrueClock:
    """The truth about a throw's clocks: robot_time = camera_time · (1 + drift) + offset."""

    offset_s: float
    drift: float

    def robot_s(self, camera_s: float) -> float:
        """Return the robot's true time at a camera's time."""
        return camera_s * (1.0 + self.drift) + self.offset_s

    def error_s(self, fit: Alignment) -> tuple[float, float]:
        """Return error and standard error of a fit's offset at the detections' middle time [s].

        There the offset is independent of the drift.
        """
        assert fit.middle_camera_time_s is not None
        assert fit.middle_se_s is not None
        robot_s = float(fit.robot_time_s(np.array(fit.middle_camera_time_s)))
        return robot_s - self.robot_s(fit.middle_camera_time_s), fit.middle_se_s


@dataclass(frozen=True, eq=False)
class ClockTrial(TrueClock):
    """One throw: marker table, joint log and truth."""

    markers: dict[str, np.ndarray]
    log: JointLog
    hand_speed_m_s: float  # peak


@dataclass(frozen=True)
class Recipe:
    """A kind of throw."""

    frame_rate_hz: float = 500.0
    drift: float = 3e-5  # standard deviation of the clocks' drift
    faults: Faults = field(default_factory=Faults)
    string: str | None = None  # that pulls at the arm, by the lab's physics (slower); None: the servo alone
    motion: JointTrajectory | None = None  # instead of a random one


def clock_trial(arm: PlanarArm, seed: int, recipe: Recipe | None = None) -> ClockTrial:
    """Return throw `seed` of a kind."""
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
    filmed_q = np.stack([np.interp(since_s, time_s, column) for column in q.T], axis=1)
    markers = _detections(arm, camera_s, filmed_q, faults, rng)
    hand_m = hand_pose(arm.chain, arm.clamp, q).position_m
    speed = np.linalg.norm(np.diff(hand_m, axis=0), axis=1) / np.diff(time_s)
    return ClockTrial(start_s - lead_s, drift, markers, log, float(speed.max()))


def random_motion(arm: PlanarArm, rng: np.random.Generator) -> Curve:
    """Return a random motion by eq. 1 from rest to rest, within the joints' range and rate limits."""
    limits, step_s = arm.limits, 1.0 / arm.log_rate_hz
    joints = len(arm.joints)
    while True:
        time_s = whole_steps(rng.uniform(*DURATIONS_S), step_s)
        slopes = rng.uniform(-LARGEST_RAD_S2, LARGEST_RAD_S2, (joints, FREE_HEIGHTS))
        heights = rest_heights(np.cumsum(slopes * time_s / (FREE_HEIGHTS + 3), axis=1))
        motion = sample(Curve(np.zeros(joints), time_s, heights), step_s)
        room = np.minimum(
            limits.velocity_rad_s / np.abs(motion.qd_rad_s).max(axis=0),
            limits.acceleration_rad_s2 / np.abs(motion.qdd_rad_s2).max(axis=0),
        )
        heights = heights * np.minimum(1.0, SLOWER * room)[:, None]
        motion = sample(Curve(np.zeros(joints), time_s, heights), step_s)
        low, high = limits.lower_rad - motion.q_rad.min(axis=0), limits.upper_rad - motion.q_rad.max(axis=0)
        if (low <= high).all():
            return Curve(rng.uniform(low, high), time_s, heights)


def _played(
    arm: PlanarArm, recipe: Recipe, zero_rad: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return time from the motion's start (K,), true joint angles (K, J) and the motion's duration."""
    drawn = random_motion(arm, rng)
    motion = recipe.motion or sample(drawn, CYCLE_S)
    if recipe.string is not None:
        variation = draw_variation(rng, len(arm.joints), 1.0)
        swing = simulate_swing(arm, "servoj", PAPER_STRINGS[recipe.string], variation, motion)
        return swing.time_s, swing.q_rad - variation.joint_zero_rad + zero_rad, float(motion.time_s[-1])
    before, after = round(BEFORE_S / CYCLE_S), round(AFTER_S / CYCLE_S)
    around = ((before, after), (0, 0))
    q = np.pad(motion.q_rad, around, "edge")
    qd, qdd = (np.pad(part, around, "constant") for part in (motion.qd_rad_s, motion.qdd_rad_s2))
    preset = SERVO_PRESETS["servoj"]
    command = JointTrajectory((np.arange(len(q)) - before) * CYCLE_S, q, qd, qdd)
    aims = set_points(arm, preset, joint_drives(arm, preset), command)
    return command.time_s, aims.q_rad + zero_rad, float(motion.time_s[-1])


def _log(
    arm: PlanarArm, time_s: np.ndarray, q: np.ndarray, faults: Faults, rng: np.random.Generator
) -> JointLog:
    every = round(1.0 / (arm.log_rate_hz * CYCLE_S))
    time_s, q = time_s[::every].copy(), q[::every]
    step = 2.0 * np.pi / ENCODER_STEPS
    q = np.round((q + faults.log_rad * rng.standard_normal(q.shape)) / step) * step
    # A stamp may be late or early by less than a row; repeated rows keep their own stamps.
    late = np.clip(faults.late_s * rng.standard_normal(len(time_s)), -0.45, 0.45)
    time_s += late / arm.log_rate_hz * (faults.late_s > 0)
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


def _detections(
    arm: PlanarArm, camera_s: np.ndarray, q: np.ndarray, faults: Faults, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    view = _view(arm, int(rng.integers(1, 2**31)))
    wrong = _miscalibrated(view, faults, rng)
    hand = hand_pose(arm.chain, arm.clamp, q)
    base = faults.base_m * rng.standard_normal(2)
    speed = np.linalg.norm(np.gradient(hand.position_m, camera_s, axis=0), axis=1)
    white, slow = rng.uniform(*faults.white_px), rng.uniform(*faults.slow_px)
    slow_s = rng.uniform(*faults.slow_s)
    phase = rng.uniform(0, 2 * np.pi, (4, 2))
    columns: dict[str, list[np.ndarray]] = {name: [] for name in COLUMNS}
    for marker in arm.markers:
        place = np.array(marker.place_m) + faults.glued_m * rng.standard_normal(2)
        turned = marker.angle_rad + faults.glued_rad * rng.standard_normal()
        corners = square_corners_m(place, turned, marker.size_m)
        cos, sin = np.cos(hand.angle_rad), np.sin(hand.angle_rad)
        turn = np.stack([np.stack([cos, sin], axis=1), np.stack([-sin, cos], axis=1)], axis=1)
        world = hand.position_m[:, None] + base + corners @ turn
        uv = view.pixels(world, marker.offset_m)
        follow = np.exp(-np.diff(camera_s, prepend=camera_s[0] - 1.0) / slow_s)
        # A marker's corner errors are mostly shared; a quarter of the power is each corner's own.
        own, shared = _correlated_noise(follow, (4, 2), rng), _correlated_noise(follow, (1, 2), rng)
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


def _correlated_noise(follow: np.ndarray, shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Return noise (F, *shape) of variance 1 with correlations (F,) from frame to frame."""
    noise = rng.standard_normal((len(follow), *shape))
    for k in range(1, len(noise)):
        noise[k] = follow[k] * noise[k - 1] + np.sqrt(1.0 - follow[k] ** 2) * noise[k]
    return noise


def _view(arm: PlanarArm, seed: int) -> LabView:
    settings = {
        "string": {"length_m": 0.3},
        "target_m": (0.5, 0.3),
        "workspace_m": WORKSPACE,
        "seed": seed,
        "lab": {},
    }
    return make_view(Experiment.model_validate(settings), "clock-trials", arm)


def _miscalibrated(view: LabView, faults: Faults, rng: np.random.Generator) -> LabView:
    """Return the camera with calibration errors, rotated about the plane's middle."""
    turn, _ = cv2.Rodrigues(faults.camera_rad * rng.standard_normal(3))
    matrix = view.matrix.copy()
    matrix[0, 0] *= 1.0 + faults.focal * rng.standard_normal()
    matrix[1, 1] *= 1.0 + faults.focal * rng.standard_normal()
    moved = view.translation_m + faults.camera_m * rng.standard_normal(3)
    return LabView(view.width_px, view.height_px, matrix, view.distortion, view.rotation @ turn, moved)


def _pose_of(view: LabView, uv: np.ndarray, size_m: float, height_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return poses (F, 3) and the tracker's standard errors (F,) from corners (F, 4, 2)."""
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
