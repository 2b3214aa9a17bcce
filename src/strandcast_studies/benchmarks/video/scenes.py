"""Film the tracking benchmark's throws: video.mp4, camera.json and the truth, one folder per video.

python -m strandcast_studies.benchmarks.video.scenes --work DIR [--seeds tuning] [--only NAME]
"""

import argparse
import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import PlanarArm, load_arm
from strandcast.camera.mapping import metre_per_pixel
from strandcast.config.experiment import Experiment
from strandcast.errors import StrandcastError
from strandcast.lab.film import FilmSubject, film_frames, film_subject, interpolated
from strandcast.lab.rig import weight_radius_m
from strandcast.lab.scene import JOINT, Canvas, LabScene, canvas_on, make_scene, paint_arm
from strandcast.lab.strings import PAPER_STRINGS, PhysicalString
from strandcast.lab.variation import draw_variation
from strandcast.lab.video import write_video
from strandcast.lab.view import LabView
from strandcast.records.camera import Camera, Lens
from strandcast.records.files import write_text
from strandcast.seeds import rng
from strandcast_studies.benchmarks.video import cases as video_cases
from strandcast_studies.benchmarks.video.cases import FRAME_RATE_HZ, LEAST_CNR, TONES_BY_CONTRAST, VideoCase
from strandcast_studies.benchmarks.video.motion import FILMED_AFTER_S, draw_swing
from strandcast_studies.benchmarks.video.truth import ON_THE_STRING_M, Truth, TruthArrays

ARM_FILE = Path(__file__).parents[4] / "config" / "arms" / "planar3.toml"
ENCODER = {"preset": "ultrafast", "qp": "18", "threads": "1"}
SIZE_PX = (1280, 720)
MIDDLE_M = (0.12, 0.20)  # of what the camera sees
WIDTHS_M = {0.30: 1.9, 0.51: 2.4, 0.61: 2.7}  # of what it sees, by the string's length
MARKER_M = 0.08
EVERY_CNR = 10  # the contrast-to-noise ratio is measured in every tenth frame
RIDGE_PX = 2.0  # reach across the string's true centre in which its contrast peaks
POINT_SPACING_M = 0.03


@dataclass(frozen=True, eq=False)
class StagedThrow:
    """A throw to be filmed: scene, moving parts, the string as grasped, mid-exposure times (F,) [s]."""

    scene: LabScene
    actors: FilmSubject
    hanging: PhysicalString
    middles_s: np.ndarray
    motion_s: float

    def frames(self, case: VideoCase) -> Iterator[np.ndarray]:
        """Yield the frames (H, W) uint8; each is overwritten by the next."""
        sensor = rng(case.name, case.seed, 1, "lab-sensor")
        return film_frames(self.scene, self.actors, self.middles_s, case.exposure_s, case.noise_grey, sensor)


def shoot(case: VideoCase, arm: PlanarArm) -> StagedThrow:
    """Simulate the throw of a case."""
    thread = PAPER_STRINGS[case.string]
    experiment = experiment_of(case)
    scene = make_scene(experiment, case.name, arm)
    variation = draw_variation(rng(case.name, case.seed, 1, "lab-throw"), len(arm.joints), 1.0)
    assert experiment.workspace_m is not None
    swing, motion_s = draw_swing(case, arm, thread, variation, experiment.workspace_m)
    hanging = thread.shifted(variation.grasp_length_m)
    actors = film_subject(swing, hanging, TONES_BY_CONTRAST[case.contrast])
    count = round((motion_s + FILMED_AFTER_S - case.start_s) * FRAME_RATE_HZ)
    middles_s = np.arange(min(count, case.most_frames)) / FRAME_RATE_HZ + case.start_s
    return StagedThrow(scene, actors, hanging, middles_s, motion_s)


def film_case(case: VideoCase, arm: PlanarArm, work: Path) -> Path:
    """Film one video into its folder below `work`, unless it exists; return the folder."""
    folder = work / case.name
    if (folder / "case.json").exists():
        return folder
    folder.mkdir(parents=True, exist_ok=True)
    taken = shoot(case, arm)
    write_video(folder / "video.mp4", taken.frames(case), *SIZE_PX, FRAME_RATE_HZ, ENCODER)
    camera = camera_of(taken.scene.view)
    camera.write(folder / "camera.json")
    arrays = arrays_of(case, taken, camera)
    check_contrast(case, arrays)
    arrays.write(folder / "truth.npz")
    length_m = PAPER_STRINGS[case.string].length_m
    facts = {"length_m": length_m, "points": round(length_m / POINT_SPACING_M), "motion_s": taken.motion_s}
    write_text(folder / "case.json", json.dumps(asdict(case) | facts, indent=1) + "\n")
    return folder


