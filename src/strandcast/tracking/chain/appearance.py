"""A string's appearance in a video: width, contrast, polarity and grey level."""

from typing import NamedTuple

import numpy as np


class Appearance(NamedTuple):
    """A string's appearance in a video; contrast, noise and levels are grey levels."""

    half_m: float  # half its visible width, including the lens blur
    contrast: float  # line score of a clear piece of string
    tip_excess_m: float = 0.0  # from the string's end to the last that is visible of it, or of the bead there
    bead_level: float = float("nan")  # of the bead at the end, its lowest; NaN if there is none
    bead_highest: float = float("nan")  # its highest: a nut has a bright and a dark side
    bead_m: float = 0.0  # the bead's radius
    beyond_m: float = 0.0  # length of string beyond the bead's centre
    polarity: float = 0.0  # 1 if the string is brighter than the background, -1 if darker, 0 if both occur
    noise: float = 1.0  # standard deviation of unchanged pixels
    level: float = float("nan")  # at its centre line; NaN if unknown

    @property
    def has_bead(self) -> bool:
        """Return whether a bead hides the string's end."""
        return bool(np.isfinite(self.bead_level))
