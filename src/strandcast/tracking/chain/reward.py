"""How well a chain explains a frame: its mean reward where the string can be visible."""

import numpy as np
from numba import njit

LEAST_OPEN = 0.25  # chosen: share of the chain that the hand must not hide


@njit(cache=True)
def mean_reward(reward: np.ndarray, hidden: np.ndarray, once: np.ndarray) -> tuple[float, float, int]:
    """Return the mean reward of nodes (K,) that can be visible, their share, and how many are doubled."""
    total, count, doubled = 0.0, 0, 0
    for k in range(len(reward)):
        if not hidden[k]:
            total += reward[k] * once[k]
            count += 1
            doubled += once[k] == 0.0
    open_share = count / len(reward)
    value = total / count if open_share > LEAST_OPEN else 0.0
    return value, open_share, doubled


@njit(cache=True)
def counted_once(nodes: np.ndarray, heading: np.ndarray, near_m: float) -> np.ndarray:
    """Return 0 for nodes that lie along an earlier part of the chain, 1 for others (K,).

    Otherwise a chain folded back onto itself would count the same piece of string twice.
    """
    once = np.ones(len(nodes))
    for k in range(6, len(nodes)):
        for j in range(1, k - 4):
            close = (nodes[k, 0] - nodes[j, 0]) ** 2 + (nodes[k, 1] - nodes[j, 1]) ** 2 < near_m * near_m
            if close and abs(np.sin(heading[k - 1] - heading[j - 1])) < 0.4:
                once[k] = 0.0
                break
    return once
