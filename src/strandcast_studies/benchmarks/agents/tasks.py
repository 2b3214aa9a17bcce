"""The benchmark's tasks: one of the paper's strings at its own target, or a random string and target."""

import json
from functools import cache
from typing import Any, NamedTuple

from strandcast.arm.load import PlanarArm, load_arm
from strandcast.config.experiment import Experiment
from strandcast.config.paper import with_method
from strandcast_studies.benchmarks.loop import drawn
from strandcast_studies.benchmarks.loop.run import PROJECT
from strandcast_studies.paper.cases import FILE, WHOLE, Method, PaperCase, load_plan, merged, settings_of


class Task(NamedTuple):
    """One string, servo and target; the name and the experiment's seed determine all random numbers."""

    name: str
    experiment: Experiment


def named_settings(string: int, seed: int, method: Method = "default") -> tuple[str, dict[str, Any]]:
    """Return the name and the settings of an experiment with a planner of config/paper.yaml.

    String 1 to 7 is thrown at its own target, as by `loop.run`; 0 is the random string of the seed, as by
    `loop.drawn`.
    """
    plan = load_plan(PROJECT / FILE)
    if string == 0:
        return f"drawn-{seed}", with_method(
            merged(drawn.settings_of(plan.common, seed), plan.methods[method])
        )
    case = PaperCase(WHOLE, seed, string, plan.string(string).target, method)
    return case.name, settings_of(plan, case)


def task_of(string: int, seed: int) -> Task:
    """Return the task of string 1 to 7 at its own target, or of the seed's random string (0)."""
    name, settings = named_settings(string, seed)
    return Task(name, Experiment.model_validate_json(json.dumps(settings), strict=True))


@cache
def arm_of(name: str) -> PlanarArm:
    """Return an arm of config/arms."""
    return load_arm(PROJECT / "config" / "arms" / f"{name}.toml").planar()
