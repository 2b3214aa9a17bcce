"""The string's silhouette as a graph: branches of its skeleton, and the crossings where they meet."""

from __future__ import annotations

import heapq
from dataclasses import dataclass, field

import cv2
import numpy as np
from numba import njit
from skimage.morphology import skeletonize

SPUR_HALF_WIDTHS, SPUR_PX = 1.5, 1.0  # a dead end shorter than both together is an artefact of thinning
NORMAL = 1.12  # times the string's half width: wider is more than one strand

End = tuple[int, int]  # branch, and which of its ends: 0 or 1
FREE = -1


@dataclass(eq=False)
class Branch:
    """A stretch of skeleton between two knots.

    Attributes
    ----------
    points
        (K, 2) x, y px in order.
    half_width
        (K,) px, distance to the silhouette's edge.
    knots
        Knot at the first and at the last point, or FREE.
    """

    points: np.ndarray
    half_width: np.ndarray
    knots: list[int]

    @property
    def length_px(self) -> float:
        """Length along the skeleton."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())


@dataclass(eq=False)
class Graph:
    """Branches by number; knots by number: place (2,) px and half width there; the string's half width."""

    branches: dict[int, Branch]
    knots: dict[int, tuple[np.ndarray, float]]
    half_width: float

    def ends_at(self, knot: int) -> list[End]:
        """Return the branch ends that meet in a knot."""
        return [(b, e) for b, branch in self.branches.items() for e in (0, 1) if branch.knots[e] == knot]

    def free_ends(self) -> list[End]:
        """Return the ends that no knot holds."""
        return self.ends_at(FREE)

    def from_end(self, end: End) -> tuple[np.ndarray, np.ndarray]:
        """Return a branch's points and half widths, read from one of its ends."""
        branch = self.branches[end[0]]
        step = 1 if end[1] == 0 else -1
        return branch.points[::step], branch.half_width[::step]


@dataclass(eq=False)
class Meeting:
    """Knots that are one crossing, the bridges of merged skeleton between them, the ends that meet there."""

    knots: list[int]
    bridges: list[int] = field(default_factory=list)
    ends: list[End] = field(default_factory=list)


def skeleton_graph(mask: np.ndarray) -> Graph:
    """Thin a silhouette (height, width) bool to its graph, without the spurs of thinning.

    A knot is a cluster of skeleton pixels with three or more neighbours.
    """
    left, top, width, height = cv2.boundingRect(mask.astype(np.uint8))
    part = np.pad(mask[top : top + height, left : left + width], 1)
    distance = cv2.distanceTransform(part.astype(np.uint8), cv2.DIST_L2, 5)
    thin = skeletonize(part)
    around = cv2.filter2D(thin.astype(np.uint8), cv2.CV_8U, np.ones((3, 3)), borderType=cv2.BORDER_CONSTANT)
    knotted = thin & (around > 3)
    count, labels = cv2.connectedComponents(knotted.astype(np.uint8), connectivity=8)
    points, starts, ends = _trace(thin, labels)
    half_width = float(np.median(distance[thin]))
    shift = np.array([left - 1.0, top - 1.0])
    graph = Graph({}, {}, half_width)
    for b in range(len(starts) - 1):
        pixels = points[starts[b] : starts[b + 1]]
        knots = [int(k) - 1 for k in ends[b]]  # label 0 is no knot: FREE
        graph.branches[b] = Branch(
            pixels[:, ::-1] + shift, distance[pixels[:, 0], pixels[:, 1]].astype(float), knots
        )
    places = np.column_stack(np.unravel_index(np.flatnonzero(knotted), knotted.shape))
    which = labels[tuple(places.T)]
    for k in range(1, count):
        cluster = places[which == k]
        graph.knots[k - 1] = (cluster.mean(axis=0)[::-1] + shift, float(distance[tuple(cluster.T)].max()))
    _prune(graph)
    return graph


def _prune(graph: Graph) -> None:
    """Take spurs away, shortest first, and join the branches that a knot of two no longer divides."""
    limit = SPUR_HALF_WIDTHS * graph.half_width + SPUR_PX
    while True:
        _dissolve(graph)
        spurs = {
            b: branch.length_px
            for b, branch in graph.branches.items()
            if sorted(k == FREE for k in branch.knots) == [False, True]
        }
        b = min(spurs, key=lambda k: spurs[k], default=None)
        if b is None or spurs[b] > limit:
            return
        del graph.branches[b]


