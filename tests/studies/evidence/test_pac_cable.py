"""Real cables: their start, fitted to one motion and predicted in the other."""

import numpy as np
import pytest

from strandcast_studies.evidence import pac_cable


@pytest.mark.parametrize("cable", pac_cable.CABLES)
def test_the_start_shape_goes_through_the_markers(real_data, cable):
    series = pac_cable.read(real_data / "pac_cable", pac_cable.FREE, cable)
    n = series.points
    off = np.linalg.norm(series.start_m[[n // 2 - 1, n - 1]] - series.markers_m[0], axis=1)
    assert off.max() < 0.006
    later = series.markers_m[1, 1] - series.markers_m[0, 1]
    assert series.start_velocity_m_s[-1] == pytest.approx(30 * later, abs=0.35)


@pytest.mark.parametrize(
    ("cable", "percent", "stiffness"),
    [("black_weighted", 1.3, (0.08, 0.14)), ("black_short_weighted", 2.9, (0.075, 0.12))],
)
def test_a_free_swing_predicts_the_driven_series(real_data, cable, percent, stiffness):
    folder = real_data / "pac_cable"
    free, driven = (pac_cable.read(folder, kind, cable) for kind in (pac_cable.FREE, pac_cable.DRIVEN))
    found = pac_cable.fit(free, pac_cable.CABLE, pac_cable.weight_kg(folder, cable))
    error_mm = pac_cable.tip_error_mm(driven, found)
    assert 0.1 * error_mm / driven.length_m < percent
    assert error_mm < 0.4 * min(pac_cable.trivial_mm(driven, free).values())
    assert stiffness[0] < np.exp(found["log_stiffness"]) < stiffness[1]  # the authors': 0.118 and 0.101


def test_friction_that_sticks_lets_both_motions_ask_for_the_same_stiffness(real_data):
    """The driven series of the short, light cable bends it so little that its friction hardly slips."""
    folder, cable = real_data / "pac_cable", "black_short_unweighted"
    free, driven = (pac_cable.read(folder, kind, cable) for kind in (pac_cable.FREE, pac_cable.DRIVEN))
    ratios, errors_mm = [], []
    for names in (pac_cable.CABLE, tuple(name for name in pac_cable.CABLE if name != "log_stick")):
        a, b = (pac_cable.fit(series, names, 0.0) for series in (free, driven))
        ratios.append(np.exp(b["log_stiffness"] - a["log_stiffness"]))
        errors_mm.append((pac_cable.tip_error_mm(driven, a), pac_cable.tip_error_mm(free, b)))
    assert ratios[0] == pytest.approx(1.0, abs=0.4)
    assert ratios[1] > 3.0
    assert errors_mm[0][0] < 0.8 * min(pac_cable.trivial_mm(driven, free).values()) < errors_mm[1][0]
    assert errors_mm[0][1] < 0.8 * min(pac_cable.trivial_mm(free, driven).values()) < errors_mm[1][1]


def test_both_predictors_without_a_model_agree_when_the_hand_rests(real_data):
    free = pac_cable.read(real_data / "pac_cable", pac_cable.FREE, "black_weighted")
    still = pac_cable.trivial_mm(free, free)
    assert still["rest_held"] == pytest.approx(still["hand_copied"], abs=1.0)  # its hand does not move
    assert 60.0 < still["rest_held"] < 100.0
