"""The fixed part of a string model, for all values of its parameters."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from strandcast.dynamics.parameters import Array

_SWITCH_WIDTH = {"rate": 0.5, "sign": 0.02, "strain": 0.1}
READINGS = tuple(_SWITCH_WIDTH)


@dataclass(frozen=True)
class StringModel:
    """A planar chain of `points` free mass points on a driven hand.

    Attributes
    ----------
    length_m
        Free length from the hand to the tip [m].
    points
        Number n of free points; the rest spacing is ``length_m / points``.
    reading
        Which bends take the parameters of compression (k_h, c_h) and which those of tension (k_sh, c_sh).
        ``rate``: a growing bend takes h, a straightening one sh. ``sign``: a bend to the left takes h, to the
        right sh. ``strain``: h where the string is compressed, sh where it is stretched.
    dt_s
        Step [s].
    precision
        ``f64``, or ``f32``: twice as many candidates at a time, for searching; micrometres away.
    switch_width
        Half-width over which h blends into sh, so that the force stays continuous; ``rate``: in theta * rate
        [rad^2/s], ``sign``: [rad], ``strain``: tension over the point's weight [1]. None: the reading's
        default.
    gravity_m_s2
        Gravity [m/s^2].
    """

    length_m: float
    points: int
    reading: Literal["rate", "sign", "strain"] = "rate"
    dt_s: float = 1e-3
    precision: Literal["f64", "f32"] = "f64"
    switch_width: float | None = None
    gravity_m_s2: float = 9.81

    @property
    def spacing_m(self) -> float:
        """Rest length of a segment, l0 [m]."""
        return self.length_m / self.points

    def places_m(self) -> Array:
        """Places of points 0…n along the string [m]."""
        return np.linspace(0.0, self.length_m, self.points + 1)

    def switch(self) -> float:
        """Half-width of the blend between h and sh, in the reading's own unit."""
        return _SWITCH_WIDTH[self.reading] if self.switch_width is None else self.switch_width
