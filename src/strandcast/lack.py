"""What a throw may lack besides a distance: told in words, and counted as a distance by planner and judge."""

from __future__ import annotations

import math

# So high that a hit of 20 mm is within 1.2 degrees beyond the tolerance, and 0.2 m/s of the speed.
DIRECTION_M_RAD = 1.0
SPEED_S = 0.1
# A velocity is that over so long to each side: neither track nor carried residual is free of noise.
VELOCITY_S = 0.006


def point_words(direction_rad: float | None, tolerance_rad: float, least_speed_m_s: float) -> str:
    """Return in words what a throw at a point is for."""
    words = "point"
    if direction_rad is not None:
        words += (
            f", the tip moving at {math.degrees(direction_rad):.0f}° ± {math.degrees(tolerance_rad):.0f}°"
        )
    if least_speed_m_s > 0.0:
        words += f", at {least_speed_m_s:g} m/s at least"
    return words


def shape_words(places: int) -> str:
    """Return in words what a throw for a shape is for."""
    return f"shape through {places} places"


def swing_words(height_m: float | None, speed_m_s: float | None) -> str:
    """Return in words what a swing is for."""
    return (
        f"swing, the tip {f'{height_m:g} m high' if speed_m_s is None else f'at {speed_m_s:g} m/s'} at least"
    )
