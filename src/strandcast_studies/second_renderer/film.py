"""The still scene, the photos of the boards, and the film of one throw."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np

from strandcast.arm.kinematics import hand_pose, link_points
from strandcast.arm.load import PlanarArm
from strandcast_studies.second_renderer.optics import Optics, facing
from strandcast_studies.second_renderer.render import SAMPLES, Body, Thread, cast, expose, mark
from strandcast_studies.second_renderer.rigs import (
    BOARD,
    MARKER_M,
    RIM_M,
    STRING_OFFSET_M,
    FilmedRig,
    marker_places,
)

WHITE, BLACK = 0.8, 0.03  # of paper and ink
STILL_SIDE = 3  # samples of a still pixel, along each side
PHOTOS = 24
TARGET_M = 0.010
DICTIONARY = cv2.aruco.DICT_4X4_50
BOARDS = cv2.aruco.DICT_5X5_100  # of the lens board, the default of camera.board


def printed(marker: int) -> np.ndarray:
    """Return a marker's cells (C, C), border included."""
    dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARY)
    return np.where(dictionary.generateImageMarker(marker, dictionary.markerSize + 2) > 127, WHITE, BLACK)


def subpixels(side: int) -> list[tuple[float, float]]:
    """Return the places of side x side samples in a pixel."""
    steps = (np.arange(side) + 0.5) / side - 0.5
    return [(float(du), float(dv)) for du in steps for dv in steps]


def still_scene(
    rig: FilmedRig, optics: Optics, target_m: np.ndarray, random: np.random.Generator
) -> np.ndarray:
    """Return the light (H, W) of wall, shelf, markers and target."""
    grain = [
        (cv2.resize(random.standard_normal((n, n)).astype(np.float32), (512, 512)), a)
        for n, a in ((7, 0.04), (60, 0.015), (300, 0.015))
    ]
    wall = np.float32(rig.tones[2]) * (1.0 + sum(a * g for g, a in grain))
    markers = [printed(k) for k in range(6)]
    light = np.zeros((optics.height_px, optics.width_px))
    offsets = subpixels(STILL_SIDE)
    for offset in offsets:
        uv = optics.grid(offset)
        behind = optics.on_plane(uv, -0.25)
        index = np.floor((behind + 4.0) * 64.0).astype(int) % 512
        seen = wall[index[..., 1], index[..., 0]].copy()
        seen[(behind[..., 1] < -0.62) & (behind[..., 1] > -0.66)] *= 0.6  # a shelf
        on_markers = optics.on_plane(uv, -STRING_OFFSET_M)
        for cells, place in zip(markers, marker_places(optics), strict=True):
            off = np.abs(on_markers - place).max(axis=-1)
            seen[off < 0.5 * MARKER_M + RIM_M] = WHITE
            inside = off < 0.5 * MARKER_M
            column, row = ((on_markers[inside] - place) / MARKER_M * [1, -1] + 0.5).T * len(cells)
            seen[inside] = cells[row.astype(int), column.astype(int)]
        away = np.linalg.norm(optics.on_plane(uv) - target_m, axis=-1)
        seen[away < TARGET_M] = BLACK if not rig.hidden_target else rig.tones[0] * 0.8
        seen[away < 0.6 * TARGET_M] = 0.45 if not rig.hidden_target else rig.tones[0]
        light += seen
    return np.asarray(light / len(offsets))


