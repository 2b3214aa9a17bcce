"""Balls on the string through a video: where the chain cannot say, they are followed from frame to frame."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from strandcast.tracking.fit import Fit
from strandcast.tracking.follower import Sight
from strandcast.tracking.tip import BALL_REACH_PX, ball_centre, place_on

FAR_PX = 6.0  # from where the chain has it, from which a ball is looked for from frame to frame, too


def follow_balls(
    look: Callable[[int], Sight | None], fits: list[Fit | None], balls: np.ndarray
) -> np.ndarray:
    """Return where the balls are, (F, B, 2) m; NaN where they are not seen.

    A chain that cuts a fold short misses the weight in the fold. The weight itself is round, larger than the
    string is wide, and goes on as it went.

    Parameters
    ----------
    look
        Returns a frame.
    fits
        The string in each frame.
    balls
        (B, 3) place along the chain (m), radius (m), grey level.
    """
    centres = np.full((len(fits), len(balls), 2), np.nan)
    for index, fit in enumerate(fits):
        at = look(index) if fit is not None and len(balls) else None
        if fit is None or at is None:
            continue
        for b, (place_m, radius_m, level) in enumerate(balls):
            expected = place_on(fit.nodes(), fit.heading, place_m)
            found = ball_centre(at.picture, expected, radius_m, level)
            if np.hypot(*(found - expected)) < FAR_PX * at.picture.plane.metre_per_pixel:
                centres[index, b] = found
    for b in range(len(balls)):
        for order in (range(len(fits)), range(len(fits) - 1, -1, -1)):
            _carry_on(look, centres[:, b], balls[b], order)
    return centres


def _carry_on(
    look: Callable[[int], Sight | None], centres: np.ndarray, ball: np.ndarray, order: range
) -> None:
    """Find a ball in frames that follow one in which it was found, in place (F, 2)."""
    for index in order[1:]:
        last = centres[index - order.step]
        if np.isfinite(centres[index, 0]) or not np.isfinite(last[0]):
            continue
        at = look(index)
        if at is None:
            continue
        before = index - 2 * order.step
        known = 0 <= before < len(centres) and np.isfinite(centres[before, 0])
        expected = 2 * last - centres[before] if known else last
        found = ball_centre(at.picture, expected, ball[1], ball[2])
        if np.hypot(*(found - expected)) < BALL_REACH_PX * at.picture.plane.metre_per_pixel:
            centres[index] = found
