"""The lab as a Gymnasium environment: what it shows, what it plays, and what the table says."""

from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env
from tests.host_needs import needs_shared_locks

from strandcast.arm.dynamics import chain_torques
from strandcast.core.trajectory import JointTrajectory
from strandcast.lab.variation import draw_variation
from strandcast.planning.bezier import sample
from strandcast.planning.draw import CurvePrior, JointBounds, draw_first
from strandcast.seeds import rng
from strandcast.stages.context import context_of
from strandcast_studies.benchmarks.agents import baselines, run
from strandcast_studies.benchmarks.agents.actions import KINDS, curve_action, curve_asked, within_limits
from strandcast_studies.benchmarks.agents.env import Observation, ThrowEnv
from strandcast_studies.benchmarks.agents.tasks import Task, arm_of, named_settings, task_of
from strandcast_studies.benchmarks.loop.oracle import missed_m
from strandcast_studies.benchmarks.loop.run import prepare, root_with_arms

pytestmark = pytest.mark.thorough

ID = "strandcast_studies.benchmarks.agents:strandcast/Throw-v0"
ARM = arm_of("planar3")
STEP_S = 1.0 / ARM.log_rate_hz


def a_curve():
    prior = CurvePrior("rest", (0.4, 0.5), 60.0)
    return draw_first(1, prior, JointBounds(ARM, STEP_S, ARM.dynamics), np.random.default_rng(1))[0]


def an_action(env: ThrowEnv, seed: int = 0) -> np.ndarray:
    random = np.random.default_rng(seed)
    return baselines.RandomSearch(env.action_space, env.preflight, random, 0).next_action(0)


def with_other_masses(task: Task) -> Task:
    settings = task.experiment.model_dump(mode="json")
    settings["lab"]["string"] |= {"linear_density_kg_m": 0.05, "curl_rad_m": -3.0}
    for weight in settings["string"]["weights"]:
        weight["mass_kg"] *= 3.0
    return Task(task.name, type(task.experiment).model_validate(settings))


def assert_same(one: Observation, other: Observation) -> None:
    for name in one:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


@pytest.mark.filterwarnings("ignore:.*render.*", "ignore:.*no spec.*")
@pytest.mark.parametrize("action", KINDS)
def test_the_librarys_checker_finds_nothing(action: str) -> None:
    check_env(gymnasium.make(ID, action=action).unwrapped)


def test_masses_show_only_in_throws() -> None:
    task = next(task for task in (task_of(0, seed) for seed in range(20)) if task.experiment.string.weights)
    env = ThrowEnv()
    before, info = env.reset(options={"task": task})
    action = an_action(env)
    after = env.step(action)[0]
    other_before, other_info = env.reset(options={"task": with_other_masses(task)})
    other_after = env.step(action)[0]
    assert_same(before, other_before)
    assert info == other_info == {}
    assert np.abs(after["points_m"] - other_after["points_m"]).max() > 0.01


def test_a_seed_determines_the_episode_and_each_throw_scatters() -> None:
    env = ThrowEnv(1, stop_at_hit=False)
    runs = []
    for seed in (7, 7, 8):
        before, _ = env.reset(seed=seed)
        action = an_action(env)
        runs.append([before, *(env.step(action)[0] for _ in range(2))])
    for one, other in zip(runs[0], runs[1], strict=True):
        assert_same(one, other)
    first, second = (thrown["closest_m"] for thrown in runs[0][1:])
    assert 0.003 < np.linalg.norm(first - second) < 0.1  # far more than the tracker's noise
    assert np.linalg.norm(first - runs[2][1]["closest_m"]) > 1e-4


def test_a_throw_is_the_loops_and_is_seen_with_a_trackers_noise(tmp_path: Path) -> None:
    name, settings = named_settings(3, 11)
    root = root_with_arms(tmp_path)
    prepare(root, name, settings)
    variation = draw_variation(rng(name, 11, 1, "lab-throw"), 3, 1.0)
    curve = a_curve()
    expected_m = missed_m(context_of(root, name), ARM, sample(curve, STEP_S), variation)
    env = ThrowEnv(3)
    env.reset(seed=11)
    observation, reward, _, _, info = env.step(curve_action(ARM, curve))
    assert -reward == info["miss_m"] == pytest.approx(expected_m, abs=1e-5)
    assert 1e-6 < abs(np.linalg.norm(observation["closest_m"]) - expected_m) < 0.003
    assert observation["seen"][:40].mean() > 0.9
    assert observation["joints_rad"][0] == pytest.approx(curve.q0_rad, abs=0.02)