def check_contrast(case: VideoCase, arrays: TruthArrays) -> None:
    """Refuse a video whose string is barely visible: it says nothing about a tracker."""
    middle = float(np.median(arrays.cnr))
    if middle < LEAST_CNR:
        what = f"{case.name}: contrast is {middle:.1f} times the noise, {LEAST_CNR:g} are required"
        raise StrandcastError("SC-L012", what, fix="less noise, a shorter exposure or another tone")


def read_case(folder: Path) -> tuple[VideoCase, dict[str, Any]]:
    """Return the case filmed into a folder, and all facts about it."""
    facts = json.loads((folder / "case.json").read_text())
    return VideoCase(**{f.name: facts[f.name] for f in fields(VideoCase) if f.name in facts}), facts


def experiment_of(case: VideoCase) -> Experiment:
    """Return the virtual rig of a case, with markers at the edges of the camera's view."""
    length_m = PAPER_STRINGS[case.string].length_m
    half = 0.5 * WIDTHS_M[length_m] * np.array([1.0, SIZE_PX[1] / SIZE_PX[0]])
    (left, low), (right, high) = MIDDLE_M - half, MIDDLE_M + half
    inset = 0.75 * MARKER_M
    places = [(x, y) for y in (high - inset, low + inset) for x in (left + inset, MIDDLE_M[0], right - inset)]
    return Experiment.model_validate(
        {
            "string": {"length_m": length_m},
            "target_m": (MIDDLE_M[0] + 0.3, MIDDLE_M[1] + 0.2),
            "workspace_m": {"x_m": (left, right), "y_m": (low, high)},
            "seed": case.seed,
            "cameras": {
                "main": {
                    "plane": {
                        "size_m": MARKER_M,
                        "markers": [{"id": k, "x_m": x, "y_m": y} for k, (x, y) in enumerate(places)],
                    }
                }
            },
            "lab": {
                "string": case.string,
                "camera": {
                    "size_px": SIZE_PX,
                    "frame_rate_hz": FRAME_RATE_HZ,
                    "exposure_s": case.exposure_s,
                    "noise_grey": case.noise_grey,
                    "background": case.background,
                },
            },
        }
    )


def camera_of(view: LabView) -> Camera:
    """Return the lab's camera as an error-free calibration."""
    camera = Camera(
        lens=Lens(
            width_px=view.width_px,
            height_px=view.height_px,
            matrix=view.matrix.tolist(),
            distortion=view.distortion.tolist(),
            rms_px=0.0,
        ),
        rotation=view.rotation.tolist(),
        translation_m=view.translation_m.tolist(),
        plane_rms_px=0.0,
        plane_markers=[],
        string_offset_m=0.0,
        scale_m_per_px=1.0,
        source="given",
    )
    return camera.model_copy(update={"scale_m_per_px": float(metre_per_pixel(camera, np.array(MIDDLE_M)))})


def arrays_of(case: VideoCase, taken: StagedThrow, camera: Camera) -> TruthArrays:
    """Return the arrays of a filmed throw's truth."""
    scene, swing, hanging, middles_s = taken.scene, taken.actors.swing, taken.hanging, taken.middles_s
    q, nodes = interpolated(swing, middles_s)
    speed_m_s = np.linalg.norm(np.gradient(nodes, middles_s, axis=0), axis=2)
    blur_px = speed_m_s * case.exposure_s / metre_per_pixel(camera, nodes)
    bare = TruthArrays(
        nodes_m=nodes,
        places_m=swing.places_m,
        hand=hand_pose(scene.arm.chain, scene.arm.clamp, q).array(),
        q_rad=q,
        hidden=np.zeros((len(q), round(swing.places_m[-1] / ON_THE_STRING_M) + 1), bool),
        blur_px=blur_px.max(axis=1),
        tip_blur_px=blur_px[:, -1],
        tip_speed_m_s=speed_m_s[:, -1],
        cnr=np.zeros(0),
        weights_m=np.reshape([(place, weight_radius_m(mass)) for place, mass in hanging.weights], (-1, 2)),
        pipes_m=np.array([pipe[:2] for pipe in hanging.pipes]).reshape(-1, 2),
        length_m=np.array(swing.places_m[-1]),
    )
    hidden = replace(bare, hidden=hidden_places(scene, Truth(bare, camera)))
    return replace(hidden, cnr=contrast_to_noise(case, taken, Truth(hidden, camera)))


