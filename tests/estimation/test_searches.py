"""The searches on functions whose minimum is known, and on a throw at an equal budget."""

import re

import numpy as np
import pytest

from strandcast.config.estimate import THOROUGH_EVALUATIONS, EstimateSettings
from strandcast.dynamics.parameters import GRAVITY_M_S2
from strandcast.errors import StrandcastError
from strandcast.estimation.ensemble import distant_members
from strandcast.estimation.estimate import search
from strandcast.estimation.fit import disagreement
from strandcast.estimation.fit_objective import EvaluationLog
from strandcast.estimation.optimisers.evolution import evolve
from strandcast.estimation.optimisers.optimiser import SearchStart
from strandcast.estimation.optimisers.paper import shrinking_search
from strandcast.estimation.optimisers.registry import OPTIMISERS
from strandcast.estimation.optimisers.screened import plausible
from strandcast.estimation.optimisers.starts import latin_hypercube

from .known_string import MODEL, objective_of, observed_throw

GOAL = np.array([0.3, 0.8, 0.55])


def bowl(chi):
    value = np.linalg.norm((chi - GOAL) * [1.0, 3.0, 0.3], axis=1)
    value[chi[:, 0] > 0.9] = np.inf
    value[chi[:, 1] < 0.1] = np.nan
    return value


def test_paper_search_is_equation_3_around_the_best_so_far():
    centre = np.array([0.5, 0.5, 0.98])
    log = EvaluationLog(lambda chi: np.linalg.norm(chi - centre, axis=1))  # the centre stays the best
    shrinking_search(log, centre, 400, np.random.default_rng(1), trials=2, chi_0=0.4, beta=0.99)
    chi, _ = log.all()
    assert log.count == 400
    reach = 0.4 / 2 * 0.99 ** np.arange(400)
    off = np.abs(chi - centre).max(axis=1)
    assert np.all(off <= reach + 1e-12)
    assert off[1:100].max() > 0.9 * reach[1]
    assert chi.max() == 1.0  # clipped
    assert np.mean(chi[1:50] - centre) < 0  # both ways, but for the clipping
    log = EvaluationLog(bowl)
    shrinking_search(log, np.array([0.85, 0.2, 0.1]), 600, np.random.default_rng(2), chi_0=0.2, beta=0.998)
    assert log.best()[1] < 0.1  # farther than its first reach


def test_differential_evolution_finds_it_too_and_reports_convergence():
    log, random = EvaluationLog(lambda chi: 1.0 + bowl(chi)), np.random.default_rng(3)
    population = random.random((20, 3))
    assert evolve(log, population, 3000, random, patience=1e-4)
    np.testing.assert_allclose(log.best()[0], GOAL, atol=5e-3)
    assert log.rejected() > 0
    assert np.all(np.diff(log.convergence()[1]) <= 0)
    assert log.count < 2500
    short = EvaluationLog(bowl)
    assert not evolve(short, population, 70, np.random.default_rng(3))
    assert short.count == 60  # whole generations only


def test_nan_never_wins():
    log = EvaluationLog(lambda chi: np.where(chi[:, 0] < 0.5, np.nan, chi[:, 0]))
    log(np.array([[0.1], [0.7], [0.6]]))
    assert log.best()[1] == 0.6


@pytest.fixture(scope="module")
def by_chance():
    """The median best E of 400 strings drawn uniformly."""
    objective = objective_of([observed_throw(1.0)], EstimateSettings())
    drawn = np.random.default_rng(1).random((5, 400, objective.space.dimension))
    return np.median([objective.cost(draws).min() for draws in drawn])


@pytest.mark.parametrize(
    ("name", "evaluations", "seeds"),
    [("descent", 400, 3), ("paper", 400, 9), ("thorough", 4000, 3)],
)
def test_the_median_search_beats_chance_within_its_budget(name, evaluations, seeds, by_chance, monkeypatch):
    """Of 30 seeds, 28 or more do with `paper`, and all with the others, whatever the register."""
    monkeypatch.setitem(shrinking_search.__kwdefaults__, "beta", 0.99)  # the paper's suits a larger budget
    settings = EstimateSettings(search=name, evaluations=evaluations)
    objective = objective_of([observed_throw(1.0)], settings)
    logs = [
        search(objective, settings, np.random.default_rng(k), SearchStart(None, 1), evaluations)
        for k in (1, *range(1, 1 + seeds))
    ]
    assert logs[0].all()[0].tobytes() == logs[1].all()[0].tobytes()
    assert all(log.count <= evaluations for log in logs)
    assert np.median([log.best()[1] for log in logs[1:]]) < by_chance


