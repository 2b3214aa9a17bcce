"""The uncertainty of a fit reaches the record and the report's table in readable units."""

from types import SimpleNamespace

import numpy as np
import pytest

from strandcast.config.estimate import EstimateSettings
from strandcast.dynamics.masses import mass_layout
from strandcast.estimation.uncertainty import Uncertainty, decades_of
from strandcast.estimation.unknowns import space_of
from strandcast.report.panels.parameters import _known
from strandcast.stages.estimate_record import uncertainty_record


def test_deviations_become_decades_and_intervals_values():
    space = space_of(EstimateSettings(), mass_layout(0.3, 10, []))
    d = space.dimension
    low, high = np.full(d, 0.4), np.full(d, 0.6)
    low[1] = np.nan
    known = Uncertainty(
        decades_of(space),
        np.full(d, 0.01),
        np.full(d, 0.1),
        np.eye(d),
        0.001,
        30.0,
        True,
        low,
        high,
        np.arange(d) == 0,
        np.zeros(d, dtype=bool),
    )
    record = uncertainty_record(SimpleNamespace(uncertainty=known, space=space))
    assert record.unknowns[0] == "k_s"
    assert record.in_decades == [True] * 10 + [False]
    assert record.marginal_sd[0] == pytest.approx(0.5)  # a tenth of five decades
    assert record.marginal_sd[-1] == pytest.approx(3.0)  # a tenth of 30 rad/m
    assert record.profile_low[0] == pytest.approx(1e5)
    assert record.profile_low[1] is None
    estimate = SimpleNamespace(uncertainty=record)
    deviation, interval = _known(estimate, "k_s")
    assert deviation.endswith("decades")
    assert interval.startswith("≤")
    assert "≥" not in interval
    assert _known(estimate, "c_s")[1] == ""
    assert _known(SimpleNamespace(uncertainty=None), "k_s") == ["", ""]
