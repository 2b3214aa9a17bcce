"""Run the peers on a filmed video: with the same frames and the exact hand, empty scene and arm."""

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from strandcast.arm.load import PlanarArm
from strandcast.camera.mapping import pixel_to_metre
from strandcast.lab.scene import canvas_on, make_scene
from strandcast.video.reader import open_video
from strandcast_studies.benchmarks.video.cpd import PointDrift
from strandcast_studies.benchmarks.video.scenes import arm_cover, experiment_of, read_case
from strandcast_studies.benchmarks.video.skeleton import NoPathError, least_bending_path, longest_path
from strandcast_studies.benchmarks.video.truth import Truth

NOISE_TIMES, LEAST_GREY = 5.0, 8.0  # threshold of the mask, in noise and in grey levels; chosen
ARM_RIM_PX = 3  # excluded margin around the arm
SMALL_AREA_PX = 12
Finder = Callable[[np.ndarray, np.ndarray], np.ndarray]  # from mask and hand [px] to a line (K, 2) [px]
PEERS = ("skeleton", "least bending", "point drift")


class PeerTrack:
    """A peer's track, without sigmas and flags; its number of failed frames; CPU time [s]."""

    def __init__(self, frames: int, count: int) -> None:
        self.points_m = np.full((frames, count + 1, 2), np.nan)
        self.sigma_m = np.full((frames, count + 1), np.nan)
        self.flags = np.zeros((frames, count + 1), np.int32)
        self.failed, self.cpu_s = 0, 0.0

    def add(self, index: int, truth: Truth, find: Callable[[], np.ndarray]) -> None:
        """Find the string's line in a frame and divide it evenly, or count a failure; add the CPU time."""
        begin = time.thread_time()
        try:
            line_px = find()
        except NoPathError:
            self.failed += 1
            return
        finally:
            self.cpu_s += time.thread_time() - begin
        line = pixel_to_metre(truth.camera, line_px, truth.camera.string_offset_m)
        self.points_m[index] = even_shares(line, self.points_m.shape[1])


def run_peers(folder: Path, arm: PlanarArm) -> dict[str, PeerTrack]:
    """Run all peers on a filmed video; failed frames are counted and have NaN places."""
    case, facts = read_case(folder)
    truth = Truth.read(folder)
    scene = make_scene(experiment_of(case), case.name, arm)
    empty, canvas = scene.still * scene.gain, canvas_on(np.zeros_like(scene.still))
    finders: tuple[Finder, ...] = (longest_path, least_bending_path, DriftTracker(truth, facts["length_m"]))
    tracks = {name: PeerTrack(len(truth.arrays.hand), facts["points"]) for name in PEERS}
    hands_px = truth.pixels(truth.arrays.hand[:, :2])
    with open_video(folder / "video.mp4") as video:
        for index, _, grey in video:
            cover = _grown(arm_cover(scene, canvas, truth.arrays.q_rad[index]))
            begin = time.thread_time()
            mask = string_mask(grey, empty, cover)
            masked_s = time.thread_time() - begin
            for track, find in zip(tracks.values(), finders, strict=True):
                track.cpu_s += masked_s
                track.add(index, truth, partial(find, mask, hands_px[index]))
    return tracks


def string_mask(grey: np.ndarray, empty: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """Return where a frame differs from the empty scene and does not show the arm, (H, W) bool."""
    difference = np.abs(grey.astype(np.float32) - empty)
    noise = 1.48 * float(np.median(difference[::4, ::4]))
    mask = (difference > max(NOISE_TIMES * noise, LEAST_GREY)) & ~arm
    _, label, facts, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    kept = facts[:, cv2.CC_STAT_AREA] >= SMALL_AREA_PX
    kept[0] = False
    return np.asarray(kept[label])


class DriftTracker:
    """Starts the point drift from a skeleton in the first frame, then tracks frame by frame."""

    def __init__(self, truth: Truth, length_m: float) -> None:
        middle = truth.arrays.nodes_m[0].mean(axis=0)
        self.length_px = length_m / float(truth.metre_per_pixel(middle))
        self.drift: PointDrift | None = None

    def __call__(self, mask: np.ndarray, hand_px: np.ndarray) -> np.ndarray:
        """Return the chain (K, 2) [px] in the next frame."""
        if self.drift is None:
            self.drift = PointDrift(longest_path(mask, hand_px), self.length_px)
        return self.drift.step(mask, hand_px)


def even_shares(line: np.ndarray, count: int) -> np.ndarray:
    """Return `count` places that divide a line (K, 2) evenly, its ends among them."""
    place = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    wanted = np.linspace(0.0, place[-1], count)
    return np.column_stack([np.interp(wanted, place, line[:, axis]) for axis in (0, 1)])


def _grown(cover: np.ndarray) -> np.ndarray:
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * ARM_RIM_PX + 1,) * 2)
    return np.asarray(cv2.dilate(cover.astype(np.uint8), disc) > 0)
