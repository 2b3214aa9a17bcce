"""An LED that the robot switches, in the picture: the brightness of a small window, and when it changed.

A frame that is exposed from t - e/2 to t + e/2 (t its time, e the exposure) is lit for a share of it. Where a
frame is lit in part, the share tells when the LED switched; where none is, it switched between two exposures.
Every frame bounds the switching time so; the event is the middle of what they leave, its sigma that width
over the square root of 12.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from strandcast.camera.mapping import metre_per_pixel, metre_to_pixel
from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera
from strandcast.records.track import SeenLed, SeenSwitch

SMALLEST_PX = 1.5  # half a window's side
SURROUND = 2.0  # side of what is looked at around a window, over the window's
LEAST_CONTRAST = 0.02  # of the whitest grey, by which a lit window must be brighter
LEAST_TIMES_NOISE = 12.0
DARK, LIT = 0.25, 0.75  # of the way from dark to lit: what is between is neither
HOLD_FRAMES, HOLD_S = 3, 0.01  # that a state must last; shorter ones are flicker
PLATEAU_FRAMES = 12  # of which the levels beside an edge are the medians
STEPS = (0.6, 1.6)  # that these may be apart, over the usual contrast
SHARED_LIGHT = 0.5  # of a change, seen around the window too: then it is another light's
SHARE_NOISE = 4.0  # standard deviations that bound a share
LEAST_SHARE_ERROR = 0.05  # encoders are a little behind a change, lamps glow a little after it
NEARLY = 0.15  # of the light, that a frame must have, or lack, to be taken for lit in part
BURNT_SHARE = 0.98  # of the whitest grey
GAMMAS = (1.0, 2.4)  # that a camera's grey = light^(1/gamma) may have, where it is not told
DIGITS = 2
MOST_TOLD = 3


@dataclass(frozen=True)
class LedPlace:
    """Where an LED is looked for: a place in the motion plane (2,) and radius [m], or a box [px].

    `gamma` is the camera's (grey = light^(1 / gamma)), None where it is not known.
    """

    place_m: tuple[float, float] | None = None
    radius_m: float = 0.01
    box_px: tuple[int, int, int, int] | None = None
    gamma: float | None = None


class LedWatch:
    """Keeps the mean brightness of a window and of what is around it, frame by frame."""

    def __init__(self, place: LedPlace, camera: Camera) -> None:
        self.gammas = GAMMAS if place.gamma is None else (place.gamma, place.gamma)
        self.window = left, top, right, bottom = window_of(place, camera)
        across, down = (round(0.5 * (SURROUND - 1.0) * side) for side in (right - left, bottom - top))
        self._inner = np.s_[top:bottom, left:right]
        self._outer = np.s_[
            max(0, top - max(1, down)) : bottom + max(1, down),
            max(0, left - max(1, across)) : right + max(1, across),
        ]
        self._seen: list[tuple[float, float, float]] = []
        self._white = 255.0

    def look(self, image: np.ndarray) -> None:
        """Take in a frame (H, W)."""
        inner, outer = image[self._inner], image[self._outer]
        total = int(inner.sum())
        around = (int(outer.sum()) - total) / (outer.size - inner.size)
        self._seen.append((total / inner.size, around, int(inner.max())))
        self._white = float(np.iinfo(image.dtype).max)

    def found(self, time_s: np.ndarray, exposure_s: float | None) -> tuple[SeenLed, list[str]]:
        """Return what was seen of the LED, and what is to be warned of.

        Parameters
        ----------
        time_s
            (F,) camera times of the frames: the middles of their exposures.
        exposure_s
            Length of the exposures; None where it is not known.
        """
        inside, around, brightest = np.array(self._seen).T
        levels = levels_of(inside, self._white)
        seen = SeenLed(window_px=list(self.window), brightness_grey=np.round(inside, DIGITS).tolist())
        if levels is None:
            return seen, [_never(seen, inside)]
        seen.dark_grey, seen.lit_grey, seen.noise_grey = levels.dark, levels.lit, levels.noise
        lit = inside > levels.at(LIT)
        seen.burnt = bool(np.median(brightest[lit]) >= BURNT_SHARE * self._white)
        switches = Switches(time_s, inside, around, levels, exposure_s, self.gammas, seen.burnt)
        seen.events, seen.rejected = switches.all()
        return seen, _warnings(seen, inside)


def window_of(place: LedPlace, camera: Camera) -> tuple[int, int, int, int]:
    """Return left, top, right, bottom [px] of the window, the last two beyond it.

    Raises
    ------
    StrandcastError
        SC-T033 it is not in the picture.
    """
    if place.box_px is not None:
        left, top, right, bottom = place.box_px
    else:
        place_m = np.array(place.place_m)
        middle = metre_to_pixel(camera, place_m, camera.string_offset_m)
        scale = metre_per_pixel(camera, place_m, camera.string_offset_m)
        half = max(place.radius_m / float(scale), SMALLEST_PX)
        left, top = (math.floor(value) for value in middle - half)
        right, bottom = (math.ceil(value) + 1 for value in middle + half)
    width, height = camera.lens.width_px, camera.lens.height_px
    if not (0 <= left < right <= width and 0 <= top < bottom <= height):
        raise StrandcastError(
            "SC-T033",
            f"the LED's window, {left} to {right} px from the left and {top} to {bottom} px from the top, is "
            f"not within the picture of {width} x {height} px",
            field="align.led",
            fix="give where the LED is seen, or leave the setting out",
        )
    return left, top, right, bottom


@dataclass(frozen=True)
class Levels:
    """Brightness of a dark and of a lit window, and noise of a frame's [grey]."""

    dark: float
    lit: float
    noise: float

    @property
    def contrast(self) -> float:
        """Return by how much a lit window is brighter."""
        return self.lit - self.dark

    def at(self, share: float) -> float:
        """Return the brightness at a share of the way from dark to lit."""
        return self.dark + share * self.contrast


