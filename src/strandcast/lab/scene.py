"""The still scene before the camera: wall, pedestal, markers in the plane, target; and painting the arm."""

from dataclasses import dataclass

import cv2
import numpy as np

from strandcast.arm.kinematics import hand_pose, link_points
from strandcast.arm.load import PlanarArm
from strandcast.camera.markers import corners_of, marker_cells
from strandcast.config.experiment import Experiment
from strandcast.errors import StrandcastError
from strandcast.lab.led import BODY, BODY_RADIUS_M, LabLed, make_led
from strandcast.lab.paint import blend, stamp, stroke
from strandcast.lab.view import LabView, make_view
from strandcast.seeds import rng

WALL, PEDESTAL, ARM, ARM_RIDGE, JOINT, PAPER, INK, TARGET, TARGET_RIM = 78, 52, 44, 58, 30, 226, 22, 150, 24
MARGIN_CELLS = 2.0  # white around a marker in the plane
PLATE_MARGIN_M = 0.010  # white around the hand's markers, which share one plate
BASE_RADIUS_M, HAND_RADIUS_M = 0.024, 0.014
RIDGE_SHARE = 0.35
TARGET_RADIUS_M = 0.010
VIGNETTING = 0.12
PLAIN_PAPER = np.full((1, 1), PAPER, np.float32)


@dataclass(frozen=True, eq=False)
class Canvas:
    """A picture being painted: light (H, W), and the buffers of the painting functions."""

    light: np.ndarray
    cover: np.ndarray
    spans: np.ndarray
    touched: np.ndarray

    def stroke(self, line_px: np.ndarray, half_px: np.ndarray, tone: float) -> None:
        """Paint a polyline (K, 2) with half widths (K - 1,) in one tone."""
        stroke(self.cover, self.spans, line_px, half_px)
        blend(self.light, self.cover, self.spans, self.touched, tone)

    def dot(self, place_px: np.ndarray, radius_px: float, tone: float) -> None:
        """Paint a disc at a pixel (2,)."""
        self.stroke(np.array([place_px, place_px]), np.array([radius_px]), tone)

    def pattern(self, corners_px: np.ndarray, cells: np.ndarray) -> None:
        """Paint a printed pattern with its corners at pixels (4, 2), clockwise from the top left."""
        rows, columns = cells.shape
        flat = np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]], np.float32)
        to_cells = cv2.getPerspectiveTransform(corners_px.astype(np.float32), flat)
        stamp(self.light, self.touched, to_cells, corners_px, cells)


def canvas_on(light: np.ndarray) -> Canvas:
    """Return a canvas that starts as a copy of the given light (H, W)."""
    height, width = light.shape
    empty = np.tile(np.array([width, 0]), (height, 1))
    return Canvas(light.astype(np.float32), np.zeros((height, width), np.float32), empty.copy(), empty.copy())


@dataclass(frozen=True, eq=False)
class HandPrint:
    """A print on the hand: tones, corners (4, 2) in the hand's frame, and height above the plane."""

    tones: np.ndarray
    corners_m: np.ndarray
    height_m: float


@dataclass(frozen=True, eq=False)
class LabScene:
    """The set-up, the same for all throws of an experiment.

    Attributes
    ----------
    still, gain
        (H, W) light of the still scene; vignetting.
    hand_prints
        The plate on the hand, then its markers in the order of the arm's file.
    led
        The LED switched by the controller, if there is one; `still` shows it dark.
    in_front
        Rows and columns of something between the camera and the throw, painted on `still`, which hides both.
    """

    view: LabView
    still: np.ndarray
    gain: np.ndarray
    arm: PlanarArm
    hand_prints: tuple[HandPrint, ...]
    led: LabLed | None = None
    in_front: tuple[slice, slice] | None = None


def make_scene(experiment: Experiment, name: str, arm: PlanarArm) -> LabScene:
    """Build the scene of an experiment.

    Raises
    ------
    StrandcastError
        SC-C022 no markers in the plane, SC-T033 a marker or the LED is outside the picture.
    """
    assert experiment.lab is not None
    view = make_view(experiment, name, arm)
    random = rng(name, experiment.seed, 0, "lab-scene")
    canvas = canvas_on(_wall(random, view, experiment.lab.camera.background))
    _paint_pedestal(canvas, view, arm)
    _paint_plane_markers(canvas, view, experiment)
    for radius, tone in ((TARGET_RADIUS_M, TARGET_RIM), (0.6 * TARGET_RADIUS_M, TARGET)):
        place_m = np.array(experiment.target_m)
        canvas.dot(view.pixels(place_m), radius * view.scale_px_m(place_m), tone)
    led = _paint_led(canvas, view, experiment)
    v, u = np.mgrid[: view.height_px, : view.width_px]
    radius = np.hypot(u / view.width_px - 0.5, v / view.width_px - 0.5 * view.height_px / view.width_px)
    gain = (1.0 - VIGNETTING * (2.0 * radius) ** 2).astype(np.float32)
    return LabScene(view, canvas.light, gain, arm, _hand_prints(arm), led)


def _hand_prints(arm: PlanarArm) -> tuple[HandPrint, ...]:
    markers = [
        HandPrint(
            marker_tones(arm.marker_dictionary, marker.id),
            square_corners_m(np.array(marker.place_m), marker.angle_rad, marker.size_m),
            marker.offset_m,
        )
        for marker in arm.markers
    ]
    if not markers:
        return ()
    corners = np.concatenate([marker.corners_m for marker in markers])
    (left, low), (right, high) = corners.min(axis=0) - PLATE_MARGIN_M, corners.max(axis=0) + PLATE_MARGIN_M
    outline = np.array([[left, high], [right, high], [right, low], [left, low]])
    return HandPrint(PLAIN_PAPER, outline, min(marker.height_m for marker in markers)), *markers


