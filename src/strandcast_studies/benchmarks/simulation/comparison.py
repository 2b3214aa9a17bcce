"""A peer's cost and error at a ladder of time steps, compared with ours."""

from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass
from typing import Protocol

import numpy as np

from strandcast.dynamics.parameters import Array
from strandcast_studies.benchmarks.simulation.entries import Entry, of_spread, of_timing
from strandcast_studies.benchmarks.simulation.swing import DURATION_S, HandSwing, rms_mm
from strandcast_studies.benchmarks.simulation.timing import Spread, Timing, timed

USABLE_MM = 50.0  # a tenth of the string's length: larger errors mean that it blew up or is useless; chosen


class Peer(Protocol):
    """Several strings on one swing, ready to be simulated with a given step."""

    def positions(self) -> Array:
        """Simulate from the start; positions (B, F, n+1, 2) [m] at the common times."""


@dataclass(frozen=True)
class PeerSetup:
    """How a peer is measured.

    A peer that does not use all threads itself is timed in one process, and its wall time is divided by the
    threads, as if one process ran on each without loss.
    """

    name: str
    make: Callable[[HandSwing, Array, float, int], Peer]  # from swing, parameters (B, 10), step [s], threads
    ladder_s: tuple[float, ...]  # steps from coarse to fine
    tiny_s: float  # step of its own reference
    batch: int  # strings per timed run: the number with which it is fastest
    threaded: bool = False  # whether it uses all threads itself


@dataclass(frozen=True, eq=False)
class Ladder:
    """A peer's tip errors (steps, B) [mm] against itself at a tiny step, and its cost at each step."""

    setup: PeerSetup
    error_mm: Array
    cost: tuple[Timing, ...]


def climb(setup: PeerSetup, swing: HandSwing, parameters: Array, threads: int, repeats: int) -> Ladder:
    """Measure a peer on the strings (B, 10) at each step of its ladder."""

    def tips(dt_s: float) -> Array:
        return setup.make(swing, parameters, dt_s, threads).positions()[:, :, -1]

    truth = tips(setup.tiny_s)
    error_mm = np.array([rms_mm(tips(dt_s), truth) for dt_s in setup.ladder_s])
    many = np.resize(parameters, (setup.batch, parameters.shape[1]))
    cost = []
    for dt_s in setup.ladder_s:
        timing = timed(setup.make(swing, many, dt_s, threads).positions, repeats)
        timing = timing.per(setup.batch * DURATION_S)
        cost.append(timing if setup.threaded else Timing(timing.cpu, timing.wall.per(threads)))
    return Ladder(setup, error_mm, tuple(cost))


def equal_steps(ladder: Ladder, ours_mm: Array) -> Array:
    """Return for each string the index (B,) of the step at which the peer is not more accurate than ours.

    The finest usable step whose error is at least ours; where the peer is more accurate at every usable step,
    the coarsest of them; where none is usable, the finest of the ladder.
    """
    usable = ladder.error_mm <= USABLE_MM
    worse = usable & (ladder.error_mm >= ours_mm)
    last = len(usable) - 1
    finest_worse = last - np.argmax(worse[::-1], axis=0)
    return np.asarray(np.where(worse.any(axis=0), finest_worse, cheapest_steps(ladder)))


def cheapest_steps(ladder: Ladder) -> Array:
    """Return for each string the index (B,) of the coarsest usable step, whatever its error."""
    usable = ladder.error_mm <= USABLE_MM
    return np.where(usable.any(axis=0), np.argmax(usable, axis=0), len(usable) - 1)


def cost_at(ladder: Ladder, steps: Array) -> Timing:
    """Return the median cost of a string when each is simulated with its own step."""
    chosen = [astuple(ladder.cost[k]) for k in steps]
    cpu, wall = np.median(chosen, axis=0).tolist()
    return Timing(Spread(*cpu), Spread(*wall))


def ratio(peer: Spread, own: Spread) -> Spread:
    """Return the peer's cost divided by ours; least and greatest from those of both."""
    return Spread(peer.value / own.value, peer.least / own.greatest, peer.greatest / own.least)


def entries(ladder: Ladder, ours_mm: Array, own: Timing) -> Iterator[Entry]:
    """Yield a peer's error and cost at each step, and its ratios to ours."""
    name = ladder.setup.name
    for dt_s, error_mm, cost in zip(ladder.setup.ladder_s, ladder.error_mm, ladder.cost, strict=True):
        step = f"@{dt_s * 1e3:.4g}ms"
        usable = error_mm <= USABLE_MM
        yield Entry(f"usable_share{step}", float(usable.mean()), "1", name)
        if usable.any():
            middle, least, greatest = np.percentile(error_mm[usable], [50, 0, 100]).tolist()
            yield Entry(f"own_error_mm{step}", middle, "mm", name, least, greatest)
        yield from of_timing(cost, name, step)
    for label, steps in (("", equal_steps(ladder, ours_mm)), ("_cheapest", cheapest_steps(ladder))):
        cost = cost_at(ladder, steps)
        yield from of_timing(cost, name, label)
        yield of_spread(f"ratio_{name}{label}", ratio(cost.cpu, own.cpu), "x", name)
        yield of_spread(f"ratio_{name}{label}_wall", ratio(cost.wall, own.wall), "x", name)