def test_a_screened_search_in_the_plane_begins_with_cables_of_all_stiffnesses():
    """The prior of cords has none that its weight hardly bends."""
    space, draw = objective_of([observed_throw(1.0)], EstimateSettings()).space, np.random.default_rng(1)
    values = space.values(plausible(space, MODEL, draw.random((64, space.dimension))))
    of = dict(zip(space.names, values.T, strict=True))
    bending_length = np.cbrt(of["k_h"] * MODEL.spacing_m**2 / GRAVITY_M_S2) / MODEL.length_m
    assert bending_length.min() < 0.05
    assert bending_length.max() > 0.4
    np.testing.assert_allclose(of["k_sh"], of["k_h"])
    np.testing.assert_allclose(of["rest_curl_rad_m"], 0.0, atol=1e-9)
    assert EstimateSettings().of_captures().search == "screened"
    assert EstimateSettings(search="thorough").of_captures().search == "thorough"


def test_independent_searches_that_end_in_different_strings_are_a_warning():
    log = EvaluationLog(bowl)
    log(GOAL[None] + [[0.05, 0.0, 0.0]])
    best = log.best()[1]
    for ends, warned in (
        ([], None),
        ([1.0, 1.09, 3.0, 4.0], None),
        ([1.0, 1.12, 3.0, 4.0], "the 4 independent searches disagree: 1 of them"),
        ([1.12, 1.15, 3.0, 4.0], "the 4 independent searches disagree: none of them"),
    ):
        log.ends = [best * end for end in ends]
        found = disagreement(log)
        assert [text[: len(warned or "")] for text in found] == ([warned] if warned else [])


def test_a_thorough_search_simulates_more_unless_told_how_many():
    assert EstimateSettings(search="thorough").evaluations == THOROUGH_EVALUATIONS
    assert EstimateSettings(search="thorough", evaluations=5000).evaluations == 5000
    assert EstimateSettings().evaluations == 4000


def test_latin_hypercube_fills_every_slice():
    draws = latin_hypercube(20, 4, np.random.default_rng(5))
    np.testing.assert_array_equal(
        np.sort((draws * 20).astype(int), axis=0), np.tile(np.arange(20)[:, None], 4)
    )


def test_members_are_near_optimal_and_apart():
    rng = np.random.default_rng(6)
    chi = rng.random((400, 2))
    values = 1.0 + np.abs(chi[:, 0] - 0.5)
    rows = distant_members(chi, values, 4)
    assert rows[0] == np.argmin(values)
    assert values[rows].max() <= 1.1 * values.min()
    assert np.ptp(chi[rows, 1]) > 0.9  # spread where the value is flat
    assert len(distant_members(chi[:2], np.array([1.0, np.inf]), 4)) == 1


def test_an_optimiser_of_another_package_is_a_search_by_name(project_root):
    page = (project_root / "docs/extending/optimiser.md").read_text(encoding="utf-8")
    names = {}
    exec(re.search(r"```python\n(.*?)```", page, re.DOTALL)[1], names)
    halving = names["halving"]
    OPTIMISERS.register("halving", halving)
    settings = EstimateSettings(search="halving", evaluations=400)
    objective = objective_of([observed_throw(1.0)], settings)
    log = search(objective, settings, np.random.default_rng(1), SearchStart(None, 1), 400)
    assert log.count == 400
    assert not log.converged
    assert log.best()[1] < 0.5 * log.all()[1][0]
    with pytest.raises(ValueError, match="registered already"):
        OPTIMISERS.register("halving", halving)


def test_an_unknown_optimiser_is_refused_with_the_known_ones():
    with pytest.raises(StrandcastError, match="SC-W021.*descent.*paper, screened, thorough") as refused:
        OPTIMISERS.get("annealing")
    assert refused.value.field == "estimate.search"
