"""A synthetic experiment in records: three throws of a weighted string, made by numpy alone."""

import base64
import io
import shutil
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from markupsafe import Markup
from PIL import Image, ImageDraw

from strandcast.core.closest_approach import segment_approaches
from strandcast.core.trial_names import trial_name
from strandcast.records.alignment import HAND, Alignment
from strandcast.records.camera import BoardView, Camera, Lens, MarkerFit
from strandcast.records.clip import PLAYED_HZ, Clip, StripPicture
from strandcast.records.estimate import (
    ENSEMBLE,
    SIMULATED,
    ConvergenceStep,
    Estimate,
    HeldOutError,
    ParameterFit,
    WeightFit,
)
from strandcast.records.files import atomic_write
from strandcast.records.lab_truth import LAB_TRUTH
from strandcast.records.manifest import LogFacts, Manifest, VideoFacts
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
from strandcast.records.predicted import PredictedThrows, write_predicted
from strandcast.records.tables import write_table
from strandcast.records.track import TRACK, Track, TrackSummary
from strandcast.records.verdict import Verdict
from strandcast.report.measures import path_distance_m
from strandcast.report.panels import content
from strandcast.report.trial_page import trial_page
from strandcast.video.small import small_video

N = 10
LENGTH_M = 0.3
FRAME_RATE_HZ = 500.0
OFFSET_S = 0.7312  # true clock offset; the alignment finds 0.2 ms more
START_S = 1.0
MOTION_S = 0.6
AFTER_S = 0.4
TARGET_M = [0.606, 0.674]  # beside the tip of trial 3
CLIP_PX = 320, 180
MOST_IN_CLIP = 500
NUMBER_BITS, NUMBER_PX = 10, 16  # of the number in each frame of the clip
STROBE = "0 107 138 159 176 187 210 232 271 354"
SWINGS_RAD = {1: 2.0, 2: 2.2, 3: 2.5}
FOLLOWING_RAD = 2.55  # of the motion for trial 4


def throw(swing_rad: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times (T,), hand pose (T, 3) and points (T, N + 1, 2) of a string swung over a shoulder."""
    time_s, pose, points = _throws((*SWINGS_RAD.values(), FOLLOWING_RAD))
    which = [*SWINGS_RAD.values(), FOLLOWING_RAD].index(swing_rad)
    return time_s, pose[:, which], points[:, which]


@cache
def _throws(swings_rad: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the same of several throws, in the time of one: pose (T, S, 3), points (T, S, N + 1, 2)."""
    dt_s = 1e-3
    time_s = np.arange(0.0, MOTION_S + AFTER_S, dt_s)
    share = np.clip(time_s / MOTION_S, 0.0, 1.0)[:, None]
    swings = np.array(swings_rad)
    angle = 2.7 - swings * (share - np.sin(2 * np.pi * share) / (2 * np.pi))
    hand = (0.1 + 0.2 * swings)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=2)
    points = np.empty((*angle.shape, N + 1, 2))
    points[0] = hand[0, :, None] - np.outer(np.arange(N + 1) * LENGTH_M / N, [0.0, 1.0])
    before = points[0].copy()
    for k in range(1, len(time_s)):
        now = points[k - 1] + 0.999 * (points[k - 1] - before) + dt_s**2 * np.array([0.0, -9.81])
        before, points[k] = points[k - 1], _shortened(now, hand[k])
    return time_s, np.concatenate([hand, angle[:, :, None]], axis=2), points


def _shortened(now: np.ndarray, hand: np.ndarray) -> np.ndarray:
    """Pull segments back to their length, even and odd ones in turn, the hand being held."""
    for turn in range(40):
        now[:, 0] = hand
        lefts = np.arange(turn % 2, N, 2)
        away = now[:, lefts + 1] - now[:, lefts]
        length = np.linalg.norm(away, axis=2, keepdims=True)
        step = 0.5 * (length - LENGTH_M / N) * away / length
        held = (lefts == 0)[:, None]
        now[:, lefts] += np.where(held, 0.0, step)
        now[:, lefts + 1] -= np.where(held, 2 * step, step)
    now[:, 0] = hand
    return now


