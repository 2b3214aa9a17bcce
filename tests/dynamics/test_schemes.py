"""Integration schemes: one of another package, and the names that are refused."""

import importlib.util
import re
import sys
import types

import numpy as np
import pytest
from arrays import simulate_batch

from strandcast.dynamics.model import StringModel
from strandcast.dynamics.schemes.registry import SCHEMES
from strandcast.dynamics.simulate import OK
from strandcast.errors import StrandcastError

TIME_S = np.linspace(0.0, 0.08, 41)
POSE = np.tile([0.1, 0.2, -np.pi / 2], (len(TIME_S), 1))
PARAMETERS = np.array([[2e7, 20.0, 0.8, 0.01, 0.5, 0.005, 0.01, 0.2, 2.0, 0.02]] * 11)


@pytest.fixture(scope="module")
def file(project_root, tmp_path_factory):
    """Return a file outside of the package with the scheme of the handbook's page."""
    page = (project_root / "docs/extending/integrator-scheme.md").read_text(encoding="utf-8")
    file = tmp_path_factory.mktemp("package") / "free_fall.py"
    file.write_text(re.search(r"```python\n(.*?)```", page, re.DOTALL)[1], encoding="utf-8")
    return file


def load(file):
    spec = importlib.util.spec_from_file_location("free_fall", file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.FREE_FALL


@pytest.fixture(scope="module")
def toy(file):
    scheme = load(file)
    SCHEMES.register("free_fall", scheme)
    return scheme


def test_a_scheme_of_another_package_is_an_integrator_by_name(toy):
    model = StringModel(0.3, 6, integrator=toy.name)
    points, status = simulate_batch(model, PARAMETERS, np.ones((11, 6)), TIME_S, POSE, TIME_S)
    assert set(status) == {OK}
    # Points that are not connected fall freely; the scheme is of first order.
    fallen_m = 0.5 * 9.81 * TIME_S**2
    np.testing.assert_allclose(
        points[..., 1:, 1],
        np.broadcast_to(points[:, :1, 1:, 1] - fallen_m[:, None], points[..., 1:, 1].shape),
        atol=9.81 * TIME_S[-1] * model.dt_s,
    )
    np.testing.assert_allclose(points[:, :, 0], np.broadcast_to(POSE[:, :2], (11, 41, 2)), atol=1e-12)
    built_in, _ = simulate_batch(StringModel(0.3, 6), PARAMETERS, np.ones((11, 6)), TIME_S, POSE, TIME_S)
    assert np.ptp(built_in[:, :, -1, 1]) < 1e-6  # a string at rest stays there


def test_machine_code_is_shared_only_if_others_can_import_the_scheme(file, monkeypatch):
    assert load(file).version != load(file).version
    monkeypatch.setitem(sys.modules, "free_fall", types.ModuleType("free_fall"))
    assert load(file).version == load(file).version


def test_a_name_is_registered_once(toy):
    with pytest.raises(ValueError, match="registered already"):
        SCHEMES.register("free_fall", toy)


def test_an_unknown_scheme_is_refused_with_the_known_ones():
    with pytest.raises(StrandcastError, match="SC-E006.*euler.*lfcn.*semi_implicit") as refused:
        SCHEMES.get("runge_kutta")
    assert refused.value.field == "estimate.integrator"