def board_photo(optics: Optics, random: np.random.Generator) -> np.ndarray:
    """Return the light (H, W) of the lens board, held somewhere before the camera."""
    board = cv2.aruco.CharucoBoard(
        (BOARD["squares_x"], BOARD["squares_y"]), BOARD["square_m"], BOARD["marker_m"],
        cv2.aruco.getPredefinedDictionary(BOARDS),
    )  # fmt: skip
    texels = 6000.0  # per metre: five to a pixel
    size = np.array([BOARD["squares_x"], BOARD["squares_y"]]) * BOARD["square_m"]
    rim = 80
    sheet = np.where(
        np.pad(board.generateImage(tuple((size * texels).astype(int).tolist())), rim, constant_values=255)
        > 127,
        WHITE,
        BLACK,
    )
    scale = random.uniform(0.5, 0.7) * optics.width_px / optics.focal_px[0]
    distance_m = size[0] / scale
    turn = random.uniform(0.1, 0.75, 3) * random.choice([-1.0, 1.0], 3) * [1, 1, 0.5]
    middle_px = np.array([optics.width_px, optics.height_px]) * random.uniform(0.12, 0.88, 2)
    rotation, place = facing(np.zeros(2), distance_m, turn)
    # The board as seen by a camera that looks at its middle, then turned to where it is in the picture.
    ahead = optics.rays(middle_px)
    light = np.zeros((optics.height_px, optics.width_px))
    offsets = subpixels(2)
    shift = (ahead * distance_m) - np.array([0.0, 0.0, distance_m])
    for offset in offsets:
        rays = optics.rays(optics.grid(offset))
        origin = place - rotation.T @ shift
        ways = rays @ rotation
        far = -origin[2] / ways[..., 2]
        spot = origin[:2] + far[..., None] * ways[..., :2]
        column = np.floor((spot[..., 0] + 0.5 * size[0]) * texels).astype(int) + rim
        row = np.floor((0.5 * size[1] - spot[..., 1]) * texels).astype(int) + rim
        inside = (column >= 0) & (column < sheet.shape[1]) & (row >= 0) & (row < sheet.shape[0])
        seen = np.full(column.shape, 0.25)
        seen[inside] = sheet[row[inside], column[inside]]
        light += seen
    return np.asarray(light / len(offsets))


def sensed(rig: FilmedRig, light: np.ndarray, random: np.random.Generator, bits: int) -> np.ndarray:
    """Return a sensor's numbers: photon and read-out noise, its response curve, rounding."""
    out = np.empty(light.shape, np.uint8 if bits == 8 else np.uint16)
    noise = random.standard_normal(light.shape, dtype=np.float32)
    expose(light, noise, rig.noise**2, rig.gamma, out, 2**bits - 1)
    return out


def body_of(rig: FilmedRig, arm: PlanarArm) -> Body:
    """Return how arm and plate look."""
    edges = np.array(
        [
            np.r_[np.array(m.place_m) - 0.5 * m.size_m, np.array(m.place_m) + 0.5 * m.size_m]
            for m in arm.markers
        ]
    )
    rim = 0.011
    plate = np.array(
        [edges[:, 0].min() - rim, edges[:, 2].max() + rim, edges[:, 1].min() - rim, edges[:, 3].max() + rim]
    )
    return Body(
        np.array([0.026, 0.021, 0.015]),
        rig.tones[3],
        plate,
        WHITE,
        np.array([[e[0], e[1], m.size_m] for e, m in zip(edges, arm.markers, strict=True)]),
        # Seen from the front: x of the hand to the right, y up.
        np.array([printed(m.id) for m in arm.markers]),
    )


def thread_of(rig: FilmedRig, places_m: np.ndarray, random: np.random.Generator) -> Thread:
    """Return how the string looks; `places_m` (N,) are those of its nodes along it, as it hangs."""
    free_m = places_m[-1] - rig.string.length_m  # more than was meant comes out of the clamp
    fibres = np.column_stack(
        [
            random.uniform(-0.5, 0.5, 6),
            random.uniform(0.001, 0.005, 6),
            np.full(6, 0.12 * rig.string.diameter_m),
        ]
    )
    kind, radius_m = rig.weight
    weights = np.array(
        [
            [np.argmin(np.abs(places_m - place - free_m)), radius_m, rig.tones[1], kind]
            for place, _ in rig.string.weights
        ]
    ).reshape(-1, 4)
    sleeve = np.zeros(4)
    if rig.sleeve_m is not None:
        first, last = (int(np.argmin(np.abs(places_m - place - free_m))) for place in rig.sleeve_m[:2])
        sleeve = np.array([first, last, rig.sleeve_m[2], rig.tones[0]])
    return Thread(0.5 * rig.string.diameter_m, rig.tones[0], rig.shade, rig.end, fibres, weights, sleeve)


