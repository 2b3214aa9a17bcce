"""The rigs of the study: cameras, strings and their ends, weights, and what an experiment says of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from strandcast.lab.strings import PhysicalString
from strandcast_studies.second_renderer.optics import Optics, facing
from strandcast_studies.second_renderer.render import BALL, CUT, FRAYED, NUT, ROUND

BOARD = {"squares_x": 7, "squares_y": 5, "square_m": 0.04, "marker_m": 0.03}
MARKER_M, RIM_M = 0.08, 0.024
STRING_OFFSET_M = 0.03  # of the throw's plane over the markers'
MIDDLE_M = (0.10, 0.16)


@dataclass(frozen=True)
class FilmedRig:
    """One rig: its string as it is, how it looks, and how it is filmed.

    Attributes
    ----------
    string
        From the clamp on; the lab's physics throw it.
    end
        `ROUND`, `CUT` or `FRAYED`.
    tones
        Of string, weights, wall and arm: linear light, 0 to 1.
    weight
        `BALL` or `NUT`, and its radius [m].
    sleeve_m
        Where a sleeve of the given radius covers the string: from, to, radius.
    size_px, tilt_rad, division
        Picture and camera.
    rate_hz, exposure_s, bits, gamma, noise
        Film: `noise` is the standard deviation at half of full light, as a share of full light.
    codec
        "ffv1", "libx264" or "libx265".
    hidden_target
        The target is as light as the string and hides its end.
    """

    string: PhysicalString
    end: int = CUT
    tones: tuple[float, float, float, float] = (0.75, 0.6, 0.2, 0.1)
    shade: float = 0.35
    weight: tuple[int, float] = (BALL, 0.009)
    sleeve_m: tuple[float, float, float] | None = None
    size_px: tuple[int, int] = (1280, 800)
    tilt_rad: tuple[float, float, float] = (0.04, -0.05, 0.01)
    division: float = -0.08
    rate_hz: float = 500.0
    exposure_s: float = 4e-4
    bits: int = 8
    gamma: float = 1.0
    noise: float = 0.008
    defocus_px: float = 0.4
    codec: str = "libx264"
    hidden_target: bool = False


def _string(
    length_m: float, g_m: float, mm: float, *weights: tuple[float, float], curl: float = 1.5
) -> PhysicalString:
    return PhysicalString(length_m, 1e-3 * g_m, 1e-6 * g_m**1.3 / 5.0, curl, 1e-3 * mm, tuple(weights))


DARK_ON_LIGHT = (0.05, 0.12, 0.62, 0.25)
RIGS: dict[str, FilmedRig] = {
    "cord-cut": FilmedRig(_string(0.45, 4.0, 2.7)),
    "cord-round": FilmedRig(
        _string(0.45, 4.0, 2.7), end=ROUND, bits=10, codec="ffv1", division=0.05, gamma=2.2
    ),
    "cord-frayed": FilmedRig(_string(0.38, 5.0, 3.2), end=FRAYED, tilt_rad=(-0.06, 0.03, -0.02)),
    "rope-cut": FilmedRig(_string(0.50, 12.0, 5.5), tones=DARK_ON_LIGHT, gamma=2.2, noise=0.012),
    "rope-round": FilmedRig(
        _string(0.50, 10.0, 5.0), end=ROUND, tones=(0.85, 0.6, 0.3, 0.1), codec="libx265", bits=10
    ),
    "thread-cut": FilmedRig(
        _string(0.35, 3.0, 1.8), noise=0.005, defocus_px=0.2, rate_hz=960.0, exposure_s=2e-4
    ),
    "ball-at-tip": FilmedRig(
        _string(0.30, 3.0, 2.4, (0.30, 0.010)), weight=(BALL, 0.011), tones=(0.7, 0.5, 0.15, 0.3)
    ),
    "nut-at-tip": FilmedRig(
        _string(0.40, 4.0, 2.5, (0.40, 0.006)), weight=(NUT, 0.008), tones=(0.7, 0.35, 0.12, 0.06)
    ),
    "nut-before-end": FilmedRig(
        _string(0.45, 4.0, 2.7, (0.443, 0.006)), weight=(NUT, 0.009), tones=(0.7, 0.4, 0.12, 0.06)
    ),
    "nut-before-dark": FilmedRig(
        _string(0.40, 6.0, 3.0, (0.394, 0.008)),
        weight=(NUT, 0.010),
        tones=DARK_ON_LIGHT,
        gamma=1.8,
        end=ROUND,
    ),
    "sleeve-at-tip": FilmedRig(
        _string(0.42, 5.0, 3.0),
        sleeve_m=(0.36, 0.42, 0.003),
        bits=10,
        codec="ffv1",
        tilt_rad=(0.02, 0.07, 0.03),
    ),
    "weight-midway": FilmedRig(
        _string(0.50, 5.0, 3.0, (0.22, 0.010)), weight=(BALL, 0.011), end=FRAYED, noise=0.015
    ),
    "over-target": FilmedRig(_string(0.45, 4.0, 2.7), hidden_target=True),
    "weak-contrast": FilmedRig(
        _string(0.42, 5.0, 3.2), tones=(0.42, 0.35, 0.28, 0.08), end=ROUND, exposure_s=8e-4
    ),
}


def optics_of(rig: FilmedRig, random: np.random.Generator) -> Optics:
    """Return the rig's camera: far enough for the whole throw, and a little off what is written there."""
    width, height = rig.size_px
    focal_px = 1.3 * width * (1.0 + 0.05 * random.uniform(-1, 1)) * np.array([1.0, 1.003])
    seen_m = 2.0 * (0.55 + rig.string.length_m) * 0.75
    distance_m = focal_px[1] * seen_m / height
    rotation, position_m = facing(np.array(MIDDLE_M), distance_m, np.array(rig.tilt_rad))
    centre_px = 0.5 * np.array([width - 1, height - 1]) + random.uniform(-6, 6, 2)
    return Optics(width, height, focal_px, centre_px, rig.division, rotation, position_m)


