"""A peer's cost and error at a ladder of steps, and what our own cost is beside it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from strandcast.bench.entries import Entry, of_spread, of_timing
from strandcast.bench.swing import DURATION_S, Swing, rms_mm
from strandcast.bench.timing import Spread, Timing, timed
from strandcast.string.parameters import Array

USABLE_MM = 50.0  # a tenth of the string's length: what is further off has blown up, or is of no use


class Peer(Protocol):
    """Several strings on one swing, ready to be simulated at a step."""

    def positions(self) -> Array:
        """Simulate anew; positions (B, F, n+1, 2) [m] at the common times."""


Maker = Callable[[Swing, Array, float, int], Peer]


@dataclass(frozen=True)
class Contest:
    """How a peer is measured.

    Attributes
    ----------
    name
        What the results call it.
    make
        Its constructor: swing, parameters (B, 10), step [s], threads.
    ladder_s, tiny_s
        Steps from coarse to fine, and the step of its own reference.
    batch
        Strings per timed run: as many as it is fastest with.
    spreads
        Whether it uses all threads itself. Else one process is timed, and its wall time divided by the
        threads, as if one such process ran on each without loss.
    """

    name: str
    make: Maker
    ladder_s: tuple[float, ...]
    tiny_s: float
    batch: int
    spreads: bool = False


@dataclass(frozen=True, eq=False)
class Ladder:
    """A peer's tip errors (steps, B) [mm] against itself at a tiny step, and its cost per step's length."""

    contest: Contest
    error_mm: Array
    cost: tuple[Timing, ...]


def climb(contest: Contest, swing: Swing, parameters: Array, threads: int, repeats: int) -> Ladder:
    """Measure a peer on the strings (B, 10) at each step of its ladder."""

    def tips(dt_s: float) -> Array:
        return contest.make(swing, parameters, dt_s, threads).positions()[:, :, -1]

    truth = tips(contest.tiny_s)
    error_mm = np.array([rms_mm(tips(dt_s), truth) for dt_s in contest.ladder_s])
    many = np.resize(parameters, (contest.batch, parameters.shape[1]))
    cost = []
    for dt_s in contest.ladder_s:
        timing = timed(contest.make(swing, many, dt_s, threads).positions, repeats)
        timing = timing.per(contest.batch * DURATION_S)
        cost.append(timing if contest.spreads else Timing(timing.cpu, timing.wall.per(threads)))
    return Ladder(contest, error_mm, tuple(cost))


def equal_steps(ladder: Ladder, ours_mm: Array) -> Array:
    """Return for each string the step (B,), an index, at which the peer is not more accurate than we are.

    The finest usable step whose error is at least ours; where the peer beats us at every usable step, the
    coarsest of them; where none is usable, the finest of the ladder.
    """
    usable = ladder.error_mm <= USABLE_MM
    worse = usable & (ladder.error_mm >= ours_mm)
    last = len(usable) - 1
    finest_worse = last - np.argmax(worse[::-1], axis=0)
    chosen = np.where(worse.any(axis=0), finest_worse, cheapest_steps(ladder))
    return np.asarray(chosen)


def cheapest_steps(ladder: Ladder) -> Array:
    """Return for each string the coarsest usable step (B,), an index, whatever its error."""
    usable = ladder.error_mm <= USABLE_MM
    return np.where(usable.any(axis=0), np.argmax(usable, axis=0), len(usable) - 1)


def cost_at(ladder: Ladder, steps: Array) -> Timing:
    """Return the median string's cost when each is simulated at its own step."""
    return Timing(
        *(
            Spread(
                *(
                    float(np.median([getattr(getattr(ladder.cost[k], kind), part) for k in steps]))
                    for part in ("value", "least", "greatest")
                )
            )
            for kind in ("cpu", "wall")
        )
    )


def ratio(peer: Spread, own: Spread) -> Spread:
    """Return how many times ours the peer's cost is; least and greatest from those of both."""
    return Spread(peer.value / own.value, peer.least / own.greatest, peer.greatest / own.least)


def entries(ladder: Ladder, ours_mm: Array, own: Timing) -> Iterator[Entry]:
    """Tell about a peer: error and cost at each step, and the ratios."""
    name = ladder.contest.name
    for dt_s, error_mm, cost in zip(ladder.contest.ladder_s, ladder.error_mm, ladder.cost, strict=True):
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
