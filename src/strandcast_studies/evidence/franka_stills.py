"""The visible length of a cable hanging from a robot's hand, measured in two calibrated pictures.

The cable is black, with a red band where it leaves the hand's fitting, a yellow one in its middle and a blue
one on the sleeve at its end; the length is from the middle of the red band to that of the blue one. The bands
are found by colour near the hand in the picture, the cable between them by its edges.

One picture gives metres in one plane only. The cable is assumed to hang in the base's x–z plane through the
flange, which faces the camera; `measure` reports the effect of a plane 10 mm off.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from strandcast.errors import StrandcastError
from strandcast_studies.evidence.figure import Figure
from strandcast_studies.stills.centreline import refine
from strandcast_studies.stills.line import even_line, smooth
from strandcast_studies.stills.mask import read_image

PICTURES = ("calib_2908", "calib_2908b")
VISIBLE_M = 0.41  # from four points clicked in calib_2908; nominal 0.40 m
TARGET_PERCENT = 3.0  # chosen

# Settings, chosen on the two pictures: hues in OpenCV's half degrees (0 … 180), saturation and value of 255.
HUES = {"red": (168, 12), "yellow": (20, 40), "blue": (95, 115)}
LEAST_SATURATION, LEAST_VALUE = 110, 80
LEAST_BAND_PX = 60
REACH_M = 0.6  # from the flange, in which the bands are searched
DARK_BELOW = 90  # least colour channel [grey levels]: cable and bands are darker, robot and wall lighter
PLANE_ERROR_M = 0.01  # assumed error of the plane, for its effect on the length


@dataclass(frozen=True, eq=False)
class CalibratedPicture:
    """A picture (h, w, 3) BGR, its projection (3, 4) from base metres to px, the flange's pose (4, 4)."""

    picture: np.ndarray
    projection: np.ndarray
    flange: np.ndarray

    def project(self, place_m: np.ndarray) -> np.ndarray:
        """Return the pixel (2,) of a place (3,) in the base's frame."""
        image = self.projection @ np.append(place_m, 1.0)
        return np.asarray(image[:2] / image[2])

    def px_per_m(self) -> float:
        """Return the picture's scale at the flange, across the line of sight."""
        here = self.flange[:3, 3]
        return float(
            np.linalg.norm(self.project(here + np.array([0.0, 0.0, 0.1])) - self.project(here)) / 0.1
        )


@dataclass(frozen=True, eq=False)
class FoundCable:
    """Band centres (2,) px by colour, centreline (K, 2) px from red to blue, where measured (K,), width."""

    bands_px: dict[str, np.ndarray]
    line_px: np.ndarray
    measured: np.ndarray
    width_px: float


def read_view(folder: Path, name: str) -> CalibratedPicture:
    """Read a picture and its calibration; the flange's pose is the mean of the logged ones."""
    entry: dict[str, Any] = json.loads((folder / "index.json").read_text())[name]
    flange = np.mean([state["O_T_EE"] for state in entry["robot_states"]], axis=0)
    return CalibratedPicture(read_image(folder / f"{name}.jpg"), np.array(entry["P_base_to_pixel"]), flange)


def find_cable(view: CalibratedPicture) -> FoundCable:
    """Find the bands and the centreline.

    Raises
    ------
    StrandcastError
        SC-T020 a band is not visible.
    """
    bands = find_bands(view)
    rough = even_line(_through(bands["red"], bands["yellow"], bands["blue"]))[0]
    least_channel = view.picture.min(axis=2).astype(np.float32)
    field = np.maximum(DARK_BELOW - least_channel, 0.0)
    half_width = _half_width(field, rough)
    line, measured, width = refine(field, rough, None, half_width)
    # Fitting and sleeve are wider or lighter than the cable: there the line is interpolated to the band.
    run = np.ones((round(width), 1), np.uint8)
    measured = cv2.morphologyEx(measured[:, None].astype(np.uint8), cv2.MORPH_OPEN, run)[:, 0] > 0
    line[0], line[-1] = bands["red"], bands["blue"]
    weight = measured.astype(float)
    weight[[0, -1]] = 1.0
    line = smooth(line, weight, 0.5 * width)
    return FoundCable(bands, line, measured, width)


