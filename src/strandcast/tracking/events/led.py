"""An LED that the robot switches: the brightness of its window in the image, and the times when it switched.

The exposure of a frame lasts from t - e/2 to t + e/2 (t its time, e the exposure), and the LED is lit for a
share of it. A partly lit frame gives the switching time by that share; without one, the LED switched between
two exposures. Each frame bounds the time; the event is the middle of the remaining interval, its sigma the
interval's width over the square root of 12.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from skimage.filters import threshold_otsu

from strandcast.camera.mapping import metre_per_pixel, metre_to_pixel
from strandcast.config.align import LedSettings
from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera
from strandcast.records.track import DetectedLed, DetectedSwitch

SMALLEST_PX = 1.5  # half a window's side
SURROUND = 2.0  # side of the surroundings over the window's side
LEAST_CONTRAST = 0.02  # of the whitest grey; least contrast of a lit window
LEAST_TIMES_NOISE = 12.0
DARK, LIT = 0.25, 0.75  # of the way from dark to lit; between them, a frame is neither
HOLD_FRAMES, HOLD_S = 3, 0.01  # least duration of a state; shorter ones are flicker
PLATEAU_FRAMES = 12  # beside an edge, whose median is the level there
STEPS = (0.6, 1.6)  # range of the step between these levels, over the usual contrast
SHARED_LIGHT = 0.5  # of a change, around the window; from there on another light causes it
SHARE_NOISE = 4.0  # standard deviations that bound a share
LEAST_SHARE_ERROR = 0.05  # encoders delay a change a little, and lamps have an afterglow
NEARLY = 0.15  # of the light; closer than this to dark or lit, a frame is not certainly partly lit
BURNT_SHARE = 0.98  # of the whitest grey
GAMMAS = (1.0, 2.4)  # range of a camera's unknown gamma: grey = light^(1/gamma)
DIGITS = 2
MOST_LISTED = 3  # changes in one warning


class LedMonitor:
    """Keeps the mean brightness of a window and of its surroundings, frame by frame."""

    def __init__(self, led: LedSettings, camera: Camera) -> None:
        self.gammas = GAMMAS if led.gamma is None else (led.gamma, led.gamma)
        self.window = left, top, right, bottom = window_of(led, camera)
        across, down = (round(0.5 * (SURROUND - 1.0) * side) for side in (right - left, bottom - top))
        self._inner = np.s_[top:bottom, left:right]
        self._outer = np.s_[
            max(0, top - max(1, down)) : bottom + max(1, down),
            max(0, left - max(1, across)) : right + max(1, across),
        ]
        self._brightness: list[tuple[float, float, float]] = []
        self._white = 255.0

    def look(self, image: np.ndarray) -> None:
        """Measure the brightness in a frame (H, W)."""
        inner, outer = image[self._inner], image[self._outer]
        total = int(inner.sum())
        around = (int(outer.sum()) - total) / (outer.size - inner.size)
        self._brightness.append((total / inner.size, around, int(inner.max())))
        self._white = float(np.iinfo(image.dtype).max)

    def found(self, time_s: np.ndarray, exposure_s: float | None) -> tuple[DetectedLed, list[str]]:
        """Return the detected LED and warnings, from the middles (F,) of the exposures and their length."""
        inside, around, brightest = np.array(self._brightness).T
        levels = levels_of(inside, self._white)
        led = DetectedLed(window_px=list(self.window), brightness_grey=np.round(inside, DIGITS).tolist())
        if levels is None:
            return led, [_never(led, inside)]
        dark, lit, noise = levels
        led.dark_grey, led.lit_grey, led.noise_grey = dark, lit, noise
        contrast = lit - dark
        led.burnt = bool(np.median(brightest[inside > dark + LIT * contrast]) >= BURNT_SHARE * self._white)
        switches = Switches(time_s, inside, around, contrast, noise, exposure_s, self.gammas, led.burnt)
        led.events, led.rejected = switches.all((inside - dark) / contrast)
        return led, _warnings(led, inside)


def window_of(led: LedSettings, camera: Camera) -> tuple[int, int, int, int]:
    """Return left, top, right, bottom (exclusive) [px] of the window; SC-T033 if it is not in the image."""
    if led.box_px is not None:
        left, top, right, bottom = led.box_px
    else:
        place_m = np.array(led.place_m)
        middle = metre_to_pixel(camera, place_m, camera.string_offset_m)
        scale = metre_per_pixel(camera, place_m, camera.string_offset_m)
        half = max(led.radius_m / float(scale), SMALLEST_PX)
        left, top = (math.floor(value) for value in middle - half)
        right, bottom = (math.ceil(value) + 1 for value in middle + half)
    width, height = camera.lens.width_px, camera.lens.height_px
    if not (0 <= left < right <= width and 0 <= top < bottom <= height):
        raise StrandcastError(
            "SC-T033",
            f"the LED's window, {left} to {right} px from the left and {top} to {bottom} px from the top, is "
            f"not within the image of {width} x {height} px",
            field="align.led",
            fix="give the LED's place in the image, or remove the setting",
        )
    return left, top, right, bottom


def levels_of(light: np.ndarray, white: float) -> tuple[float, float, float] | None:
    """Return dark and lit grey level of a brightness (F,), and its noise; None if it has only one level."""
    values, counts = np.unique(light, return_counts=True)
    if len(light) < 2 * HOLD_FRAMES or len(values) < 2:
        return None
    split = threshold_otsu(hist=(counts, values))  # exact; a histogram of 256 bins splits elsewhere
    dark, lit = float(np.median(light[light <= split])), float(np.median(light[light > split]))
    # Steps from frame to frame are noise, except for the few at the LED's edges.
    noise = 1.4826 * float(np.median(np.abs(np.diff(light)))) / math.sqrt(2.0)
    least = max(LEAST_CONTRAST * white, LEAST_TIMES_NOISE * noise)
    return (dark, lit, noise) if lit - dark > least else None


@dataclass(frozen=True, eq=False)
class Switches:
    """Finds the LED's switchings in a brightness over time."""

    time_s: np.ndarray  # (F,)
    light: np.ndarray  # brightness of the window, (F,)
    around: np.ndarray  # and of its surroundings, (F,)
    contrast: float  # of `light`: how much brighter the lit window is than the dark one
    noise: float  # of `light` in one frame
    exposure_s: float | None  # None if unknown
    gammas: tuple[float, float]  # least and greatest of the camera
    burnt: bool  # the lit LED saturates the camera: a frame that looks lit may be only partly lit

    def all(self, share: np.ndarray) -> tuple[list[DetectedSwitch], list[str]]:
        """Return the switchings in order of time, and the reasons to reject other changes.

        `share` (F,) is the brightness between dark (0) and lit (1).
        """
        period_s = float(np.median(np.diff(self.time_s)))
        runs, short = _runs(share, max(HOLD_FRAMES, math.ceil(HOLD_S / period_s)))
        events, rejected = [], [f"{short} flashes or dips of a few frames"] if short else []
        for before, after in pairwise(runs):
            kind = "led_on" if after.lit else "led_off"
            at = f"{kind} at {self.time_s[after.first]:.4f} s"
            why = self._why_not(before, after)
            between = None if why else self._between(before, after)
            if between is None:
                rejected.append(f"{at}: {why or 'its frames contradict each other, or the exposure given'}")
                continue
            low_s, high_s = between
            events.append(
                DetectedSwitch(
                    kind=kind,
                    camera_time_s=0.5 * (low_s + high_s),
                    sigma_s=(high_s - low_s) / math.sqrt(12.0),
                )
            )
        return events, rejected

    def _why_not(self, before: LevelRun, after: LevelRun) -> str | None:
        """Return why the LED cannot have caused a change of state; None if it can."""
        if after.first - before.last > 2:
            return f"takes {after.first - before.last - 1} frames"
        old, new = before.tail(), after.head()
        step = abs(_median(self.light, new) - _median(self.light, old))
        if not STEPS[0] < step / self.contrast < STEPS[1]:
            return f"is {step:.1f} grey levels instead of {self.contrast:.1f}"
        around = abs(_median(self.around, new) - _median(self.around, old))
        if around > SHARED_LIGHT * step:
            return f"the light around it changes as well, by {around:.1f} grey levels"
        return None

    def _between(self, before: LevelRun, after: LevelRun) -> tuple[float, float] | None:
        """Return the bounds of the time when the LED switched; None where they contradict each other."""
        frames = np.arange(before.last - 1, after.first + 2)
        old, new = _median(self.light, before.tail()), _median(self.light, after.head())
        share = (self.light[frames] - old) / (new - old)
        error = max(LEAST_SHARE_ERROR, SHARE_NOISE * self.noise / abs(new - old))
        period_s = float(np.max(np.diff(self.time_s[frames])))
        exposures = (0.0, period_s) if self.exposure_s is None else (self.exposure_s, self.exposure_s)
        if after.lit:
            return self._bounds(self.time_s[frames], share, error, exposures)
        # Switching off is switching on, backwards in time.
        found = self._bounds(-self.time_s[frames][::-1], 1.0 - share[::-1], error, exposures)
        return None if found is None else (-found[1], -found[0])

    def _bounds(
        self, time_s: np.ndarray, share: np.ndarray, error: float, exposures: tuple[float, float]
    ) -> tuple[float, float] | None:
        """Return the bounds of the time when an LED was switched on, from shares (K,) of light in frames.

        Lit for a share s, it was switched on at t + e/2 - s e; after dark frames, and before fully lit ones.
        """
        low_s, high_s = -math.inf, math.inf
        for at_s, measured in zip(time_s, share, strict=True):
            least, most = self._true_share(measured, error)
            if most < 1.0:
                low_s = max(low_s, min(at_s + (0.5 - most) * e for e in exposures))
            if least > 0.0:
                high_s = min(high_s, max(at_s + (0.5 - least) * e for e in exposures))
        return (float(low_s), float(high_s)) if low_s <= high_s else None

    def _true_share(self, measured: float, error: float) -> tuple[float, float]:
        """Return the bounds of the share of light from the share of brightness."""
        least = 0.0 if measured < NEARLY else np.clip(measured - error, 0.0, 1.0)
        most = 1.0 if measured > 1.0 - NEARLY else np.clip(measured + error, 0.0, 1.0)
        if self.burnt:
            return (1e-9 if least > 0.0 else 0.0), float(most)
        return float(least ** max(self.gammas)), float(most ** min(self.gammas))


