"""The string in one picture: its ordered centreline, through self-crossings."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from strandcast_studies.stills.graph import FREE, Graph, skeleton_graph
from strandcast_studies.stills.line import even_line, measure_across, normals, sample, smooth
from strandcast_studies.stills.mask import Silhouette, find_silhouette, given_silhouette
from strandcast_studies.stills.order import StillOrder, find_order
from strandcast_studies.stills.sureness import doubts

# All chosen on the mBEST pictures and on drawn strings.
SURE_MARGIN = 6.0  # by which every other order must cost more: squared bending in units of the typical one
WIDTH_RANGE = (0.6, 1.35)  # of a single strand, times the typical width
BRIDGE_HALF_WIDTHS = 4.0  # a longer bridge guides the strands that run along it
GUIDE_WEIGHT = 0.05  # of the skeleton of merged strands; a single strand's has 1
PRIOR_WEIGHT = 0.0025  # of the previous line, where nothing is measured
ROUNDS = 2  # of measuring across the line
END_TRIM = 0.85  # of the half width: near its end a skeleton bends towards a corner
END_REACH_HALF_WIDTHS = 12.0  # thinning shortens the ends of a string that lies at 45°


@dataclass(frozen=True, eq=False)
class StillCrossing:
    """A place where the string meets itself."""

    place_px: np.ndarray  # (2,) x, y
    along_px: tuple[float, ...]  # arc lengths at which the string passes it, ascending
    margin: float  # how much more the next best order costs; see `stills.order`
    sure: bool  # whether the margin is large enough to rely on the order, and no end of the string lies here
    crosses: bool  # whether the strands change sides; if not, they touch and separate again


@dataclass(frozen=True, eq=False)
class StillString:
    """A string in one picture; pixel centres are integers."""

    line_px: np.ndarray  # (K, 2) x, y of the centreline from end to end, one pixel apart
    measured: np.ndarray  # (K,) whether the centre was measured; at crossings it is interpolated
    width_px: float  # median
    crossings: list[StillCrossing]  # in the order in which the string first passes them
    mask: np.ndarray  # (height, width), the silhouette used
    choices: dict[str, Any]  # values chosen automatically, with units in the names
    doubts: list[str]  # why the line may not be the whole string; see `stills.sureness`

    @property
    def length_px(self) -> float:
        """Length of the centreline."""
        return float(np.linalg.norm(np.diff(self.line_px, axis=0), axis=1).sum())

    @property
    def sure(self) -> bool:
        """Whether the order is certain at every crossing, and ends, gaps and border raise no doubt."""
        return not self.doubts and all(c.sure for c in self.crossings)


def string_in_picture(
    picture: np.ndarray,
    background: np.ndarray | None = None,
    polarity: int = 0,
    threshold: float | None = None,
    start_px: np.ndarray | None = None,
) -> StillString:
    """Find the only string in a picture; parameters as for `mask.find_silhouette`, and `start_px`.

    Parameters
    ----------
    start_px
        (2,) a place near the first end, e.g. the hand; by default the upper end comes first.

    Raises
    ------
    StrandcastError
        SC-T020 no string is visible; SC-T021 the silhouette is not one string with two ends.
    """
    return _follow(find_silhouette(picture, background, polarity, threshold), start_px)


def string_in_mask(mask: np.ndarray, start_px: np.ndarray | None = None) -> StillString:
    """Order the string in a mask (height, width); its centre is midway between the mask's edges.

    Raises
    ------
    StrandcastError
        As `string_in_picture`.
    """
    return _follow(given_silhouette(mask), start_px)


def _follow(silhouette: Silhouette, start_px: np.ndarray | None) -> StillString:
    graph = skeleton_graph(silhouette.mask)
    order = find_order(graph)
    if _starts_last(graph, order, start_px):
        order.course[:] = [(b, 1 - e) for b, e in reversed(order.course)]
    field = silhouette.mask.astype(np.float32) if silhouette.contrast is None else silhouette.contrast
    rough, weight = _to_the_ends(field, *_rough_line(graph, order), graph, order)
    line, measured, width = refine(field, rough, weight, graph.half_width)
    choices = {
        "polarity": silhouette.polarity,
        "threshold": silhouette.threshold,
        "beside_share": silhouette.beside_share,
        "width_px": width,
    }
    crossings = _crossings(graph, order, line)
    found = doubts(silhouette, line, measured, width, [crossing.place_px for crossing in crossings])
    return StillString(line, measured, width, crossings, silhouette.mask, choices, found)


def _starts_last(graph: Graph, order: StillOrder, start_px: np.ndarray | None) -> bool:
    """Return whether the course must be reversed to begin at the start, or at the upper end."""
    b, e = order.course[-1]
    first, last = graph.from_end(order.course[0])[0][0], graph.from_end((b, 1 - e))[0][0]
    if start_px is None:
        return bool(tuple(last[::-1]) < tuple(first[::-1]))
    return bool(np.linalg.norm(last - start_px) < np.linalg.norm(first - start_px))


def _rough_line(graph: Graph, order: StillOrder) -> tuple[np.ndarray, np.ndarray]:
    """Return the skeleton along the course, one pixel apart, and its weights; merged strands weigh little."""
    pieces: list[np.ndarray] = []
    weights: list[np.ndarray] = []
    for place, end in enumerate(order.course):
        points, half_width = graph.from_end(end)
        last = (end[0], 1 - end[1])
        low = order.arms[end].cut if end in order.arms else _bent(half_width, graph.half_width)
        high = order.arms[last].cut if last in order.arms else _bent(half_width[::-1], graph.half_width)
        if place:
            bridge = _guide(graph, order, (order.course[place - 1][0], 1 - order.course[place - 1][1]), end)
            pieces.append(bridge)
            weights.append(np.full(len(bridge), GUIDE_WEIGHT))
        pieces.append(points[low : max(len(points) - high, low + 1)])
        weights.append(np.ones(len(pieces[-1])))
    line, where = even_line(np.vstack(pieces))
    each = np.concatenate(weights)
    lower = np.clip(np.floor(where + 1e-6).astype(int), 0, len(each) - 1)
    upper = np.clip(np.ceil(where - 1e-6).astype(int), 0, len(each) - 1)
    # Between two pieces the line is a chord without weight.
    step = np.linalg.norm(np.diff(np.vstack(pieces), axis=0), axis=1)
    chord = np.r_[step > 2.5, False][np.minimum(lower, len(step) - 1)] & (upper > lower)
    return line, np.where(chord, 0.0, np.minimum(each[lower], each[upper]))


def _bent(half_width: np.ndarray, usual: float) -> int:
    """Return how many points at a skeleton's free end are too near the silhouette's edge to be central."""
    return min(int(np.argmax(half_width > END_TRIM * usual)), int(0.3 * len(half_width)))


def _guide(graph: Graph, order: StillOrder, coming: tuple[int, int], going: tuple[int, int]) -> np.ndarray:
    """Return the skeleton of a long bridge between two ends; (0, 2) if there is none."""
    nodes = [graph.branches[b].nodes[e] for b, e in (coming, going)]
    for group in order.junctions:
        for b in group.bridges:
            branch = graph.branches[b]
            long = branch.length_px > BRIDGE_HALF_WIDTHS * graph.half_width
            if long and sorted(branch.nodes) == sorted(nodes) and FREE not in nodes:
                return branch.points if branch.nodes[0] == nodes[0] else branch.points[::-1]
    return np.zeros((0, 2))


def refine(
    field: np.ndarray, line: np.ndarray, weight: np.ndarray | None, half_width: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return a line moved to the measured centre, one pixel apart; where it was measured; the median width.

    Parameters
    ----------
    field
        (height, width) float32 contrast or mask.
    line, weight
        (K, 2) px and (K,): nothing is measured where the weight is below 1; None measures everywhere.
    half_width
        Of the string, px.
    """
    weight = np.ones(len(line)) if weight is None else weight
    allowed = weight >= 1.0
    line = smooth(line, weight, 0.5 * half_width)
    measured, usual = np.zeros(len(line), dtype=bool), 2.0 * half_width
    for _ in range(ROUNDS):
        offset, width = measure_across(field, line, half_width)
        fits = allowed & np.isfinite(width) & (np.abs(offset) < half_width)
        usual = float(np.median(width[fits])) if fits.any() else usual
        measured = fits & (width > WIDTH_RANGE[0] * usual) & (width < WIDTH_RANGE[1] * usual)
        centre = line + np.where(measured, offset, 0.0)[:, None] * normals(line)
        line = smooth(centre, np.where(measured, 1.0, PRIOR_WEIGHT), 0.5 * half_width)
    line, where = even_line(line)
    return line, measured[np.rint(where).astype(int)], usual


