"""The string as a chain of equal, inextensible links: nodes, normals, and standard deviations per axis."""

import numpy as np
from numba import njit


@njit(cache=True)
def place_nodes(root: np.ndarray, heading: np.ndarray, link_m: float) -> np.ndarray:
    """Return the nodes (M+1, 2) of a chain that starts at `root` with link headings (M,)."""
    nodes: np.ndarray = nodes_along(root, link_directions(heading), link_m)
    return nodes


@njit(cache=True)
def link_directions(heading: np.ndarray) -> np.ndarray:
    """Return the unit vectors (M, 2) of links with headings (M,)."""
    along = np.empty((len(heading), 2))
    for j in range(len(heading)):
        along[j, 0], along[j, 1] = np.cos(heading[j]), np.sin(heading[j])
    return along


@njit(cache=True)
def nodes_along(root: np.ndarray, along: np.ndarray, link_m: float) -> np.ndarray:
    """Return the nodes (M+1, 2) of a chain that starts at `root` with links of directions (M, 2)."""
    nodes = np.empty((len(along) + 1, 2))
    nodes[0, 0], nodes[0, 1] = root[0], root[1]
    for j in range(len(along)):
        nodes[j + 1, 0] = nodes[j, 0] + link_m * along[j, 0]
        nodes[j + 1, 1] = nodes[j, 1] + link_m * along[j, 1]
    return nodes


@njit(cache=True)
def node_normals(heading: np.ndarray) -> np.ndarray:
    """Return unit normals (M+1, 2) at the nodes: the mean direction of the links that meet, turned +90°."""
    normals: np.ndarray = normals_to(link_directions(heading))
    return normals


@njit(cache=True)
def normals_to(along: np.ndarray) -> np.ndarray:
    """Return the same as `node_normals`, of links with directions (M, 2)."""
    count = len(along)
    normals = np.empty((count + 1, 2))
    for k in range(count + 1):
        before, after = max(k - 1, 0), min(k, count - 1)
        cosine, sine = along[before, 0] + along[after, 0], along[before, 1] + along[after, 1]
        length = np.hypot(cosine, sine)
        if length < 1e-6:
            cosine, sine, length = along[before, 0], along[before, 1], 1.0
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
