"""The string as a chain of equal, inextensible links: geometry, and the fit of its headings to sightings.

Link after link, the chain is a path: a link's end follows from its heading, its heading from the bend before
it, and the bend changes a little from joint to joint. What is seen and expected makes that a linear-quadratic
problem, solved from the tip to the clamp and back in time that grows with the number of links alone; the same
recursion run forwards gives the covariance of every node (Kalman's smoother, in its control form).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

LARGEST_TURN_RAD = 0.7  # of a link in one round


class Evidence(NamedTuple):
    """What is known of a chain beside its headings.

    Attributes
    ----------
    target
        Sighted place of each node (m), (M+1, 2).
    normals
        Direction in which each sighting is good, (M+1, 2).
    weight
        1/variance of each sighting (1/m²), (M+1,); 0 where nothing was seen.
    tip_slide_m, tip_weight
        By how much the tip should move along the last link, and the weight (1/m²) of that; 0 for none.
    pins
        Places on the chain that are known in both directions, (P, 4): place along the chain, x, y (m) and
        weight (1/m²).
    prior
        Predicted headings (rad), (M,).
    clamp_m, clamp_rad
        Where and in which direction the string leaves the clamp.
    """

    target: np.ndarray
    normals: np.ndarray
    weight: np.ndarray
    tip_slide_m: float
    tip_weight: float
    pins: np.ndarray
    prior: np.ndarray
    clamp_m: np.ndarray
    clamp_rad: float


class Stiffness(NamedTuple):
    """How a string bends: standard deviations (rad).

    Attributes
    ----------
    change
        Of a bend against the joint before.
    bend
        Of a bend.
    unseen
        Of a bend where nothing is seen: between seen ends a string under tension is straight.
    prior
        Of a heading against the prediction.
    clamp
        Of the first heading against the clamp's.
    root_m
        Of the chain's start against the clamp (m): how much of the string the clamp's surroundings hide is
        not seen, so the chain may begin a little before or behind it and be held by its tip.
    """

    change: float
    bend: float
    unseen: float
    prior: float
    clamp: float
    root_m: float


@njit(cache=True)
def place_nodes(root: np.ndarray, heading: np.ndarray, link_m: float) -> np.ndarray:
    """Return the nodes (M+1, 2) of a chain that starts at `root` with link headings (M,)."""
    nodes = np.empty((len(heading) + 1, 2))
    nodes[0] = root
    for j in range(len(heading)):
        nodes[j + 1, 0] = nodes[j, 0] + link_m * np.cos(heading[j])
        nodes[j + 1, 1] = nodes[j, 1] + link_m * np.sin(heading[j])
    return nodes


@njit(cache=True)
def node_normals(heading: np.ndarray) -> np.ndarray:
    """Return unit normals (M+1, 2) at the nodes: the mean direction of the links that meet, turned +90°."""
    count = len(heading)
    normals = np.empty((count + 1, 2))
    for k in range(count + 1):
        before = heading[max(k - 1, 0)]
        after = heading[min(k, count - 1)]
        cosine, sine = np.cos(before) + np.cos(after), np.sin(before) + np.sin(after)
        length = np.hypot(cosine, sine)
        if length < 1e-6:
            cosine, sine, length = np.cos(before), np.sin(before), 1.0
        normals[k, 0], normals[k, 1] = -sine / length, cosine / length
    return normals


@njit(cache=True)
def fit_headings(
    root: np.ndarray, heading: np.ndarray, link_m: float, seen: Evidence, stiffness: Stiffness, rounds: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fit link headings to sightings across the chain (Gauss-Newton).

    Parameters
    ----------
    root, heading
        Where the chain starts (m), (2,), and the headings of its links (rad), (M,): first values.
    link_m
        Length of a link.
    seen, stiffness
        What is known.
    rounds
        Gauss-Newton rounds.

    Returns
    -------
    root, heading, covariances
        Start (2,), headings (M,), and the nodes' covariances (M+1, 2, 2) (m²).
    """
    count = len(heading)
    root, heading = root.copy(), heading.copy()
    along = np.array([np.cos(heading[-1]), np.sin(heading[-1])])
    tip_target = place_nodes(root, heading, link_m)[-1] + seen.tip_slide_m * along
    gains = np.empty((count, 4))
    offsets = np.empty(count)
    spreads = np.empty(count)
    start = np.empty((4, 4))
    for _ in range(rounds):
        shift, step = _solve(
            root, heading, link_m, seen, stiffness, along, tip_target, gains, offsets, spreads, start
        )
        share = min(1.0, LARGEST_TURN_RAD / max(np.abs(step).max(), 1e-12))
        root += share * shift
        heading += share * step
    return root, heading, _covariances(heading, link_m, gains, spreads, start)