@dataclass(frozen=True)
class LevelRun:
    """Frames, first and last included, in which the LED is lit or dark."""

    lit: bool
    first: int
    last: int

    def head(self) -> slice:
        """Return its first frames, without the very first, which may be partly lit."""
        return slice(min(self.first + 1, self.last), min(self.first + PLATEAU_FRAMES, self.last) + 1)

    def tail(self) -> slice:
        """Return its last frames, without the very last."""
        return slice(max(self.last - PLATEAU_FRAMES, self.first), max(self.last - 1, self.first) + 1)


def _runs(share: np.ndarray, hold: int) -> tuple[list[LevelRun], int]:
    """Return the lasting runs of light and darkness, and the number of shorter ones."""
    state = np.where(share > LIT, 1, np.where(share < DARK, -1, 0))
    starts = np.flatnonzero(np.diff(np.concatenate([[9], state])))
    ends = np.append(starts[1:], len(state)) - 1
    runs: list[LevelRun] = []
    short = 0
    for first, last in zip(starts.tolist(), ends.tolist(), strict=True):
        if state[first] == 0:
            continue
        if last - first + 1 < hold:
            short += 1
        elif runs and runs[-1].lit == (state[first] == 1):
            runs[-1] = LevelRun(runs[-1].lit, runs[-1].first, last)
        else:
            runs.append(LevelRun(bool(state[first] == 1), first, last))
    return runs, short


def _median(values: np.ndarray, part: slice) -> float:
    return float(np.median(values[part]))


def _never(led: DetectedLed, inside: np.ndarray) -> str:
    left, top, right, bottom = led.window_px
    return (
        f"align.led: no LED switches in {left} to {right} px from the left, {top} to {bottom} px "
        f"from the top (brightness {inside.min():.0f} to {inside.max():.0f} grey levels): the clocks are "
        "aligned by the hand's motion alone; check its place and its wire, or remove the setting"
    )


def _warnings(led: DetectedLed, inside: np.ndarray) -> list[str]:
    warnings = [] if led.events else [_never(led, inside)]
    if led.rejected:
        warnings.append(
            "align.led: these changes in the LED's window are not its switching: "
            + "; ".join(led.rejected[:MOST_LISTED])
            + (f"; and {len(led.rejected) - MOST_LISTED} more" if len(led.rejected) > MOST_LISTED else "")
        )
    return warnings
