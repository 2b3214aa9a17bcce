"""The lab's LED: a lamp in the plane of motion that the controller switches on around the throw."""

from dataclasses import dataclass

import numpy as np

from strandcast.lab.paint import PSF_PX
from strandcast.lab.view import LabView

# Chosen.
BODY_RADIUS_M, LAMP_RADIUS_M = 0.005, 0.0035
BODY, LAMP, HALO = 46.0, 214.0, 24.0  # grey levels; the halo is light scattered in the lens
HALO_WIDTH = 3.0  # in widths of the lamp
BEFORE_S, AFTER_S = 0.12, 0.15  # before and after the motion
LATENCY_S = (1e-4, 3e-4)  # from the controller's output to the light; drawn for each throw


@dataclass(frozen=True)
class LedTimes:
    """The controller's switching times since the motion's start, and the light's latency [s]."""

    on_s: float
    off_s: float
    latency_s: float

    def share(self, middle_s: float, exposure_s: float) -> float:
        """Return the share of an exposure in which the LED is lit, given its middle on the same clock."""
        first = max(middle_s - 0.5 * exposure_s, self.on_s + self.latency_s)
        last = min(middle_s + 0.5 * exposure_s, self.off_s + self.latency_s)
        return max(0.0, last - first) / exposure_s


def led_times(motion_s: float, random: np.random.Generator) -> LedTimes:
    """Return when the LED is lit in a throw."""
    return LedTimes(-BEFORE_S, motion_s + AFTER_S, float(random.uniform(*LATENCY_S)))


@dataclass(frozen=True, eq=False)
class LabLed:
    """The LED in the picture: the region that it lights, and the light (h, w) that it adds there."""

    rows: slice
    columns: slice
    glow: np.ndarray


def make_led(view: LabView, place_m: tuple[float, float]) -> LabLed:
    """Return the LED at a place in the plane."""
    middle = view.pixels(np.array(place_m))
    radius = LAMP_RADIUS_M * view.scale_px_m(np.array(place_m))
    reach = 3.0 * HALO_WIDTH * radius
    low = np.maximum(np.floor(middle - reach).astype(int), 0)
    high = np.minimum(np.ceil(middle + reach).astype(int) + 1, [view.width_px, view.height_px])
    rows, columns = slice(low[1], high[1]), slice(low[0], high[0])
    v, u = np.mgrid[rows, columns]
    away = np.hypot(u - middle[0], v - middle[1])
    lamp = 1.0 / (1.0 + np.exp(1.7 * (away - radius) / PSF_PX))  # close to a blurred edge
    halo = np.exp(-0.5 * (away / (HALO_WIDTH * radius)) ** 2)
    return LabLed(rows, columns, ((LAMP - BODY) * lamp + HALO * halo).astype(np.float32))
