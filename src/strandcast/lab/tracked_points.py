"""The lab's throws as a tracker measures them: points of the string with its noise, without video."""

from dataclasses import dataclass

import numpy as np

from strandcast.lab.swing import LabSwing


@dataclass(frozen=True)
class TrackerNoise:
    """Errors of tracked points (standard deviation per coordinate) and of the clocks.

    Attributes
    ----------
    white_m, slow_m, slow_s
        White noise, and noise with a correlation time of `slow_s`.
    lost
        Share of lost frames, in runs of `lost_run`.
    offset_s
        Offset of the camera's clock from the robot's.
    """

    white_m: float = 2e-4
    slow_m: float = 5e-4
    slow_s: float = 0.008
    lost: float = 0.006
    lost_run: int = 4
    offset_s: float = 7e-5


def points_at(swing: LabSwing, places_m: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Return positions (F, n+1, 2) of the points at `places_m` (n+1,) along the string, the last the tip."""
    nodes = swing.nodes_m
    k = np.clip(np.searchsorted(swing.time_s, time_s, side="right") - 1, 0, len(swing.time_s) - 2)
    share = ((time_s - swing.time_s[k]) / (swing.time_s[k + 1] - swing.time_s[k]))[:, None, None]
    at = (1.0 - share) * nodes[k] + share * nodes[k + 1]
    along = np.append(places_m[:-1], swing.places_m[-1])
    i = np.clip(np.searchsorted(swing.places_m, along, side="right") - 1, 0, len(swing.places_m) - 2)
    part = ((along - swing.places_m[i]) / (swing.places_m[i + 1] - swing.places_m[i]))[:, None]
    return np.asarray((1.0 - part) * at[:, i] + part * at[:, i + 1])


def with_tracker_noise(
    points_m: np.ndarray, step_s: float, noise: TrackerNoise, rng: np.random.Generator
) -> np.ndarray:
    """Return points (F, n+1, 2) as from a tracker: with noise, and NaN in lost frames."""
    keep = float(np.exp(-step_s / noise.slow_s))
    fresh = rng.standard_normal(points_m.shape)
    slow = np.empty_like(fresh)
    slow[0] = fresh[0]
    for f in range(1, len(fresh)):
        slow[f] = keep * slow[f - 1] + np.sqrt(1.0 - keep**2) * fresh[f]
    found = points_m + noise.slow_m * slow + noise.white_m * rng.standard_normal(points_m.shape)
    for start in np.flatnonzero(rng.random(len(found)) < noise.lost / noise.lost_run):
        found[start : start + noise.lost_run] = np.nan
    return np.asarray(found)