def levels_of(light: np.ndarray, white: float) -> Levels | None:
    """Return the two levels that a brightness (F,) keeps to, None where it keeps to one.

    They are split where the variance within both is least (Otsu 1979).
    """
    count = len(light)
    if count < 2 * HOLD_FRAMES:
        return None
    ranked = np.sort(light)
    below = np.arange(1, count)
    sums = np.cumsum(ranked)
    apart = (sums[-1] - sums[:-1]) / (count - below) - sums[:-1] / below
    split = int(np.argmax(below * (count - below) * apart**2)) + 1
    dark, lit = float(np.median(ranked[:split])), float(np.median(ranked[split:]))
    # Steps from frame to frame are noise, but for the few at the LED's edges.
    noise = 1.4826 * float(np.median(np.abs(np.diff(light)))) / math.sqrt(2.0)
    least = max(LEAST_CONTRAST * white, LEAST_TIMES_NOISE * noise)
    return Levels(dark, lit, noise) if lit - dark > least else None


@dataclass(frozen=True, eq=False)
class Switches:
    """A brightness over time, in which the LED's switchings are found.

    Attributes
    ----------
    time_s, light, around
        (F,) time, brightness of the window and of what is around it.
    levels
        Of `light`.
    exposure_s
        None where it is not known.
    gammas
        Least and greatest that the camera may have.
    burnt
        Whether the lit LED is brighter than the camera tells: then a frame that seems lit may be so in part.
    """

    time_s: np.ndarray
    light: np.ndarray
    around: np.ndarray
    levels: Levels
    exposure_s: float | None
    gammas: tuple[float, float]
    burnt: bool

    def all(self) -> tuple[list[SeenSwitch], list[str]]:
        """Return the switchings in order of time, and why other changes are none."""
        share = (self.light - self.levels.dark) / self.levels.contrast
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
                SeenSwitch(
                    kind=kind,
                    camera_time_s=0.5 * (low_s + high_s),
                    sigma_s=(high_s - low_s) / math.sqrt(12.0),
                )
            )
        return events, rejected

    def _why_not(self, before: Run, after: Run) -> str | None:
        """Return why a change of state is not an LED's, None if it may be."""
        if after.first - before.last > 2:
            return f"takes {after.first - before.last - 1} frames"
        old, new = before.tail(), after.head()
        step = abs(_median(self.light, new) - _median(self.light, old))
        if not STEPS[0] < step / self.levels.contrast < STEPS[1]:
            return f"is {step:.1f} grey levels instead of {self.levels.contrast:.1f}"
        around = abs(_median(self.around, new) - _median(self.around, old))
        if around > SHARED_LIGHT * step:
            return f"the light around it changes too, by {around:.1f} grey levels"
        return None

    def _between(self, before: Run, after: Run) -> tuple[float, float] | None:
        """Return between which times the LED switched; None where there is no such time."""
        frames = np.arange(before.last - 1, after.first + 2)
        old, new = _median(self.light, before.tail()), _median(self.light, after.head())
        share = (self.light[frames] - old) / (new - old)
        error = max(LEAST_SHARE_ERROR, SHARE_NOISE * self.levels.noise / abs(new - old))
        period_s = float(np.max(np.diff(self.time_s[frames])))
        exposures = (0.0, period_s) if self.exposure_s is None else (self.exposure_s, self.exposure_s)
        if after.lit:
            return self._bounds(self.time_s[frames], share, error, exposures)
        # Going out is going on, backwards in time.
        found = self._bounds(-self.time_s[frames][::-1], 1.0 - share[::-1], error, exposures)
        return None if found is None else (-found[1], -found[0])

    def _bounds(
        self, time_s: np.ndarray, share: np.ndarray, error: float, exposures: tuple[float, float]
    ) -> tuple[float, float] | None:
        """Return between which times an LED went on, from the seen shares (K,) of light in frames.

        Lit for a share s, it went on at t + e/2 - s e. A dark frame only says that it went on after that, a
        fully lit one only that it did before.
        """
        low_s, high_s = -math.inf, math.inf
        for at_s, seen in zip(time_s, share, strict=True):
            least, most = self._true_share(seen, error)
            if most < 1.0:
                low_s = max(low_s, min(at_s + (0.5 - most) * e for e in exposures))
            if least > 0.0:
                high_s = min(high_s, max(at_s + (0.5 - least) * e for e in exposures))
        return (float(low_s), float(high_s)) if low_s <= high_s else None

    def _true_share(self, seen: float, error: float) -> tuple[float, float]:
        """Return between which shares of light a share of brightness lies."""
        least = 0.0 if seen < NEARLY else np.clip(seen - error, 0.0, 1.0)
        most = 1.0 if seen > 1.0 - NEARLY else np.clip(seen + error, 0.0, 1.0)
        if self.burnt:
            return (1e-9 if least > 0.0 else 0.0), float(most)
        return float(least ** max(self.gammas)), float(most ** min(self.gammas))


