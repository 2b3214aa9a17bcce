"""A later motion: small changes around the best trial, with what the simulation missed by carried over."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strandcast.arm.servo import respond
from strandcast.motion.bezier import Curve, sample
from strandcast.motion.cost import motion_cost, throw_cost
from strandcast.motion.earlier import Earlier
from strandcast.motion.residual import Carried, alike, carry
from strandcast.motion.search import minimise
from strandcast.motion.strings import Strings, joined, regrasped
from strandcast.motion.task import Options, Task
from strandcast.motion.throws import Thrown, World, assessed, commands, throw
from strandcast.progress import Progress

# Scale of the heights, and the standard deviation with which the search starts: wider after a wide miss.
HEIGHT_RAD_S, SPREAD = 0.15, 0.7
NEAR_M, WIDEST = 0.04, 4.0


@dataclass(frozen=True, eq=False)
class Neighbourhood:
    """The best trial, its like, and the strings, as fitted and grasped differently.

    Attributes
    ----------
    best
        The curve of the best trial.
    strings, world, carried
        What every motion near it is thrown with.
    """

    best: Curve
    strings: Strings
    world: World
    carried: Carried


def neighbourhood(
    task: Task,
    strings: Strings,
    world: World,
    best: Earlier,
    trials: list[Earlier],
    regrasp: np.random.Generator | None = None,
) -> Neighbourhood:
    """Return what planning around the best trial needs.

    Parameters
    ----------
    world
        With the servo's response, if there is to be one.
    best, trials
        The best trial, which has a curve, and all.
    regrasp
        With chance given, every string is there a second time, grasped a little differently; what is
        carried over to it is the fitted string's.
    """
    assert best.curve is not None
    carried = carry(task, strings, world.servo, alike(trials, best))
    world = replace(world, start_m=best.start_m)
    if regrasp is None:
        return Neighbourhood(best.curve, strings, world, carried)
    tips = np.concatenate([carried.tip_m, carried.tip_m], axis=1)
    both = joined(strings, regrasped(strings, regrasp))
    return Neighbourhood(best.curve, both, world, replace(carried, tip_m=tips))


def throw_near(task: Task, near: Neighbourhood, curves: list[Curve]) -> tuple[Thrown, np.ndarray]:
    """Return the throws of P curves with every string, and (B, T, 2) what is carried over to the tips [m]."""
    time_s, q, last = commands([sample(curve, task.step_s) for curve in curves], task.step_s)
    weights = near.carried.weights(curves)
    q = q if near.world.servo is None else respond(near.world.servo, time_s, q)
    thrown = throw(
        task, near.strings, near.world, q + np.einsum("pn,ntj->ptj", weights, near.carried.joints_rad), last
    )
    shift = np.einsum("pn,nktx->pktx", weights, near.carried.tip_m)
    return thrown, shift.reshape(-1, *shift.shape[2:])


def plan_near(
    task: Task, near: Neighbourhood, miss_m: float, options: Options, rng: np.random.Generator
) -> tuple[Curve, int]:
    """Return the cheapest motion near the best trial, which missed by `miss_m`, and the throws simulated."""
    best = near.best
    inner = slice(2, -2) if not best.ramp_s else slice(1, None)
    shape = best.heights_rad_s[:, inner].shape

    def curve(point: np.ndarray) -> Curve:
        heights = best.heights_rad_s.copy()
        heights[:, inner] += point.reshape(shape) * HEIGHT_RAD_S
        return replace(best, heights_rad_s=heights)

    def value(points: np.ndarray) -> np.ndarray:
        curves = [curve(point) for point in points]
        thrown, shift = throw_near(task, near, curves)
        change = HEIGHT_RAD_S * np.sqrt(np.mean(points**2, axis=1))
        price = np.array([motion_cost(task, sample(c, task.step_s)) for c in curves])
        told = assessed(task, thrown, shift, options.clearance_m)
        cost = throw_cost(told, len(near.strings), task.step_s)
        return np.asarray(cost + price + options.change_cost_m_s_rad * change)

    budget = options.evaluations // 2
    tell = Progress("plan: search", total=budget)
    spread = SPREAD * float(np.clip(miss_m / NEAR_M, 1.0, WIDEST))
    point, _ = minimise(value, np.zeros(np.prod(shape)), spread, budget, rng, tell)
    return curve(point), budget * len(near.strings)
