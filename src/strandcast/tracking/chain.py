"""The string as a chain of equal, inextensible links: geometry, and the fit of its headings to sightings."""

from __future__ import annotations

import numpy as np
from numba import njit


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
    root: np.ndarray,
    heading: np.ndarray,
    link_m: float,
    target: np.ndarray,
    normals: np.ndarray,
    weight: np.ndarray,
    tip_slide_m: float,
    tip_weight: float,
    prior: np.ndarray,
    clamp_rad: float,
    sigmas: np.ndarray,
    rounds: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Fit link headings to sightings across the chain (Gauss-Newton).

    Parameters
    ----------
    root
        Where the chain starts (m), (2,).
    heading
        Start values (rad), (M,).
    link_m
        Length of a link.
    target
        Sighted place of each node (m), (M+1, 2).
    normals
        Direction in which each sighting is good, (M+1, 2).
    weight
        1/variance of each sighting (1/m²), (M+1,); 0 where nothing was seen.
    tip_slide_m, tip_weight
        By how much the tip should move along the last link, and the weight (1/m²) of that; 0 for none.
    prior
        Predicted headings (rad), (M,).
    clamp_rad
        Direction in which the clamp points the string.
    sigmas
        Standard deviations (rad): change of bend from joint to joint, bend of a joint, heading against the
        prediction, first heading against the clamp; (4,).
    rounds
        Gauss-Newton rounds.

    Returns
    -------
    heading, hessian
        The headings (M,) and the matrix (M, M) whose inverse is their covariance.
    """
    count = len(heading)
    heading = heading.copy()
    tip_normal = np.array([np.cos(heading[-1]), np.sin(heading[-1])])
    tip_target = place_nodes(root, heading, link_m)[-1] + tip_slide_m * tip_normal
    hessian = np.zeros((count, count))
    gradient = np.zeros(count)
    for _ in range(rounds):
        hessian[:] = 0.0
        gradient[:] = 0.0
        nodes = place_nodes(root, heading, link_m)
        add_sightings(
            hessian,
            gradient,
            nodes,
            heading,
            link_m,
            target,
            normals,
            weight,
            tip_target,
            tip_normal,
            tip_weight,
        )
        add_smoothness(hessian, gradient, heading, sigmas[0], sigmas[1])
        for j in range(count):
            hessian[j, j] += 1.0 / sigmas[2] ** 2
            gradient[j] += (heading[j] - prior[j]) / sigmas[2] ** 2
        # As a sine: a string that is flung back over the clamp is not pulled round.
        hessian[0, 0] += 1.0 / sigmas[3] ** 2
        gradient[0] += np.sin(heading[0] - clamp_rad) / sigmas[3] ** 2
        step = solve_factored(cholesky(hessian), gradient)
        largest = np.abs(step).max()
        heading -= step * min(1.0, 0.7 / max(largest, 1e-12))
    return heading, hessian


@njit(cache=True)
def add_sightings(
    hessian: np.ndarray,
    gradient: np.ndarray,
    nodes: np.ndarray,
    heading: np.ndarray,
    link_m: float,
    target: np.ndarray,
    normals: np.ndarray,
    weight: np.ndarray,
    tip_target: np.ndarray,
    tip_normal: np.ndarray,
    tip_weight: float,
) -> None:
    """Add the sightings' part of Gauss-Newton's matrix and gradient, in O(M²) by sums from the tip inwards.

    Link j moves every node beyond it by ``link_m * (-sin, cos)``, so its column is a sum over those nodes.
    """
    count = len(heading)
    # Sums over nodes k > j of w n nᵀ and of w n (n · error).
    sum_xx = sum_xy = sum_yy = sum_x = sum_y = 0.0
    ex = nodes[-1, 0] - tip_target[0]
    ey = nodes[-1, 1] - tip_target[1]
    slide = tip_normal[0] * ex + tip_normal[1] * ey
    sum_xx += tip_weight * tip_normal[0] ** 2
    sum_xy += tip_weight * tip_normal[0] * tip_normal[1]
    sum_yy += tip_weight * tip_normal[1] ** 2
    sum_x += tip_weight * tip_normal[0] * slide
    sum_y += tip_weight * tip_normal[1] * slide
    for j in range(count - 1, -1, -1):
        k = j + 1
        nx, ny = normals[k, 0], normals[k, 1]
        across = nx * (nodes[k, 0] - target[k, 0]) + ny * (nodes[k, 1] - target[k, 1])
        sum_xx += weight[k] * nx * nx
        sum_xy += weight[k] * nx * ny
        sum_yy += weight[k] * ny * ny
        sum_x += weight[k] * nx * across
        sum_y += weight[k] * ny * across
        jx, jy = -link_m * np.sin(heading[j]), link_m * np.cos(heading[j])
        gradient[j] += jx * sum_x + jy * sum_y
        ax, ay = jx * sum_xx + jy * sum_xy, jx * sum_xy + jy * sum_yy
        for i in range(j + 1):
            value = -ax * link_m * np.sin(heading[i]) + ay * link_m * np.cos(heading[i])
            hessian[i, j] += value
            if i != j:
                hessian[j, i] += value


@njit(cache=True)
def add_smoothness(
    hessian: np.ndarray, gradient: np.ndarray, heading: np.ndarray, change_sigma: float, bend_sigma: float
) -> None:
    """Add the priors that bends are small and change little from joint to joint."""
    count = len(heading)
    second = 1.0 / change_sigma**2
    first = 1.0 / bend_sigma**2
    for j in range(1, count):
        bend = heading[j] - heading[j - 1]
        gradient[j] += first * bend
        gradient[j - 1] -= first * bend
        hessian[j, j] += first
        hessian[j - 1, j - 1] += first
        hessian[j, j - 1] -= first
        hessian[j - 1, j] -= first
    pattern = np.array([1.0, -2.0, 1.0])
    for j in range(1, count - 1):
        change = heading[j + 1] - 2 * heading[j] + heading[j - 1]
        for a in range(3):
            gradient[j - 1 + a] += second * pattern[a] * change
            for b in range(3):
                hessian[j - 1 + a, j - 1 + b] += second * pattern[a] * pattern[b]


@njit(cache=True)
def node_sigmas(
    hessian: np.ndarray, heading: np.ndarray, link_m: float, every: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return covariances (2, 2) of every `every`-th node and its sigma (m), from the fit's matrix.

    Sigma is the root of half the trace of the covariance: per axis, so that the expected squared distance is
    twice its square.
    """
    count = len(heading)
    factor = cholesky(hessian)
    kept = count // every
    covariances = np.zeros((kept, 2, 2))
    sigma = np.empty(kept)
    column = np.zeros((2, count))
    for p in range(kept):
        column[:] = 0.0
        for j in range((p + 1) * every):
            column[0, j] = -link_m * np.sin(heading[j])
            column[1, j] = link_m * np.cos(heading[j])
        for a in range(2):
            spread = solve_factored(factor, column[a])
            for b in range(2):
                covariances[p, a, b] = (spread * column[b]).sum()
        sigma[p] = np.sqrt(max(0.0, 0.5 * (covariances[p, 0, 0] + covariances[p, 1, 1])))
    return covariances, sigma


@njit(cache=True)
def cholesky(matrix: np.ndarray) -> np.ndarray:
    """Return the lower factor of a symmetric positive matrix (M, M).

    Written out, because a linear-algebra library's result may depend on its number of threads.
    """
    count = len(matrix)
    factor = np.zeros((count, count))
    for i in range(count):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            factor[i, j] = np.sqrt(max(total, 1e-12)) if i == j else total / factor[j, j]
    return factor


@njit(cache=True)
def solve_factored(factor: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return x (M,) of L Lᵀ x = right."""
    count = len(right)
    x = right.copy()
    for i in range(count):
        for k in range(i):
            x[i] -= factor[i, k] * x[k]
        x[i] /= factor[i, i]
    for i in range(count - 1, -1, -1):
        x[i] /= factor[i, i]
        for k in range(i):
            x[k] -= factor[i, k] * x[i]
    return x
