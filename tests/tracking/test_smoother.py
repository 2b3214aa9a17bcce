"""The chain's geometry, fit and covariance, against a dense solution."""

import numpy as np
import pytest

from strandcast.tracking.chain.constraints import NO_TIP, Anchors, Constraints, Pins, Stiffness, Tip
from strandcast.tracking.chain.links import node_normals, per_axis, place_nodes
from strandcast.tracking.chain.smoother import fit_headings, node_covariances

LINK_M = 0.006
LOOSE = Stiffness(change=0.5, bend=5.0, hidden=5.0, prior=50.0, clamp=50.0, root_m=1e-5)
USUAL = Stiffness(change=0.2, bend=1.0, hidden=0.2, prior=0.8, clamp=2.0, root_m=0.0025)
NO_PINS = Pins(np.zeros(0), np.zeros((0, 2)), np.zeros(0))
FREE = Anchors(NO_TIP, NO_PINS)


def wave(links: int, bend: float) -> np.ndarray:
    return -np.pi / 2 + bend * np.sin(np.linspace(0, 2 * np.pi, links))


def constraints(target, heading, weight, prior, anchors=FREE, stiffness=USUAL, **changes) -> Constraints:
    """Detections that are valid across the chain `heading`; the clamp is at the first one."""
    known = Constraints(target, node_normals(heading), weight, anchors, prior, target[0], prior[0], stiffness)
    return known._replace(**changes)


def dense_fit(root, heading, seen: Constraints) -> tuple[np.ndarray, np.ndarray]:
    """One Gauss-Newton step and the covariance of (root x, root y, headings), by matrices."""
    count, stiffness = len(heading), seen.stiffness
    nodes = place_nodes(root, heading, LINK_M)
    rows, offs, weights = [], [], []

    def add(row, off, weight) -> None:
        rows.append(row)
        offs.append(off)
        weights.append(weight)

    def moves(k, nx, ny, fraction=1.0):
        row = np.zeros(2 + count)
        row[:2] = nx, ny
        row[2 : 2 + k] = LINK_M * (-nx * np.sin(heading[:k]) + ny * np.cos(heading[:k]))
        row[1 + k] *= fraction
        return row

    for k in range(1, count + 1):
        nx, ny = seen.normals[k]
        add(moves(k, nx, ny), (nodes[k] - seen.target[k]) @ [nx, ny], seen.weight[k])
    along = np.array([np.cos(heading[-1]), np.sin(heading[-1])])
    add(moves(count, *along), -seen.anchors.tip.along_m, seen.anchors.tip.weight)
    for place_m, (x, y), weight in zip(*seen.anchors.pins, strict=True):
        k = min(int(place_m / LINK_M) + 1, count)
        fraction = place_m / LINK_M - (k - 1)
        here = nodes[k - 1] + fraction * (nodes[k] - nodes[k - 1])
        for axis, (nx, ny) in enumerate(((1.0, 0.0), (0.0, 1.0))):
            add(moves(k, nx, ny, fraction), here[axis] - (x, y)[axis], weight)
    unit = np.eye(2 + count)
    for j in range(count):
        add(unit[2 + j], heading[j] - seen.prior[j], stiffness.prior**-2)
        if j > 0:
            bend = stiffness.bend if seen.weight[j] > 0 else stiffness.hidden
            add(unit[2 + j] - unit[1 + j], heading[j] - heading[j - 1], bend**-2)
        if j > 1:
            change = heading[j] - 2 * heading[j - 1] + heading[j - 2]
            add(unit[2 + j] - 2 * unit[1 + j] + unit[j], change, stiffness.change**-2)
    add(unit[2], np.sin(heading[0] - seen.clamp_rad), stiffness.clamp**-2)
    for axis in range(2):
        add(unit[axis], root[axis] - seen.clamp_m[axis], stiffness.root_m**-2)
    jacobian, weight = np.array(rows), np.array(weights)
    covariance = np.linalg.inv(jacobian.T @ (weight[:, None] * jacobian))
    return -covariance @ jacobian.T @ (weight * np.array(offs)), covariance


def test_nodes_of_a_quarter_circle():
    links = 90
    heading = (np.arange(links) + 0.5) * (np.pi / 2 / links)
    nodes = place_nodes(np.zeros(2), heading, 1.0)
    radius = 0.5 / np.sin(np.pi / 4 / links)
    np.testing.assert_allclose(nodes[-1], [radius, radius], rtol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(np.diff(nodes, axis=0), axis=1), 1.0)


@pytest.mark.parametrize("stiffness", [pytest.param(USUAL, marks=pytest.mark.thorough), LOOSE])
def test_recursion_equals_the_dense_solution(stiffness):
    rng = np.random.default_rng(5)
    root, heading = np.array([0.1, 0.2]), wave(40, 0.8) + rng.normal(0, 0.02, 40)
    truth = heading + 0.05 * np.cos(np.linspace(0, 5, 40))
    weight = rng.uniform(1e5, 1e7, 41)
    weight[12:19] = 0.0
    target = place_nodes(root + 1e-4, truth, LINK_M)
    pins = Pins(
        np.array([0.1, 40 * LINK_M]), np.array([target[16] + 0.001, target[40]]), np.array([3e5, 1e6])
    )
    anchors = Anchors(Tip(0.002, 1e6), pins)
    clamp = {"clamp_m": root + 2e-4, "clamp_rad": heading[0] + 0.3}
    seen = constraints(target, heading, weight, heading + 0.01, anchors, stiffness, **clamp)
    step, _ = dense_fit(root, heading, seen)
    new_root, new_heading, _ = fit_headings(root, heading, LINK_M, seen, 1)
    np.testing.assert_allclose(new_root - root, step[:2], atol=1e-9)
    np.testing.assert_allclose(new_heading - heading, step[2:], atol=1e-9)


