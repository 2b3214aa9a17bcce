"""Peers that trace a skeleton: the longest path from the hand, and least bending at crossings.

Both are our own implementations: the first is the baseline of many papers, the second the ordering idea of
mBEST (minimal bending energy at the skeleton's crossings), not its authors' code. Neither uses time or the
string's length.
"""

from itertools import combinations

import cv2
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from skimage.morphology import skeletonize

# All chosen on the tuning videos.
JUNCTION_PX = 3  # radius around a junction's pixels
SPUR_PX = 6  # shorter branches with a free end are artefacts of thinning
HEADING_PX = 10  # length of a branch that gives its direction
REACH_PX = 60.0  # largest distance of the string's first visible pixel from the hand
SMOOTH_PX = 2.0


class NoPathError(Exception):
    """No path can be traced."""


def skeleton_pixels(mask: np.ndarray) -> np.ndarray:
    """Return the pixels (K, 2) u, v of a mask's skeleton.

    Raises
    ------
    NoPathError
        The mask is almost empty.
    """
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if len(rows) < 2 or len(columns) < 2:
        raise NoPathError
    top, left = rows[0], columns[0]
    thin = skeletonize(mask[top : rows[-1] + 1, left : columns[-1] + 1])
    v, u = np.nonzero(thin)
    if len(u) < HEADING_PX:
        raise NoPathError
    return np.column_stack([u + left, v + top])


def longest_path(mask: np.ndarray, hand_px: np.ndarray) -> np.ndarray:
    """Return the shortest path (K, 2) [px] from the hand to the skeleton's farthest pixel along it."""
    pixels = skeleton_pixels(mask)
    first, second = _neighbours(pixels)
    weights = np.linalg.norm(pixels[first] - pixels[second], axis=1)
    graph = coo_array((weights, (first, second)), shape=(len(pixels), len(pixels))).tocsr()
    start = _start(pixels, hand_px)
    away, before = (
        row[0] for row in dijkstra(graph, directed=False, indices=np.array([start]), return_predecessors=True)
    )
    end = int(np.argmax(np.where(np.isfinite(away), away, -1.0)))
    way = [end]
    while way[-1] != start:
        way.append(int(before[way[-1]]))
    return smooth(np.vstack([hand_px, pixels[way[::-1]]]))


