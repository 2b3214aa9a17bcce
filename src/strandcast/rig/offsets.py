"""What an arm's file states wrongly, the same in every trial: links, the clamp's place, the joints' zeros.

The tracked hand of all trials is compared with the hand by the joint log and the arm's file. Each number of
the file is either right, to within what a careful lab leaves, or, seldom, wrong by much more; at most
`MOST_WRONG` are. The camera's plane may lie beside the arm's, turned and stretched, and each trial has zeros
and a clock of its own. How much zeros scatter is not known: its prior is a grid, as in
`rig.unknown_size`.

Two questions, two answers. How far is each number off, by the trials alone, whatever the others are? Numbers
that the motions cannot tell apart have large standard deviations there. And which few wrong numbers explain
the trials? All sets that may be wrong are weighed, and those that explain them remain as alternatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import PlanarArm
from strandcast.core.disturbances import JOINT_ZERO_RAD
from strandcast.rig.hand_noise import noise_root, whitened
from strandcast.rig.unknown_size import GRID

LEAST_TRIALS = 2  # one trial's own zeros look the same as wrong ones
LEAST_FRAMES = 50  # of a trial that counts; chosen, a tenth of a second
MOST_FRAMES = 300  # of a trial that are read, evenly; neighbours share their errors, more teach nothing
# Standard deviations of a link, the clamp's place and a zero, chosen. Right: what a calibrated arm leaves.
# Wrong: a ruler between axes that housings hide, or the file of a sister model; a clamp mounted by hand; a
# joint that was zeroed by eye against a mark (0.6 degrees).
RIGHT_M, RIGHT_RAD = 5e-4, 5e-4
LINK_M, CLAMP_M, ZERO_RAD = 5e-3, 5e-3, 1e-2
WRONG_SHARE = 0.1  # of the numbers of an arm's file; chosen
MOST_WRONG = 4  # all sets of up to so many are weighed
FREE = 20.0  # times the standard deviation of a wrong number: as good as unknown
# Of the camera's plane in the arm's frame: markers placed by ruler and levelled, to 1 mm and 1 mm in 1 m. The
# calibration's standard error comes on top.
SHIFT_M, TURN_RAD, STRETCH = 1e-3, 1e-3, 1e-3
REACH_M = 0.5  # chosen: the distance over which an error of the calibration turns or stretches the plane
CLOCK_S = 1e-3  # of a trial's offset; ten times the alignment's usual error: a wrong arm displaces the offset
SCATTER_FACTOR = 2.0  # two rigs in three have zeros within this factor of `JOINT_ZERO_RAD`
STEP = 1e-5  # of derivatives, in m and rad
SIZES = GRID[::8]  # enough for an average
ROUNDS = 3  # of Gauss-Newton; wrong by 10 mm and 35 mrad, the third changes nothing
WORTH_M = 1e-3  # at the hand: a wrong number is worth this much
SURE = 0.99  # probability from which something is wrong; right files of simulated trials stay below 0.7
POSSIBLE = 0.05  # least probability at which a set explains the trials; usual


class HandSeen(NamedTuple):
    """One trial: the tracked hand (F, 2) [m] at times (F,) [s], the log's joints then (F, J) [rad]."""

    time_s: np.ndarray
    hand_m: np.ndarray
    q_rad: np.ndarray


