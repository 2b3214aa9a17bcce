"""The string's silhouette as a graph: the branches of its skeleton and the crossings where they meet."""

import heapq
from dataclasses import dataclass, field

import cv2
import numpy as np
from scipy.sparse.csgraph import connected_components, depth_first_order
from skimage.graph import pixel_graph
from skimage.morphology import skeletonize

# A dead end shorter than the sum of both is an artefact of thinning; chosen on the mBEST pictures.
SPUR_HALF_WIDTHS, SPUR_PX = 1.5, 1.0
NORMAL = 1.12  # times the string's half width: anything wider is more than one strand; chosen

End = tuple[int, int]  # branch, and which of its ends: 0 or 1
FREE = -1


@dataclass(eq=False)
class Branch:
    """A stretch of skeleton between two nodes."""

    points: np.ndarray  # (K, 2) x, y px in order
    half_width: np.ndarray  # (K,) px, distance to the silhouette's edge
    nodes: list[int]  # at the first and at the last point, or FREE

    @property
    def length_px(self) -> float:
        """Length along the skeleton."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())


@dataclass(eq=False)
class Graph:
    """Branches by number; nodes by number: place (2,) px and half width there; the string's half width."""

    branches: dict[int, Branch]
    nodes: dict[int, tuple[np.ndarray, float]]
    half_width: float

    def ends_at(self, node: int) -> list[End]:
        """Return the branch ends that meet in a node, or those at no node (FREE)."""
        return [(b, e) for b, branch in self.branches.items() for e in (0, 1) if branch.nodes[e] == node]

    def from_end(self, end: End) -> tuple[np.ndarray, np.ndarray]:
        """Return a branch's points and half widths, read from one of its ends."""
        branch = self.branches[end[0]]
        step = 1 if end[1] == 0 else -1
        return branch.points[::step], branch.half_width[::step]


@dataclass(eq=False)
class Junction:
    """Nodes that form one crossing, the branches that bridge them, and the other branch ends there."""

    nodes: list[int]
    bridges: list[int] = field(default_factory=list)
    ends: list[End] = field(default_factory=list)


def skeleton_graph(mask: np.ndarray) -> Graph:
    """Return the graph of a silhouette (height, width) bool, without the spurs that thinning leaves.

    A node is a cluster of skeleton pixels with three or more neighbours.
    """
    left, top, width, height = cv2.boundingRect(mask.astype(np.uint8))
    part = np.pad(mask[top : top + height, left : left + width], 1)
    distance = cv2.distanceTransform(part.astype(np.uint8), cv2.DIST_L2, 5)
    thin = skeletonize(part)
    around = cv2.filter2D(thin.astype(np.uint8), cv2.CV_8U, np.ones((3, 3)), borderType=cv2.BORDER_CONSTANT)
    branching = thin & (around > 3)
    count, labels = cv2.connectedComponents(branching.astype(np.uint8), connectivity=8)
    half_width = float(np.median(distance[thin]))
    shift = np.array([left - 1.0, top - 1.0])
    graph = Graph({}, {}, half_width)
    for b, pixels in enumerate(_ordered_branches(thin & (labels == 0))):
        first = _node_beside(labels, pixels[0])
        # A branch of one pixel lies between two nodes.
        last = _node_beside(labels, pixels[-1], first if len(pixels) == 1 else 0)
        graph.branches[b] = Branch(
            pixels[:, ::-1] + shift,
            distance[tuple(pixels.T)].astype(float),
            [first - 1, last - 1],  # label 0 is no node: FREE
        )
    places = np.column_stack(np.unravel_index(np.flatnonzero(branching), branching.shape))
    which = labels[tuple(places.T)]
    for k in range(1, count):
        cluster = places[which == k]
        graph.nodes[k - 1] = (cluster.mean(axis=0)[::-1] + shift, float(distance[tuple(cluster.T)].max()))
    _prune(graph)
    return graph


def _prune(graph: Graph) -> None:
    """Remove spurs, shortest first, and join the two branches at a node that has no third."""
    limit = SPUR_HALF_WIDTHS * graph.half_width + SPUR_PX
    while True:
        _dissolve(graph)
        spurs = {
            b: branch.length_px
            for b, branch in graph.branches.items()
            if sorted(k == FREE for k in branch.nodes) == [False, True]
        }
        b = min(spurs, key=lambda k: spurs[k], default=None)
        if b is None or spurs[b] > limit:
            return
        del graph.branches[b]


def _dissolve(graph: Graph) -> None:
    """Remove loops shorter than the string's own circumference, and nodes with two ends or fewer."""
    for b in list(graph.branches):
        i, j = graph.branches[b].nodes
        if i == j != FREE and graph.branches[b].length_px < 2.0 * np.pi * graph.half_width:
            del graph.branches[b]
    for node in list(graph.nodes):
        ends = graph.ends_at(node)
        if len(ends) > 2:
            continue
        place, width = graph.nodes.pop(node)
        for b, e in ends:
            graph.branches[b].nodes[e] = FREE
        if len(ends) == 2 and ends[0][0] != ends[1][0]:
            (first, e), (second, f) = ends
            near, near_width = graph.from_end((first, 1 - e))
            far, far_width = graph.from_end((second, f))
            nodes = [graph.branches[first].nodes[1 - e], graph.branches[second].nodes[1 - f]]
            del graph.branches[second]
            graph.branches[first] = Branch(
                np.vstack([near, place[None], far]), np.concatenate([near_width, [width], far_width]), nodes
            )