def find_bands(view: CalibratedPicture) -> dict[str, np.ndarray]:
    """Return the centres (2,) px of the bands: of each colour, the largest patch below the flange."""
    hue, saturation, value = cv2.split(cv2.cvtColor(view.picture, cv2.COLOR_BGR2HSV))
    strong = (saturation > LEAST_SATURATION) & (value > LEAST_VALUE)
    hand = view.project(view.flange[:3, 3])
    bands = {}
    for colour, (low, high) in HUES.items():
        inside = (hue >= low) & (hue <= high) if low < high else (hue >= low) | (hue <= high)
        # The yellow band has green stripes: closing joins them.
        patch = (strong & inside).astype(np.uint8)
        patch = cv2.morphologyEx(patch, cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8))
        _, _, facts, middles = cv2.connectedComponentsWithStats(patch)
        near = np.linalg.norm(middles - hand, axis=1) < REACH_M * view.px_per_m()
        below = middles[:, 1] > hand[1]
        area = np.where(near & below, facts[:, cv2.CC_STAT_AREA], 0)
        area[0] = 0
        if area.max() < LEAST_BAND_PX:
            raise StrandcastError(
                "SC-T020", f"the cable's {colour} band is not visible", fix="change its hues"
            )
        bands[colour] = np.asarray(middles[area.argmax()])
    return bands


def _through(*places: np.ndarray) -> np.ndarray:
    """Return the parabola (100, 2) through three places, parametrised by chord length."""
    points = np.array(places)
    along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    course = np.polynomial.polynomial.polyfit(along, points, 2)
    return np.asarray(np.polynomial.polynomial.polyval(np.linspace(0.0, along[-1], 100), course).T)


def _half_width(field: np.ndarray, line: np.ndarray) -> float:
    """Return half the median width of the dark stretch in the rows that a steep line passes."""
    widths = []
    for x, y in np.rint(line).astype(int):
        left, right = np.flatnonzero(field[y, :x] == 0.0), np.flatnonzero(field[y, x:] == 0.0)
        if field[y, x] > 0.0 and len(left) and len(right):
            widths.append(x + right[0] - left[-1] - 1)
    return 0.5 * float(np.median(widths))


def on_plane(
    view: CalibratedPicture, pixels: np.ndarray, origin_m: np.ndarray, normal: np.ndarray
) -> np.ndarray:
    """Return the places (K, 3) of pixels (K, 2) on a plane, in the base's frame, metres."""
    inverse = np.linalg.inv(view.projection[:, :3])
    eye = -inverse @ view.projection[:, 3]
    rays = np.column_stack([pixels, np.ones(len(pixels))]) @ inverse.T
    far = ((origin_m - eye) @ normal) / (rays @ normal)
    return np.asarray(eye + far[:, None] * rays)


def length_m(places_m: np.ndarray) -> float:
    """Return the length of a polyline (K, d)."""
    return float(np.linalg.norm(np.diff(places_m, axis=0), axis=1).sum())


def measure(folder: Path) -> list[Figure]:
    """Return the visible length in each picture against 0.41 m, and the effect of other planes."""
    figures = []
    for name in PICTURES:
        view = read_view(folder, name)
        cable = find_cable(view)
        origin, facing = view.flange[:3, 3], np.array([0.0, 1.0, 0.0])
        found = length_m(on_plane(view, cable.line_px, origin, facing))
        nearer = length_m(on_plane(view, cable.line_px, origin - PLANE_ERROR_M * facing, facing))
        hand_plane = view.flange[:3, 1]  # holds the flange's axis and its x
        turned = length_m(on_plane(view, cable.line_px, origin, hand_plane))
        figures.append(
            Figure(
                f"franka_stills.visible_length.{name}",
                100.0 * (found / VISIBLE_M - 1.0),
                "%",
                TARGET_PERCENT,
                "middle of the red band to that of the blue one, in the base's x–z plane through the flange; "
                f"against {VISIBLE_M} m",
                {
                    "length_m": found,
                    "percent_per_10_mm_of_plane": 100.0 * (nearer / found - 1.0),
                    "length_in_hands_plane_m": turned,
                    "length_px": length_m(cable.line_px),
                    "measured_share": float(cable.measured.mean()),
                    "width_px": cable.width_px,
                },
            )
        )
    return figures