def test_what_leaves_the_picture_is_not_seen() -> None:
    task = task_of(1, 7)
    env = ThrowEnv()
    env.reset(options={"task": task})
    action = an_action(env)
    whole = env.step(action)[0]
    x_m = whole["points_m"][:, -1, 0]
    edge_m = float(0.5 * (x_m[0] + x_m.max()))
    view = task.experiment.workspace_m.model_copy(update={"x_m": (-0.75, edge_m)})
    env.reset(options={"task": Task(task.name, task.experiment.model_copy(update={"workspace_m": view}))})
    part = env.step(action)[0]
    np.testing.assert_array_equal(part["seen"], whole["seen"] * (whole["points_m"][:, :, 0] <= edge_m))
    assert 0 < part["seen"][:, -1].sum() < whole["seen"][:, -1].sum()
    assert (part["points_m"][part["seen"] == 0.0] == 0.0).all()


@pytest.mark.parametrize("kind", KINDS)
def test_played_motions_keep_the_arms_limits(kind: str) -> None:
    random, limits, dynamics = np.random.default_rng(0), ARM.limits, ARM.dynamics
    shape, asked = KINDS[kind]
    for scale in (0.1, 1.0, 1.0, 1.0, 1.0):
        found = within_limits(ARM, asked(ARM, np.sign(random.uniform(-1, 1, shape(ARM))) * scale))
        assert found is not None
        motion = found[0]
        assert (motion.q_rad >= limits.lower_rad - 1e-9).all()
        assert (motion.q_rad <= limits.upper_rad + 1e-9).all()
        assert (np.abs(motion.qd_rad_s) <= limits.velocity_rad_s).all()
        assert (np.abs(motion.qdd_rad_s2) <= limits.acceleration_rad_s2).all()
        assert motion.qd_rad_s[[0, -1]] == pytest.approx(0.0, abs=1e-9)
        turned = np.cumsum(0.5 * (motion.qd_rad_s[1:] + motion.qd_rad_s[:-1]) * STEP_S, axis=0)
        assert motion.q_rad[1:] - motion.q_rad[0] == pytest.approx(turned, abs=1e-3)
        torque = chain_torques(
            motion.q_rad, motion.qd_rad_s, motion.qdd_rad_s2, dynamics.links, dynamics.gravity_m_s2
        )
        assert (np.abs(torque) <= limits.torque_n_m).all()


def test_a_motion_that_asks_for_too_much_torque_is_slowed() -> None:
    dynamics, asked = ARM.dynamics, curve_asked(ARM, curve_action(ARM, a_curve()))

    def torque_n_m(motion: JointTrajectory) -> np.ndarray:
        states = motion.q_rad, motion.qd_rad_s, motion.qdd_rad_s2
        return np.abs(chain_torques(*states, dynamics.links, dynamics.gravity_m_s2)).max(axis=0)

    most = 0.9 * torque_n_m(asked)
    weaker = replace(ARM, limits=replace(ARM.limits, torque_n_m=most))
    found = within_limits(weaker, asked)
    assert found is not None
    assert 0.3 < found[1] < 0.9
    assert (torque_n_m(found[0]) <= most).all()


def test_a_motion_within_the_limits_is_played_as_asked() -> None:
    curve = a_curve()
    found = within_limits(ARM, curve_asked(ARM, curve_action(ARM, curve)))
    assert found is not None
    assert found[1] == pytest.approx(1.0, abs=1e-6)
    assert found[0].q_rad == pytest.approx(sample(curve, STEP_S).q_rad, abs=1e-5)


def test_a_string_that_would_hang_over_the_arm_is_refused() -> None:
    env = ThrowEnv(7, throws=1)
    env.reset(seed=1)
    action = np.zeros(env.action_space.shape, np.float32)
    action[-4] = -0.1  # the arm stretched upwards: the string would hang along it
    assert not env.preflight(action)
    observation, reward, terminated, truncated, info = env.step(action)
    assert info["refused"]
    assert not info["hit"]
    assert (reward, terminated, truncated) == (-1.0, True, False)
    assert observation["seen"].sum() == 0


def test_an_episode_ends_at_a_hit_or_after_its_throws() -> None:
    task = task_of(1, 1)
    easy = Task(task.name, task.experiment.model_copy(update={"hit_radius_m": 1.5}))
    for stop_at_hit, ends in ((True, [True]), (False, [False, True])):
        env = ThrowEnv(throws=2, stop_at_hit=stop_at_hit)
        env.reset(options={"task": easy})
        action = an_action(env)
        assert [env.step(action)[2] for _ in ends] == ends


