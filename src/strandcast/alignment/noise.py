"""How sure the fit is: errors that follow each other along the hand's way, the log's noise, the priors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from strandcast.alignment.problem import Problem
from strandcast.arm.kinematics import hand_pose

MOST_BINS = 80
REST_M_S = 0.2  # a second at rest counts as so much way
REACH_M = (
    0.15  # prior of the way over which slow errors change; a factor of REACH_FACTOR either way is likely
)
REACH_FACTOR = 3.0
SIZE_FACTOR = 10.0
EVALUATIONS = 120
LEAST_SHARE = 0.01


@dataclass(frozen=True, eq=False)
class Summary:
    """The fit's x, its covariance, and the offset's error were the constants known less, in units of x.

    Attributes
    ----------
    true_share
        How much of what is known of the offset the motion tells, and not the log's noise.
    slow_m, slow_rad, reach_m
        Size of the slow errors of place and angle, and the way over which they change.
    """

    x: np.ndarray
    covariance: np.ndarray
    unaided_se: float
    true_share: float
    slow_m: float
    slow_rad: float
    reach_m: float


@dataclass(frozen=True, eq=False)
class Binned:
    """The hand's residual summed over stretches of its way: x and y [m], angle times lever [m].

    Attributes
    ----------
    off, slope
        (3 b,) and (3 b, p), axis by axis.
    noise
        (3 b, 3 b): of single sightings, and of the log's rows.
    false_motion
        (3 b, r): what of the offset's slope each of the log's numbers feigns by its noise.
    way_m
        (b,) where along the hand's way.
    lever_m
        The lever.
    """

    off: np.ndarray
    slope: np.ndarray
    noise: np.ndarray
    false_motion: np.ndarray
    way_m: np.ndarray
    lever_m: float


def certainty(problem: Problem, x: np.ndarray, sigma: np.ndarray, wider: float) -> Summary:
    """Refine a robust fit by generalised least squares, and say how sure it is.

    Parameters
    ----------
    problem
        Without wrong sightings.
    x
        The robust fit.
    sigma
        (m, 3) noise of the sightings.
    wider
        Factor on the priors of the constants for `Summary.unaided_se`.

    Notes
    -----
    Camera map, lens and marker corners err alike in neighbouring frames. Such errors are taken as processes
    along the hand's way with exponential correlation, whose size and reach are the most probable by the
    restricted likelihood (Patterson and Thompson, Biometrika 58, 1971) under wide priors: what the fit takes
    up of them is accounted for, which no estimate from its residuals alone would do.
    """
    binned, inner = bin_hand(problem, x, sigma)
    more, more_slope = (np.concatenate(pair) for pair in zip(problem.event_rows(x), inner, strict=True))
    prior = problem.prior()
    expected = prior * (problem.expected - x) + more_slope.T @ more
    information = np.diag(prior) + more_slope.T @ more_slope
    grain = float(np.sqrt(np.median(np.diag(binned.noise))))
    start = np.log([grain, grain, REACH_M])

    def cost(logs: np.ndarray) -> float:
        away = (logs - start) / np.log([SIZE_FACTOR, SIZE_FACTOR, REACH_FACTOR])
        return 0.5 * float(away @ away) - restricted(binned, logs, information, expected)[0]

    best = minimize(
        cost, start, method="Nelder-Mead", options={"maxfev": EVALUATIONS, "xatol": 0.05, "fatol": 0.02}
    ).x
    _, step, covariance = restricted(binned, best, information, expected)
    share = _true_share(binned, best, information, covariance)
    covariance = covariance / share
    loose = np.diag(problem.prior(wider)) + more_slope.T @ more_slope
    unaided = restricted(binned, best, loose, expected)[2]
    unaided = unaided / _true_share(binned, best, loose, unaided)
    slow_m, slow_turn, reach_m = np.exp(best)
    return Summary(
        x + step,
        covariance,
        float(np.sqrt(unaided[0, 0])),
        share,
        slow_m,
        slow_turn / binned.lever_m,
        reach_m,
    )


def _true_share(binned: Binned, logs: np.ndarray, information: np.ndarray, covariance: np.ndarray) -> float:
    """Return how much of what is known of the offset the motion tells; the rest, the log's noise pretends to.

    The noise of the log's rows wiggles the path, and wiggles that are no motion tell the offset in formulas
    alone (errors in variables: Fuller, Measurement Error Models, 1987). They count where the hand moves
    evenly.
    """
    lower = cho_factor(noise_of(binned, logs), lower=True)
    false = cho_solve(lower, binned.false_motion)
    others = binned.slope[:, 1:]
    weighted = cho_solve(lower, others)
    normal = information[1:, 1:] + others.T @ weighted
    pull = weighted.T @ binned.false_motion
    pretended = (binned.false_motion * false).sum() - (pull * np.linalg.solve(normal, pull)).sum()
    return float(max(1.0 - pretended * covariance[0, 0], LEAST_SHARE))


def restricted(
    binned: Binned, logs: np.ndarray, information: np.ndarray, expected: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """Return restricted log likelihood, step of x (p,) and covariance (p, p) for given slow errors.

    Parameters
    ----------
    binned
        The residual.
    logs
        Logarithms of size of place errors [m], of angle errors [m at the lever], and reach [m].
    information, expected
        (p, p) of priors and events, and (p,) their pull.
    """
    lower = cho_factor(noise_of(binned, logs), lower=True)
    weighted = cho_solve(lower, np.column_stack([binned.slope, binned.off]))
    normal = information + binned.slope.T @ weighted[:, :-1]
    pull = expected + binned.slope.T @ weighted[:, -1]
    covariance = np.linalg.inv(normal)
    step = covariance @ pull
    likelihood = (
        -np.log(np.diag(lower[0])).sum()
        - 0.5 * np.linalg.slogdet(normal)[1]
        - 0.5 * (binned.off @ weighted[:, -1] - pull @ step)
    )
    return float(likelihood), step, covariance


def noise_of(binned: Binned, logs: np.ndarray) -> np.ndarray:
    """Return the covariance (3 b, 3 b) of the binned residual, slow errors included."""
    place, turn, reach = np.exp(logs)
    bins = len(binned.way_m)
    alike = np.exp(-np.abs(binned.way_m[:, None] - binned.way_m) / reach)
    noise = binned.noise.copy()
    for axis, size in enumerate((place, place, turn)):
        block = slice(axis * bins, (axis + 1) * bins)
        noise[block, block] += size**2 * alike
    return noise


def bin_hand(
    problem: Problem, x: np.ndarray, sigma: np.ndarray
) -> tuple[Binned, tuple[np.ndarray, np.ndarray]]:
    """Return the hand's residual in bins of equal way, all markers of a frame taken together.

    Each frame's sightings give one small displacement of a rigid hand by weighted least squares; frames of a
    bin are averaged. Both are sums, so that slopes and noise of the sums are exact. Beside them come
    residuals (3 K,) and slopes (3 K, p), in standard deviations, of how the markers lie to each other.
    """
    off, (joint, slope) = problem.residual(x), problem.slopes(x)
    _, first, frame = np.unique(problem.seen.time_s, return_index=True, return_inverse=True)
    reduce, about, lever_m = _rigid(problem, sigma, frame)
    hand_off = np.einsum("mhc,mc->mh", reduce, off)
    frames = int(frame.max()) + 1
    hand = _by(frame, frames, hand_off)
    noise = _by(frame, frames, np.einsum("mhc,mc->mh", reduce**2, sigma**2))
    way_m = _way(problem, problem.robot_s(x)[first])
    bins = _bins(way_m)
    count = int(bins.max()) + 1
    share = np.zeros((count, frames))
    share[bins, np.arange(frames)] = 1.0
    share /= share.sum(axis=1, keepdims=True)
    grain = _grain(hand, bins, noise)
    sums = share[:, frame]
    by_joint, robot_s = np.einsum("mhc,mcj->mhj", reduce, joint), problem.robot_s(x)
    single = np.concatenate([(share**2) @ (grain[axis] * noise[:, axis]) for axis in range(3)])
    slopes = np.einsum("mhc,mcp->mhp", reduce, slope)
    binned = Binned(
        (share @ hand).T.ravel(),
        np.concatenate([sums @ slopes[:, axis] for axis in range(3)]),
        problem.path.covariance(by_joint, robot_s, sums) + np.diag(single),
        problem.scales[0] * problem.path.false_motion(by_joint, robot_s, sums),
        share @ way_m,
        lever_m,
    )
    rigid = np.stack([np.bincount(frame, axis, frames) for axis in hand_off.T], axis=1)
    rigid_slope = np.zeros((frames, *slopes.shape[1:]))
    np.add.at(rigid_slope, frame, slopes)
    own = off - np.einsum("mch,mh->mc", _spread(about, lever_m), rigid[frame])
    own_slope = slope - np.einsum("mch,mhp->mcp", _spread(about, lever_m), rigid_slope[frame])
    return binned, _between_markers(problem, x, own, own_slope, sigma)


def _spread(about: np.ndarray, lever_m: float) -> np.ndarray:
    """Return how a frame's displacement moves its sightings (m, 3, 3), which lie about (m, 2) its middle."""
    spread = np.tile(np.eye(3), (len(about), 1, 1))
    spread[:, 0, 2], spread[:, 1, 2] = -about[:, 1] / lever_m, about[:, 0] / lever_m
    spread[:, 2, 2] = 1.0 / lever_m
    return spread


