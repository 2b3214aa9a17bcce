"""The ensemble: near-optimal strings that differ as much as they can."""

import numpy as np

from strandcast.estimation.evaluation import Array

# Chosen.
WORSE = 1.1  # times the best E is still near-optimal
FLOOR_M = 2e-4  # differences in E below this are meaningless
MEMBERS = 6  # near-best strings that are kept for the planner
WIDTH = 0.3  # largest standard deviation of an exponent


def near_samples(best: Array, value: float, curvature: Array, count: int, rng: np.random.Generator) -> Array:
    """Return candidates (count, d) around `best`, far away in directions to which E is insensitive.

    Drawn from a normal distribution. By the curvature of E, a typical member is `WORSE` times as bad as the
    best; no standard deviation is above `WIDTH`.
    """
    d = len(curvature)
    allowed = max((WORSE - 1.0) * value, FLOOR_M)
    # Next to a string that cannot be simulated there is no derivative.
    precision = np.nan_to_num(curvature) * d / (2.0 * allowed) + np.eye(d) / WIDTH**2
    values, vectors = np.linalg.eigh(0.5 * (precision + precision.T))
    root = np.asarray(vectors / np.sqrt(np.maximum(values, 1.0 / WIDTH**2)))
    return np.asarray(np.clip(best + rng.standard_normal((count, len(best))) @ root.T, 0.0, 1.0))


def distant_members(chi: Array, values: Array, count: int = MEMBERS) -> Array:
    """Choose `count` near-optimal candidates, the best first, each the farthest from those before it.

    If fewer than `count` are near-optimal, the next best ones are added.
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