def _to_the_ends(
    field: np.ndarray, line: np.ndarray, weight: np.ndarray, graph: Graph, order: StillOrder
) -> tuple[np.ndarray, np.ndarray]:
    """Extend a line and its weights in a straight line to the string's ends."""
    line = smooth(line, weight, 0.5 * graph.half_width)
    b, e = order.course[-1]
    if (b, 1 - e) not in order.arms:
        more = _beyond(field, line, graph.half_width)
        line, weight = np.vstack([line, more]), np.append(weight, np.ones(len(more)))
    if order.course[0] not in order.arms:
        more = _beyond(field, line[::-1], graph.half_width)[::-1]
        line, weight = np.vstack([more, line]), np.append(np.ones(len(more)), weight)
    return line, weight


def _beyond(field: np.ndarray, line: np.ndarray, half_width: float) -> np.ndarray:
    """Return points (K, 2), about one pixel apart, from a line's last point to the string's end."""
    back = min(len(line) - 1, max(3, round(2.0 * half_width)))
    ahead = line[-1] - line[-1 - back]
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    level = 0.5 * float(np.median([sample(field, *line[-1 - k]) for k in range(back + 1)]))
    steps = np.arange(0.25, END_REACH_HALF_WIDTHS * half_width, 0.25)
    values = np.array([sample(field, *(line[-1] + s * ahead)) for s in steps])
    out = np.flatnonzero(values < level)
    inside = out[0] if len(out) else len(steps)
    far = steps[inside - 1] if inside else 0.0
    count = round(far)
    return np.asarray(line[-1] + (far / max(count, 1) * np.arange(1, count + 1))[:, None] * ahead)