def _neighbours(pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the pairs of touching pixels, each once."""
    index = {(u, v): k for k, (u, v) in enumerate(pixels.tolist())}
    pairs = [
        (k, index[u + du, v + dv])
        for (u, v), k in index.items()
        for du, dv in ((1, 0), (0, 1), (1, 1), (1, -1))
        if (u + du, v + dv) in index
    ]
    first, second = np.array(pairs, int).reshape(-1, 2).T
    return first, second


def _start(pixels: np.ndarray, hand_px: np.ndarray) -> int:
    away = np.linalg.norm(pixels - hand_px, axis=1)
    if away.min() > REACH_PX:
        raise NoPathError
    return int(np.argmin(away))


def smooth(path: np.ndarray) -> np.ndarray:
    """Return a smoothed pixel path (K, 2) with the same ends."""
    weights = cv2.getGaussianKernel(9, SMOOTH_PX).ravel()
    padded = np.pad(path.astype(float), ((4, 4), (0, 0)), mode="reflect", reflect_type="odd")
    return np.column_stack([np.convolve(padded[:, axis], weights, mode="valid") for axis in (0, 1)])


def least_bending_path(mask: np.ndarray, hand_px: np.ndarray) -> np.ndarray:
    """Return the path (K, 2) [px] from the hand that bends least at each crossing.

    The skeleton is cut at its junctions into branches; at each junction the branch ends are paired with the
    least total turn; the path follows the pairs.
    """
    pixels = skeleton_pixels(mask)
    branches, junctions = _branches(pixels)
    if not branches:
        raise NoPathError
    after = _pairs(branches, junctions)
    return smooth(np.vstack([hand_px, _walk(branches, after, hand_px)]))


End = tuple[int, int]  # branch, and which of its ends: 0 or -1
Ends = list[End]
Pair = tuple[End, End]


def _branches(pixels: np.ndarray) -> tuple[list[np.ndarray], list[Ends]]:
    """Return the branches (K, 2) of a skeleton without spurs, and the branch ends at each junction."""
    low = pixels.min(axis=0) - JUNCTION_PX - 1
    shape = (pixels.max(axis=0) - low + JUNCTION_PX + 2)[::-1]
    thin = np.zeros(shape, np.uint8)
    u, v = (pixels - low).T
    thin[v, u] = 1
    around = cv2.filter2D(thin, -1, np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT)
    crossing = ((thin > 0) & (around > 3)).astype(np.uint8)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * JUNCTION_PX + 1,) * 2)
    grown = cv2.dilate(crossing, disc)
    count, label = cv2.connectedComponents(grown)
    touched = cv2.dilate(label.astype(np.uint16), np.ones((3, 3), np.uint8))
    parts, part = cv2.connectedComponents(np.where(grown > 0, 0, thin).astype(np.uint8))
    branches: list[np.ndarray] = []
    junctions: list[Ends] = [[] for _ in range(count)]
    for k in range(1, parts):
        ordered = _ordered(np.column_stack(np.nonzero(part == k))[:, ::-1])
        meets = [int(touched[y, x]) for x, y in (ordered[0], ordered[-1])]
        if len(ordered) < SPUR_PX and 0 in meets:
            continue
        for end, junction in zip((0, -1), meets, strict=True):
            if junction:
                junctions[junction].append((len(branches), end))
        branches.append(ordered + low)
    return branches, junctions


def _ordered(pixels: np.ndarray) -> np.ndarray:
    """Return the pixels (K, 2) of a branch from one end to the other."""
    left = {tuple(p) for p in pixels.tolist()}
    steps = [(du, dv) for du in (-1, 0, 1) for dv in (-1, 0, 1) if du or dv]
    steps.sort(key=lambda step: abs(step[0]) + abs(step[1]))

    def touching(p: tuple[int, ...]) -> list[tuple[int, ...]]:
        return [(p[0] + du, p[1] + dv) for du, dv in steps if (p[0] + du, p[1] + dv) in left]

    at = min(left, key=lambda p: len(touching(p)))
    way = [at]
    left.remove(at)
    while following := touching(at):
        at = following[0]
        left.remove(at)
        way.append(at)
    return np.array(way)


def _outward(branch: np.ndarray, end: int) -> np.ndarray:
    """Return the direction in which a branch leaves a junction by one of its ends."""
    inside = min(HEADING_PX, len(branch) - 1) if end == 0 else max(-HEADING_PX - 1, -len(branch))
    inner = branch[inside]
    way = (inner - branch[end]).astype(float)
    return np.asarray(way / max(np.linalg.norm(way), 1e-9))


def _pairs(branches: list[np.ndarray], junctions: list[Ends]) -> dict[End, End]:
    """Return the pairs of branch ends at each junction with least bending; an odd one stays single."""
    after: dict[End, End] = {}
    for ends in junctions:
        ways = {end: _outward(branches[end[0]], end[1]) for end in ends}
        turn = {(a, b): 1.0 + float(ways[a] @ ways[b]) for a, b in combinations(ends, 2)}
        for first, second in _least(ends, turn):
            after[first], after[second] = second, first
    return after


def _least(ends: Ends, turn: dict[Pair, float]) -> list[Pair]:
    """Return the pairs of least total turn; unless there are four ends, they are paired greedily."""
    if len(ends) == 4:
        a, b, c, d = ends
        ways: list[list[Pair]] = [[(a, b), (c, d)], [(a, c), (b, d)], [(a, d), (b, c)]]
        return min(ways, key=lambda pairs: turn[pairs[0]] + turn[pairs[1]])
    chosen: list[Pair] = []
    for pair in sorted(turn, key=lambda pair: turn[pair]):
        if not any(end in taken for taken in chosen for end in pair):
            chosen.append(pair)
    return chosen


def _walk(branches: list[np.ndarray], after: dict[End, End], hand_px: np.ndarray) -> np.ndarray:
    """Return the path from the end nearest to the hand until it ends or repeats."""
    ends = [(k, end) for k in range(len(branches)) for end in (0, -1)]
    at = min(ends, key=lambda one: np.linalg.norm(branches[one[0]][one[1]] - hand_px) + 1e6 * (one in after))
    if np.linalg.norm(branches[at[0]][at[1]] - hand_px) > REACH_PX:
        raise NoPathError
    way: list[np.ndarray] = []
    visited: set[int] = set()
    while at[0] not in visited:
        visited.add(at[0])
        way.append(branches[at[0]] if at[1] == 0 else branches[at[0]][::-1])
        leaves = (at[0], -1 if at[1] == 0 else 0)
        if leaves not in after:
            break
        at = after[leaves]
    return np.vstack(way)
