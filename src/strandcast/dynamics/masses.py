"""Relative masses of the points, from weights and stiff sections at known places along the string.

Places are metres from the hand. A weight between two points is split linearly over them. The points that a
stiff section touches carry a mass of their own, as in the paper (Table 4).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from strandcast.dynamics.parameters import Array

Reading = Literal["added", "own"]
FREE_END = 0.5  # see `MassLayout.tip`


@dataclass(frozen=True)
class MassLayout:
    """The distribution of the free masses over the points.

    Attributes
    ----------
    shares
        (w, n) share of free mass j that point i + 1 carries; each row sums to 1.
    places_m
        (w,) place of each free mass along the string [m].
    reading
        ``added``: a free mass comes on top of the plain point. ``own``: it replaces the plain point's mass,
        which allows a weighted point lighter than the plain ones, as in the paper's Table 4.
    stiff
        Number of free masses, the last ones, that belong to stiff sections.
    tip
        Mass of the last point, if plain, relative to the others': 0.5 at a free end, because it carries half
        of one segment, not of two; 1 in the paper.
    """

    shares: Array
    places_m: Array
    reading: Reading = "added"
    stiff: int = 0
    tip: float = FREE_END

    @property
    def plain(self) -> Array:
        """(n,) relative masses of the points without free masses."""
        return np.append(np.ones(self.shares.shape[1] - 1), self.tip)

    @property
    def count(self) -> int:
        """Number of free masses."""
        return len(self.shares)

    def stiff_joints(self) -> NDArray[np.bool_]:
        """(n,) True for joints 0…n-1 at points of stiff sections: joint i is at point i."""
        touched = self.shares[self.count - self.stiff :].sum(axis=0) > 0
        return np.concatenate([[False], touched[:-1]])


def mass_layout(
    length_m: float,
    n: int,
    weight_places_m: list[float],
    stiff_sections_m: list[tuple[float, float]] | None = None,
    reading: Reading = "added",
    tip: float = FREE_END,
) -> MassLayout:
    """Lay the free masses out over the points.

    Parameters
    ----------
    length_m, n
        Free length [m] and number of free points.
    weight_places_m
        Place of each weight [m from the hand], in (0, length_m].
    stiff_sections_m
        (from_m, to_m) of each stiff section; every point it touches has a free mass, the nearest point if it
        touches none.
    reading, tip
        See `MassLayout`.
    """
    spacing_m = length_m / n
    rows = [_split(place / spacing_m, n) for place in weight_places_m]
    places = list(weight_places_m)
    for start_m, end_m in stiff_sections_m or []:
        for point in points_touched(start_m, end_m, spacing_m, n):
            rows.append(_split(float(point), n))
            places.append(point * spacing_m)
    stiff = len(rows) - len(weight_places_m)
    shares = np.array(rows).reshape(len(rows), n)
    return MassLayout(shares, np.array(places, dtype=float), reading, stiff, tip)


def point_masses(layout: MassLayout, free: Array, plain: Array | float = 1.0) -> Array:
    """Relative mass of every point.

    Parameters
    ----------
    layout
        Distribution of the free masses.
    free
        (..., w) the free masses.
    plain
        (...,) mass of a plain point.

    Returns
    -------
    (..., n) relative masses of points 1…n.
    """
    common = np.asarray(plain, dtype=float)[..., None] * layout.plain
    carried = np.asarray(free, dtype=float) @ layout.shares
    if layout.reading == "own":
        return np.asarray(common * (1.0 - layout.shares.sum(axis=0).clip(max=1.0)) + carried)
    return np.asarray(common + carried)


def points_touched(start_m: float, end_m: float, spacing_m: float, n: int) -> list[int]:
    """Points (1…n) between two places on the string, or the one nearest to their middle."""
    inside = [i for i in range(1, n + 1) if start_m <= i * spacing_m <= end_m]
    return inside or [int(np.clip(round((start_m + end_m) / 2 / spacing_m), 1, n))]


def _split(position: float, n: int) -> Array:
    """Shares of points 1…n in a mass at `position`, in spacings from the hand (1 = point 1)."""
    place = min(max(position, 1.0), float(n))
    low = min(int(place), n - 1) if n > 1 else 1
    share = np.zeros(n)
    share[low - 1] = 1.0 - (place - low)
    if n > 1:
        share[low] = place - low
    return share
