"""The chain's geometry, its fit and its covariance, against numpy and finite differences."""

from __future__ import annotations

import numpy as np
import pytest

from strandcast.tracking.chain import (
    cholesky,
    fit_headings,
    node_normals,
    node_sigmas,
    place_nodes,
    solve_factored,
)

LINK_M = 0.006
LOOSE = np.array([0.5, 5.0, 50.0, 50.0])


def wave(links: int, bend: float) -> np.ndarray:
    return -np.pi / 2 + bend * np.sin(np.linspace(0, 2 * np.pi, links))


def test_nodes_of_a_quarter_circle():
    links = 90
    heading = (np.arange(links) + 0.5) * (np.pi / 2 / links)
    nodes = place_nodes(np.zeros(2), heading, 1.0)
    radius = 0.5 / np.sin(np.pi / 4 / links)
    np.testing.assert_allclose(nodes[-1], [radius, radius], rtol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(np.diff(nodes, axis=0), axis=1), 1.0)


def test_factored_solution_is_numpys():
    rng = np.random.default_rng(2)
    root = rng.normal(size=(40, 40))
    matrix, right = root @ root.T + np.eye(40), rng.normal(size=40)
    np.testing.assert_allclose(
        solve_factored(cholesky(matrix), right), np.linalg.solve(matrix, right), rtol=1e-9
    )


def test_fit_recovers_a_bent_chain_from_sightings_across_it():
    truth = wave(50, 0.9)
    root = np.array([0.1, 0.2])
    seen = place_nodes(root, truth, LINK_M)
    start = wave(50, 0.7)
    heading = start
    for _ in range(6):
        normals = node_normals(heading)
        weight = np.full(51, 1e8)
        tip = place_nodes(root, heading, LINK_M)[-1]
        slide = (seen[-1] - tip) @ [np.cos(heading[-1]), np.sin(heading[-1])]
        # What is seen is where the normal meets the true curve; near the end, the true point itself.
        heading, hessian = fit_headings(
            root, heading, LINK_M, seen, normals, weight, slide, 1e8, start, truth[0], LOOSE, 3
        )
    off = np.linalg.norm(place_nodes(root, heading, LINK_M) - seen, axis=1)
    assert off.max() < 2e-4
    assert np.isfinite(hessian).all()


def test_unseen_middle_is_bridged_and_doubted():
    truth = wave(50, 0.3)
    root = np.zeros(2)
    seen = place_nodes(root, truth, LINK_M)
    weight = np.full(51, 1e7)
    weight[20:32] = 0.0
    heading, hessian = fit_headings(
        root, truth, LINK_M, seen, node_normals(truth), weight, 0.0, 1e7, truth, truth[0],
        np.array([0.2, 1.0, 0.8, 1.0]), 2,
    )  # fmt: skip
    _, sigma = node_sigmas(hessian, heading, LINK_M, 5)
    assert sigma[4] > 2 * sigma[2]
    assert sigma[4] > 2 * sigma[8]


def test_sigma_is_the_inverse_matrixs():
    truth = wave(20, 0.5)
    heading, hessian = fit_headings(
        np.zeros(2), truth, LINK_M, place_nodes(np.zeros(2), truth, LINK_M), node_normals(truth),
        np.full(21, 1e7), 0.0, 1e6, truth, truth[0], LOOSE, 1,
    )  # fmt: skip
    covariances, sigma = node_sigmas(hessian, heading, LINK_M, 4)
    jacobian = np.zeros((2, 20))
    jacobian[0, :12], jacobian[1, :12] = -LINK_M * np.sin(heading[:12]), LINK_M * np.cos(heading[:12])
    expected = jacobian @ np.linalg.inv(hessian) @ jacobian.T
    np.testing.assert_allclose(covariances[2], expected, rtol=1e-8)
    assert sigma[2] == pytest.approx(np.sqrt(0.5 * np.trace(expected)))


def test_a_string_flung_back_is_not_pulled_round():
    back = np.full(30, np.pi)
    seen = place_nodes(np.zeros(2), back, LINK_M)
    heading, _ = fit_headings(
        np.zeros(2), back, LINK_M, seen, node_normals(back), np.full(31, 1e7), 0.0, 0.0, back, 0.0,
        np.array([0.2, 1.0, 0.8, 1.0]), 5,
    )  # fmt: skip
    np.testing.assert_allclose(heading, np.pi, atol=1e-9)