def _crossings(graph: Graph, order: StillOrder, line: np.ndarray) -> list[StillCrossing]:
    """Return the crossings with the arc lengths at which the line passes them."""
    found = []
    for group, pairing, margin in zip(order.junctions, order.pairings, order.margins, strict=True):
        place = np.mean([graph.nodes[k][0] for k in group.nodes], axis=0)
        middles = [0.5 * (order.arms[p].place + order.arms[q].place) for p, q in pairing]
        passes = _passes(line, place, middles, graph.half_width)
        chords = [(order.arms[p].place, order.arms[q].place) for p, q in pairing]
        crosses = len(chords) == 2 and _intersect(*chords[0], *chords[1])
        # An end that lies on the string may continue, hidden: its place is uncertain.
        sure = margin >= SURE_MARGIN and len(group.ends) % 2 == 0
        found.append(StillCrossing(place, passes, margin, bool(sure), crosses))
    return sorted(found, key=lambda crossing: crossing.along_px)


def _passes(
    line: np.ndarray, place: np.ndarray, middles: list[np.ndarray], half_width: float
) -> tuple[float, ...]:
    """Return the arc lengths [px] at which a line is nearest to a place, one for every strand there."""
    distance = np.linalg.norm(line - place, axis=1)
    low = np.r_[True, distance[1:] <= distance[:-1]] & np.r_[distance[:-1] < distance[1:], True]
    nearest = sorted(np.flatnonzero(low), key=lambda k: distance[k])[: len(middles)]
    return tuple(sorted(float(k) for k in nearest))


def _intersect(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> bool:
    """Return whether the segments from a to b and from c to d cross."""

    def side(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    return side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0
