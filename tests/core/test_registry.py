"""The registry of extension points: entries by name from three sources, and its errors."""

from importlib.metadata import EntryPoint

import pytest

from strandcast.core.registry import Registry
from strandcast.errors import StrandcastError

PI = 3.141592653589793


@pytest.fixture
def numbers(monkeypatch: pytest.MonkeyPatch) -> Registry[float]:
    """Return a registry of numbers with one of its own and two of an installed package."""
    points = [
        EntryPoint("pi", "math:pi", "toys.numbers"),
        EntryPoint("broken", "no_such_package:e", "toys.numbers"),
    ]
    monkeypatch.setattr(
        "importlib.metadata.entry_points", lambda group: points if group == "toys.numbers" else []
    )
    return Registry("number", "toys.numbers", "toy.number", {"two": 2.0})


def test_entries_are_found_by_name(numbers: Registry[float]) -> None:
    numbers.register("three", 3.0)
    assert [numbers.get(name) for name in ("two", "three", "pi")] == [2.0, 3.0, PI]
    assert list(numbers) == ["two", "three", "pi", "broken"]
    assert numbers.known() == {"two": 2.0, "three": 3.0, "pi": PI}
    assert numbers.find("four") is None


def test_a_name_is_registered_once(numbers: Registry[float]) -> None:
    with pytest.raises(ValueError, match="'two' is registered already as number"):
        numbers.register("two", 2.5)


def test_a_listener_hears_of_every_new_entry(numbers: Registry[float]) -> None:
    calls: list[int] = []
    numbers.on_registration(lambda: calls.append(len(numbers.known())))
    numbers.register("three", 3.0)
    numbers.get("pi")
    numbers.get("pi")
    assert calls == [2, 3]


def test_an_unknown_name_is_refused_with_the_known_ones_and_the_nearest(numbers: Registry[float]) -> None:
    with pytest.raises(StrandcastError) as caught:
        numbers.get("tow", "experiment.yaml")
    error = caught.value
    assert (error.code, error.file, error.field) == ("SC-W021", "experiment.yaml", "toy.number")
    assert error.what == "there is no number 'tow'; available: broken, pi, two"
    assert str(error.fix).startswith("did you mean 'two'?")
    assert error.exit_code == 3


def test_an_entry_that_cannot_be_imported_is_named(numbers: Registry[float]) -> None:
    with pytest.raises(StrandcastError, match="SC-W013.*'broken'.*ModuleNotFoundError.*no_such_package"):
        numbers.get("broken")
