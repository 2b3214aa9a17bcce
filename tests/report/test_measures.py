"""Distances and instants that a person can check by hand."""

import numpy as np
import pytest

from strandcast.report import numbers
from strandcast.report.measures import arc_length_m, equal_instants, path_distance_m, rms, with_gaps


def test_arc_length_bridges_gaps() -> None:
    path = np.array([[0.0, 0.0], [3.0, 4.0], [np.nan, np.nan], [3.0, 10.0]])
    assert arc_length_m(path).tolist() == [0.0, 5.0, 5.0, 11.0]


def test_instants_lie_at_equal_arc_length_not_at_equal_times() -> None:
    x = np.concatenate([np.linspace(0, 1, 101), np.linspace(1, 2, 11)[1:]])
    tip = np.column_stack([x, np.zeros_like(x)])
    rows = equal_instants(tip, 5, None)
    assert tip[rows, 0] == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0], abs=0.01)


def test_the_forced_instant_replaces_its_neighbour() -> None:
    tip = np.column_stack([np.linspace(0, 1, 101), np.zeros(101)])
    assert equal_instants(tip, 5, 30).tolist() == [0, 30, 50, 75, 100]


def test_a_tip_that_is_never_detected_has_no_instants() -> None:
    assert len(equal_instants(np.full((5, 2), np.nan), 4, None)) == 0


def test_distance_is_to_segments_not_to_samples() -> None:
    path = np.array([[0.0, 0.0], [2.0, 0.0], [np.nan, np.nan], [2.0, 2.0]])
    points = np.array([[1.0, 0.3], [2.5, 1.0], [-3.0, 4.0]])
    assert path_distance_m(points, path) == pytest.approx([0.3, 0.5, 5.0])


def test_rms_leaves_out_unknown_values() -> None:
    assert rms(np.array([3.0, np.nan, 4.0])) == pytest.approx(np.sqrt(12.5))
    assert np.isnan(rms(np.array([np.nan])))


def test_a_line_breaks_where_samples_are_missing() -> None:
    gapped = with_gaps(np.array([0.0, 1.0, 2.0, 5.0, 6.0]), np.arange(5.0))
    np.testing.assert_equal(gapped, [[0.0, 1.0, 2.0, np.nan, 5.0, 6.0], [0.0, 1.0, 2.0, np.nan, 3.0, 4.0]])


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (38.04, "38"),
        (-0.0219, "−0.0219"),
        (1e8, "1·10⁸"),
        (3.55e-3, "3.55·10⁻³"),
        (23456.0, "23456"),
        (None, "–"),
        (float("nan"), "–"),
    ],
)
def test_significant_digits(value: float | None, text: str) -> None:
    assert numbers.significant(value) == text


def test_a_result_carries_unit_and_uncertainty() -> None:
    assert numbers.millimetres(0.0123, 0.0009) == "12.3\u00a0±\u00a00.9\u00a0mm"
    assert numbers.milliseconds(-0.5) == "−500.00\u00a0ms"
    assert numbers.milliseconds(18233.99199, 2e-4) == "18233.99199\u00a0±\u00a00.00020\u00a0s"
    assert [numbers.signed(text) for text in ("-0 %", "-0.00", "-0.05", "-10")] == [
        "0 %",
        "0.00",
        "−0.05",
        "−10",
    ]
    assert numbers.percent(None) == "–"
