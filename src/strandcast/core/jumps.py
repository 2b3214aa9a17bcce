"""Jumps of markers on strings in space: errors of measurement, which do not enter E."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

# Chosen.
GLITCH_M_S = 5.0  # beyond the velocity around: fast strings move, they do not jump
AROUND = 5  # intervals from one frame to the next; their median is the velocity around


def jumps(time_s: np.ndarray, points_m: np.ndarray, fastest_m_s: float = GLITCH_M_S) -> np.ndarray:
    """Return where markers (F, m, 3) [m] at times (F,) [s] jump from one frame to the next: (F - 1, m).

    There their velocity differs by more than `fastest_m_s` from that of the intervals around.
    """
    velocity = np.diff(points_m, axis=0) / np.diff(time_s)[:, None, None]
    side = AROUND // 2
    around = np.pad(velocity, ((side, side), (0, 0), (0, 0)), constant_values=np.nan)
    known = ~np.isnan(velocity[..., 0])
    usual = np.nanmedian(sliding_window_view(around, AROUND, axis=0)[known], axis=-1)
    found = np.zeros(known.shape, dtype=bool)
    found[known] = np.linalg.norm(velocity[known] - usual, axis=-1) > fastest_m_s
    return found
