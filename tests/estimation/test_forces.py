"""An optional force is kept where it predicts better what was not fitted, and only there."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from tests.estimation.test_cable_fit import LENGTH_M, PLACES, TRUTH, series

from strandcast.config.estimate import EstimateSettings
from strandcast.core.strings import BEND_FRICTION, FORCES
from strandcast.estimation import forces
from strandcast.estimation.cable_series import CableSeries
from strandcast.estimation.cable_space import space_of_cable
from strandcast.estimation.cross_validation import folds_of
from strandcast.estimation.estimate import find_string
from strandcast.estimation.fit_objective import EvaluationLog, FitObjective
from strandcast.estimation.optimisers.optimiser import SearchStart
from strandcast.estimation.unknowns import forces_of
from strandcast.estimation.windows import parts_of_series

NOISE_M = 5e-4
RUBBED = TRUTH | {"friction_turn_rad": 1.0, "stick_turn_rad": 0.1}


@pytest.mark.thorough
@pytest.mark.parametrize("true", [[], ["friction_stick"]], ids=["plain", "rubbed"])
def test_friction_is_kept_where_the_cable_has_it_and_only_there(true: list[str]) -> None:
    """E of what was not fitted: 1.81 instead of 2.11 ± 0.21 mm, or the cost is lowered by less than 1 %."""
    model, truth = space_of_cable(LENGTH_M, False, forces={"rest_curl", "taper", *true})
    chi = truth.exponents(np.array([RUBBED[name] for name in truth.names]))
    seen, random = [], np.random.default_rng(1)
    for phase in (0.0, 1.3):
        bare = series(False, phase)
        markers_m = bare.predicted(model, truth.strings(chi))
        markers_m += random.normal(0.0, NOISE_M, markers_m.shape)
        seen.append(CableSeries(bare.time_s, bare.pose, markers_m, PLACES))
    _, box = space_of_cable(LENGTH_M, False)
    found = find_string(
        {"": parts_of_series(seen, model.points, last=False)},
        model,
        box,
        EstimateSettings().in_space(thrown=False),
        partial(np.random.default_rng, 1),
        SearchStart(None, len(seen)),
        ["friction_stick"],
    )
    assert [force.name for force in found.forces if force.kept] == true
    assert ("friction_turn_rad" in found.values()) is bool(true)


def test_a_search_that_has_not_converged_tries_nothing() -> None:
    model, box = space_of_cable(LENGTH_M, False)
    parts = {"": parts_of_series([series(False, 0.0)], model.points, last=False)}
    few = EstimateSettings(evaluations=100).in_space(thrown=False)
    start, random = SearchStart(None, 1), partial(np.random.default_rng, 1)
    assert find_string(parts, model, box, few, random, start, ["drag_along"]).forces == ()


def test_the_settings_say_which_forces_are_fitted_and_which_are_tried() -> None:
    assert forces_of("paper") == (set(), [])
    assert forces_of(list(FORCES)) == (set(FORCES), [])
    assert forces_of("auto") == ({"rest_curl"}, ["drag_along"])
    assert forces_of("auto", in_plane=False) == ({"rest_curl", "drag_along"}, [])
    captured, tried = forces_of("auto", in_plane=False, thrown=False)
    assert captured == {"rest_curl", "taper"}
    assert tried == ["drag_along", "friction_stick", "stiff_bend", "marker_shift"]


def test_a_window_that_is_left_out_is_in_no_other() -> None:
    model, box = space_of_cable(LENGTH_M, False)
    long = series(False, 0.0)
    parts = parts_of_series([long], model.points, last=False)
    halves = tuple(long.prepared(first, first + 90, model.points) for first in (0, 30, 60))
    parts = parts._replace(throws=halves, trial=np.zeros(3, dtype=int))
    objective = FitObjective(model, box, halves, np.full(3, 1.0 / 3.0), "world", True)
    folds = folds_of(objective, parts)
    assert len(folds) == 3
    for rest, left_out in folds:
        out = np.concatenate([throw.frames for throw in left_out])
        for throw in rest.throws:
            assert not np.isin(throw.frames[throw.weight.any(axis=1)], out).any()
    newest = replace(objective, shares=np.array([0.0, 0.0, 1.0]))
    assert all(np.isfinite(rest.shares).all() for rest, _ in folds_of(newest, parts))


def test_a_string_that_fails_where_it_was_not_fitted_is_not_compared_there(monkeypatch) -> None:
    """With too little to compare, the force is left out, and the fit goes on."""
    model, box = space_of_cable(LENGTH_M, False)
    parts = parts_of_series([series(False, 0.0)], model.points, last=False)
    objective = FitObjective(model, box, parts.throws, parts.shares(1.0), "world", True)
    log, better = EvaluationLog(objective.cost), EvaluationLog(objective.cost)
    log.found, better.found, better.converged = (np.zeros(2), 2e-3), (np.zeros(2), 1e-3), True
    found = forces._Search("drag_along", objective, better)
    errors = iter([np.array([np.inf, 3.0, 3.1, 2.9]), np.array([1.0, 1.0, 1.1, 1.0])])
    monkeypatch.setattr(forces, "fold_errors", lambda folds, chi: next(errors))
    assert forces._judged(found, objective, log, parts).held_out_m == pytest.approx([3.0, 3.1 / 3])
    errors = iter([np.array([np.inf, np.inf, 3.0, 3.0]), np.array([1.0, 1.0, 1.0, 1.0])])
    left_out = forces._judged(found, objective, log, parts)
    assert (left_out.kept, left_out.held_out_m) == (False, None)


def test_a_force_is_only_kept_from_a_fit_that_had_all_of_it() -> None:
    _, box = space_of_cable(LENGTH_M, False)
    plain = box.strings(np.full((1, box.dimension), 0.5))
    rubs = plain.with_values(**{BEND_FRICTION: np.ones(1)})
    sticks = rubs.with_values(friction_stick_rad_m=np.ones(1))
    kept = [forces.kept_forces(["friction_stick"], box, each) for each in (None, plain, rubs, sticks)]
    assert kept == [[], [], [], ["friction_stick"]]
    assert box.with_force("taper") is box
