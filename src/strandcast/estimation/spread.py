"""The ensemble: near-optimal strings that differ as much as they can."""

from __future__ import annotations

import numpy as np

from strandcast.estimation.evaluation import Array

WORSE = 1.1  # of the best E, still near-optimal
FLOOR_M = 2e-4  # differences in E below this mean nothing


def near_samples(
    best: Array, value: float, curvature: Array, count: int, rng: np.random.Generator, width: float = 0.3
) -> Array:
    """Candidates (count, d) around `best` within its valley, wide where E does not care.

    Drawn from a normal law whose typical member is `WORSE` times as bad, by the curvature of E, and no wider
    than `width` in exponents.
    """
    root = valley_root(value, curvature, width)
    return np.asarray(np.clip(best + rng.standard_normal((count, len(best))) @ root.T, 0.0, 1.0))


def valley_root(value: float, curvature: Array, width: float = 0.3) -> Array:
    """Root (d, d) of the covariance of `near_samples`."""
    d = len(curvature)
    allowed = max((WORSE - 1.0) * value, FLOOR_M)
    precision = curvature * d / (2.0 * allowed) + np.eye(d) / width**2
    values, vectors = np.linalg.eigh(0.5 * (precision + precision.T))
    return np.asarray(vectors / np.sqrt(np.maximum(values, 1.0 / width**2)))


def distant_members(chi: Array, values: Array, count: int) -> Array:
    """Choose `count` near-optimal candidates, the best first, each the farthest from those before it.

    Where fewer than `count` are near-optimal, the next best ones fill up.
    """
    order = np.argsort(values, kind="stable")
    order = order[np.isfinite(values[order])]
    best = values[order[0]]
    near = order[values[order] <= max(WORSE * best, best + FLOOR_M)]
    pool = near if len(near) >= count else order[:count]
    chosen = [int(pool[0])]
    reach = np.linalg.norm(chi[pool] - chi[chosen[0]], axis=1)
    while len(chosen) < min(count, len(pool)):
        k = int(np.argmax(reach))
        chosen.append(int(pool[k]))
        reach = np.minimum(reach, np.linalg.norm(chi[pool] - chi[pool[k]], axis=1))
        reach[k] = -1.0
    return np.array(chosen)