class OffsetFit(NamedTuple):
    """Deviations from the arm's file: links but the last, the clamp along and across, zeros (p = 2 J + 1).

    A positive one is a longer link, a clamp farther along or to the left, a joint that reads too little.

    Attributes
    ----------
    value, covariance
        (p,) and (p, p) of what the trials alone show, if each number may be anything [m or rad].
    wrong_sd
        (p,) of a wrong number, before the trials.
    sets, probability
        (H, p) sets of numbers that may be wrong, the first of none, and the probability (H,) of each.
    given, given_covariance
        (H, p), (H, p, p) of the deviations if exactly the numbers of that set are wrong.
    moves_m
        (F, 2, p) moves of the hand per unit in all frames of all trials.
    zero_scatter_rad
        Standard deviation of a joint's zero from trial to trial, rms over what is known of it.
    """

    value: np.ndarray
    covariance: np.ndarray
    wrong_sd: np.ndarray
    sets: np.ndarray
    probability: np.ndarray
    given: np.ndarray
    given_covariance: np.ndarray
    moves_m: np.ndarray
    zero_scatter_rad: float

    @property
    def alone(self) -> np.ndarray:
        """Value and standard deviation (p, 2) by the trials alone; NaN where that says too little."""
        sd = np.sqrt(np.diag(self.covariance))
        return np.where((sd < self.wrong_sd)[:, None], np.column_stack([self.value, sd]), np.nan)

    @property
    def if_wrong(self) -> np.ndarray:
        """Value and standard deviation (p, 2) of each number, should it be wrong."""
        each = [
            _mixed(self.probability[None] * w, self.given[None], self.given_covariance[None])
            for w in self.sets.T
        ]
        return np.array([(value[k], np.sqrt(square[k, k])) for k, (value, square) in enumerate(each)])

    @property
    def together_m(self) -> float:
        """Farthest that all deviations together move the hand [m]."""
        return float(self.hand_m(self.probability @ self.given))

    def hand_m(self, value: np.ndarray) -> float:
        """Farthest that deviations (p,) move the hand [m]."""
        return float(np.linalg.norm(self.moves_m @ value, axis=1).max(initial=0.0))

    @property
    def explanations(self) -> list[int]:
        """Sets that explain the trials, the likeliest first; none unless something is surely wrong.

        A set is left out if a likelier one explains as much with fewer numbers.
        """
        if 1.0 - self.probability[0] <= SURE or self.together_m <= WORTH_M:
            return []
        found: list[int] = []
        for h in np.argsort(-self.probability):
            if self.probability[h] < POSSIBLE and found:
                break
            if not any((self.sets[h] >= self.sets[known]).all() for known in found):
                found.append(int(h))
        return found

    @property
    def wrong(self) -> np.ndarray:
        """Which (p,) are wrong by every explanation."""
        found = self.explanations
        return np.asarray(self.sets[found].all(axis=0) if found else self.sets[0])

    @property
    def possible(self) -> np.ndarray:
        """Which (p,) are wrong by some explanation, and not by others."""
        return np.asarray(self.sets[self.explanations].any(axis=0) & ~self.wrong)


def fit_offsets(arm: PlanarArm, seen: Sequence[HandSeen], plane_sd_m: float) -> OffsetFit | None:
    """Fit the deviations from the arm's file to all trials; None for fewer than `LEAST_TRIALS`.

    `plane_sd_m` is the standard error of a point in the camera's plane, from its calibration.
    """
    seen = [_thinned(one) for one in seen if len(one.time_s) >= LEAST_FRAMES]
    if len(seen) < LEAST_TRIALS:
        return None
    turn, stretch = (np.hypot(sd, plane_sd_m / REACH_M) for sd in (TURN_RAD, STRETCH))
    plane_sd = np.array([*[np.hypot(SHIFT_M, plane_sd_m)] * 2, turn, *[stretch] * 3])
    value = np.zeros(2 * len(arm.joints) + 1)
    roots = [_noise(arm, one) for one in seen]
    for _ in range(ROUNDS):
        trials = [_normal_equations(arm, one, value, root) for one, root in zip(seen, roots, strict=True)]
        found = _posterior(trials, plane_sd, len(arm.joints))
        value = found.probability @ found.given
    return found._replace(moves_m=np.concatenate([_moves(arm, one.q_rad, value) for one in seen]))