def _between_markers(
    problem: Problem, x: np.ndarray, own: np.ndarray, own_slope: np.ndarray, sigma: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return each marker's mean residual and slope in the hand's frame, less what the rigid hand explains.

    As sure as one sighting: errors that all frames share are no less.
    """
    rig, marker = problem.rig, problem.seen.marker
    angle = hand_pose(rig.chain, rig.clamp, problem.path.at(problem.robot_s(x)))[:, 2]
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.zeros((len(angle), 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = cos
    turn[:, 0, 1], turn[:, 1, 0], turn[:, 2, 2] = sin, -sin, 1.0
    off, slope = np.einsum("mab,mb->ma", turn, own), np.einsum("mab,mbp->map", turn, own_slope)
    offs, slopes = [], []
    for index in np.unique(marker):
        mine = marker == index
        size = np.median(sigma[mine], axis=0)
        offs.append(off[mine].mean(axis=0) / size)
        slopes.append(slope[mine].mean(axis=0) / size[:, None])
    return np.concatenate(offs), np.concatenate(slopes)


def _rigid(problem: Problem, sigma: np.ndarray, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return what each sighting gives to its frame's displacement, where it lies, and the lever of angles.

    (m, 3, 3), (m, 2) about the frame's middle [m], [m].
    """
    seen, rig = problem.seen, problem.rig
    weight = 1.0 / sigma[:, 0] ** 2
    frames = int(frame.max()) + 1
    total = np.bincount(frame, weight, frames)
    centre = np.stack([np.bincount(frame, weight * seen.pose[:, axis], frames) / total for axis in (0, 1)], 1)
    about = seen.pose[:, :2] - centre[frame]
    lever_m = float(rig.size_m.mean())
    turn_weight = 1.0 / sigma[:, 2] ** 2
    turning = np.bincount(frame, weight * (about**2).sum(axis=1) + turn_weight, frames)[frame]
    reduce = np.zeros((len(frame), 3, 3))
    reduce[:, 0, 0] = reduce[:, 1, 1] = weight / total[frame]
    reduce[:, 2, 0] = -lever_m * weight * about[:, 1] / turning
    reduce[:, 2, 1] = lever_m * weight * about[:, 0] / turning
    reduce[:, 2, 2] = lever_m * turn_weight / turning
    return reduce, about, lever_m


def _way(problem: Problem, robot_s: np.ndarray) -> np.ndarray:
    """Return how far the hand has come by each instant, as the joints tell it [m]; rest counts a little."""
    hand_m = hand_pose(problem.rig.chain, problem.rig.clamp, problem.path.at(robot_s))[:, :2]
    steps = np.linalg.norm(np.diff(hand_m, axis=0), axis=1) + REST_M_S * np.diff(robot_s)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _bins(way_m: np.ndarray) -> np.ndarray:
    """Return the bin of each frame, of equal way; empty ones do not count."""
    edges = np.linspace(0.0, way_m[-1], min(MOST_BINS, len(way_m)) + 1)[1:-1]
    return np.unique(np.searchsorted(edges, way_m), return_inverse=True)[1]


def _grain(hand: np.ndarray, bins: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Return (3,) how much larger than said the noise within bins is."""
    count = np.bincount(bins)
    free = max(len(bins) - len(count), 1)
    grain = np.ones(3)
    for axis in range(3):
        mean = np.bincount(bins, hand[:, axis]) / count
        square = (hand[:, axis] - mean[bins]) ** 2 / noise[:, axis]
        grain[axis] = square.sum() / free
    return np.maximum(grain, 1e-4)


def _by(frame: np.ndarray, frames: int, values: np.ndarray) -> np.ndarray:
    return np.stack([np.bincount(frame, column, frames) for column in values.T], axis=1)
