"""The order in which a string runs through its crossings: the one path of least bending over all branches.

At each crossing the ends that meet are paired; a pairing costs what the string would have to bend beyond its
usual curvature. Pairings are taken together, as one path from end to end that uses every branch once: the
cheapest such path is the answer. How much dearer the cheapest path is that pairs one crossing differently
tells how sure that crossing is. That a string bends least at a crossing is the idea of mBEST (Choi et al.,
IEEE RA-L 2023).
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.tracking.still_graph import FREE, NORMAL, End, Graph, Meeting, meetings

HEADING_SIGMA_RAD = 0.08  # of a branch's measured heading
LEAST_CURVATURE = 0.03  # per half width: a string is never taken to be straighter
FIT_HALF_WIDTHS = 6.0  # of a branch, to which its heading is fitted
LEAST_FIT_PX = 8.0
MOST_STATES = 20000

Pairing = tuple[tuple[End, End], ...]


@dataclass(frozen=True, eq=False)
class Arm:
    """Where a branch leaves a crossing as one strand: place (2,) px, unit direction outward, points cut."""

    place: np.ndarray
    outward: np.ndarray
    cut: int


@dataclass(frozen=True, eq=False)
class Order:
    """The string's course.

    Attributes
    ----------
    course
        Branch ends in order: each branch is entered at the end listed and left at its other one.
    meetings
        The places where strands meet.
    pairings
        Per meeting, the ends that belong together.
    margins
        Per meeting, by how much the cheapest other path is dearer: squared bending in units of the string's
        usual; inf where there is no other.
    arms
        Of every end that meets others.
    """

    course: list[End]
    meetings: list[Meeting]
    pairings: list[Pairing]
    margins: list[float]
    arms: dict[End, Arm]


def find_order(graph: Graph) -> Order:
    """Order the branches of a string.

    Raises
    ------
    StrandcastError
        SC-T021 the silhouette has not the two ends of one string (an end may lie on the string).
    """
    free = graph.free_ends()
    if len(free) > 2:
        places = ", ".join(f"({p[0]:.0f}, {p[1]:.0f})" for p in (graph.from_end(e)[0][0] for e in free))
        raise StrandcastError(
            "SC-T021", f"one string has two ends, the silhouette has {len(free)}: {places}",
            fix="leave out what touches the string, or give a mask")  # fmt: skip
    if any(_closed(graph, b) for b in graph.branches):
        raise StrandcastError(
            "SC-T021", "one string has two ends, the silhouette is a ring",
            fix="leave out what closes the ring, or give a mask")  # fmt: skip
    met = meetings(graph, 2 - len(free))
    arms = {end: arm_of(graph, end) for group in met for end in group.ends}
    curvature = max(usual_curvature(graph), LEAST_CURVATURE / graph.half_width)
    ranked = [_ranked_pairings(group.ends, arms, curvature) for group in met]
    best, margins = _best_path(graph, ranked)
    pairings = [ranked[k][i][1] for k, i in enumerate(best)]
    course = _walk(graph, pairings)
    assert course is not None  # _best_path returns paths only
    return Order(course, met, pairings, margins, arms)


def _closed(graph: Graph, b: int) -> bool:
    """Whether a branch is a ring: it ends beside its own first point, and at no knot."""
    points = graph.branches[b].points
    gap = float(np.linalg.norm(points[-1] - points[0]))
    return graph.branches[b].knots == [FREE, FREE] and len(points) > 3 and gap < 2.0


def arm_of(graph: Graph, end: End) -> Arm:
    """Return the arm of a branch end: cut back to where the silhouette is as wide as one strand."""
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
        knot = graph.branches[end[0]].knots[end[1]]
        away = points[0] - graph.knots[knot][0]
        return Arm(points[0], away / max(float(np.linalg.norm(away)), 1e-9), 0)
    course = np.polynomial.polynomial.polyfit(along, stretch, degree)
    return Arm(course[0], course[1] / max(float(np.linalg.norm(course[1])), 1e-9), cut)


def usual_curvature(graph: Graph) -> float:
    """Return the root mean square curvature of the branches (1/px), over steps of three half widths."""
    step = max(3, round(3.0 * graph.half_width))
    squares = []
    for branch in graph.branches.values():
        knees = branch.points[::step]
        if len(knees) > 2:
            chords = np.diff(knees, axis=0)
            heading = np.arctan2(chords[:, 1], chords[:, 0])
            turns = _wrap(np.diff(heading))
            lengths = np.linalg.norm(chords, axis=1)
            squares.append((turns / (0.5 * (lengths[1:] + lengths[:-1]))) ** 2)
    return float(np.sqrt(np.concatenate(squares).mean())) if squares else 0.0


def link_cost(one: Arm, other: Arm, curvature: float) -> float:
    """Return how improbable it is that one strand runs from an arm to another.

    A thin beam between two places with slopes a and b against the chord of length L has bending energy
    (4/L)(a² + ab + b²); a circular arc that turns by t gives t²/L. So 4(a² + ab + b²) is a squared turn, here
    in units of what the heading's error and the string's usual curvature over L explain.
    """
    chord = other.place - one.place
    a = _angle(chord, -one.outward)
    b = _angle(chord, other.outward)
    usual = HEADING_SIGMA_RAD**2 + (curvature * float(np.linalg.norm(chord))) ** 2
    return float(4.0 * (a * a + a * b + b * b) / usual)


def _ranked_pairings(ends: list[End], arms: dict[End, Arm], curvature: float) -> list[tuple[float, Pairing]]:
    """Return all ways to pair the ends, cheapest first; of an odd number one stays alone."""
    cost = {(p, q): link_cost(arms[p], arms[q], curvature) for i, p in enumerate(ends) for q in ends[i + 1 :]}
    ways = [(sum(cost[pair] for pair in pairing), pairing) for pairing in _pairings(ends)]
    return sorted(ways, key=lambda way: way[0])


def _pairings(ends: list[End]) -> list[Pairing]:
    """Return all perfect pairings of an even number of ends; of an odd number, those of all but one."""
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
        Per meeting, the rank of its pairing in the cheapest combination that is one path.
    margins
        Per meeting, the cost by which the cheapest path with another pairing there exceeds it.
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
        raise StrandcastError(
            "SC-T021", "the silhouette's branches do not form one string with two ends",
            fix="leave out what touches the string, or give a mask")  # fmt: skip
    # Where the search ended before another path was found, what it reached is a lower bound.
    rest = np.inf if not heap else reached - least
    return list(best), [margins.get(k, rest) for k in range(len(ranked))]


def _next_dearer(ranks: tuple[int, ...], ranked: list[list[tuple[float, Pairing]]]) -> list[tuple[int, ...]]:
    """Return the combinations that take the next dearer pairing at one meeting."""
    return [
        (*ranks[:k], ranks[k] + 1, *ranks[k + 1 :])
        for k in range(len(ranks))
        if ranks[k] + 1 < len(ranked[k])
    ]


def _walk(graph: Graph, pairings: list[Pairing]) -> list[End] | None:
    """Return the course from one end of the string to the other, None if it does not use every branch."""
    partner: dict[End, End] = {}
    for pairing in pairings:
        for p, q in pairing:
            partner[p], partner[q] = q, p
    bridged = _bridged(graph, partner)
    used = [b for b in graph.branches if b not in bridged]
    ends = [(b, e) for b in used for e in (0, 1) if (b, e) not in partner]
    if len(ends) != 2:
        return None
    course = [ends[0]]
    while (course[-1][0], 1 - course[-1][1]) in partner:
        course.append(partner[course[-1][0], 1 - course[-1][1]])
    return course if len(course) == len(used) else None


def _bridged(graph: Graph, partner: dict[End, End]) -> set[int]:
    """Return the branches that are bridges: held by knots at both ends and paired at neither."""
    return {
        b
        for b, branch in graph.branches.items()
        if FREE not in branch.knots and (b, 0) not in partner and (b, 1) not in partner
    }


def _angle(one: np.ndarray, other: np.ndarray) -> float:
    """Signed angle from one direction to another (rad)."""
    return float(np.arctan2(one[0] * other[1] - one[1] * other[0], one @ other))


def _wrap(angle: np.ndarray) -> np.ndarray:
    """Angles in (-pi, pi]."""
    return np.asarray(-np.mod(np.pi - angle, 2.0 * np.pi) + np.pi)
