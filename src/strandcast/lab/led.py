"""The lab's LED: a lamp on the board in the plane of motion that the controller switches around a swing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strandcast.lab.paint import PSF_PX
from strandcast.lab.view import View

BODY_RADIUS_M, LAMP_RADIUS_M = 0.005, 0.0035
BODY, LAMP, HALO = 46.0, 214.0, 24.0  # tones; the halo is what the lens scatters of the lamp
HALO_TIMES = 3.0  # as wide as the lamp
BEFORE_S, AFTER_S = 0.12, 0.15  # of the swing
LATENCY_S = (1e-4, 3e-4)  # from the controller's output to the light; each throw draws its own


@dataclass(frozen=True)
class Switched:
    """When the LED is lit: the controller's times, and the light's delay behind them [s]."""

    on_s: float
    off_s: float
    latency_s: float

    def share(self, middle_s: float, exposure_s: float) -> float:
        """Return the share of an exposure, given its middle on the same clock, in which the LED is lit."""
        first = max(middle_s - 0.5 * exposure_s, self.on_s + self.latency_s)
        last = min(middle_s + 0.5 * exposure_s, self.off_s + self.latency_s)
        return max(0.0, last - first) / exposure_s


def switched(motion_s: float, random: np.random.Generator) -> Switched:
    """Return when the LED is lit in a throw, from the motion's start."""
    return Switched(-BEFORE_S, motion_s + AFTER_S, float(random.uniform(*LATENCY_S)))


@dataclass(frozen=True, eq=False)
class Led:
    """The LED in the picture: the part that it lights, and the light (h, w) that it adds there."""

    rows: slice
    columns: slice
    glow: np.ndarray


def make_led(view: View, place_m: tuple[float, float]) -> Led:
    """Return the LED at a place in the plane."""
    middle = view.pixels(np.array(place_m))
    radius = LAMP_RADIUS_M * view.scale_px_m(np.array(place_m))
    reach = 3.0 * HALO_TIMES * radius
    low = np.maximum(np.floor(middle - reach).astype(int), 0)
    high = np.minimum(np.ceil(middle + reach).astype(int) + 1, [view.width_px, view.height_px])
    rows, columns = slice(low[1], high[1]), slice(low[0], high[0])
    v, u = np.mgrid[rows, columns]
    away = np.hypot(u - middle[0], v - middle[1])
    lamp = 1.0 / (1.0 + np.exp(1.7 * (away - radius) / PSF_PX))  # close to a blurred edge
    halo = np.exp(-0.5 * (away / (HALO_TIMES * radius)) ** 2)
    return Led(rows, columns, ((LAMP - BODY) * lamp + HALO * halo).astype(np.float32))