@njit(cache=True)
def _solve(
    root: np.ndarray, heading: np.ndarray, link_m: float, seen: Evidence, stiffness: Stiffness,
    along: np.ndarray, tip_target: np.ndarray, gains: np.ndarray, offsets: np.ndarray, spreads: np.ndarray,
    start: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return the Gauss-Newton steps of start (2,) and headings (M,); fills what the covariances need.

    The state at link j is (x and y of its end, its heading, its bend), as small changes; what changes the
    bend from link to link is free at a price. `cost` and `slope` are the price of a state's change for all
    that is beyond it.
    """
    count = len(heading)
    nodes = place_nodes(root, heading, link_m)
    per_change = 1.0 / stiffness.change**2
    per_prior = 1.0 / stiffness.prior**2
    cost = np.zeros((4, 4))
    slope = np.zeros(4)
    _add(cost, slope, along[0], along[1], 0.0, nodes[count] - tip_target, seen.tip_weight)
    for j in range(count - 1, -1, -1):
        k = j + 1
        normal = seen.normals[k]
        _add(cost, slope, normal[0], normal[1], 0.0, nodes[k] - seen.target[k], seen.weight[k])
        for pin in seen.pins:
            if j == min(max(int(pin[0] / link_m), 0), count - 1):
                _add_pin(cost, slope, nodes[k], heading[j], k * link_m - pin[0], pin)
        cost[2, 2] += per_prior
        slope[2] += per_prior * (heading[j] - seen.prior[j])
        if j == 0:
            break
        bend = heading[j] - heading[j - 1]
        per_bend = 1.0 / (stiffness.bend if seen.weight[j] > 0 else stiffness.unseen) ** 2
        cost[3, 3] += per_bend
        slope[3] += per_bend * bend
        bend_before = heading[j - 1] - heading[j - 2] if j > 1 else bend
        _step_back(
            cost, slope, heading[j], link_m, per_change, bend - bend_before, j, gains, offsets, spreads
        )
    # As a sine: a string that is flung back over the clamp is not pulled round.
    cost[2, 2] += 1.0 / stiffness.clamp**2
    slope[2] += np.sin(heading[0] - seen.clamp_rad) / stiffness.clamp**2
    per_root = 1.0 / stiffness.root_m**2
    return _step_forth(cost, slope, heading, link_m, per_root, root - seen.clamp_m, gains, offsets, start)


@njit(cache=True)
def _add_pin(
    cost: np.ndarray, slope: np.ndarray, node: np.ndarray, heading: float, before_m: float, pin: np.ndarray
) -> None:
    """Add what it costs that a place `before_m` before a link's end is off its pin."""
    cosine, sine = np.cos(heading), np.sin(heading)
    off = np.array([node[0] - before_m * cosine - pin[1], node[1] - before_m * sine - pin[2]])
    _add(cost, slope, 1.0, 0.0, before_m * sine, off, pin[3])
    _add(cost, slope, 0.0, 1.0, -before_m * cosine, off, pin[3])


@njit(cache=True)
def _add(
    cost: np.ndarray, slope: np.ndarray, nx: float, ny: float, turned: float, off: np.ndarray, weight: float
) -> None:
    """Add what a place's being off in one direction costs; `turned`: how far the link's turn moves it."""
    row = (nx, ny, turned)
    error = nx * off[0] + ny * off[1]
    for a in range(3):
        slope[a] += weight * row[a] * error
        for b in range(3):
            cost[a, b] += weight * row[a] * row[b]


@njit(cache=True)
def _step_back(
    cost: np.ndarray, slope: np.ndarray, heading: float, link_m: float, per_change: float, change: float,
    j: int, gains: np.ndarray, offsets: np.ndarray, spreads: np.ndarray,
) -> None:  # fmt: skip
    """Turn the price of link j's state into that of the state before it, in place.

    With q = (-l sin, l cos, 1, 0), what a turned link does: x' = x + q (turn + bend + free), and the bend
    itself grows by what is free.
    """
    qx, qy = -link_m * np.sin(heading), link_m * np.cos(heading)
    gx = qx * cost[0, 0] + qy * cost[0, 1] + cost[0, 2]
    gy = qx * cost[1, 0] + qy * cost[1, 1] + cost[1, 2]
    gt = qx * cost[2, 0] + qy * cost[2, 1] + cost[2, 2]
    gb = qx * cost[3, 0] + qy * cost[3, 1] + cost[3, 2]
    hx, hy, ht, hb = gx + cost[0, 3], gy + cost[1, 3], gt + cost[2, 3], gb + cost[3, 3]
    qg = qx * gx + qy * gy + gt
    qh = qx * hx + qy * hy + ht
    bh = qh + hb
    slope_q = qx * slope[0] + qy * slope[1] + slope[2]
    slope_b = slope_q + slope[3]
    spread = 1.0 / (bh + per_change)
    offset = slope_b + per_change * change
    gains[j, 0], gains[j, 1], gains[j, 2], gains[j, 3] = (
        -hx * spread,
        -hy * spread,
        -qh * spread,
        -bh * spread,
    )
    offsets[j] = -offset * spread
    spreads[j] = spread
    cost[0, 2] = cost[2, 0] = gx
    cost[1, 2] = cost[2, 1] = gy
    cost[2, 2] = qg
    cost[0, 3] = cost[3, 0] = hx
    cost[1, 3] = cost[3, 1] = hy
    cost[2, 3] = cost[3, 2] = qh
    cost[3, 3] = bh
    slope[2], slope[3] = slope_q, slope_b
    free = (hx, hy, qh, bh)
    for a in range(4):
        slope[a] -= free[a] * offset * spread
        for b in range(4):
            cost[a, b] -= free[a] * free[b] * spread


@njit(cache=True)
def _step_forth(
    cost: np.ndarray, slope: np.ndarray, heading: np.ndarray, link_m: float, per_root: float,
    root_off: np.ndarray, gains: np.ndarray, offsets: np.ndarray, start: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return by how much the start (2,) and each heading (M,) are to change.

    `start` becomes the covariance of start, first heading and first bend.
    """
    first = _first_link(heading[0], link_m)
    matrix = _carried(first.T.copy(), cost)
    right = np.zeros(4)
    for a in range(4):
        for b in range(4):
            right[a] -= first[b, a] * slope[b]
    for a in range(2):
        matrix[a, a] += per_root
        right[a] -= per_root * root_off[a]
    start[:] = _inverse(matrix)
    change = np.zeros(4)
    for a in range(4):
        for b in range(4):
            change[a] += start[a, b] * right[b]
    step = np.empty(len(heading))
    turn, bend = change[2], change[3]
    x = change[0] - link_m * np.sin(heading[0]) * turn
    y = change[1] + link_m * np.cos(heading[0]) * turn
    step[0] = turn
    for j in range(1, len(heading)):
        free = gains[j, 0] * x + gains[j, 1] * y + gains[j, 2] * turn + gains[j, 3] * bend + offsets[j]
        bend += free
        turn += bend
        x -= link_m * np.sin(heading[j]) * turn
        y += link_m * np.cos(heading[j]) * turn
        step[j] = turn
    return change[:2], step


@njit(cache=True)
def _first_link(heading: float, link_m: float) -> np.ndarray:
    """Return the matrix (4, 4) from (start x, start y, heading, bend) to the first link's state."""
    first = np.eye(4)
    first[0, 2], first[1, 2] = -link_m * np.sin(heading), link_m * np.cos(heading)
    return first


@njit(cache=True)
def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Return the inverse of a small symmetric positive matrix (Gauss-Jordan, no library's threads)."""
    count = len(matrix)
    work = matrix.copy()
    inverse = np.eye(count)
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
    return inverse


@njit(cache=True)
def _covariances(
    heading: np.ndarray, link_m: float, gains: np.ndarray, spreads: np.ndarray, start: np.ndarray
) -> np.ndarray:
    """Return the covariances of the nodes (M+1, 2, 2), from the gains of the last solution."""
    count = len(heading)
    nodes = np.zeros((count + 1, 2, 2))
    nodes[0] = start[:2, :2]
    spread = _carried(_first_link(heading[0], link_m), start)
    nodes[1] = spread[:2, :2]
    carry = np.empty((4, 4))
    for j in range(1, count):
        q = (-link_m * np.sin(heading[j]), link_m * np.cos(heading[j]), 1.0, 0.0)
        for a in range(4):
            free = q[a] + (1.0 if a == 3 else 0.0)
            for b in range(4):
                carry[a, b] = free * gains[j, b] + (1.0 if a == b and a < 3 else 0.0)
            carry[a, 2] += q[a] if a < 2 else 0.0
            carry[a, 3] += free
        spread = _carried(carry, spread)
        for a in range(4):
            for b in range(4):
                of_a, of_b = q[a] + (1.0 if a == 3 else 0.0), q[b] + (1.0 if b == 3 else 0.0)
                spread[a, b] += of_a * of_b * spreads[j]
        nodes[j + 1] = spread[:2, :2]
    return nodes


@njit(cache=True)
def _carried(carry: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """Return carry · spread · carryᵀ."""
    rows, inner = carry.shape
    half = np.zeros((rows, inner))
    for a in range(rows):
        for b in range(inner):
            for c in range(inner):
                half[a, b] += carry[a, c] * spread[c, b]
    out = np.zeros((rows, rows))
    for a in range(rows):
        for b in range(rows):
            for c in range(inner):
                out[a, b] += half[a, c] * carry[b, c]
    return out


@njit(cache=True)
def per_axis(covariances: np.ndarray) -> np.ndarray:
    """Return sigma (K,) of covariances (K, 2, 2): the root of half the trace, so that it is per axis."""
    sigma = np.empty(len(covariances))
    for k in range(len(covariances)):
        sigma[k] = np.sqrt(max(0.0, 0.5 * (covariances[k, 0, 0] + covariances[k, 1, 1])))
    return sigma
