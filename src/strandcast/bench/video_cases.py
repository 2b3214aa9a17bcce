"""Which videos the tracking benchmark films: a balanced design over strings, motions, scenes and sensors."""

from __future__ import annotations

from dataclasses import dataclass, replace

from strandcast.lab.film import TONES, Tones

HELD_OUT, TUNING = 9000, 100  # first seeds; what a tracker was tuned on is never what it is judged by
STRINGS = tuple(f"paper-{number}" for number in range(1, 8))
BACKGROUNDS = ("plain", "textured", "cluttered")
NOISES_GREY = (2.5, 5.0)
EXPOSURES_S = (4e-4, 1e-3)
FRAME_RATE_HZ = 500.0
LEAST_CNR = 8.0
CROSSING_S = 0.02
QUICK_FRAMES = 80

# The tip's peak speed [m/s] tells how violent a motion is.
TIP_SPEEDS_M_S = {"gentle": (0.8, 2.5), "brisk": (3.0, 6.0), "violent": (7.0, 18.0)}
TONES_BY_CONTRAST = {"bright": TONES, "weak": Tones(130, 140, 120), "dark": Tones(18, 12, 34)}


@dataclass(frozen=True)
class Case:
    """One video of the benchmark.

    Attributes
    ----------
    name
        Its folder, and with `seed` the source of its random numbers.
    seed
        Of motion, view, wall, grasp and sensor.
    string
        Name of the lab's string.
    speed
        Key of `TIP_SPEEDS_M_S`.
    background, noise_grey, exposure_s
        The lab camera's.
    contrast
        Key of `TONES_BY_CONTRAST`: how string, pipes and weights look before the wall.
    crossing_s
        For how long at least the string crosses itself while it is filmed [s].
    start_s, most_frames
        When the camera starts, from the motion's start [s], and after how many frames it stops.
    """

    name: str
    seed: int
    string: str
    speed: str
    background: str
    noise_grey: float
    exposure_s: float
    contrast: str = "bright"
    crossing_s: float = 0.0
    start_s: float = -0.06
    most_frames: int = 10_000


# Speed, noise and exposure of a string's first four videos; every other string swaps noise and exposure.
_FOUR = (("gentle", 0, 0), ("brisk", 1, 0), ("violent", 0, 1), ("violent", 1, 1))
_FOUR_SWAPPED = (("gentle", 1, 1), ("brisk", 0, 1), ("violent", 1, 0), ("brisk", 0, 0))
# The fifth: a string that hardly stands out, or a dark one. Weak ones have no clutter behind them that
# would be as bright as they are.
_FIFTH = (
    ("dark", "plain", "brisk"),
    ("weak", "textured", "brisk"),
    ("dark", "textured", "violent"),
    ("weak", "plain", "violent"),
    ("dark", "cluttered", "gentle"),
    ("weak", "textured", "gentle"),
    ("dark", "plain", "violent"),
)


def held_out() -> list[Case]:
    """Return the benchmark's 35 videos: five per string, on motions that nothing was tuned to.

    Each string's second video, in brisk motion, is one in which it crosses itself.
    """
    cases = []
    for number, string in enumerate(STRINGS):
        four = _FOUR_SWAPPED if number % 2 else _FOUR
        for k, (speed, noise, exposure) in enumerate(four):
            background = BACKGROUNDS[(number + k) % 3]
            case = _case(HELD_OUT, string, k, speed, background, noise, exposure)
            cases.append(replace(case, crossing_s=CROSSING_S if k == 1 else 0.0))
        contrast, background, speed = _FIFTH[number]
        cases.append(_case(HELD_OUT, string, 4, speed, background, 0, number % 2, contrast))
    return cases


def tuning() -> list[Case]:
    """Return 14 other videos, two per string, for who builds a tracker; the brisk cross themselves."""
    cases = []
    for number, string in enumerate(STRINGS):
        speeds = (("brisk", "gentle", "violent")[number % 3], "violent" if number % 3 < 2 else "brisk")
        for k, speed in enumerate(speeds):
            background = BACKGROUNDS[(number + 2 * k) % 3]
            contrast = {(1, 0): "dark", (4, 0): "weak"}.get((number, k), "bright")
            case = _case(TUNING, string, k, speed, background, (number + k) % 2, number // 2 % 2, contrast)
            cases.append(replace(case, crossing_s=CROSSING_S if speed == "brisk" else 0.0))
    return cases


def quick() -> list[Case]:
    """Return one short video that shows whether the benchmark runs."""
    return [replace(held_out()[0], name="quick", noise_grey=2.5, start_s=0.15, most_frames=QUICK_FRAMES)]


def speed() -> Case:
    """Return the video that speed is measured on: a long string, with weights, in brisk motion."""
    return replace(held_out()[18], name="speed", speed="brisk", background="textured", noise_grey=2.5)


def _case(
    first: int, string: str, k: int, speed: str, background: str, noise: int, exposure: int,
    contrast: str = "bright",
) -> Case:  # fmt: skip
    number = STRINGS.index(string)
    return Case(
        name=f"{string}-{k}" if first == HELD_OUT else f"tune-{string[-1]}-{k}",
        seed=first + 10 * number + k,
        string=string,
        speed=speed,
        background=background,
        noise_grey=NOISES_GREY[noise],
        exposure_s=EXPOSURES_S[exposure],
        contrast=contrast,
    )