def marker_tones(dictionary: str, marker: int) -> np.ndarray:
    """Return the cells of an ArUco marker (side, side) as printed, the black border included."""
    return np.where(marker_cells(dictionary, marker), INK, PAPER).astype(np.float32)


def square_corners_m(centre_m: np.ndarray, angle_rad: float, side_m: float) -> np.ndarray:
    """Return the corners (4, 2) of a square, clockwise from the top left in the camera's view."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.asarray(np.asarray(centre_m) + corners_of(side_m) @ np.array([[cos, sin], [-sin, cos]]))


def _paint_plane_markers(canvas: Canvas, view: LabView, experiment: Experiment) -> None:
    plane = experiment.camera.plane
    if not plane.markers:
        raise StrandcastError(
            "SC-C022",
            "has no markers in the plane of motion",
            field="camera.plane.markers",
            cost="the video would have no scale",
            fix="give at least four, at the edges of the workspace",
        )
    for marker in plane.markers:
        tones = marker_tones(plane.dictionary, marker.id)
        sides = plane.size_m * np.array([1.0 + 2.0 * MARGIN_CELLS / len(tones), 1.0])
        place = np.array([marker.x_m, marker.y_m])
        paper, uv = (
            view.pixels(
                square_corners_m(place, marker.angle_rad, side), -experiment.camera.string_offset_and_sd_m[0]
            )
            for side in sides
        )
        if (uv < 0).any() or (uv > np.array([view.width_px, view.height_px]) - 1).any():
            raise StrandcastError(
                "SC-T033",
                f"marker {marker.id} at ({marker.x_m}, {marker.y_m}) m is outside the picture",
                field="camera.plane.markers",
                fix="move it into the workspace_m box",
            )
        canvas.pattern(paper, PLAIN_PAPER)
        canvas.pattern(uv, tones)


def _paint_led(canvas: Canvas, view: LabView, experiment: Experiment) -> LabLed | None:
    """Paint the dark LED, and return it."""
    declared = experiment.align.led
    if declared is None or declared.place_m is None:
        return None
    place_m = declared.place_m
    middle = view.pixels(np.array(place_m))
    if (middle < 0).any() or (middle > np.array([view.width_px, view.height_px]) - 1).any():
        raise StrandcastError(
            "SC-T033",
            f"the LED at {place_m} m is outside the picture",
            field="align.led",
            fix="move it into the workspace_m box, away from string and arm",
        )
    canvas.dot(middle, BODY_RADIUS_M * view.scale_px_m(np.array(place_m)), BODY)
    return make_led(view, place_m)


def _paint_pedestal(canvas: Canvas, view: LabView, arm: PlanarArm) -> None:
    origin = arm.chain.origin_m
    foot = origin - np.array([0.0, 3.0])
    line = view.pixels(np.linspace(origin, foot, 40), -0.03)
    inside = line[:, 1] < view.height_px + 100
    half = np.full(inside.sum() - 1, 0.045 * view.scale_px_m(origin))
    canvas.stroke(line[inside], half, PEDESTAL)


def _wall(random: np.random.Generator, view: LabView, kind: str) -> np.ndarray:
    """Return the light (H, W) of the wall behind the plane."""
    shape = (view.height_px, view.width_px)
    grains = {"plain": ((80.0, 4.0),)}.get(kind, ((1.2, 2.5), (4.0, 2.5), (90.0, 9.0)))
    light = np.full(shape, float(WALL), np.float32)
    for size_px, amplitude in grains:
        coarse = cv2.GaussianBlur(random.standard_normal(shape), (0, 0), size_px)
        light += np.float32(amplitude / coarse.std()) * coarse.astype(np.float32)
    if kind == "cluttered":
        for _ in range(14):
            u, v = random.uniform(0, shape[1]), random.uniform(0, shape[0])
            size = random.uniform(40, 220, 2)
            cv2.rectangle(
                light,
                (int(u), int(v)),
                (int(u + size[0]), int(v + size[1])),
                float(random.uniform(45, 120)),
                int(random.choice([-1, 2, 3])),
            )
        light = cv2.GaussianBlur(light, (0, 0), 1.2)
    return light


def paint_arm(canvas: Canvas, scene: LabScene, q_rad: np.ndarray) -> None:
    """Paint the arm at (J,) true joint angles: links, joints, the hand's markers."""
    points = link_points(scene.arm.chain, q_rad)
    radii = np.linspace(BASE_RADIUS_M, HAND_RADIUS_M, len(points))
    line = scene.view.pixels(points)
    scale = scene.view.scale_px_m(points[-1])
    for k in range(len(points) - 1):
        canvas.stroke(line[k : k + 2], radii[k : k + 1] * scale, ARM)
        canvas.stroke(line[k : k + 2], RIDGE_SHARE * radii[k : k + 1] * scale, ARM_RIDGE)
    for k in range(len(points) - 1):
        canvas.dot(line[k], 0.8 * radii[k] * scale, JOINT)
    for printed, corners in zip(scene.hand_prints, hand_corners_m(scene, q_rad), strict=True):
        canvas.pattern(scene.view.pixels(corners, printed.height_m), printed.tones)


def hand_corners_m(scene: LabScene, q_rad: np.ndarray) -> list[np.ndarray]:
    """Return the corners (4, 2) of each print on the hand, projected into the plane."""
    hand = hand_pose(scene.arm.chain, scene.arm.clamp, q_rad)
    cos, sin = np.cos(hand.angle_rad), np.sin(hand.angle_rad)
    turn = np.array([[cos, sin], [-sin, cos]])
    return [hand.position_m + printed.corners_m @ turn for printed in scene.hand_prints]
