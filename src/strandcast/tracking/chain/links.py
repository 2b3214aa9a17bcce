"""The string as a chain of equal, inextensible links: nodes, normals, and standard deviations per axis."""

import numpy as np
from numba import njit


@njit(cache=True)
def place_nodes(root: np.ndarray, heading: np.ndarray, link_m: float) -> np.ndarray:
    """Return the nodes (M+1, 2) of a chain that starts at `root` with link headings (M,)."""
    nodes = np.empty((len(heading) + 1, 2))
    nodes[0, 0], nodes[0, 1] = root[0], root[1]
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
def per_axis(covariances: np.ndarray) -> np.ndarray:
    """Return sigma (K,) of covariances (K, 2, 2): the root of half the trace, so that it is per axis."""
    sigma = np.empty(len(covariances))
    for k in range(len(covariances)):
        sigma[k] = np.sqrt(max(0.0, 0.5 * (covariances[k, 0, 0] + covariances[k, 1, 1])))
    return sigma


@njit(cache=True)
def place_on(nodes: np.ndarray, heading: np.ndarray, place_m: float) -> np.ndarray:
    """Return where a place along the chain (m) is, (2,)."""
    link_m = np.hypot(nodes[1, 0] - nodes[0, 0], nodes[1, 1] - nodes[0, 1])
    j = min(max(int(place_m / link_m), 0), len(heading) - 1)
    beyond_m = place_m - j * link_m
    place: np.ndarray = nodes[j] + beyond_m * np.array([np.cos(heading[j]), np.sin(heading[j])])
    return place