def test_covariances_are_those_of_the_inverse_matrix():
    root, heading = np.array([0.1, 0.2]), wave(40, 0.8)
    weight = np.full(41, 1e6)
    weight[12:19] = 0.0
    target = place_nodes(root, heading, LINK_M)
    pins = Pins(np.array([0.1]), target[16:17], np.array([3e5]))
    seen = constraints(target, heading, weight, heading, Anchors(Tip(0.0, 1e6), pins))
    for _ in range(3):  # until a round changes nothing
        root, heading, recursion = fit_headings(root, heading, LINK_M, seen, 5)
    covariances = node_covariances(heading, LINK_M, recursion)
    _, covariance = dense_fit(root, heading, seen)
    jacobian = np.zeros((2, 42))
    jacobian[:, :2] = np.eye(2)
    jacobian[0, 2:27] = -LINK_M * np.sin(heading[:25])
    jacobian[1, 2:27] = LINK_M * np.cos(heading[:25])
    expected = jacobian @ covariance @ jacobian.T
    np.testing.assert_allclose(covariances[25], expected, rtol=1e-3, atol=1e-12)
    assert per_axis(covariances)[25] == pytest.approx(np.sqrt(0.5 * np.trace(expected)), rel=1e-3)


def test_fit_recovers_a_bent_chain_from_detections_across_it():
    truth = wave(50, 0.9)
    root = np.array([0.1, 0.2])
    target = place_nodes(root, truth, LINK_M)
    start = wave(50, 0.7)
    heading = start
    for _ in range(6):
        tip = place_nodes(root, heading, LINK_M)[-1]
        slide = (target[-1] - tip) @ [np.cos(heading[-1]), np.sin(heading[-1])]
        anchors = Anchors(Tip(slide, 1e8), NO_PINS)
        clamp = {"clamp_m": root, "clamp_rad": truth[0]}
        seen = constraints(target, heading, np.full(51, 1e8), start, anchors, LOOSE, **clamp)
        root, heading, recursion = fit_headings(root, heading, LINK_M, seen, 3)
    off = np.linalg.norm(place_nodes(root, heading, LINK_M) - target, axis=1)
    assert off.max() < 2e-4
    assert np.isfinite(node_covariances(heading, LINK_M, recursion)).all()


def test_a_hidden_middle_is_bridged_straight_and_less_certain():
    truth = wave(50, 0.3)
    target = place_nodes(np.zeros(2), truth, LINK_M)
    weight = np.full(51, 1e7)
    weight[20:32] = 0.0
    seen = constraints(target, truth, weight, truth, Anchors(Tip(0.0, 1e7), NO_PINS))
    _, heading, recursion = fit_headings(np.zeros(2), truth, LINK_M, seen, 2)
    sigma = per_axis(node_covariances(heading, LINK_M, recursion))[5::5]
    assert sigma[4] > 2 * sigma[2]
    assert sigma[4] > 2 * sigma[8]


def test_a_chain_longer_than_what_is_visible_slides_back_behind_the_clamp():
    truth = np.full(40, -np.pi / 2)
    clamp = np.zeros(2)
    target = place_nodes(clamp, truth, LINK_M) + np.array([0.0, 0.002])
    anchors = Anchors(Tip(-0.002, 1e8), NO_PINS)
    seen = constraints(target, truth, np.full(41, 1e7), truth, anchors, clamp_m=clamp)
    root, heading, _ = fit_headings(clamp, truth, LINK_M, seen, 3)
    np.testing.assert_allclose(heading, truth, atol=0.02)
    assert root[1] == pytest.approx(0.002, abs=2e-4)


def test_a_pin_holds_a_place_between_nodes():
    truth = np.full(40, -np.pi / 2)
    target = place_nodes(np.zeros(2), truth, LINK_M)
    pin = Pins(np.array([20.5 * LINK_M]), np.array([[0.004, -20.5 * LINK_M]]), np.array([1e10]))
    seen = constraints(target, truth, np.zeros(41), truth, Anchors(NO_TIP, pin))
    root, heading, _ = fit_headings(np.zeros(2), truth, LINK_M, seen, 4)
    nodes = place_nodes(root, heading, LINK_M)
    np.testing.assert_allclose(0.5 * (nodes[20] + nodes[21]), pin.point_m[0], atol=2e-5)


def test_a_string_flung_back_is_not_turned_around():
    back = np.full(30, np.pi)
    target = place_nodes(np.zeros(2), back, LINK_M)
    seen = constraints(target, back, np.full(31, 1e7), back, clamp_m=np.zeros(2), clamp_rad=0.0)
    _, heading, _ = fit_headings(np.zeros(2), back, LINK_M, seen, 5)
    np.testing.assert_allclose(heading, np.pi, atol=1e-9)