def _thinned(seen: HandSeen) -> HandSeen:
    """Return a trial with every so many of its frames, at most `MOST_FRAMES`."""
    every = slice(None, None, -(-len(seen.time_s) // MOST_FRAMES))
    return HandSeen(*(column[every] for column in seen))


def _hand_m(arm: PlanarArm, q_rad: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Return the hand (F, 2) [m] of an arm that deviates from its file by `value` (p,)."""
    joints = len(arm.joints)
    links, clamp, zeros = np.split(value, [joints - 1, joints + 1])
    chain = arm.chain._replace(lengths_m=arm.chain.lengths_m + np.append(links, 0.0))
    along, across = np.array(arm.clamp.offset_m) + clamp
    held = arm.clamp.model_copy(update={"offset_m": (along, across)})
    return np.asarray(hand_pose(chain, held, q_rad + zeros).position_m)


def _moves(arm: PlanarArm, q_rad: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Return the derivatives (F, 2, p) of the hand by the deviations."""
    steps = STEP * np.eye(len(value))
    slopes = [_hand_m(arm, q_rad, value + step) - _hand_m(arm, q_rad, value - step) for step in steps]
    return np.stack(slopes, axis=2) / (2.0 * STEP)


class _NormalEquations(NamedTuple):
    """A trial's least squares over its noise: by what all trials share (x) and by its own unknowns (u).

    Its own are the joints' zeros and the clock.
    """

    xx: np.ndarray
    xu: np.ndarray
    uu: np.ndarray
    x: np.ndarray
    u: np.ndarray


def _normal_equations(
    arm: PlanarArm, seen: HandSeen, value: np.ndarray, root: np.ndarray
) -> _NormalEquations:
    """Return the equations of one trial, linear about `value`, over its noise."""
    off_m, common, own = _linear(arm, seen, value)
    both, off = whitened(root, np.concatenate([common, own], axis=2)), whitened(root, off_m[:, :, None])[:, 0]
    square, target, n = both.T @ both, both.T @ off, common.shape[2]
    return _NormalEquations(square[:n, :n], square[:n, n:], square[n:, n:], target[:n], target[n:])


def _noise(arm: PlanarArm, seen: HandSeen) -> np.ndarray:
    """Return the root (F, F) of the noise's covariance: what all unknowns together leave."""
    off_m, common, own = _linear(arm, seen, np.zeros(2 * len(arm.joints) + 1))
    return noise_root(off_m, np.concatenate([common, own[:, :, -1:]], axis=2), seen.time_s)


def _linear(arm: PlanarArm, seen: HandSeen, value: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return deviations (F, 2), and how they move with common unknowns and the trial's own, about `value`."""
    there_m, moves = _hand_m(arm, seen.q_rad, value), _moves(arm, seen.q_rad, value)
    speed_m_s = np.gradient(there_m, seen.time_s, axis=0)
    own = np.concatenate([moves[:, :, -len(arm.joints) :], speed_m_s[:, :, None]], axis=2)
    return seen.hand_m - there_m + moves @ value, np.concatenate([moves, _plane_moves(there_m)], axis=2), own


def _plane_moves(place_m: np.ndarray) -> np.ndarray:
    """Return how the plane's shift (2), turn, stretch along x and y, and shear move places: (F, 2, 6)."""
    x, y = place_m.T
    one, none = np.ones_like(x), np.zeros_like(x)
    return np.stack(
        [np.stack([one, none, -y, x, none, y], axis=1), np.stack([none, one, x, none, y, x], axis=1)], axis=1
    )


def _posterior(trials: Sequence[_NormalEquations], plane_sd: np.ndarray, joints: int) -> OffsetFit:
    """Return the estimates, averaged over the zeros' scatter and over which numbers are wrong."""
    sets, right_sd, wrong_sd = _sets_of_numbers(joints)
    count = len(wrong_sd)
    probability = np.prod(np.where(sets, WRONG_SHARE, 1.0 - WRONG_SHARE), axis=1)
    sizes_rad = JOINT_ZERO_RAD * np.exp(np.log(SCATTER_FACTOR) * SIZES)
    pooled = [_pooled(trials, size_rad, joints) for size_rad in sizes_rad]

    def given(sd: np.ndarray, log: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        prior_sd = np.hstack([sd, np.tile(plane_sd, (len(sd), 1))])
        each = zip(*(_given(*one, prior_sd, count) for one in pooled), strict=True)
        mean, covariance, evidence = map(np.array, each)
        log = evidence + log - 0.5 * SIZES[:, None] ** 2
        weight = np.exp(log - log.max())
        return weight / weight.sum(), mean, covariance

    alone = _mixed(*given(FREE * wrong_sd[None], np.zeros(1)))
    prior_sd, log = np.where(sets, wrong_sd, right_sd), np.log(probability / probability.sum())
    weight, mean, covariance = given(prior_sd, log)
    each = [_mixed(weight[:, [h]], mean[:, [h]], covariance[:, [h]]) for h in range(len(sets))]
    return OffsetFit(
        *alone,
        wrong_sd=wrong_sd,
        sets=sets,
        probability=weight.sum(axis=0),
        given=np.array([value for value, _ in each]),
        given_covariance=np.array([square for _, square in each]),
        moves_m=np.zeros((0, 2, count)),
        zero_scatter_rad=float(np.sqrt(weight.sum(axis=1) @ sizes_rad**2)),
    )


def _sets_of_numbers(joints: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return sets of at most `MOST_WRONG` numbers (H, p), and standard deviations (p,) of right and wrong."""
    wrong_sd = np.array([*[LINK_M] * (joints - 1), *[CLAMP_M] * 2, *[ZERO_RAD] * joints])
    right_sd = np.array([*[RIGHT_M] * (joints + 1), *[RIGHT_RAD] * joints])
    numbers = range(len(wrong_sd))
    sets = [some for k in range(MOST_WRONG + 1) for some in combinations(numbers, k)]
    return np.array([np.isin(numbers, some) for some in sets]), right_sd, wrong_sd


def _pooled(
    trials: Sequence[_NormalEquations], size_rad: float, joints: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return all trials' equations without their own unknowns, zeros of this scatter and clocks.

    The square and the target of what they share, and the logarithm of what their own unknowns add.
    """
    own = np.diag([*[size_rad**-2] * joints, CLOCK_S**-2])
    square, target, log = np.zeros_like(trials[0].xx), np.zeros_like(trials[0].x), 0.0
    for one in trials:
        inner = one.uu + own
        back = np.linalg.solve(inner, np.column_stack([one.xu.T, one.u]))
        square += one.xx - one.xu @ back[:, :-1]
        target += one.x - one.xu @ back[:, -1]
        log += 0.5 * (one.u @ back[:, -1] - np.linalg.slogdet(inner)[1] + np.linalg.slogdet(own)[1])
    return square, target, float(log)


def _given(
    square: np.ndarray, target: np.ndarray, log: float, prior_sd: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the first `count` unknowns of `_pooled` equations for each row of priors (H, p + 6).

    Means (H, p), covariances (H, p, p), and the logarithms of the evidence (H,).
    """
    squares = square + prior_sd[:, :, None] ** -2 * np.eye(prior_sd.shape[1])
    covariance = np.linalg.inv(squares)
    mean = covariance @ target
    own = 0.5 * (mean @ target - np.linalg.slogdet(squares)[1]) - np.log(prior_sd).sum(axis=1)
    return mean[:, :count], covariance[:, :count, :count], log + own


def _mixed(weight: np.ndarray, mean: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and covariance over all cases (S, H), weighted."""
    share = weight / max(float(weight.sum()), 1e-300)
    middle = np.einsum("sh,shi->i", share, mean)
    apart = mean - middle
    return middle, np.einsum("sh,shij->ij", share, covariance + apart[..., :, None] * apart[..., None, :])
