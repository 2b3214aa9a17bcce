"""A peer that registers a chain to the mask's pixels: coherent point drift with geodesic coherence.

Our own implementation of published methods (coherent point drift; its use for strings with a motion-coherence
kernel over distances along the string, as in TrackDLO). Its accuracy may differ from that of the authors'
code. It is given the string's length and the exact hand.
"""

import numpy as np

# All chosen on the tuning videos.
NODES = 40
PIXELS = 400  # sample of the mask's pixels
ROUNDS = 30
COHERENCE_SHARE = 0.25  # length scale of coherent motion, as a share of the string's length
STIFFNESS = 1.0  # weight of the coherence (lambda)
OUTLIERS = 0.05
FIRST_SIGMA_PX, LEAST_SIGMA_PX = 12.0, 0.8
ANCHOR = 1e3  # weight of the hand; a pixel has 1


class PointDrift:
    """A chain that is tracked from frame to frame."""

    def __init__(self, line_px: np.ndarray, length_px: float) -> None:
        self.link_px = length_px / (NODES - 1)
        self.nodes = _resampled(line_px, NODES, self.link_px)
        along = np.arange(NODES) / (NODES - 1)
        self.kernel = np.exp(-((along[:, None] - along) ** 2) / (2.0 * COHERENCE_SHARE**2))
        self.random = np.random.default_rng(0)

    def step(self, mask: np.ndarray, hand_px: np.ndarray) -> np.ndarray:
        """Track the chain to the next frame's mask (H, W); return it, (NODES, 2) [px]."""
        v, u = np.nonzero(mask)
        pixels = np.column_stack([u, v]).astype(float)
        if len(pixels) > PIXELS:
            pixels = pixels[self.random.choice(len(pixels), PIXELS, replace=False)]
        before = self.nodes + (hand_px - self.nodes[0])
        moved = _registered(before, pixels, hand_px, self.kernel) if len(pixels) > NODES else before
        self.nodes = _inextensible(moved, hand_px, self.link_px)
        return self.nodes


def _registered(
    before: np.ndarray, pixels: np.ndarray, hand_px: np.ndarray, kernel: np.ndarray
) -> np.ndarray:
    nodes, power = before.copy(), FIRST_SIGMA_PX**2
    area = np.ptp(pixels, axis=0).prod() + 1.0
    for _ in range(ROUNDS):
        square = ((pixels[None] - nodes[:, None]) ** 2).sum(axis=2)
        near = np.exp(-square / (2.0 * power))
        stray = 2.0 * np.pi * power * OUTLIERS / (1.0 - OUTLIERS) * NODES / area
        share = near / (near.sum(axis=0) + stray)
        weight = share.sum(axis=1)
        pull = share @ pixels - weight[:, None] * before
        weight[0] += ANCHOR
        pull[0] += ANCHOR * (hand_px - before[0])
        moves = np.linalg.solve(weight[:, None] * kernel + STIFFNESS * power * np.eye(NODES), pull)
        nodes = before + kernel @ moves
        power = max(float((share * square).sum() / max(share.sum(), 1e-9) / 2.0), LEAST_SIGMA_PX**2)
    return nodes


def _inextensible(nodes: np.ndarray, hand_px: np.ndarray, link_px: float) -> np.ndarray:
    """Return the chain with every link at its length, starting from the hand."""
    steps = np.diff(nodes, axis=0)
    steps *= link_px / np.maximum(np.linalg.norm(steps, axis=1, keepdims=True), 1e-9)
    return np.vstack([hand_px, hand_px + np.cumsum(steps, axis=0)])


def _resampled(line_px: np.ndarray, count: int, link_px: float) -> np.ndarray:
    """Return `count` places along a line, `link_px` apart; a line that is too short is extended straight."""
    place = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line_px, axis=0), axis=1)))
    wanted = np.arange(count) * link_px
    inside = np.column_stack([np.interp(wanted, place, line_px[:, axis]) for axis in (0, 1)])
    way = line_px[-1] - line_px[max(0, len(line_px) - 11)]
    beyond = np.maximum(wanted - place[-1], 0.0)[:, None]
    return np.asarray(inside + beyond * way / max(np.linalg.norm(way), 1e-9))
