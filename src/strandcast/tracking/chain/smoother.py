"""Fit a chain's headings to detections across it: a linear-quadratic smoother along the chain.

Link after link, the chain is a path: a link's end follows from its heading, its heading from the bend before
it, and the bend changes a little from joint to joint. Detections and priors make that a linear-quadratic
problem. It is solved from the tip to the clamp and back, in time linear in the number of links; the same
recursion run forwards gives the covariance of every node (a Kalman smoother in its control form).
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from strandcast.tracking.chain.constraints import Constraints, Pins
from strandcast.tracking.chain.links import link_directions, nodes_along

LARGEST_TURN_RAD = 0.7  # chosen: of a link in one round


class CostToGo(NamedTuple):
    """Quadratic and linear cost of a state's change, summed from there to the tip, in place."""

    cost: np.ndarray  # (4, 4)
    gradient: np.ndarray  # (4,)


class Recursion(NamedTuple):
    """Results of the backward recursion for the forward one, filled in place."""

    gains: np.ndarray  # change of each bend per change of the state before it, (M, 4)
    offsets: np.ndarray  # and the constant part, (M,)
    variances: np.ndarray  # of the free part of each bend, (M,)
    start: np.ndarray  # covariance of start, first heading and first bend, (4, 4)


@njit(cache=True, inline="always")
def fit_headings(
    root: np.ndarray, heading: np.ndarray, link_m: float, known: Constraints, rounds: int
) -> tuple[np.ndarray, np.ndarray, Recursion]:
    """Fit a chain's start (2,) and headings (M,) to the constraints in Gauss-Newton rounds from first values.

    Returns start, headings, and what `node_covariances` needs.
    """
    count = len(heading)
    root, heading = root.copy(), heading.copy()
    links = link_directions(heading)
    along = links[-1].copy()
    tip_target = nodes_along(root, links, link_m)[-1] + known.anchors.tip.along_m * along
    recursion = Recursion(np.empty((count, 4)), np.empty(count), np.empty(count), np.empty((4, 4)))
    for _ in range(rounds):
        links = link_directions(heading)
        shift, step = _solve(root, heading, links, link_m, known, along, tip_target, recursion)
        share = min(1.0, LARGEST_TURN_RAD / max(np.abs(step).max(), 1e-12))
        root += share * shift
        heading += share * step
    return root, heading, recursion


