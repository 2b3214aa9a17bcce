"""The order in which a string runs through its crossings: the path of least bending over all branches.

At each crossing the branch ends are paired; the cost of a pairing is the bending beyond the string's typical
curvature. The result is the cheapest combination of pairings that forms one path from end to end using every
branch once. The extra cost of the cheapest path that pairs one crossing differently is the margin of that
crossing. The idea that a string bends least at a crossing is from mBEST (Choi et al., IEEE RA-L 2023).
"""

import heapq
from dataclasses import dataclass

import numpy as np

from strandcast.errors import StrandcastError
from strandcast_studies.stills.graph import FREE, NORMAL, Branch, End, Graph, Junction, junctions

# All chosen on the mBEST pictures and on drawn strings.
HEADING_SIGMA_RAD = 0.08  # standard error of a branch's measured heading
LEAST_CURVATURE = 0.03  # per half width: lower bound of a string's typical curvature
FIT_HALF_WIDTHS = 6.0  # length of branch to which its heading is fitted
LEAST_FIT_PX = 8.0  # the least such length
MOST_STATES = 20000  # of the search

Pairing = tuple[tuple[End, End], ...]


@dataclass(frozen=True, eq=False)
class BranchArm:
    """Where a branch leaves a crossing as a single strand: place (2,) px, unit direction, points cut off."""

    place: np.ndarray
    outward: np.ndarray
    cut: int


@dataclass(frozen=True, eq=False)
class StillOrder:
    """The string's course.

    A margin is how much more the cheapest other path costs: squared bending in units of the string's typical
    one; inf where there is no other.
    """

    course: list[End]  # each branch is entered at the end listed and left at its other one
    junctions: list[Junction]  # the places where strands meet
    pairings: list[Pairing]  # per crossing, the ends that belong together
    margins: list[float]  # per crossing
    arms: dict[End, BranchArm]  # for all ends at crossings


def find_order(graph: Graph) -> StillOrder:
    """Order the branches of a string.

    Raises
    ------
    StrandcastError
        SC-T021 the silhouette does not have the two ends of one string (an end may lie on the string).
    """
    free = graph.ends_at(FREE)
    if len(free) > 2:
        places = ", ".join(f"({p[0]:.0f}, {p[1]:.0f})" for p in (graph.from_end(e)[0][0] for e in free))
        raise _refusal(f"one string has two ends, the silhouette has {len(free)}: {places}")
    if any(_closed(graph, b) for b in graph.branches):
        raise _refusal("one string has two ends, the silhouette is a ring", "closes the ring")
    met = junctions(graph, 2 - len(free))
    arms = {end: arm_of(graph, end) for group in met for end in group.ends}
    curvature = max(usual_curvature(graph), LEAST_CURVATURE / graph.half_width)
    ranked = [_ranked_pairings(group.ends, arms, curvature) for group in met]
    best, margins = _best_path(graph, ranked)
    pairings = [ranked[k][i][1] for k, i in enumerate(best)]
    course = _walk(graph, pairings)
    assert course is not None  # _best_path returns paths only
    return StillOrder(course, met, pairings, margins, arms)


def _refusal(what: str, cause: str = "touches the string") -> StrandcastError:
    return StrandcastError("SC-T021", what, fix=f"leave out what {cause}, or give a mask")


def _closed(graph: Graph, b: int) -> bool:
    """Return whether a branch is a ring: it ends beside its own first point, and at no node."""
    points = graph.branches[b].points
    gap = float(np.linalg.norm(points[-1] - points[0]))
    return graph.branches[b].nodes == [FREE, FREE] and len(points) > 3 and gap < 2.0


def arm_of(graph: Graph, end: End) -> BranchArm:
    """Return the arm of a branch end, cut back to where the silhouette is as wide as one strand."""
    points, half_width = graph.from_end(end)
    usual = min(graph.half_width, float(np.median(half_width)))
    wide = half_width > NORMAL * usual
    single = int(np.argmin(wide)) if not wide.all() else len(points)
    cut = int(min(single + round(graph.half_width), 0.4 * len(points)))
    reach = int(max(FIT_HALF_WIDTHS * graph.half_width, LEAST_FIT_PX))
    stretch = points[cut : min(cut + reach, max(len(points) - cut, cut + 2))]
    if len(stretch) < 3:
        stretch = points
    along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(stretch, axis=0), axis=1))]
    degree = min(2, len(stretch) - 1)
    if degree < 1:
        node = graph.branches[end[0]].nodes[end[1]]
        away = points[0] - graph.nodes[node][0]
        return BranchArm(points[0], away / max(float(np.linalg.norm(away)), 1e-9), 0)
    course = np.polynomial.polynomial.polyfit(along, stretch, degree)
    return BranchArm(course[0], course[1] / max(float(np.linalg.norm(course[1])), 1e-9), cut)


def usual_curvature(graph: Graph) -> float:
    """Return the root mean square curvature of the branches (1/px), over steps of three half widths."""
    step = max(3, round(3.0 * graph.half_width))
    squares = []
    for branch in graph.branches.values():
        knees = branch.points[::step]
        if len(knees) > 2:
            chords = np.diff(knees, axis=0)
            heading = np.arctan2(chords[:, 1], chords[:, 0])
            turns = -np.mod(np.pi - np.diff(heading), 2.0 * np.pi) + np.pi  # to (-pi, pi]
            lengths = np.linalg.norm(chords, axis=1)
            squares.append((turns / (0.5 * (lengths[1:] + lengths[:-1]))) ** 2)
    return float(np.sqrt(np.concatenate(squares).mean())) if squares else 0.0


