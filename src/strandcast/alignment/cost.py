"""The cost of a wrong offset: the distance that the fastest point moves in that time."""

from typing import NamedTuple


class FastestPoint(NamedTuple):
    """The fastest point of the throw: the owner of the speed, as "the hand's", and its speed [m/s]."""

    owner: str
    speed_m_s: float

    def error_mm(self, time_s: float) -> float:
        """Return how far the point moves in a time [mm]."""
        return abs(time_s) * self.speed_m_s * 1e3

    def __str__(self) -> str:
        return f"{self.owner} {self.speed_m_s:.1f} m/s"
