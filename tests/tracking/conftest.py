"""The tracker's small world, filmed once for all tests."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

_SPEC = importlib.util.spec_from_file_location("tracking_scene", Path(__file__).with_name("scene.py"))
assert _SPEC is not None
assert _SPEC.loader is not None
_SCENE = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(_SCENE)


@pytest.fixture(scope="session")
def scene() -> ModuleType:
    """Return the module that draws the small world."""
    return _SCENE


@pytest.fixture(scope="session")
def filmed(scene, tmp_path_factory):
    """Return path, hand poses and curves of a filmed swing."""
    path = tmp_path_factory.mktemp("film") / "swing.mkv"
    return (path, *scene.film(path))
