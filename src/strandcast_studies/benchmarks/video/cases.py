"""The videos of the tracking benchmark: a balanced design over strings, motions, scenes and sensors."""

from dataclasses import dataclass, replace

from strandcast.lab.film import TONES, Tones

HELD_OUT, TUNING = 9000, 100  # first seeds; the tracker is never scored on videos used for tuning
STRINGS = tuple(f"paper-{number}" for number in range(1, 8))
BACKGROUNDS = ("plain", "textured", "cluttered")
NOISES_GREY = (2.5, 5.0)
EXPOSURES_S = (4e-4, 1e-3)
FRAME_RATE_HZ = 500.0
LEAST_CNR = 8.0
CROSSING_S = 0.02
QUICK_FRAMES = 80

# Peak speed of the tip [m/s]; chosen.
TIP_SPEEDS_M_S = {"gentle": (0.8, 2.5), "brisk": (3.0, 6.0), "violent": (7.0, 18.0)}
TONES_BY_CONTRAST = {"bright": TONES, "weak": Tones(130, 140, 120), "dark": Tones(18, 12, 34)}


@dataclass(frozen=True)
class VideoCase:
    """One video of the benchmark."""

    name: str  # of its folder; with `seed`, the source of its random numbers
    seed: int  # of motion, view, wall, grasp and sensor
    string: str  # name of the lab's string
    speed: str  # key of `TIP_SPEEDS_M_S`
    background: str  # this, noise and exposure are settings of the lab's camera
    noise_grey: float
    exposure_s: float
    contrast: str = "bright"  # key of `TONES_BY_CONTRAST`: grey levels of string, pipes and weights
    crossing_s: float = 0.0  # least time for which the filmed string crosses itself
    start_s: float = -0.06  # when the camera starts, from the motion's start
    most_frames: int = 10_000  # after which it stops


# Speed, noise and exposure of a string's first four videos; every other string swaps noise and exposure.
_FOUR = (("gentle", 0, 0), ("brisk", 1, 0), ("violent", 0, 1), ("violent", 1, 1))
_FOUR_SWAPPED = (("gentle", 1, 1), ("brisk", 0, 1), ("violent", 1, 0), ("brisk", 0, 0))
# The fifth video: a weak or a dark string. Weak strings have no cluttered background of similar brightness.
_FIFTH = (
    ("dark", "plain", "brisk"),
    ("weak", "textured", "brisk"),
    ("dark", "textured", "violent"),
    ("weak", "plain", "violent"),
    ("dark", "cluttered", "gentle"),
    ("weak", "textured", "gentle"),
    ("dark", "plain", "violent"),
)


def held_out() -> list[VideoCase]:
    """Return the benchmark's 35 videos: five per string, on motions not used for tuning.

    In each string's second video, with a brisk motion, the string crosses itself.
    """
    cases = []
    for number in range(len(STRINGS)):
        four = _FOUR_SWAPPED if number % 2 else _FOUR
        for k, (speed, noise, exposure) in enumerate(four):
            background = BACKGROUNDS[(number + k) % 3]
            case = _case(HELD_OUT, number, k, noise, exposure)
            crossing_s = CROSSING_S if k == 1 else 0.0
            cases.append(replace(case, speed=speed, background=background, crossing_s=crossing_s))
        contrast, background, speed = _FIFTH[number]
        case = _case(HELD_OUT, number, 4, 0, number % 2)
        cases.append(replace(case, speed=speed, background=background, contrast=contrast))
    return cases


def tuning() -> list[VideoCase]:
    """Return 14 other videos, two per string, for development; in brisk motions the string crosses itself."""
    cases = []
    for number in range(len(STRINGS)):
        speeds = (("brisk", "gentle", "violent")[number % 3], "violent" if number % 3 < 2 else "brisk")
        for k, speed in enumerate(speeds):
            background = BACKGROUNDS[(number + 2 * k) % 3]
            contrast = {(1, 0): "dark", (4, 0): "weak"}.get((number, k), "bright")
            case = _case(TUNING, number, k, (number + k) % 2, number // 2 % 2)
            case = replace(case, speed=speed, background=background, contrast=contrast)
            cases.append(replace(case, crossing_s=CROSSING_S if speed == "brisk" else 0.0))
    return cases


def quick() -> list[VideoCase]:
    """Return one short video as a test run of the benchmark."""
    return [replace(held_out()[0], name="quick", noise_grey=2.5, start_s=0.15, most_frames=QUICK_FRAMES)]


def speed() -> VideoCase:
    """Return the video for measuring speed: a long string with weights in brisk motion."""
    return replace(held_out()[18], name="speed", speed="brisk", background="textured", noise_grey=2.5)


def _case(first: int, number: int, k: int, noise: int, exposure: int) -> VideoCase:
    """Return case `k` of a string, brisk before a plain background."""
    return VideoCase(
        name=f"{STRINGS[number]}-{k}" if first == HELD_OUT else f"tune-{number + 1}-{k}",
        seed=first + 10 * number + k,
        string=STRINGS[number],
        speed="brisk",
        background="plain",
        noise_grey=NOISES_GREY[noise],
        exposure_s=EXPOSURES_S[exposure],
    )
