"""Misses per throw of our planner, the paper's, random search and a learner, on the lab's seven strings.

    python -m strandcast_studies.benchmarks.agents.run --methods random,cma:60 --seeds 5001-5003

A method is ours, paper, random, cma or package.module.Class (docs/benchmark.md); after a colon, the number of
training throws at each string before those that are scored. Each method's runs are written to a file of its
own; the table shows all that are in the folder.
"""

import argparse
import importlib
import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from strandcast_studies.benchmarks.agents.baselines import Agent
from strandcast_studies.benchmarks.agents.env import ThrowEnv
from strandcast_studies.benchmarks.agents.tasks import named_settings
from strandcast_studies.benchmarks.loop.run import (
    RIGS,
    numbers,
    outcome,
    prepare,
    root_with_arms,
    run_jobs,
    run_prepared,
)
from strandcast_studies.hit_rates import hit_rate, misses_at
from strandcast_studies.paper.cases import Method

SEEDS = "5001-5003"  # used for no tuning
THROWS = 5
HIT_M = 0.02
PLANNERS: dict[str, Method] = {"ours": "default", "paper": "paper"}
AGENTS = {
    "random": "strandcast_studies.benchmarks.agents.baselines.RandomSearch",
    "cma": "strandcast_studies.benchmarks.agents.baselines.Cma",
}


@dataclass
class ScoredThrow:
    """The true miss of a throw, and the measured one [m]."""

    true_miss_m: float
    miss_m: float


def play(method: str, string: int, seed: int) -> list[ScoredThrow]:
    """Return the scored throws of an agent at one string.

    The agent sees observations alone: neither the reward nor `info`.
    """
    name, _, budget = method.partition(":")
    training = int(budget or 0)
    env = ThrowEnv(string, throws=training + THROWS, stop_at_hit=False)
    observation, _ = env.reset(seed=seed)
    random = np.random.default_rng([seed, string])
    agent = _factory(name)(env.action_space, env.preflight, random, training)
    thrown = []
    for _ in range(training + THROWS):
        observation, reward, *_ = env.step(agent.act(observation))
        thrown.append(ScoredThrow(-reward, float(np.linalg.norm(observation["closest_m"]))))
    return thrown[training:]


def _factory(name: str) -> Callable[..., Agent]:
    module, _, attribute = AGENTS.get(name, name).rpartition(".")
    factory: Callable[..., Agent] = getattr(importlib.import_module(module), attribute)
    return factory


def _plan(root: str, method: str, string: int, seed: int) -> dict[str, Any]:
    name, settings = named_settings(string, seed, PLANNERS[method])
    prepare(Path(root), name, settings)
    return _given(method, string, seed) | outcome(
        lambda: run_prepared(Path(root), name, THROWS, RIGS["usual"])
    )


def _play(method: str, string: int, seed: int) -> dict[str, Any]:
    return _given(method, string, seed) | outcome(lambda: play(method, string, seed))


def _given(method: str, string: int, seed: int) -> dict[str, Any]:
    return {"method": method, "string": string, "seed": seed}


def run_method(method: str, cases: list[tuple[int, int]], processes: int, out: Path) -> None:
    """Run a method on strings with seeds and write its runs."""
    if method not in PLANNERS:
        run_jobs(_play, [(method, *case) for case in cases], processes, out)
        return
    with tempfile.TemporaryDirectory(prefix="strandcast-agents-") as folder:
        root = str(root_with_arms(Path(folder)))
        run_jobs(_plan, [(root, method, *case) for case in cases], processes, out)


def table(runs: list[dict[str, Any]]) -> str:
    """Return medians of the true misses by throw, and how many runs have hit, as a Markdown table."""
    throws = range(1, THROWS + 1)
    by = (1, 2, THROWS)
    head = ["method", "training throws", *(f"throw {k}" for k in throws), "p90 of the last"]
    head += [f"hit by {k}" for k in by]
    lines = [head, ["---"] * len(head)]
    for method in dict.fromkeys(run["method"] for run in runs):
        misses = [[t["true_miss_m"] for t in run["trials"]] for run in runs if run["method"] == method]
        at = [misses_at(misses, k) for k in throws]
        rates = [hit_rate(misses, HIT_M, k) for k in by]
        name, _, budget = method.partition(":")
        spread = [_mm(one.median_m) for one in at] + [_mm(at[-1].p90_m)]
        lines.append([name, budget or "0", *spread, *(f"{rate.hits} of {rate.runs}" for rate in rates)])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _mm(miss_m: float | None) -> str:
    return "" if miss_m is None else f"{1000 * miss_m:.3g} mm"


def main(arguments: list[str] | None = None) -> None:
    """Run the methods one after another and print the table of all in the folder."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--methods", default="ours,paper,random,random:60,cma:60", help="separated by commas")
    parser.add_argument("--seeds", type=numbers, default=numbers(SEEDS), help="e.g. 5001,5003-5005")
    parser.add_argument("--strings", type=numbers, default=numbers("1-7"), help="0: the seed's random one")
    parser.add_argument("--jobs", type=int, default=2, help="runs at the same time")
    parser.add_argument("--out", type=Path, default=Path("results/bench-agents"), help="folder of the runs")
    options = parser.parse_args(arguments)
    cases = [(string, seed) for seed in options.seeds for string in options.strings]
    for method in filter(None, options.methods.split(",")):
        run_method(method, cases, options.jobs, options.out / f"{method.replace(':', '-')}.json")
    files = sorted(options.out.glob("*.json"))
    print(table([run for file in files for run in json.loads(file.read_text(encoding="utf-8"))["runs"]]))


if __name__ == "__main__":
    main()
