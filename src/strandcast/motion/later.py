"""A later motion: small changes around the best trial, with what the simulation missed by carried over."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strandcast.arm.servo import respond
from strandcast.motion.bezier import Curve
from strandcast.motion.cost import motion_costs, throw_cost
from strandcast.motion.earlier import Earlier
from strandcast.motion.paths import Paths, paths_of_any
from strandcast.motion.residual import Carried, alike, carry
from strandcast.motion.search import minimise
from strandcast.motion.strings import Strings, crossed
from strandcast.motion.task import Options, Task
from strandcast.motion.throws import AFTER_END_S, Thrown, World, assessed, throw
from strandcast.progress import Progress

# Scale of the heights, and the standard deviation with which the search starts: wider after a wide miss.
HEIGHT_RAD_S, SPREAD = 0.15, 0.7
NEAR_M, WIDEST = 0.04, 4.0
SAME_SHAPE_M = 0.003  # rms, between the shape at the start and the model's at rest


@dataclass(frozen=True, eq=False)
class Neighbourhood:
    """The best trial, its like, and the strings.

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
    options: Options,
) -> Neighbourhood:
    """Return what planning around the best trial needs.

    Parameters
    ----------
    world
        With the servo's response, if there is to be one.
    best, trials
        The best trial, which has a curve, and all.
    """
    assert best.curve is not None
    carried = carry(task, strings, world.servo, alike(trials, best.curve))
    world = replace(world, start_m=settled(task, strings, best))
    if not options.carry_residual:
        carried = replace(carried, tip_m=np.zeros_like(carried.tip_m))
    return Neighbourhood(best.curve, strings, world, carried)


def with_every_disturbance(task: Task, near: Neighbourhood, options: Options) -> Neighbourhood:
    """Return it with every string thrown with every disturbance; what is carried over stays the string's."""
    thrown = crossed(near.strings, len(task.arm.joints), options.disturbances)
    whose = np.arange(len(thrown)) * len(near.strings) // len(thrown)
    return replace(near, strings=thrown, carried=replace(near.carried, tip_m=near.carried.tip_m[:, whose]))


def settled(task: Task, strings: Strings, trial: Earlier) -> np.ndarray | None:
    """Return the shape (n, 2) with which a motion like a trial's starts [m]; None: it hangs as the model's.

    How a string sways is one throw's chance: the shape that it had is turned about the hand to where it hangs
    at rest. The model's own shape is taken where it is as near as the tracker tells.
    """
    if trial.start_m is None:
        return None
    assert trial.curve is not None
    resting = np.tile(trial.curve.q0_rad, (1, 2, 1))
    shape = throw(task, strings.first(1), World(), resting, np.array([1])).points_m[0, 0]
    rest, was = shape[1:] - shape[0], trial.start_m - shape[0]
    turn = np.arctan2((was[:, 0] * rest[:, 1] - was[:, 1] * rest[:, 0]).sum(), (was * rest).sum())
    cos, sin = np.cos(turn), np.sin(turn)
    turned = was @ np.array([[cos, sin], [-sin, cos]])
    off_m = float(np.sqrt(np.mean(((turned - rest) ** 2).sum(axis=1))))
    return None if off_m < SAME_SHAPE_M else np.asarray(turned + shape[0])


def throw_near(
    task: Task, near: Neighbourhood, paths: Paths, heights: np.ndarray
) -> tuple[Thrown, np.ndarray]:
    """Return the throws of P motions with every string, and (B, T, 2) what is carried over to the tips [m].

    Parameters
    ----------
    paths, heights
        The commanded angles and the control heights (P, J, H) of motions as long as the best one.
    """
    time_s = np.arange(paths.q.shape[1]) * task.step_s
    q = paths.q if near.world.servo is None else respond(near.world.servo, time_s, paths.q)
    q = q + np.einsum("pn,ntj->ptj", near.carried.weights(heights), near.carried.joints_rad)
    thrown = throw(task, near.strings, near.world, q, paths.last + round(AFTER_END_S / task.step_s))
    shift = np.einsum("pn,nktx->pktx", near.carried.shares(heights), near.carried.tip_m)
    return thrown, shift.reshape(-1, *shift.shape[2:])


def plan_near(
    task: Task, near: Neighbourhood, miss_m: float, options: Options, rng: np.random.Generator
) -> tuple[Curve, int]:
    """Return the cheapest motion near the best trial, which missed by `miss_m`, and the throws simulated.

    The strings are thrown undisturbed: so near, no motion scatters noticeably less than another, and the
    disturbances hide what it misses by (docs/throws.md).
    """
    task, best = task.rough(), near.best
    inner = slice(2, -2) if not best.ramp_s else slice(1, None)
    shape = best.heights_rad_s[:, inner].shape

    def curve(point: np.ndarray) -> Curve:
        heights = best.heights_rad_s.copy()
        heights[:, inner] += point.reshape(shape) * HEIGHT_RAD_S
        return replace(best, heights_rad_s=heights)

    def value(points: np.ndarray) -> np.ndarray:
        curves = [curve(point) for point in points]
        paths = paths_of_any(curves, task.step_s, AFTER_END_S, task.dynamics)
        thrown, shift = throw_near(task, near, paths, np.array([c.heights_rad_s for c in curves]))
        change = HEIGHT_RAD_S * np.sqrt(np.mean(points**2, axis=1))
        price = motion_costs(task, paths)
        told = assessed(task, thrown, shift, options.clearance_m)
        cost = throw_cost(told, len(near.strings), task.step_s)
        return np.asarray(cost + price + options.change_cost_m_s_rad * change)

    budget = 2 * options.evaluations // 3
    tell = Progress("plan: search", total=budget)
    spread = SPREAD * float(np.clip(miss_m / NEAR_M, 1.0, WIDEST))
    point, _, tried = minimise(value, np.zeros(np.prod(shape)), spread, budget, rng, tell)
    return curve(point), tried * len(near.strings)
