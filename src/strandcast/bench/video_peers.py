"""Run the peers on a filmed video: the same frames, the exact hand, the exact empty scene and arm."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from strandcast.arm.load import Arm
from strandcast.bench.video_cpd import Drift
from strandcast.bench.video_scenes import arm_cover, experiment_of, read_case
from strandcast.bench.video_skeleton import NoPathError, least_bending_path, longest_path
from strandcast.bench.video_truth import Truth
from strandcast.camera.mapping import pixel_to_metre
from strandcast.lab.scene import canvas_on, make_scene
from strandcast.video.reader import open_video

NOISE_TIMES, LEAST_GREY = 5.0, 8.0
ARM_RIM_PX = 3  # around the arm that is not looked at
SMALL_AREA_PX = 12
PEERS = ("skeleton", "least bending", "point drift")


@dataclass
class PeerTrack:
    """What a peer found: as a track, with no sigmas and no flags; frames that it failed on; CPU time [s]."""

    points_m: np.ndarray
    sigma_m: np.ndarray
    flags: np.ndarray
    failed: int = 0
    cpu_s: float = 0.0


def run_peers(folder: Path, arm: Arm) -> dict[str, PeerTrack]:
    """Run all peers on a filmed video; a frame that one fails on is counted, its places are NaN."""
    case, facts = read_case(folder)
    truth = Truth.read(folder)
    scene = make_scene(experiment_of(case), case.name, arm)
    empty, canvas = scene.still * scene.gain, canvas_on(np.zeros_like(scene.still))
    count, frames = facts["points"], len(truth.arrays.hand)
    tracks = {name: _nothing(frames, count) for name in PEERS}
    hands_px = truth.pixels(truth.arrays.hand[:, :2])
    drift = Drifter(truth, facts["length_m"])
    with open_video(folder / "video.mp4") as video:
        for index, _, grey in video:
            cover = _grown(arm_cover(scene, canvas, truth.arrays.q_rad[index]))
            begin = time.thread_time()
            mask = string_mask(grey, empty, cover)
            masked_s = time.thread_time() - begin
            for name, find in (
                ("skeleton", longest_path),
                ("least bending", least_bending_path),
                ("point drift", drift),
            ):
                _record(tracks[name], index, truth, find, mask, hands_px[index], masked_s)
    return tracks


def string_mask(grey: np.ndarray, empty: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """Return where a frame differs from the empty scene and shows no arm, (H, W) bool."""
    difference = np.abs(grey.astype(np.float32) - empty)
    noise = 1.48 * float(np.median(difference[::4, ::4]))
    mask = (difference > max(NOISE_TIMES * noise, LEAST_GREY)) & ~arm
    _, label, facts, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    kept = facts[:, cv2.CC_STAT_AREA] >= SMALL_AREA_PX
    kept[0] = False
    return np.asarray(kept[label])


class Drifter:
    """Starts the point drift on the first frame with a skeleton, and carries it on."""

    def __init__(self, truth: Truth, length_m: float) -> None:
        middle = truth.arrays.nodes_m[0].mean(axis=0)
        self.length_px = length_m / float(truth.metre_per_pixel(middle))
        self.drift: Drift | None = None

    def __call__(self, mask: np.ndarray, hand_px: np.ndarray) -> np.ndarray:
        """Return the chain (K, 2) [px] in the next frame."""
        if self.drift is None:
            self.drift = Drift(longest_path(mask, hand_px), self.length_px)
        return self.drift.step(mask, hand_px)


Find = Callable[[np.ndarray, np.ndarray], np.ndarray]


def _record(
    track: PeerTrack, index: int, truth: Truth, find: Find, mask: np.ndarray, hand_px: np.ndarray,
    masked_s: float,
) -> None:  # fmt: skip
    begin = time.thread_time()
    try:
        line_px = find(mask, hand_px)
    except NoPathError:
        track.failed += 1
        return
    finally:
        track.cpu_s += masked_s + time.thread_time() - begin
    line = pixel_to_metre(truth.camera, line_px, truth.camera.string_offset_m)
    track.points_m[index] = even_shares(line, track.points_m.shape[1])


def even_shares(line: np.ndarray, count: int) -> np.ndarray:
    """Return `count` places that divide a line (K, 2) evenly, its ends among them."""
    place = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    wanted = np.linspace(0.0, place[-1], count)
    return np.column_stack([np.interp(wanted, place, line[:, axis]) for axis in (0, 1)])


def _nothing(frames: int, count: int) -> PeerTrack:
    return PeerTrack(
        points_m=np.full((frames, count + 1, 2), np.nan),
        sigma_m=np.full((frames, count + 1), np.nan),
        flags=np.zeros((frames, count + 1), np.int32),
    )


def _grown(cover: np.ndarray) -> np.ndarray:
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * ARM_RIM_PX + 1,) * 2)
    return np.asarray(cv2.dilate(cover.astype(np.uint8), disc) > 0)