def _ordered_branches(plain: np.ndarray) -> list[np.ndarray]:
    """Return the pixels of every branch from end to end, (K, 2) rows and columns.

    Without the nodes no pixel has more than two neighbours: every connected part is a path or a ring.
    """
    network, pixels = pixel_graph(plain, connectivity=2)
    degree = np.diff(network.indptr)
    _, part = connected_components(network)
    _, any_pixel = np.unique(part, return_index=True)
    traced: set[int] = set()
    branches = []
    for start in [*np.flatnonzero(degree < 2), *any_pixel]:  # the paths from an end; the rest are rings
        if part[start] not in traced:
            traced.add(part[start])
            order = depth_first_order(network, start, directed=False, return_predecessors=False)
            branches.append(np.column_stack(np.unravel_index(pixels[order], plain.shape)))
    return branches


def _node_beside(labels: np.ndarray, pixel: np.ndarray, other_than: int = 0) -> int:
    """Return the label of a node beside a pixel, another than `other_than` where there is one; 0 for none."""
    row, column = pixel
    near = [int(label) for label in labels[row - 1 : row + 2, column - 1 : column + 2].flat if label > 0]
    return next((label for label in near if label != other_than), other_than if near else 0)


def junctions(graph: Graph, unmatched: int) -> list[Junction]:
    """Group nodes into crossings.

    Two strands that cross at an acute angle thin to two nodes of three branches with a shared bridge between
    them. Nodes whose discs overlap belong together; groups that still have an odd number of ends are joined
    pairwise, along the branches that best fit as the stems of their Ys.

    Parameters
    ----------
    graph
        Of the string.
    unmatched
        Crossings that may keep an odd number of ends: string ends that lie on the string itself.
    """
    groups = {node: Junction([node]) for node in graph.nodes}
    of = {node: node for node in graph.nodes}
    for b, branch in sorted(graph.branches.items(), key=lambda item: item[1].length_px):
        i, j = branch.nodes
        if FREE not in (i, j) and branch.length_px < graph.nodes[i][1] + graph.nodes[j][1] and of[i] != of[j]:
            _merge(groups, of, of[i], of[j], b)
    _list_ends(graph, groups)
    for b in _bridges(graph, groups, of, unmatched):
        i, j = (of[k] for k in graph.branches[b].nodes)
        if i != j:
            _merge(groups, of, i, j, b)
    _list_ends(graph, groups)
    return list(groups.values())


def _merge(groups: dict[int, Junction], of: dict[int, int], i: int, j: int, bridge: int) -> None:
    """Merge two junctions."""
    gone = groups.pop(j)
    groups[i].nodes += gone.nodes
    groups[i].bridges += [*gone.bridges, bridge]
    for node in gone.nodes:
        of[node] = i


def _list_ends(graph: Graph, groups: dict[int, Junction]) -> None:
    """List the branch ends at each junction, without those of bridges."""
    inner = {b for group in groups.values() for b in group.bridges}
    for group in groups.values():
        group.ends = [end for node in group.nodes for end in graph.ends_at(node) if end[0] not in inner]


def _bridges(graph: Graph, groups: dict[int, Junction], of: dict[int, int], unmatched: int) -> list[int]:
    """Return the branches that join the odd junctions pairwise at the lowest total cost.

    A bridge may run through an even junction, where a third strand crosses two merged ones.
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
    graph: Graph, groups: dict[int, Junction], of: dict[int, int], start: int
) -> dict[int, tuple[float, list[int]]]:
    """Return the cost and the branches of the cheapest route to every junction that can be reached."""
    reached: dict[int, tuple[float, list[int]]] = {}
    heap: list[tuple[float, int, list[int]]] = [(0.0, start, [])]
    while heap:
        cost, here, path = heapq.heappop(heap)
        if here in reached:
            continue
        reached[here] = (cost, path)
        for b, e in groups[here].ends:
            other = graph.branches[b].nodes[1 - e]
            if other != FREE and of[other] not in reached:
                there = of[other]
                step = _stem_cost(graph, groups[here], (b, e)) + _stem_cost(graph, groups[there], (b, 1 - e))
                heapq.heappush(heap, (cost + step, there, [*path, b]))
    return reached


def _stem_cost(graph: Graph, group: Junction, stem: End) -> float:
    """Return the cost of a branch as the stem of a junction's Y: squared turns into its two arms [rad²]."""
    others = [end for end in group.ends if end != stem]
    if len(others) != 2:
        return 1.0
    along = -direction(graph, stem)
    turns = [np.arccos(np.clip(along @ direction(graph, end), -1.0, 1.0)) for end in others]
    return float(turns[0] ** 2 + turns[1] ** 2)


def direction(graph: Graph, end: End) -> np.ndarray:
    """Return the unit direction (2,) in which a branch leaves its node, over about two string widths."""
    points, _ = graph.from_end(end)
    far = min(len(points) - 1, int(4.0 * graph.half_width))
    node = graph.branches[end[0]].nodes[end[1]]
    leaving = points[far] - (graph.nodes[node][0] if node != FREE else points[0])
    return np.asarray(leaving / max(float(np.linalg.norm(leaving)), 1e-9))