def link_cost(one: BranchArm, other: BranchArm, curvature: float) -> float:
    """Return the cost of one strand running from one arm to another.

    A thin beam between two places with slopes a and b against the chord of length L has bending energy
    (4/L)(a² + ab + b²); a circular arc that turns by t has t²/L. So 4(a² + ab + b²) is a squared turn, here
    in units of the turn explained by the heading's error and the string's typical curvature over L.
    """
    chord = other.place - one.place
    a = _angle(chord, -one.outward)
    b = _angle(chord, other.outward)
    usual = HEADING_SIGMA_RAD**2 + (curvature * float(np.linalg.norm(chord))) ** 2
    return float(4.0 * (a * a + a * b + b * b) / usual)


def _ranked_pairings(
    ends: list[End], arms: dict[End, BranchArm], curvature: float
) -> list[tuple[float, Pairing]]:
    """Return all ways to pair the ends, cheapest first; with an odd number, one stays single."""
    cost = {(p, q): link_cost(arms[p], arms[q], curvature) for i, p in enumerate(ends) for q in ends[i + 1 :]}
    ways = [(sum(cost[pair] for pair in pairing), pairing) for pairing in _pairings(ends)]
    return sorted(ways, key=lambda way: way[0])


def _pairings(ends: list[End]) -> list[Pairing]:
    """Return all perfect pairings of an even number of ends; for an odd number, those of all but one end."""
    if len(ends) % 2:
        return [way for k in range(len(ends)) for way in _pairings(ends[:k] + ends[k + 1 :])]
    if not ends:
        return [()]
    first, rest = ends[0], ends[1:]
    return [((first, rest[k]), *way) for k in range(len(rest)) for way in _pairings(rest[:k] + rest[k + 1 :])]


def _best_path(graph: Graph, ranked: list[list[tuple[float, Pairing]]]) -> tuple[list[int], list[float]]:
    """Search the combinations of pairings in order of their cost.

    Returns
    -------
    best
        Per crossing, the rank of its pairing in the cheapest combination that forms one path.
    margins
        Per crossing, the extra cost of the cheapest path with another pairing there.
    """
    start = (0,) * len(ranked)
    heap = [(sum(way[0][0] for way in ranked), start)]
    pushed = {start}
    best: tuple[int, ...] | None = None
    least, reached = 0.0, 0.0
    margins: dict[int, float] = {}
    for _ in range(MOST_STATES):
        if not heap or (best is not None and len(margins) == len(ranked)):
            break
        reached, ranks = heapq.heappop(heap)
        if _walk(graph, [ranked[k][i][1] for k, i in enumerate(ranks)]) is not None:
            if best is None:
                best, least = ranks, reached
            for k in range(len(ranked)):
                if ranks[k] != best[k]:
                    margins.setdefault(k, reached - least)
        for further in _next_dearer(ranks, ranked):
            if further not in pushed:
                pushed.add(further)
                heapq.heappush(heap, (sum(ranked[k][i][0] for k, i in enumerate(further)), further))
    if best is None:
        raise _refusal("the silhouette's branches do not form one string with two ends")
    # If the search ended before it found another path, the cost it reached is a lower bound.
    rest = np.inf if not heap else reached - least
    return list(best), [margins.get(k, rest) for k in range(len(ranked))]


def _next_dearer(ranks: tuple[int, ...], ranked: list[list[tuple[float, Pairing]]]) -> list[tuple[int, ...]]:
    """Return the combinations with the next more expensive pairing at one crossing."""
    return [
        (*ranks[:k], ranks[k] + 1, *ranks[k + 1 :])
        for k in range(len(ranks))
        if ranks[k] + 1 < len(ranked[k])
    ]


def _walk(graph: Graph, pairings: list[Pairing]) -> list[End] | None:
    """Return the course from one end of the string to the other; None if it does not use every branch."""
    partner: dict[End, End] = {}
    for pairing in pairings:
        for p, q in pairing:
            partner[p], partner[q] = q, p
    used = [b for b, branch in graph.branches.items() if not _is_bridge(b, branch, partner)]
    ends = [(b, e) for b in used for e in (0, 1) if (b, e) not in partner]
    if len(ends) != 2:
        return None
    course = [ends[0]]
    while (course[-1][0], 1 - course[-1][1]) in partner:
        course.append(partner[course[-1][0], 1 - course[-1][1]])
    return course if len(course) == len(used) else None


def _is_bridge(b: int, branch: Branch, partner: dict[End, End]) -> bool:
    """Return whether a branch is at a node with both ends, and paired at neither."""
    return FREE not in branch.nodes and (b, 0) not in partner and (b, 1) not in partner


def _angle(one: np.ndarray, other: np.ndarray) -> float:
    """Return the signed angle from one direction to another [rad]."""
    return float(np.arctan2(one[0] * other[1] - one[1] * other[0], one @ other))
