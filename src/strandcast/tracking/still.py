"""The string in one picture, without time: its centreline in order, through self-crossings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from strandcast.tracking.still_graph import FREE, Graph, skeleton_graph
from strandcast.tracking.still_line import even_line, measure_across, normals, sample, smooth
from strandcast.tracking.still_mask import Silhouette, find_silhouette, given_silhouette
from strandcast.tracking.still_order import Order, find_order

SURE_MARGIN = 6.0  # squared bending in units of the usual, by which another order must be dearer
MOST_BESIDE = 0.1  # area that is as string but apart from it, of the string's: it may be in pieces
WIDTH_RANGE = (0.6, 1.35)  # times the usual, in which a width is one strand's
BRIDGE_HALF_WIDTHS = 4.0  # a longer bridge guides the strands that run along it
GUIDE_WEIGHT = 0.05  # of the skeleton of merged strands, against 1 for a single strand's
PRIOR_WEIGHT = 0.0025  # of the line before, where nothing is measured
ROUNDS = 2  # of measuring across
END_TRIM = 0.85  # of the half width: a skeleton's end is bent towards a corner
END_REACH_HALF_WIDTHS = 12.0  # thinning eats the ends of a string that lies at 45°


@dataclass(frozen=True, eq=False)
class Crossing:
    """A place where the string meets itself.

    Attributes
    ----------
    place_px
        (2,) x, y.
    along_px
        Arc lengths at which the string passes it, rising.
    margin
        By how much the next best order is dearer; see `still_order`.
    sure
        Whether the margin is large enough to rely on the order, and no end of the string lies here.
    crosses
        Whether the strands change sides; they may also touch and part.
    """

    place_px: np.ndarray
    along_px: tuple[float, ...]
    margin: float
    sure: bool
    crosses: bool


@dataclass(frozen=True, eq=False)
class StillString:
    """A string in one picture.

    Attributes
    ----------
    line_px
        (K, 2) x, y of the centreline from end to end, one pixel apart; pixel centres are whole numbers.
    measured
        (K,) whether the centre was measured across; elsewhere (crossings) it is bridged.
    width_px
        Usual width.
    crossings
        In the order in which the string first passes them.
    mask
        The silhouette used (height, width).
    choices
        What was chosen automatically, with units in the names.
    """

    line_px: np.ndarray
    measured: np.ndarray
    width_px: float
    crossings: list[Crossing]
    mask: np.ndarray
    choices: dict[str, Any]

    @property
    def length_px(self) -> float:
        """Length of the centreline."""
        return float(np.linalg.norm(np.diff(self.line_px, axis=0), axis=1).sum())

    @property
    def sure(self) -> bool:
        """Whether the order at every crossing is sure, and little else in the picture could be string."""
        return self.choices["beside_share"] < MOST_BESIDE and all(c.sure for c in self.crossings)


def string_in_picture(
    picture: np.ndarray,
    background: np.ndarray | None = None,
    polarity: int = 0,
    threshold: float | None = None,
    start_px: np.ndarray | None = None,
) -> StillString:
    """Find the one string in a picture; parameters as `still_mask.find_silhouette`, and `start_px`.

    Parameters
    ----------
    start_px
        (2,) near the end from which to order, e.g. the hand; by default the upper end.

    Raises
    ------
    StrandcastError
        SC-T020 no string is seen; SC-T021 not the two ends of one string.
    """
    return _follow(find_silhouette(picture, background, polarity, threshold), start_px)


def string_in_mask(mask: np.ndarray, start_px: np.ndarray | None = None) -> StillString:
    """Order the string of a mask (height, width); the centre is midway between the mask's edges.

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
    crossings = _crossings(graph, order, line)
    choices = {
        "polarity": silhouette.polarity,
        "threshold": silhouette.threshold,
        "beside_share": silhouette.beside_share,
        "width_px": width,
    }
    return StillString(line, measured, width, crossings, silhouette.mask, choices)