@dataclass(frozen=True)
class Run:
    """Frames, first and last included, in which the LED is lit, or dark."""

    lit: bool
    first: int
    last: int

    def head(self) -> slice:
        """Return its first frames, without the very first, which may be lit in part."""
        return slice(min(self.first + 1, self.last), min(self.first + PLATEAU_FRAMES, self.last) + 1)

    def tail(self) -> slice:
        """Return its last frames, without the very last."""
        return slice(max(self.last - PLATEAU_FRAMES, self.first), max(self.last - 1, self.first) + 1)


def _runs(share: np.ndarray, hold: int) -> tuple[list[Run], int]:
    """Return the runs of light and darkness that last, and the number of those that do not."""
    state = np.where(share > LIT, 1, np.where(share < DARK, -1, 0))
    starts = np.flatnonzero(np.diff(np.concatenate([[9], state])))
    ends = np.append(starts[1:], len(state)) - 1
    runs: list[Run] = []
    short = 0
    for first, last in zip(starts.tolist(), ends.tolist(), strict=True):
        if state[first] == 0:
            continue
        if last - first + 1 < hold:
            short += 1
        elif runs and runs[-1].lit == (state[first] == 1):
            runs[-1] = Run(runs[-1].lit, runs[-1].first, last)
        else:
            runs.append(Run(bool(state[first] == 1), first, last))
    return runs, short


def _median(values: np.ndarray, part: slice) -> float:
    return float(np.median(values[part]))


def _never(seen: SeenLed, inside: np.ndarray) -> str:
    left, top, right, bottom = seen.window_px
    return (
        f"align.led: no LED is seen to switch in {left} to {right} px from the left, {top} to {bottom} px "
        f"from the top (brightness {inside.min():.0f} to {inside.max():.0f} grey levels): the clocks are "
        "aligned by the hand's motion alone; check its place and its wire, or leave the setting out"
    )


def _warnings(seen: SeenLed, inside: np.ndarray) -> list[str]:
    told = [] if seen.events else [_never(seen, inside)]
    if seen.rejected:
        told.append(
            "align.led: these changes in the LED's window are not its switching: "
            + "; ".join(seen.rejected[:MOST_TOLD])
            + (f"; and {len(seen.rejected) - MOST_TOLD} more" if len(seen.rejected) > MOST_TOLD else "")
        )
    return told