def _dissolve(graph: Graph) -> None:
    """Take out loops that a string cannot make, shorter than its own circumference, and knots of two ends."""
    for b in list(graph.branches):
        i, j = graph.branches[b].knots
        if i == j != FREE and graph.branches[b].length_px < 2.0 * np.pi * graph.half_width:
            del graph.branches[b]
    for knot in list(graph.knots):
        ends = graph.ends_at(knot)
        if len(ends) > 2:
            continue
        place, width = graph.knots.pop(knot)
        for b, e in ends:
            graph.branches[b].knots[e] = FREE
        if len(ends) == 2 and ends[0][0] != ends[1][0]:
            (first, e), (second, f) = ends
            near, near_width = graph.from_end((first, 1 - e))
            far, far_width = graph.from_end((second, f))
            knots = [graph.branches[first].knots[1 - e], graph.branches[second].knots[1 - f]]
            del graph.branches[second]
            graph.branches[first] = Branch(
                np.vstack([near, place[None], far]), np.concatenate([near_width, [width], far_width]), knots
            )


@njit(cache=True)
def _trace(thin: np.ndarray, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Walk all branches of a skeleton.

    Parameters
    ----------
    thin
        (height, width) bool, with an empty frame.
    labels
        (height, width) numbers of the knots that pixels belong to, 0 for none.

    Returns
    -------
    points : ndarray (K, 2)
        Rows and columns, branch after branch.
    starts : ndarray (B + 1,)
        Where each branch starts in `points`.
    ends : ndarray (B, 2)
        Labels of the knots at its first and last point, 0 for none.
    """
    height, width = thin.shape
    points = np.empty((int(thin.sum()), 2), np.int64)
    seen = labels > 0
    starts = [0]
    ends = [(0, 0)]
    filled = 0
    for turn in range(2):  # first from the ends; what is left is closed
        for i in range(1, height - 1):
            for j in range(1, width - 1):
                if not thin[i, j] or seen[i, j]:
                    continue
                if turn == 0 and _plain_neighbours(thin, labels, i, j) > 1:
                    continue
                begun = filled
                r, c = i, j
                while r >= 0:
                    seen[r, c] = True
                    points[filled, 0], points[filled, 1] = r, c
                    filled += 1
                    r, c = _next(thin, seen, r, c)
                first = _label_beside(labels, points[begun], 0)
                # A branch of one pixel lies between two knots.
                other = first if filled - begun == 1 else 0
                last = _label_beside(labels, points[filled - 1], other)
                starts.append(filled)
                ends.append((first, last))
    return points[:filled], np.array(starts), np.array(ends)[1:]


@njit(cache=True)
def _plain_neighbours(thin: np.ndarray, labels: np.ndarray, i: int, j: int) -> int:
    """Count the neighbours on the skeleton that are in no knot."""
    count = 0
    for r in range(i - 1, i + 2):
        for c in range(j - 1, j + 2):
            if (r != i or c != j) and thin[r, c] and labels[r, c] == 0:
                count += 1
    return count


@njit(cache=True)
def _next(thin: np.ndarray, seen: np.ndarray, i: int, j: int) -> tuple[int, int]:
    """Return a neighbour not seen yet, straight ones first, or (-1, -1)."""
    for straight in (1, 2):
        for r in range(i - 1, i + 2):
            for c in range(j - 1, j + 2):
                if abs(r - i) + abs(c - j) == straight and thin[r, c] and not seen[r, c]:
                    return r, c
    return -1, -1


@njit(cache=True)
def _label_beside(labels: np.ndarray, point: np.ndarray, but: int) -> int:
    """Return the label of a knot beside a pixel, another than `but` where there is one."""
    found = 0
    for r in range(point[0] - 1, point[0] + 2):
        for c in range(point[1] - 1, point[1] + 2):
            if labels[r, c] > 0 and (found == 0 or found == but):
                found = labels[r, c]
    return found


def meetings(graph: Graph, unmatched: int) -> list[Meeting]:
    """Gather knots to crossings.

    Two strands that cross at an angle thin to two knots of three with a bridge between them, which both run
    through. Knots whose discs overlap belong together; what then still has an odd number of ends is joined
    pairwise, along the branches that are best the stems of their Ys.

    Parameters
    ----------
    graph
        Of the string.
    unmatched
        Crossings that may keep an odd number of ends: as many ends of the string as lie on the string itself.
    """
    groups = {knot: Meeting([knot]) for knot in graph.knots}
    of = {knot: knot for knot in graph.knots}
    for b, branch in sorted(graph.branches.items(), key=lambda item: item[1].length_px):
        i, j = branch.knots
        if FREE not in (i, j) and branch.length_px < graph.knots[i][1] + graph.knots[j][1] and of[i] != of[j]:
            _merge(groups, of, of[i], of[j], b)
    _fill(graph, groups)
    for b in _bridges(graph, groups, of, unmatched):
        i, j = (of[k] for k in graph.branches[b].knots)
        if i != j:
            _merge(groups, of, i, j, b)
    _fill(graph, groups)
    return list(groups.values())


def _merge(groups: dict[int, Meeting], of: dict[int, int], i: int, j: int, bridge: int) -> None:
    """Make one meeting of two."""
    gone = groups.pop(j)
    groups[i].knots += gone.knots
    groups[i].bridges += [*gone.bridges, bridge]
    for knot in gone.knots:
        of[knot] = i


def _fill(graph: Graph, groups: dict[int, Meeting]) -> None:
    """List the ends that meet, without those of bridges."""
    inner = {b for group in groups.values() for b in group.bridges}
    for group in groups.values():
        group.ends = [end for knot in group.knots for end in graph.ends_at(knot) if end[0] not in inner]


def _bridges(graph: Graph, groups: dict[int, Meeting], of: dict[int, int], unmatched: int) -> list[int]:
    """Return the branches that join the odd meetings pairwise at the least total cost.

    A bridge may lead through a meeting that is even, where a third strand crosses two merged ones.
    """
    odd = [k for k, group in groups.items() if len(group.ends) % 2]
    routes = sorted(
        (cost, sorted({i, j}), path)
        for i in odd
        for j, (cost, path) in _cheapest_routes(graph, groups, of, i).items()
        if j in odd and j > i
    )
    best: tuple[int, float, list[int]] = (len(odd), 0.0, [])

    def search(left: frozenset[int], used: list[int], cost: float, first: int) -> None:
        nonlocal best
        best = min(best, (max(len(left), unmatched), cost, used))
        if len(left) <= unmatched:
            return
        for k in range(first, len(routes)):
            price, pair, path = routes[k]
            if best[0] <= unmatched and cost + price * (len(left) - unmatched) / 2.0 >= best[1]:
                return
            if left.issuperset(pair):
                search(left.difference(pair), used + path, cost + price, k + 1)

    search(frozenset(odd), [], 0.0, 0)
    return best[2]


def _cheapest_routes(
    graph: Graph, groups: dict[int, Meeting], of: dict[int, int], start: int
) -> dict[int, tuple[float, list[int]]]:
    """Return for every meeting that can be reached the cost of the cheapest route and its branches."""
    reached: dict[int, tuple[float, list[int]]] = {}
    heap: list[tuple[float, int, list[int]]] = [(0.0, start, [])]
    while heap:
        cost, here, path = heapq.heappop(heap)
        if here in reached:
            continue
        reached[here] = (cost, path)
        for b, e in groups[here].ends:
            other = graph.branches[b].knots[1 - e]
            if other != FREE and of[other] not in reached:
                there = of[other]
                step = _stem_cost(graph, groups[here], (b, e)) + _stem_cost(graph, groups[there], (b, 1 - e))
                heapq.heappush(heap, (cost + step, there, [*path, b]))
    return reached


def _stem_cost(graph: Graph, group: Meeting, stem: End) -> float:
    """Return how little a branch is the stem of a meeting's Y: squared turns into its two arms (rad²)."""
    others = [end for end in group.ends if end != stem]
    if len(others) != 2:
        return 1.0
    along = -direction(graph, stem)
    turns = [np.arccos(np.clip(along @ direction(graph, end), -1.0, 1.0)) for end in others]
    return float(turns[0] ** 2 + turns[1] ** 2)


def direction(graph: Graph, end: End) -> np.ndarray:
    """Return the unit direction (2,) in which a branch leaves its knot, over about two widths."""
    points, _ = graph.from_end(end)
    far = min(len(points) - 1, int(4.0 * graph.half_width))
    knot = graph.branches[end[0]].knots[end[1]]
    leaving = points[far] - (graph.knots[knot][0] if knot != FREE else points[0])
    return np.asarray(leaving / max(float(np.linalg.norm(leaving)), 1e-9))