def _starts_last(graph: Graph, order: Order, start_px: np.ndarray | None) -> bool:
    """Whether the course must be turned round to begin at the start, or at the upper end."""
    b, e = order.course[-1]
    first, last = graph.from_end(order.course[0])[0][0], graph.from_end((b, 1 - e))[0][0]
    if start_px is None:
        return bool(tuple(last[::-1]) < tuple(first[::-1]))
    return bool(np.linalg.norm(last - start_px) < np.linalg.norm(first - start_px))


def _rough_line(graph: Graph, order: Order) -> tuple[np.ndarray, np.ndarray]:
    """Return the skeleton along the course, one pixel apart, and its weight: 0 where strands are merged."""
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
    # Between two pieces the line is a chord: it has no weight.
    step = np.linalg.norm(np.diff(np.vstack(pieces), axis=0), axis=1)
    chord = np.r_[step > 2.5, False][np.minimum(lower, len(step) - 1)] & (upper > lower)
    return line, np.where(chord, 0.0, np.minimum(each[lower], each[upper]))


def _bent(half_width: np.ndarray, usual: float) -> int:
    """Return how many points of a skeleton's free end are nearer to the edge than the string is wide."""
    return min(int(np.argmax(half_width > END_TRIM * usual)), int(0.3 * len(half_width)))


def _guide(graph: Graph, order: Order, coming: tuple[int, int], going: tuple[int, int]) -> np.ndarray:
    """Return the skeleton of a long bridge between two ends, (0, 2) where there is none."""
    knots = [graph.branches[b].knots[e] for b, e in (coming, going)]
    for group in order.meetings:
        for b in group.bridges:
            branch = graph.branches[b]
            long = branch.length_px > BRIDGE_HALF_WIDTHS * graph.half_width
            if long and sorted(branch.knots) == sorted(knots) and FREE not in knots:
                return branch.points if branch.knots[0] == knots[0] else branch.points[::-1]
    return np.zeros((0, 2))


def refine(
    field: np.ndarray, line: np.ndarray, weight: np.ndarray | None, half_width: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return a line moved onto the measured centre, one pixel apart; where it was measured; the usual width.

    Parameters
    ----------
    field
        (height, width) float32 contrast or mask.
    line, weight
        (K, 2) px and (K,): below 1, nothing is measured; None for measuring everywhere.
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
    field: np.ndarray, line: np.ndarray, weight: np.ndarray, graph: Graph, order: Order
) -> tuple[np.ndarray, np.ndarray]:
    """Lengthen a line and its weight to where the string ends, straight on from its last widths."""
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
    """Return points (K, 2) about one pixel apart from a line's last point to the string's edge."""
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


def _crossings(graph: Graph, order: Order, line: np.ndarray) -> list[Crossing]:
    """Return the crossings with the arc lengths of their passes."""
    found = []
    for group, pairing, margin in zip(order.meetings, order.pairings, order.margins, strict=True):
        place = np.mean([graph.knots[k][0] for k in group.knots], axis=0)
        middles = [0.5 * (order.arms[p].place + order.arms[q].place) for p, q in pairing]
        passes = _passes(line, place, middles, graph.half_width)
        chords = [(order.arms[p].place, order.arms[q].place) for p, q in pairing]
        crosses = len(chords) == 2 and _intersect(*chords[0], *chords[1])
        # An end that lies on the string may go on, hidden: its place is not sure.
        sure = margin >= SURE_MARGIN and len(group.ends) % 2 == 0
        found.append(Crossing(place, passes, margin, bool(sure), crosses))
    return sorted(found, key=lambda crossing: crossing.along_px)


def _passes(
    line: np.ndarray, place: np.ndarray, middles: list[np.ndarray], half_width: float
) -> tuple[float, ...]:
    """Return the arc lengths (px) at which a line is nearest to a place, once for every strand there."""
    distance = np.linalg.norm(line - place, axis=1)
    low = np.r_[True, distance[1:] <= distance[:-1]] & np.r_[distance[:-1] < distance[1:], True]
    nearest = sorted(np.flatnonzero(low), key=lambda k: distance[k])[: len(middles)]
    return tuple(sorted(float(k) for k in nearest))


def _intersect(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> bool:
    """Whether the stretches from a to b and from c to d cross."""

    def side(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    return side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0