def camera() -> Camera:
    rng = np.random.default_rng(5)
    matrix = [[1100.0, 0.0, 640.0], [0.0, 1100.0, 360.0], [0.0, 0.0, 1.0]]

    def corners(count: int, sigma_px: float) -> list[list[float]]:
        places = np.column_stack([rng.uniform(80, 1200, count), rng.uniform(60, 660, count)])
        return np.column_stack([places, rng.normal(0, sigma_px, (count, 2))]).tolist()

    views = [
        BoardView(file=f"lens-{k}.png", corners=24, rms_px=0.11, used=True, residuals_px=corners(24, 0.08))
        for k in range(4)
    ]
    views.append(BoardView(file="lens-4.png", corners=3, rms_px=None, used=False, reason="too few corners"))
    return Camera(
        lens=Lens(
            width_px=1280,
            height_px=720,
            matrix=matrix,
            distortion=[-0.08, 0.02, 1e-4, -2e-4, 0.0],
            rms_px=0.113,
            standard_errors={"fx_px": 0.8, "fy_px": 0.8, "cx_px": 0.5, "cy_px": 0.5},
            views=views,
        ),
        rotation=[[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
        translation_m=[0.0, 0.35, 2.4],
        plane_rms_px=0.21,
        plane_markers=[MarkerFit(marker=k, rms_px=0.2, residuals_px=corners(4, 0.15)) for k in range(4)],
        string_offset_m=0.02,
        scale_m_per_px=0.00218,
        source="markers",
    )


def projected_px(record: Camera, points_m: np.ndarray) -> np.ndarray:
    world = np.column_stack([points_m.reshape(-1, 2), np.full(points_m.size // 2, record.string_offset_m)])
    turn, _ = cv2.Rodrigues(np.array(record.rotation))
    pixels, _ = cv2.projectPoints(
        world,
        turn,
        np.array(record.translation_m),
        np.array(record.lens.matrix),
        np.array(record.lens.distortion),
    )
    return pixels.reshape(*points_m.shape)


def write_strobe(path: Path, record: Camera, points_m: np.ndarray) -> None:
    rng = np.random.default_rng(9)
    noise = rng.normal(70, 6, (720, 1280)).clip(0, 255).astype(np.uint8)
    image = Image.fromarray(np.repeat(noise[:, :, None], 3, axis=2))
    draw = ImageDraw.Draw(image)
    for row in map(int, STROBE.split()):
        draw.line([tuple(p) for p in projected_px(record, points_m[row])], fill=(235, 235, 225), width=4)
    out = io.BytesIO()
    image.save(out, "WEBP", quality=70)
    with atomic_write(path) as temporary:
        temporary.write_bytes(out.getvalue())


def numbered(frame: int, width: int = CLIP_PX[0], height: int = CLIP_PX[1]) -> np.ndarray:
    """Return a grey picture with a frame's number in it: one square for each bit, white or black."""
    picture = np.full((height, width), 90, np.uint8)
    for bit in range(NUMBER_BITS):
        left = NUMBER_PX * bit
        picture[:NUMBER_PX, left : left + NUMBER_PX] = 240 if frame >> bit & 1 else 10
    return picture


def write_clip(path: Path, experiment: str, trial: int, frames: int, rate_hz: float) -> None:
    width, height = CLIP_PX
    step = -(-frames // MOST_IN_CLIP)
    shown = range(0, frames, step)
    mp4 = small_video(
        map(numbered, shown),
        width_px=width,
        height_px=height,
        count=len(shown),
        rate_hz=PLAYED_HZ,
        most_bytes=10**6,
    )
    strip = []
    for frame in map(int, STROBE.split()):
        _, data = cv2.imencode(".webp", numbered(frame))
        strip.append(StripPicture(frame=frame, webp=base64.b64encode(data.tobytes()).decode()))
    Clip(
        experiment=experiment,
        trial=trial,
        rate_hz=rate_hz,
        first_frame=0,
        step=step,
        frames=len(shown),
        box_px=(0, 0, 1280, 720),
        width_px=width,
        height_px=height,
        mp4=base64.b64encode(mp4).decode(),
        strip=strip,
    ).write(path)


def motion(experiment: str, trial: int, swing_rad: float, played: bool) -> Motion:
    time_s = np.arange(0.0, MOTION_S + 1e-9, 0.01)
    share = time_s / MOTION_S
    rate = -swing_rad / MOTION_S * (1 - np.cos(2 * np.pi * share))
    qd = np.column_stack([0.6 * rate, 0.3 * rate, 0.1 * rate])
    q = np.cumsum(qd, axis=0) * 0.01 + [2.0, 0.5, 0.2]
    _, pose, points = throw(swing_rad)
    heights = [[0.0, *(1.4 * peak * np.array([0.4, 1.0, 1.0, 0.4])), 0.0] for peak in qd.min(axis=0)]
    return Motion(
        experiment=experiment,
        trial=trial,
        target_m=TARGET_M,
        robot=Robot(name="planar3", file_sha256="a" * 64, urdf_sha256="b" * 64),
        joint_names=["joint_1", "joint_2", "joint_3"],
        start=StartPosture(positions_rad=q[0].tolist(), tolerance_rad=[0.01] * 3),
        bezier=Bezier(duration_s=MOTION_S, heights_rad_s=heights),
        points=points_of((time_s * 1e9).round().astype(int), q, qd, np.gradient(qd, 0.01, axis=0)),
        predicted=Prediction(
            miss_m=0.004,
            ensemble_miss_m=[0.004, 0.009, 0.013, 0.022],
            hit_probability=0.75,
            miss_quantiles_m={"p10": 0.002, "p50": 0.008, "p90": 0.031},
            calibrated=True,
            hit_time_s=0.48,
            largest_bend_rad=0.7,
            peak_speed_rad_s=[4.0, 2.0, 0.7],
            peak_acceleration_rad_s2=[41.0, 20.0, 7.0],
            peak_tip_speed_m_s=9.4,
            time_s=(np.arange(0, len(pose), 2) * 1e-3).tolist(),
            hand_m=pose[::2, :2].tolist(),
            tip_m=points[::2, -1].tolist(),
        ),
        provenance=Provenance(
            planner="ensemble",
            kind="first" if trial == 1 else "replanned",
            seed=11,
            planned_from={} if trial == 1 else {f"{trial_name(trial - 1)}/estimate.json": "c" * 64},
            parent_motion_sha256=None,
            simulations=1680,
            start_string="ensemble" if trial == 1 else None,
            string=StringSet(parameters={"k_s": 1e6}, masses=[1.0] * N),
            flags=[] if played else ["speed limit active at joint_1"],
        ),
    )


def predicted(planned: Motion) -> PredictedThrows:
    """Return 20 throws that go 2 % less to 2 % farther than a motion's, every other one with its path."""
    assert planned.predicted is not None
    tips_m = np.linspace(0.98, 1.02, 20)[:, None, None] * np.array(planned.predicted.tip_m)
    miss_m = np.array([path_distance_m(np.array([TARGET_M]), tip_m)[0] for tip_m in tips_m])
    chosen, time_s = np.arange(0, 20, 2), np.array(planned.predicted.time_s)
    return PredictedThrows(miss_m, chosen, time_s[::2], tips_m[chosen, ::2], planned.content_sha256())


def estimate(experiment: str, trial: int) -> Estimate:
    ranges = {
        "k_s": ("N/m/kg", 1e3, 1e8, 0.97),
        "c_s": ("N s/m/kg", 1.0, 1e3, 0.55),
        "k_h": ("N m/rad/kg", 1e-4, 10.0, 0.31),
        "c_h": ("N m s/rad/kg", 1e-4, 10.0, 0.2),
        "k_sh": ("N m/rad/kg", 1e-4, 10.0, 0.25),
        "c_sh": ("N m s/rad/kg", 1e-4, 10.0, 0.22),
        "C_c1": ("N s/m/kg", 1e-6, 10.0, 0.0),
        "C_c2": ("N s2/m2/kg", 1e-6, 10.0, 0.62),
        "k_ph": ("N m/rad/kg", 1e-3, 10.0, 0.7),
        "c_ph": ("N m s/rad/kg", 1e-4, 10.0, 0.4),
    }
    fits = []
    for name, (unit, low, high, chi) in ranges.items():
        spread = 0.04 if name in ("k_s", "C_c2") else 0.15
        value, below, above = (
            low * (high / low) ** min(max(c, 0.0), 1.0) for c in (chi, chi - spread, chi + spread)
        )
        fits.append(
            ParameterFit(
                name=name,
                unit=unit,
                value=value,
                exponent=chi,
                minimum=low,
                maximum=high,
                at_bound=chi < 0.01,
                ensemble_low=below,
                ensemble_high=above,
            )
        )
    masses = [1.0] * (N - 1) + [38.0]
    best = 0.0031 if trial == 1 else 0.0024
    return Estimate(
        experiment=experiment,
        trial=trial,
        trials_used=list(range(1, trial + 1)),
        length_m=LENGTH_M,
        points=N,
        reading="rate",
        dt_s=1e-3,
        search="descent",
        ranges="wide",
        start_shape="observed",
        evaluation="world",
        w=0.1,
        seed=42,
        string=StringSet(parameters={f.name: f.value for f in fits}, masses=masses),
        parameters=fits,
        weights=[
            WeightFit(
                place_m=0.3,
                kind="weight",
                value=38.0,
                minimum=0.1,
                maximum=800.0,
                at_bound=False,
                ensemble_low=31.0,
                ensemble_high=46.0,
            )
        ],
        frames_used=290,
        window_s=[START_S, START_S + 0.58],
        E_planned_m=0.0262 if trial == 1 else 0.0054,
        E_m=best,
        E_weighted_m=best * 1.6,
        E_points_m=[best * (0.37 + 0.14 * i) for i in range(N)],
        rmse_m=best * 1.2,
        tip_error_m=best * 1.9,
        held_out=[HeldOutError(what="every fifth frame", E_m=best * 1.1)],
        convergence=[
            ConvergenceStep(evaluations=16 * k, best_m=best + 0.04 * np.exp(-k / 25)) for k in range(1, 190)
        ],
        evaluations=3024,
        rejected=37,
        servo=None,
        planned_from={"trial-01/track.parquet": "d" * 64},
        warnings=[],
    )


def build_trial(folder: Path, experiment: str, trial: int, rate_hz: float = FRAME_RATE_HZ) -> None:
    """Write all results of one trial, filmed at a frame rate."""
    rng = np.random.default_rng(trial)
    time_s, pose, points = throw(SWINGS_RAD[trial])
    frame_s = np.arange(0.0, time_s[-1], 1 / rate_hz)
    rows = np.searchsorted(time_s, frame_s)
    true_s, true_m = START_S + frame_s, points[rows]
    camera_s = true_s - OFFSET_S
    frames = np.arange(len(rows))
    seen_m = true_m + rng.normal(0, 7e-4, true_m.shape)
    seen_m[120:128, 7:] = np.nan
    sigma_m = np.full(seen_m.shape[:2], 8e-4) * rng.uniform(0.7, 1.5, seen_m.shape[:2])
    track = Track(frames, camera_s, seen_m, sigma_m, np.zeros(sigma_m.shape, dtype=np.int32))
    write_table(folder / "track.parquet", TRACK, track.columns())
    record = camera()
    record.write(folder.parent / "cameras" / "main.json")
    write_strobe(folder / "strobe.webp", record, true_m)
    write_clip(folder / "clip.json", experiment, trial, len(frames), rate_hz)
    known = np.isfinite(seen_m[:, -1]).all(axis=1)
    tip_m, tip_s = seen_m[known, -1], true_s[known]
    passed = min(segment_approaches(tip_m, np.array(TARGET_M)), key=lambda each: each.distance_m)
    row = passed.index + (passed.share >= 0.5)
    hit = passed.distance_m <= 0.02
    Verdict(
        experiment=experiment,
        trial=trial,
        target_m=TARGET_M,
        hit_radius_m=0.02,
        miss_m=passed.distance_m,
        miss_sigma_m=0.0009,
        hit=hit,
        closest_frame=int(frames[known][row]),
        closest_robot_time_s=float(np.interp(passed.index + passed.share, np.arange(len(tip_s)), tip_s)),
        closest_m=passed.place_m.tolist(),
        reason=None,
    ).write(folder / "verdict.json")
    planned = motion(experiment, trial, SWINGS_RAD[trial], played=True)
    planned.write(folder / "motion.json")
    write_predicted(folder / "predicted.parquet", predicted(planned))
    _manifest(experiment, trial, len(frames), planned.content_sha256()).write(folder / "manifest.json")
    TrackSummary(
        experiment=experiment,
        trial=trial,
        source="video",
        points=N,
        length_m=LENGTH_M,
        decoded_frames=len(frames),
        expected_frames=len(frames),
        tracked_fraction=0.994,
        tip_fraction=0.984,
        marker_fraction=1.0,
        median_sigma_m=8.2e-4,
        choices={"polarity": "bright", "threshold_grey": 31, "strobe_frames": STROBE},
        warnings=["8 frames without the tip"],
    ).write(folder / "track.json")
    Alignment(
        experiment=experiment,
        trial=trial,
        source="fit",
        offset_s=OFFSET_S + 2e-4,
        offset_se_s=1.5e-4,
        drift=0.0,
        drift_se=4e-5,
        drift_prior=5e-5,
        residual_rms_m=8e-4,
        frames=len(frames),
        motion_start_s=START_S,
        motion_end_s=START_S + MOTION_S,
        marker_shift_m=[0.001, -0.0005],
        marker_turn_rad=0.01,
        sync_events=[],
    ).write(folder / "alignment.json")
    _hand(folder, time_s, pose, rng)
    estimate(experiment, trial).write(folder / "estimate.json")
    write_table(
        folder / "ensemble.parquet", ENSEMBLE, {"member": [0, 1], "E_m": [0.0031, 0.0033], "k_s": [1e6, 2e6]}
    )
    _simulated(folder, frames, true_s, true_m)
    _lab_truth(folder, frames, true_s, true_m)


def _manifest(experiment: str, trial: int, frames: int, motion_sha256: str) -> Manifest:
    return Manifest(
        experiment=experiment,
        trial=trial,
        video=VideoFacts(
            file="video.mp4",
            sha256="1" * 64,
            size_bytes=4_000_000,
            container="mov,mp4",
            codec="h264",
            pixel_format="gray",
            width_px=1280,
            height_px=720,
            header_frames=frames,
            packets=frames,
            frame_rate_hz=FRAME_RATE_HZ,
            frame_rate_source="time stamps",
            time_base_s=1 / 16000,
            time_stamps=[32 * k for k in range(frames)],
            gaps=[],
            duplicates=0,
        ),
        joint_log=LogFacts(
            file="joints.csv",
            sha256="2" * 64,
            rows=900,
            start_s=0.5,
            end_s=2.3,
            rate_hz=500.0,
            gaps=[],
            duplicates=0,
        ),
        motion_sha256=motion_sha256,
        warnings=[],
    )


def _hand(folder: Path, time_s: np.ndarray, pose: np.ndarray, rng: np.random.Generator) -> None:
    late = np.column_stack([np.interp(time_s - 0.02, time_s, pose[:, k]) for k in range(3)])
    seen = late[::2] + rng.normal(0, [6e-4, 6e-4, 3e-3], late[::2].shape)
    parts = [("commanded", time_s, pose), ("measured", time_s, late), ("seen", time_s[::2], seen)]
    write_table(
        folder / "hand.parquet",
        HAND,
        {
            "source": np.concatenate([np.full(len(t), name, dtype=object) for name, t, _ in parts]),
            "robot_time_s": np.concatenate([START_S + t for _, t, _ in parts]),
            "x_m": np.concatenate([p[:, 0] for _, _, p in parts]),
            "y_m": np.concatenate([p[:, 1] for _, _, p in parts]),
            "angle_rad": np.concatenate([p[:, 2] for _, _, p in parts]),
        },
    )


def _simulated(folder: Path, frames: np.ndarray, robot_s: np.ndarray, points_m: np.ndarray) -> None:
    since = (robot_s - START_S)[:, None, None]
    along = (np.arange(N + 1) / N)[None, :, None]
    wrong = along**2 * np.sin(9 * since) * np.array([0.7, -0.6])
    count = len(frames) * (N + 1)
    moved = np.stack([points_m + amplitude_m * wrong for amplitude_m in (0.06, 0.005)])
    columns = {
        "source": np.repeat(np.array(["planned", "fitted"], dtype=object), count),
        "frame": np.tile(np.repeat(frames, N + 1), 2),
        "robot_time_s": np.tile(np.repeat(robot_s, N + 1), 2),
        "point": np.tile(np.arange(N + 1), 2 * len(frames)),
        "x_m": moved[..., 0].ravel(),
        "y_m": moved[..., 1].ravel(),
    }
    write_table(folder / "simulated.parquet", SIMULATED, columns)


def _lab_truth(folder: Path, frames: np.ndarray, robot_s: np.ndarray, points_m: np.ndarray) -> None:
    places_m = np.arange(N + 1) * LENGTH_M / N
    write_table(
        folder / "lab_truth.parquet",
        LAB_TRUTH,
        {
            "frame": np.repeat(frames, N + 1),
            "robot_time_s": np.repeat(robot_s, N + 1),
            "place_m": np.tile(places_m, len(frames)),
            "x_m": points_m[..., 0].ravel(),
            "y_m": points_m[..., 1].ravel(),
        },
        {
            "offset_s": OFFSET_S,
            "drift": 0.0,
            "miss_m": 0.012,
            "joint_angles_rad": [[0.0]],
            "variation": {"grasp_m": 0.002},
        },
    )


@pytest.fixture(scope="session")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return results/<experiment> with trials 1, 2, 3 and the motion for trial 4."""
    folder = tmp_path_factory.mktemp("results") / "swing"
    for trial in SWINGS_RAD:
        (folder / trial_name(trial)).mkdir(parents=True)
        build_trial(folder / trial_name(trial), "swing", trial)
    following = motion("swing", 4, FOLLOWING_RAD, played=False)
    following.write(folder / "trial-04" / "motion.json")
    write_predicted(folder / "trial-04" / "predicted.parquet", predicted(following))
    return folder


@pytest.fixture(scope="session")
def fast_results(results: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the same results, but trial 3 filmed at ten times the frame rate."""
    folder = Path(shutil.copytree(results, tmp_path_factory.mktemp("fast") / "swing"))
    build_trial(folder / "trial-03", "swing", 3, 10 * FRAME_RATE_HZ)
    return folder


@pytest.fixture(scope="session")
def drawn(results: Path) -> str:
    """Return the page of trial 3 with its next motion, for the files whose tests look at a usual page."""
    next_motion = results / "trial-04" / "motion.json"
    return trial_page(results / "trial-03", trial=3, experiment="swing", next_motion=next_motion)


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the drawings of pages empty, for a test of their words: half of a page's time goes there."""
    empty = Markup('<svg role="img" aria-label="{}"></svg>')
    monkeypatch.setattr(content, "to_svg", lambda drawn, name: empty.format(drawn.alt))