@njit(cache=True, inline="always")
def _solve(
    root: np.ndarray,
    heading: np.ndarray,
    links: np.ndarray,
    link_m: float,
    known: Constraints,
    along: np.ndarray,
    tip_target: np.ndarray,
    recursion: Recursion,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the Gauss-Newton steps of start (2,) and headings (M,); fills `recursion`.

    `links` (M, 2) are the directions of the headings. The state at link j is (x and y of its end, its
    heading, its bend), as small changes; the change of the bend from link to link is the control.
    """
    count = len(heading)
    nodes, pins, stiffness = nodes_along(root, links, link_m), known.anchors.pins, known.stiffness
    per_change = 1.0 / stiffness.change**2
    per_prior = 1.0 / stiffness.prior**2
    ahead = CostToGo(np.zeros((4, 4)), np.zeros(4))
    cost, gradient = ahead
    _add(ahead, (along[0], along[1], 0.0), nodes[count] - tip_target, known.anchors.tip.weight)
    for j in range(count - 1, -1, -1):
        k = j + 1
        normal = known.normals[k]
        _add(ahead, (normal[0], normal[1], 0.0), nodes[k] - known.target[k], known.weight[k])
        for p in range(len(pins.place_m)):
            place_m = pins.place_m[p]
            if j == min(max(int(place_m / link_m), 0), count - 1):
                _add_pin(ahead, nodes[k], links[j], k * link_m - place_m, pins, p)
        cost[2, 2] += per_prior
        gradient[2] += per_prior * (heading[j] - known.prior[j])
        if j == 0:
            break
        bend = heading[j] - heading[j - 1]
        per_bend = 1.0 / (stiffness.bend if known.weight[j] > 0 else stiffness.hidden) ** 2
        cost[3, 3] += per_bend
        gradient[3] += per_bend * bend
        bend_before = heading[j - 1] - heading[j - 2] if j > 1 else bend
        _step_back(ahead, links[j], link_m, per_change, bend - bend_before, j, recursion)
    # As a sine: a string that is flung back over the clamp is not turned around.
    cost[2, 2] += 1.0 / stiffness.clamp**2
    gradient[2] += np.sin(heading[0] - known.clamp_rad) / stiffness.clamp**2
    per_root = 1.0 / stiffness.root_m**2
    off_m = root - known.clamp_m
    steps: tuple[np.ndarray, np.ndarray] = _step_forward(ahead, links, link_m, per_root, off_m, recursion)
    return steps


@njit(cache=True)
def _add_pin(
    ahead: CostToGo, node: np.ndarray, along: np.ndarray, before_m: float, pins: Pins, p: int
) -> None:
    """Add the cost of a place `before_m` before a link's end being off its pin."""
    cosine, sine = along
    x, y = pins.point_m[p]
    off = np.array([node[0] - before_m * cosine - x, node[1] - before_m * sine - y])
    _add(ahead, (1.0, 0.0, before_m * sine), off, pins.weight[p])
    _add(ahead, (0.0, 1.0, -before_m * cosine), off, pins.weight[p])


@njit(cache=True)
def _add(ahead: CostToGo, row: tuple[float, float, float], off: np.ndarray, weight: float) -> None:
    """Add the cost of a place being off in one direction.

    The row holds x and y of the direction, and how far the link's turn moves the place along it.
    """
    cost, gradient = ahead
    error = row[0] * off[0] + row[1] * off[1]
    for a in range(3):
        gradient[a] += weight * row[a] * error
        for b in range(3):
            cost[a, b] += weight * row[a] * row[b]


@njit(cache=True)
def _step_back(
    ahead: CostToGo,
    along: np.ndarray,
    link_m: float,
    per_change: float,
    change: float,
    j: int,
    recursion: Recursion,
) -> None:
    """Turn the cost of link j's state into that of the state before it, in place.

    With q = (-l sin, l cos, 1, 0), the effect of a turned link: x' = x + q (turn + bend + free), and the bend
    itself grows by the free part.
    """
    cost, gradient = ahead
    qx, qy = -link_m * along[1], link_m * along[0]
    gx = qx * cost[0, 0] + qy * cost[0, 1] + cost[0, 2]
    gy = qx * cost[1, 0] + qy * cost[1, 1] + cost[1, 2]
    gt = qx * cost[2, 0] + qy * cost[2, 1] + cost[2, 2]
    gb = qx * cost[3, 0] + qy * cost[3, 1] + cost[3, 2]
    hx, hy, ht, hb = gx + cost[0, 3], gy + cost[1, 3], gt + cost[2, 3], gb + cost[3, 3]
    qg = qx * gx + qy * gy + gt
    qh = qx * hx + qy * hy + ht
    bh = qh + hb
    slope_q = qx * gradient[0] + qy * gradient[1] + gradient[2]
    slope_b = slope_q + gradient[3]
    variance = 1.0 / (bh + per_change)
    offset = slope_b + per_change * change
    free = (hx, hy, qh, bh)
    for a in range(4):
        recursion.gains[j, a] = -free[a] * variance
    recursion.offsets[j] = -offset * variance
    recursion.variances[j] = variance
    cost[0, 2] = cost[2, 0] = gx
    cost[1, 2] = cost[2, 1] = gy
    cost[2, 2] = qg
    cost[0, 3] = cost[3, 0] = hx
    cost[1, 3] = cost[3, 1] = hy
    cost[2, 3] = cost[3, 2] = qh
    cost[3, 3] = bh
    gradient[2], gradient[3] = slope_q, slope_b
    for a in range(4):
        gradient[a] -= free[a] * offset * variance
        for b in range(4):
            cost[a, b] -= free[a] * free[b] * variance


@njit(cache=True, inline="always")
def _step_forward(
    ahead: CostToGo,
    links: np.ndarray,
    link_m: float,
    per_root: float,
    root_off: np.ndarray,
    recursion: Recursion,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the changes of the start (2,) and of each heading (M,); fills `recursion.start`."""
    cost, gradient = ahead
    gains, offsets, start = recursion.gains, recursion.offsets, recursion.start
    first = _first_link(links[0], link_m)
    transposed = np.empty((4, 4))
    for a in range(4):
        for b in range(4):
            transposed[a, b] = first[b, a]
    matrix = _propagated(transposed, cost)
    right = np.zeros(4)
    for a in range(4):
        for b in range(4):
            right[a] -= first[b, a] * gradient[b]
    for a in range(2):
        matrix[a, a] += per_root
        right[a] -= per_root * root_off[a]
    _invert(matrix, start)
    change = np.zeros(4)
    for a in range(4):
        for b in range(4):
            change[a] += start[a, b] * right[b]
    step = np.empty(len(links))
    turn, bend = change[2], change[3]
    x = change[0] - link_m * links[0, 1] * turn
    y = change[1] + link_m * links[0, 0] * turn
    step[0] = turn
    for j in range(1, len(links)):
        free = gains[j, 0] * x + gains[j, 1] * y + gains[j, 2] * turn + gains[j, 3] * bend + offsets[j]
        bend += free
        turn += bend
        x -= link_m * links[j, 1] * turn
        y += link_m * links[j, 0] * turn
        step[j] = turn
    return change[:2], step


@njit(cache=True)
def _first_link(along: np.ndarray, link_m: float) -> np.ndarray:
    """Return the matrix (4, 4) from (start x, start y, heading, bend) to the first link's state."""
    first = np.zeros((4, 4))
    for a in range(4):
        first[a, a] = 1.0
    first[0, 2], first[1, 2] = -link_m * along[1], link_m * along[0]
    return first


@njit(cache=True)
def _invert(work: np.ndarray, inverse: np.ndarray) -> None:
    """Invert a small symmetric positive matrix, which is used up (Gauss-Jordan, without threads)."""
    count = len(work)
    for a in range(count):
        for b in range(count):
            inverse[a, b] = 1.0 if a == b else 0.0
    for a in range(count):
        pivot = max(work[a, a], 1e-300)
        for b in range(count):
            work[a, b] /= pivot
            inverse[a, b] /= pivot
        for c in range(count):
            if c != a:
                factor = work[c, a]
                for b in range(count):
                    work[c, b] -= factor * work[a, b]
                    inverse[c, b] -= factor * inverse[a, b]


@njit(cache=True)
def node_covariances(heading: np.ndarray, link_m: float, recursion: Recursion) -> np.ndarray:
    """Return the covariances of the nodes (M+1, 2, 2) (m²), from the gains of the last solution."""
    gains, start, links = recursion.gains, recursion.start, link_directions(heading)
    count = len(heading)
    nodes = np.zeros((count + 1, 2, 2))
    _copy_places(start, nodes, 0)
    covariance = _propagated(_first_link(links[0], link_m), start)
    _copy_places(covariance, nodes, 1)
    carry = np.empty((4, 4))
    for j in range(1, count):
        q = (-link_m * links[j, 1], link_m * links[j, 0], 1.0, 0.0)
        for a in range(4):
            free = q[a] + (1.0 if a == 3 else 0.0)
            for b in range(4):
                carry[a, b] = free * gains[j, b] + (1.0 if a == b and a < 3 else 0.0)
            carry[a, 2] += q[a] if a < 2 else 0.0
            carry[a, 3] += free
        covariance = _propagated(carry, covariance)
        for a in range(4):
            for b in range(4):
                of_a, of_b = q[a] + (1.0 if a == 3 else 0.0), q[b] + (1.0 if b == 3 else 0.0)
                covariance[a, b] += of_a * of_b * recursion.variances[j]
        _copy_places(covariance, nodes, j + 1)
    return nodes


@njit(cache=True)
def _copy_places(covariance: np.ndarray, nodes: np.ndarray, k: int) -> None:
    """Copy the part of a state's covariance (4, 4) that is of places to `nodes` (M+1, 2, 2)."""
    for a in range(2):
        for b in range(2):
            nodes[k, a, b] = covariance[a, b]


@njit(cache=True)
def _propagated(carry: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return carry · covariance · carryᵀ."""
    rows, inner = carry.shape
    half = np.zeros((rows, inner))
    for a in range(rows):
        for b in range(inner):
            for c in range(inner):
                half[a, b] += carry[a, c] * covariance[c, b]
    out = np.zeros((rows, rows))
    for a in range(rows):
        for b in range(rows):
            for c in range(inner):
                out[a, b] += half[a, c] * carry[b, c]
    return out