def marker_places(optics: Optics) -> np.ndarray:
    """Return where six markers are in their plane (6, 2) [m]: near the picture's edges."""
    inset = 0.075
    shares = [(x, y) for y in (inset, 1.0 - inset) for x in (inset * 0.75, 0.5, 1.0 - inset * 0.75)]
    size = np.array([optics.width_px, optics.height_px])
    return np.round(optics.on_plane(np.array(shares) * size, -STRING_OFFSET_M), 3)


def experiment_of(rig: FilmedRig, optics: Optics, target_m: np.ndarray) -> dict[str, Any]:
    """Return experiment.yaml: what a careful person would write, with what a ruler says."""
    string: dict[str, Any] = {"length_m": rig.string.length_m}
    if rig.string.weights:
        string["weights"] = [{"place_m": place_m} for place_m, _ in rig.string.weights]
    if rig.sleeve_m is not None:
        string["stiff_sections"] = [{"from_m": rig.sleeve_m[0], "to_m": rig.sleeve_m[1]}]
    return {
        "title": "A film by the second renderer",
        "string": string,
        "arm": "planar3",
        "target_m": [round(float(x), 4) for x in target_m],
        "workspace_m": {"x_m": [-1.3, 1.3], "y_m": [-1.0, 1.3]},
        "seed": 1,
        "camera": {
            "board": BOARD,
            "string_offset_m": STRING_OFFSET_M,
            "exposure_s": rig.exposure_s,
            "plane": {
                "size_m": MARKER_M,
                "markers": [
                    {"id": k, "x_m": float(x), "y_m": float(y)}
                    for k, (x, y) in enumerate(marker_places(optics))
                ],
            },
        },
    }