def dense_places_m(truth: Truth) -> np.ndarray:
    """Return places along the string (D,), every `ON_THE_STRING_M`."""
    places_m = np.arange(truth.arrays.hidden.shape[1]) * ON_THE_STRING_M
    return np.asarray(np.minimum(places_m, float(truth.arrays.length_m)))


def arm_cover(scene: LabScene, canvas: Canvas, q_rad: np.ndarray) -> np.ndarray:
    """Return where arm and hand are in the picture, (H, W) bool; the canvas is overwritten."""
    canvas.light[:] = 0.0
    paint_arm(canvas, scene, q_rad)
    return np.asarray(canvas.light > 0.5 * JOINT)


def hidden_places(scene: LabScene, truth: Truth) -> np.ndarray:
    """Return which places along the string (F, D) are behind the arm or the hand."""
    canvas = canvas_on(np.zeros_like(scene.still))
    uv = np.rint(truth.pixels(truth.at(dense_places_m(truth)))).astype(int)
    height, width = scene.still.shape
    u, v = np.clip(uv[..., 0], 0, width - 1), np.clip(uv[..., 1], 0, height - 1)
    return np.stack([arm_cover(scene, canvas, q)[v[k], u[k]] for k, q in enumerate(truth.arrays.q_rad)])


def contrast_to_noise(case: VideoCase, taken: StagedThrow, truth: Truth) -> np.ndarray:
    """Return the contrast-to-noise ratio (K,) at visible places of the string in every `EVERY_CNR`-th frame.

    Contrast: largest difference between a noiseless rendering and the empty scene within `RIDGE_PX` of the
    string. Noise: the standard deviation of a noisy rendering from the noiseless one at those pixels.
    """
    chosen = np.arange(0, len(taken.middles_s), EVERY_CNR)
    some = replace(taken, middles_s=taken.middles_s[chosen])
    pairs = zip(some.frames(replace(case, noise_grey=0.0)), some.frames(case), strict=True)
    empty = taken.scene.still * taken.scene.gain
    places = dense_places_m(truth)
    visible = truth.visible(places)
    steps = np.arange(-RIDGE_PX, RIDGE_PX + 0.1, 0.5)[:, None, None]
    peaks, off = [], []
    for frame, (clean, noisy) in zip(chosen, pairs, strict=True):
        if visible[frame].sum() < 2:
            continue
        line = truth.pixels(truth.at(places)[frame])[visible[frame]]
        along = np.gradient(line, axis=0)
        across = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1, keepdims=True)
        uv = np.rint(line + steps * across).astype(int)
        u, v = np.clip(uv[..., 0], 0, SIZE_PX[0] - 1), np.clip(uv[..., 1], 0, SIZE_PX[1] - 1)
        contrast = np.abs(clean[v, u] - empty[v, u])
        peaks.append(contrast.max(axis=0))
        off.append((noisy[v, u].astype(float) - clean[v, u])[contrast > 0.5 * contrast.max(axis=0)])
    return np.asarray(np.concatenate(peaks) / np.concatenate(off).std())


SETS = {"held-out": video_cases.held_out, "tuning": video_cases.tuning, "quick": video_cases.quick}


def main(arguments: list[str] | None = None) -> None:
    """Film a set of videos from the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", choices=sorted(SETS), default="held-out")
    parser.add_argument(
        "--work", type=Path, required=True, help="folder for the videos, outside the repository"
    )
    parser.add_argument("--only", help="only videos whose name contains this")
    chosen = parser.parse_args(arguments)
    arm = load_arm(ARM_FILE).planar()
    for case in SETS[chosen.seeds]():
        if chosen.only is None or chosen.only in case.name:
            folder = film_case(case, arm, chosen.work)
            print(describe(folder), flush=True)


def describe(folder: Path) -> str:
    """Return a line of text with a video's properties."""
    arrays = Truth.read(folder).arrays
    low, middle = np.percentile(arrays.cnr, [5, 50])
    megabytes = (folder / "video.mp4").stat().st_size / 1e6
    return (
        f"{folder.name:12s} {len(arrays.hand)} frames  tip {arrays.tip_speed_m_s.max():5.1f} m/s  "
        f"blur {arrays.blur_px.max():4.1f} px  CNR {middle:5.1f} (5 %: {low:4.1f})  {megabytes:.0f} MB"
    )


if __name__ == "__main__":
    main()
