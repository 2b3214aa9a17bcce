"""A pendulum's period, and whether it is that of a thread of the declared length."""

from pathlib import Path

import numpy as np

from strandcast.errors import StrandcastError

STANDARD_GRAVITY_M_S2 = 9.81
# Chosen. A ball's radius left out of the length, a heavy thread and a drawn-out camera clock cost up to 5 %:
# of a real thread of 0.62 m, 2 %. On Earth gravity itself varies by 0.5 %.
GRAVITY_TOLERANCE = 0.12
HYSTERESIS = 0.5  # chosen: of the rms angle, that the swing reaches on each side between two passages
FEWEST_PASSAGES = 2


def check_period(time_s: np.ndarray, angle_rad: np.ndarray, length_m: float, path: str | Path) -> float:
    """Return a swing's period [s], NaN if it is shorter; refuse one that contradicts the length (SC-T004).

    Parameters
    ----------
    time_s, angle_rad
        (F,) times and angles from the vertical; angles of frames without the ball are NaN.
    length_m
        From the pivot to the ball's centre.
    """
    known = np.isfinite(angle_rad)
    period = period_s(time_s[known], angle_rad[known])
    if not np.isfinite(period):
        return period
    # Second order in the amplitude (root 2 times the rms angle); 0.02 % off at 0.5 rad.
    longer = 1.0 + np.var(angle_rad[known]) / 8.0
    gravity_m_s2 = length_m * (2.0 * np.pi * longer / period) ** 2
    ratio = gravity_m_s2 / STANDARD_GRAVITY_M_S2
    if abs(ratio - 1.0) < GRAVITY_TOLERANCE:
        return period
    expected_s = period * np.sqrt(ratio)
    raise StrandcastError(
        "SC-T004",
        f"swings with a period of {period:.3f} s; a thread of {length_m:g} m takes {expected_s:.3f} s "
        f"(gravity would be {gravity_m_s2:.1f} m/s²)",
        file=path,
        field="string.length_m",
        cost=f"metres or seconds would be wrong: {length_m / ratio:.3f} m would fit, or "
        f"{1.0 / np.sqrt(ratio):.3g} times the frame rate",
        fix="measure string.length_m from the pivot to the ball's centre, and check camera.frame_rate_hz",
    )


def period_s(time_s: np.ndarray, angle_rad: np.ndarray) -> float:
    """Return the mean period [s] between the first and last rising passage through the middle.

    Falling passages are used if fewer than two are rising; NaN if these are as few. Between two passages the
    angle must reach both sides, so that noise does not count.
    """
    middle = angle_rad - angle_rad.mean()
    passages_s = _rising_s(time_s, middle)
    if len(passages_s) < FEWEST_PASSAGES:
        passages_s = _rising_s(time_s, -middle)
    if len(passages_s) < FEWEST_PASSAGES:
        return float("nan")
    return float(np.polyfit(np.arange(len(passages_s)), passages_s, 1)[0])


def _rising_s(time_s: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Return the times at which a series rises through zero, once for each time that it was well below."""
    rising = np.flatnonzero((middle[:-1] < 0) & (middle[1:] >= 0))
    low = np.flatnonzero(middle < -HYSTERESIS * np.sqrt((middle**2).mean()))
    # The number of the last frame well below zero before each passage; of several with the same, the first.
    before = np.searchsorted(low, rising, side="right")
    rising = rising[np.diff(before, prepend=-1 if middle[0] < 0 else 0) > 0]
    share = middle[rising] / (middle[rising] - middle[rising + 1])
    return np.asarray(time_s[rising] + share * (time_s[rising + 1] - time_s[rising]))
