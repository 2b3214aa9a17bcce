"""Rest shapes in space, from soft and heavy to stiff and light, straight to coiled: no force is left over."""

from itertools import product

import numpy as np
import pytest
from arrays import simulate_batch, start_shape, strings_of
from proofs_space import first_clamp, pose_of, poses_in_plane, swung
from reference_space import ClampState, SpatialEquations

from strandcast.dynamics import simulate as simulation
from strandcast.dynamics.batch import HandPath
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.simulate import NO_REST_SHAPE, OK
from strandcast.errors import StrandcastError

LENGTH_M, GRAVITY_M_S2 = 0.5, 9.81
STIFFNESS = (1e-5, 1e-3, 1e-1)  # N m^2
DENSITY = (1e-3, 40e-3)  # kg/m
CURL, TORSION = (0.0, 3.0, 12.0), (0.0, 20.0)  # rad over the length, rad/m
SIDES = np.array([0.8, 0.6])  # left and up
UP = np.r_[np.zeros(3), 0.0, 0.0, 1.0, 1.0, 0.0, 0.0]


def parameters_of(stiffness: float, density: float, n: int) -> np.ndarray:
    """Ten parameters of a cable that stretches as little as one of 20 mm thickness, or as its weight asks."""
    spacing = LENGTH_M / n
    k = stiffness / (density * spacing**2)
    stretch = max(4e4 * k, 1e3 * n * GRAVITY_M_S2 / spacing)
    return np.array([stretch, 0.0, k, 0.0, k, 0.0, 0.0, 0.0, 2.0 * k, 0.0])


def far_clamp(t: float) -> ClampState:
    at = swung(t, 1.0, -0.7)
    return at._replace(place=first_clamp(t).place + np.array([0.3, 0.05, 0.1]))


@pytest.mark.parametrize("two_ends", [False, True], ids=["one end", "two ends"])
@pytest.mark.parametrize("n", [10, 20, 40])
def test_no_force_is_left_at_rest(n, two_ends):
    model = StringModel(LENGTH_M, n)
    clamp, far = first_clamp(0.0), far_clamp(0.0)
    pose = np.r_[pose_of(clamp), pose_of(far)] if two_ends else pose_of(clamp)
    cases = list(product(STIFFNESS, DENSITY, CURL, TORSION))
    rows = np.array([parameters_of(stiffness, density, n) for stiffness, density, _, _ in cases])
    curl = np.array([case[2] / LENGTH_M for case in cases])[:, None] * SIDES
    torsion = np.array([case[3] for case in cases])
    masses = np.ones((len(cases), n))
    at_s = np.zeros(1)
    points, status = simulate_batch(
        model,
        rows,
        masses,
        np.array([0.0, 1.0]),
        np.array([pose, pose]),
        at_s,
        rest_curl_rad_m=curl,
        rest_torsion_rad_m=torsion,
    )
    assert (status == OK).all()
    still = [each._replace(velocity=np.zeros(3), rate=np.zeros(3)) for each in (clamp, far)]
    for k, x in enumerate(points[:, 0]):
        equations = SpatialEquations(
            rows[k],
            masses[k],
            model.spacing_m,
            curl_rad_m=curl[k],
            torsion_rad_m=float(torsion[k]),
            gravity_m_s2=GRAVITY_M_S2,
        )
        left_over = equations.accelerations(x, np.zeros_like(x), still[0], still[1] if two_ends else None)
        # Over the force with which a bend of the whole string, or its weight, resists.
        resists = GRAVITY_M_S2 + 3.0 * rows[k, 2] * model.spacing_m / (n * LENGTH_M**2)
        assert np.abs(left_over).max() / resists < 1e-4, cases[k]


@pytest.mark.parametrize("angle", [-1.57, 0.0, 0.8])
def test_coils_rest_in_the_plane_as_in_space(angle):
    """Coils have many segments that point upwards, whose weight works against the plane's first search."""
    n, pose = 20, np.array([0.0, 0.0, angle])
    in_plane = poses_in_plane(pose[None], np.zeros(3), np.eye(3)[0], np.eye(3)[2])[0]
    for turn, (stiffness, density) in product((12.0, 20.0), ((1e-5, 1e-3), (1e-5, 5e-3), (1e-4, 40e-3))):
        row, curl = parameters_of(stiffness, density, n), turn / LENGTH_M
        model = StringModel(LENGTH_M, n)
        flat = start_shape(model, row, np.ones(n), pose, rest_curl_rad_m=curl)
        start = np.insert(flat[1:], 1, 0.0, axis=1)
        spatial = start_shape(model, row, np.ones(n), in_plane, start, settle=True, rest_curl_rad_m=curl)
        np.testing.assert_allclose(spatial[1:], start, atol=1e-6)


def test_an_upright_string_falls_to_a_side():
    """Upright, without curl, is a saddle of the energy for a string too long to stand."""
    model = StringModel(LENGTH_M, 20)
    soft = parameters_of(1e-3, 40e-3, 20)
    upright = np.array([0.0, 0.0, 1.0]) * model.spacing_m * np.arange(1, 21)[:, None]
    points = start_shape(model, soft, np.ones(20), UP, upright, settle=True)
    assert points[-1, 2] < 0.0
    stiff = parameters_of(1.0, 40e-3, 20)
    standing = start_shape(model, stiff, np.ones(20), UP, upright, settle=True)
    np.testing.assert_allclose(standing[1:], upright, atol=1e-4)


def test_a_string_without_a_rest_shape_is_reported():
    model = StringModel(LENGTH_M, 10)
    rows = np.array([parameters_of(1e-3, 5e-3, 10)] * 2)
    rows[1, 2] = rows[1, 4] = np.nan
    time_s, poses = np.array([0.0, 0.1]), np.array([UP, UP])
    points, status = simulate_batch(model, rows, np.ones((2, 10)), time_s, poses, time_s)
    assert list(status) == [OK, NO_REST_SHAPE]
    assert np.isfinite(points[0]).all()
    assert np.isnan(points[1, :, 1:]).all()
    with pytest.raises(StrandcastError, match="no rest shape was found for any of 1 strings") as found:
        simulation.simulate_batch(
            model, strings_of(rows[1:], np.ones((1, 10))), HandPath(time_s, poses), time_s
        )
    assert found.value.code == "SC-E003"