class Filming:
    """What stays the same through a film: the rays, the still scene, the look of what moves."""

    def __init__(
        self, rig: FilmedRig, optics: Optics, arm: PlanarArm, still: np.ndarray, random: np.random.Generator
    ) -> None:
        self.rig, self.optics, self.arm, self.random = rig, optics, arm, random
        self.still = still
        self.places = optics.on_plane(optics.grid())
        self.plate_places = optics.on_plane(optics.grid(), arm.markers[0].offset_m)
        right, down = optics.on_plane(optics.grid((1.0, 0.0))), optics.on_plane(optics.grid((0.0, 1.0)))
        self.slopes = np.stack([right - self.places, down - self.places], axis=-1)
        self.body = body_of(rig, arm)
        height, width = still.shape
        self.near = np.empty((height, width, 2), np.int32)
        self.light = np.empty((height, width))

    def exposure(self, q_rad: np.ndarray, nodes_m: np.ndarray, thread: Thread) -> np.ndarray:
        """Return the light (H, W) of an exposure: joints (T, J) and nodes (T, N, 2) at its instants."""
        optics, arm = self.optics, self.arm
        line_px = optics.pixels(nodes_m)
        widest = max([thread.radius_m + 0.006, thread.sleeve[2], *thread.weights[:, 1]])
        scale = 1.0 / np.abs(self.slopes[optics.height_px // 2, optics.width_px // 2]).max()
        self.near[..., 0], self.near[..., 1] = len(nodes_m[0]), 0
        mark(self.near, line_px, widest * scale + 3.0)
        hands = hand_pose(arm.chain, arm.clamp, q_rad).array()
        joints = link_points(arm.chain, q_rad)
        shown = optics.pixels(joints).reshape(-1, 2)
        reach = 0.09 * scale
        bounds = np.r_[shown.min(axis=0) - reach, shown.max(axis=0) + reach]
        around = np.array([bounds[0], bounds[2], bounds[1], bounds[3]])
        # A place in each pixel and one of the lens for every sample; neighbours in time are shuffled.
        grid = np.array(subpixels(7))[self.random.permutation(49)[:SAMPLES]]
        angle, radius = (
            self.random.uniform(0, 2 * np.pi, SAMPLES),
            self.rig.defocus_px * np.sqrt(self.random.uniform(size=SAMPLES)),
        )
        offsets = (
            grid
            + self.random.uniform(-0.5, 0.5, grid.shape) / 7
            + np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
        )
        cast(
            self.light, self.still, self.places, self.plate_places, self.slopes, offsets, self.near, around,
            nodes_m, hands, joints, thread, self.body,
        )  # fmt: skip
        return self.light

    def frames(
        self, moments: Iterator[tuple[np.ndarray, np.ndarray]], thread: Thread
    ) -> Iterator[np.ndarray]:
        """Yield the film's frames; `moments` are joints and nodes at the instants of each exposure."""
        for q_rad, nodes_m in moments:
            yield sensed(self.rig, self.exposure(q_rad, nodes_m, thread), self.random, self.rig.bits)


def write_film(path: Path, frames: Iterator[np.ndarray], rig: FilmedRig) -> None:
    """Write a film in the rig's codec."""
    options = {
        "ffv1": {},
        "libx264": {"crf": "10", "preset": "veryfast"},
        "libx265": {"crf": "10", "preset": "ultrafast", "x265-params": "log-level=error"},
    }
    pixels = {
        ("ffv1", 8): "gray",
        ("ffv1", 10): "gray10le",
        ("libx264", 8): "yuv420p",
        ("libx265", 10): "yuv420p10le",
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(rig.codec, rate=Fraction(rig.rate_hz).limit_denominator(1000))
        stream.width, stream.height = rig.size_px
        stream.pix_fmt = pixels[rig.codec, rig.bits]
        stream.codec_context.color_range = 2
        stream.codec_context.options = options[rig.codec]
        for number, grey in enumerate(frames):
            frame = av.VideoFrame(grey.shape[1], grey.shape[0], stream.pix_fmt)
            frame.color_range, frame.pts = 2, number
            for plane, middle in zip(frame.planes, (None, 128, 128), strict=False):
                rows = np.zeros((plane.height, plane.line_size // grey.itemsize), grey.dtype)
                rows[:, : plane.width] = grey if middle is None else middle << (rig.bits - 8)
                plane.update(rows)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