def test_environments_side_by_side_throw_as_one_alone() -> None:
    needs_shared_locks()
    several = gymnasium.make_vec(
        ID, num_envs=2, vectorization_mode="async", vector_kwargs={"context": "spawn"}, string=2
    )
    several.reset(seed=[3, 4])
    env = ThrowEnv(2)
    env.reset(seed=4)
    action = an_action(env)
    rewards = several.step(np.stack([action, action]))[1]
    several.close()
    assert rewards[1] == env.step(action)[1] != rewards[0]


class Bowl:
    """A stand-in for the lab: the miss is the distance of the action from a place."""

    def __init__(self) -> None:
        self.space = spaces.Box(-1.0, 1.0, (4,), np.float32)
        self.place = np.array([0.3, -0.2, 0.1, 0.6])
        self.thrown: list[np.ndarray] = []

    def misses(self, agent: baselines.Agent, throws: int) -> list[float]:
        action, closest, found = np.zeros(4), np.ones(2), []
        for k in range(throws):
            seen = {"throw": np.array([k]), "closest_m": closest, "action": action}
            action = agent.act(seen)
            assert self.space.contains(action)
            self.thrown.append(action)
            found.append(float(np.linalg.norm(action - self.place)))
            closest = np.array([found[-1], 0.0])
        return found


@pytest.mark.parametrize("training", [1, 60])
@pytest.mark.parametrize("kind", [baselines.RandomSearch, baselines.Cma])
def test_an_agent_repeats_its_nearest_throw_after_its_training(
    kind: type[baselines.RandomSearch], training: int
) -> None:
    bowl = Bowl()
    misses = bowl.misses(kind(bowl.space, lambda _: True, np.random.default_rng(0), training), training + 3)
    assert misses[training:] == [min(misses[:training])] * 3
    assert len(set(misses[:training])) == training


def test_cma_learns_where_random_search_does_not_and_throws_nothing_that_is_refused() -> None:
    bowl = Bowl()

    def allowed(action: np.ndarray) -> bool:
        return bool(action[0] > 0.25)

    found = {}
    for kind in (baselines.RandomSearch, baselines.Cma):
        agent = kind(bowl.space, allowed, np.random.default_rng(0), 200)
        found[kind] = bowl.misses(agent, 201)[-1]
        assert min(action[0] for action in bowl.thrown) > 0.25
    assert found[baselines.Cma] < 0.3 * found[baselines.RandomSearch]


class Recorder:
    """An agent as a stranger would write it; it keeps what it is shown."""

    shown: list[Observation] = []

    def __init__(
        self, space: spaces.Box, preflight: object, random: np.random.Generator, training: int
    ) -> None:
        self.action = baselines.RandomSearch(space, preflight, random, 0).next_action(0)
        assert training == 1

    def act(self, observation: Observation) -> np.ndarray:
        self.shown.append(observation)
        return self.action


def test_an_agent_of_ones_own_is_thrown_and_only_its_last_throws_count(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(run, "THROWS", 2)
    monkeypatch.setitem(run.AGENTS, "mine", f"{__name__}.Recorder")
    thrown = run.play("mine:1", 1, 5)
    assert len(thrown) == 2
    assert [int(seen["throw"][0]) for seen in Recorder.shown] == [0, 1, 2]
    for k, seen in enumerate(Recorder.shown[2:]):
        assert thrown[k].miss_m == pytest.approx(np.linalg.norm(seen["closest_m"]))


@pytest.mark.parametrize("string", [0, 3])
def test_both_planners_get_the_same_string_and_target(string: int) -> None:
    ours, papers = (named_settings(string, 5, method)[1] for method in ("default", "paper"))
    assert all(ours[key] == papers[key] for key in ("string", "target_m", "seed", "lab"))
    assert papers["method"] == "paper"
    assert "method" not in ours
    assert task_of(string, 5).experiment.target_m == tuple(ours["target_m"])


def test_the_table_has_medians_and_counts_of_hits() -> None:
    def a_run(method: str, *misses_m: float) -> dict[str, object]:
        return {"method": method, "trials": [{"true_miss_m": miss} for miss in misses_m]}

    runs = [
        a_run("cma:60", 0.1, 0.03, 0.01, 0.01, 0.01),
        a_run("cma:60", 0.2, 0.01, 0.03, 0.03, 0.01),
        a_run("ours", 0.005, 0.004, 0.003, 0.002, 0.001),
    ]
    assert run.table(runs).splitlines()[2:] == [
        "| cma | 60 | 150 mm | 20 mm | 20 mm | 20 mm | 10 mm | 10 mm | 0 of 2 | 1 of 2 | 2 of 2 |",
        "| ours | 0 | 5 mm | 4 mm | 3 mm | 2 mm | 1 mm | 1 mm | 1 of 1 | 1 of 1 | 1 of 1 |",
    ]
