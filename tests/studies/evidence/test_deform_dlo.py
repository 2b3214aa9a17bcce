"""Cables driven at both ends in space: baselines, and the fitted string on real data."""

from pathlib import Path

import numpy as np
import pytest

from strandcast_studies.evidence import deform_dlo
from strandcast_studies.evidence.figure import Figure


def translated(frames: int = 20) -> np.ndarray:
    rng = np.random.default_rng(3)
    cable = np.cumsum(rng.uniform(0.02, 0.1, (13, 3)), axis=0)
    return np.stack([cable + k * np.array([1e-3, -2e-3, 5e-4]) for k in range(frames)])[None]


def test_carried_is_exact_for_a_cable_moved_as_a_whole():
    moved = translated()
    assert max(deform_dlo.errors_m(deform_dlo.carried, moved)) < 1e-9
    coordinate_m = 9.5 * (1e-3 + 2e-3 + 5e-4) / 3 * 9 / 13
    distance_m = 9.5 * np.linalg.norm([1e-3, 2e-3, 5e-4])
    assert deform_dlo.errors_m(deform_dlo.held, moved) == pytest.approx((coordinate_m, distance_m))


def test_a_glitch_is_not_counted():
    jumping = translated()
    jumping[0, 7, 5] += 0.3
    assert max(deform_dlo.errors_m(deform_dlo.carried, jumping)) < 1e-9


def sequences(real_data: Path, cable: str, part: str) -> np.ndarray:
    return np.load(real_data / "deform_dlo" / f"{cable}_{part}.npy")


def predicted(real_data: Path, cable: str) -> dict[str, Figure]:
    """Return the figures of a cable's evaluation sequences, by the end of their names."""
    training, evaluation = (sequences(real_data, cable, part) for part in ("train", "eval"))
    start = f"deform_dlo.coordinate.{cable}."
    return {f.name.removeprefix(start): f for f in deform_dlo.predicted(cable, training, evaluation)}


@pytest.mark.thorough
def test_fitted_string_on_real_data(real_data):
    first, second = (predicted(real_data, cable) for cable in ("DLO1", "DLO4"))
    assert first["carried_by_the_ends"].value == pytest.approx(33.1, abs=0.2)
    assert first["shape_held"].value == pytest.approx(56.6, abs=0.2)
    assert first["string"].value < 9.9
    assert second["string"].value < 5.5
    assert len(second["string"].detail["unknowns"]) <= 10


@pytest.mark.thorough
def test_each_half_is_predicted_from_the_other_and_friction_that_sticks_fits_too(real_data, tmp_path):
    """On a second of four sequences of a cable: fits take a tenth of the time that they take on all."""
    for part in ("train", "eval"):
        np.save(tmp_path / f"DLO4_{part}.npy", sequences(real_data, "DLO4", part)[:4, :100])
    figures = {figure.name.removeprefix("deform_dlo."): figure for figure in deform_dlo.measure(tmp_path)}
    halves = [f"held_out.DLO4.{way}" for way in ("even_to_odd", "odd_to_even")]
    strings = [f"{name}.{string}" for name in (*halves, "coordinate.DLO4") for string in ("string", "sticks")]
    carried = figures["coordinate.DLO4.carried_by_the_ends"].value
    assert carried > 20.0
    assert [name for name in strings if figures[name].value > 0.3 * carried] == []
    sticking = figures["coordinate.DLO4.sticks"].detail["unknowns"]
    assert len(sticking) == len(figures["coordinate.DLO4.string"].detail["unknowns"]) + 2
