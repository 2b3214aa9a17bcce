"""The string that was fitted is the string that is planned with, and is known again when it was thrown."""

from __future__ import annotations

from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest

from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import Box, load_arm
from strandcast.estimation.objective import play
from strandcast.estimation.settings import FitSettings, prior_exponents
from strandcast.estimation.space import Strings
from strandcast.estimation.throw import Task as Seen
from strandcast.experiment import EstimateSettings
from strandcast.motion.bezier import Curve, rest_heights, sample
from strandcast.motion.describe import Found, described
from strandcast.motion.task import Options, Task
from strandcast.motion.throws import World, commands, throw
from strandcast.motion.write import to_record
from strandcast.records.estimate import ENSEMBLE
from strandcast.records.tables import write_table
from strandcast.stages.estimate import _fit_settings, _members, _planned
from strandcast.stages.plan import _fitted_strings
from strandcast.string.masses import mass_layout
from strandcast.string.model import StringModel

LENGTH_M, POINTS = 0.30, 10
PIPED = mass_layout(LENGTH_M, POINTS, [0.30], [(0.12, 0.18)])
MODEL = StringModel(LENGTH_M, POINTS)


@pytest.fixture
def task(project_root) -> Task:
    arm = load_arm(project_root / "config/arms/planar3.toml")
    return Task(arm, MODEL, np.array([0.50, 0.50]), 0.02, Box((-0.75, 1.25), (-0.32, 0.80)))


@pytest.fixture
def fitted() -> Strings:
    """Return three strings with a curl, a turned clamp, a stiff pipe, a found weight and dry friction."""
    settings = FitSettings(clamp_offset=True, stiff_bend=True, bend_friction=True, find_weights=1)
    space = settings.space(PIPED, LENGTH_M)
    return space.strings(prior_exponents(space, MODEL, 3, np.random.default_rng(4)))


def test_what_the_experiment_wants_fitted_is_fitted():
    for name in ("rest_curl", "clamp_offset", "stiff_bend", "bend_friction"):
        for wanted in (True, False):
            settings = EstimateSettings.model_validate({name: wanted})
            assert getattr(_fit_settings(settings, PIPED), name) is wanted


def test_the_planner_throws_what_was_fitted(tmp_path, task, fitted):
    path = tmp_path / "ensemble.parquet"
    write_table(path, ENSEMBLE, _members(SimpleNamespace(members=fitted, member_values_m=np.arange(3.0))))
    planned = _fitted_strings(path, PIPED)
    heights = rest_heights(np.array([[3.0, 2.0, -1.0], [2.0, 4.0, 1.0], [-2.0, 3.0, 5.0]]))
    curve = Curve(np.array([0.4, -0.5, 0.3]), 0.5, heights)
    time_s, q, last = commands([sample(curve, task.step_s)], task.step_s)
    pose = hand_pose(task.arm.chain, task.arm.clamp, q[0])
    nothing = np.zeros(0)
    seen = Seen(nothing, time_s, nothing, nothing, time_s, pose, None, None)
    simulated, _ = play(MODEL, seen, fitted)
    thrown = throw(task, planned, World(), q, last)
    np.testing.assert_allclose(thrown.points_m, simulated, atol=1e-9)
    assert not np.allclose(simulated[0], simulated[1], atol=0.01)

    plan = described(task, planned, Options(), Found("refined", curve, 1, []), (thrown, None), np.zeros(3))
    known = _planned(to_record(plan, task, "test", 2, 0, {}), PIPED)
    assert known is not None
    for column in fields(Strings):
        if column.name not in ("free_masses", "found"):  # the masses tell them
            np.testing.assert_array_equal(getattr(known, column.name), getattr(fitted, column.name)[:1])
