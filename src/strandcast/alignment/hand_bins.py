"""The hand's residual in bins along its path, with its derivatives and the noise of detections and log."""

from dataclasses import dataclass

import numpy as np

from strandcast.alignment.problem import ClockProblem
from strandcast.arm.kinematics import hand_pose

# Chosen.
MOST_BINS = 80
REST_M_S = 0.2  # path length that a second at rest counts as


@dataclass(frozen=True, eq=False)
class Binned:
    """The hand's mean residual in b bins of its path: x and y [m], angle times lever [m].

    Attributes
    ----------
    off, slope
        (3 b,) residual and (3 b, p) its derivatives, axis by axis.
    noise
        (3 b, 3 b) covariance from single detections and from the log's rows.
    spurious
        (3 b, r) the part of the offset's derivatives that the noise of each of the log's values feigns.
    path_m
        (b,) path length at which each bin lies.
    """

    off: np.ndarray
    slope: np.ndarray
    noise: np.ndarray
    spurious: np.ndarray
    path_m: np.ndarray


def bin_hand(
    problem: ClockProblem, x: np.ndarray, sigma: np.ndarray
) -> tuple[Binned, tuple[np.ndarray, np.ndarray]]:
    """Return the hand's residual in bins of equal path length, and residuals between the markers.

    Each frame's detections give one small displacement of a rigid hand by weighted least squares; the frames
    of a bin are averaged. Both steps are linear, so that the derivatives and the noise of the bins are exact.
    The second part holds residuals (3 K,) and derivatives (3 K, p), in standard deviations, of the markers'
    poses relative to each other.
    """
    off, (joint, slope) = problem.residual(x), problem.jacobian(x)
    _, first, frame = np.unique(problem.detections.time_s, return_index=True, return_inverse=True)
    reduce, about, lever_m = _rigid(problem, sigma, frame)
    hand_off = np.einsum("mhc,mc->mh", reduce, off)
    frames = int(frame.max()) + 1
    hand = _sums(frame, frames, hand_off)
    noise = _sums(frame, frames, np.einsum("mhc,mc->mh", reduce**2, sigma**2))
    path_m = _path_length_m(problem, problem.robot_s(x)[first])
    bins = _bins(path_m)
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
        problem.scales[0] * problem.path.spurious_motion(by_joint, robot_s, sums),
        share @ path_m,
    )
    rigid_slope = np.zeros((frames, *slopes.shape[1:]))
    np.add.at(rigid_slope, frame, slopes)
    own = off - np.einsum("mch,mh->mc", _spread(about, lever_m), hand[frame])
    own_slope = slope - np.einsum("mch,mhp->mcp", _spread(about, lever_m), rigid_slope[frame])
    return binned, _between_markers(problem, x, own, own_slope, sigma)


def _spread(about: np.ndarray, lever_m: float) -> np.ndarray:
    """Return how a frame's displacement moves its detections (m, 3, 3), at (m, 2) from its centre."""
    spread = np.tile(np.eye(3), (len(about), 1, 1))
    spread[:, 0, 2], spread[:, 1, 2] = -about[:, 1] / lever_m, about[:, 0] / lever_m
    spread[:, 2, 2] = 1.0 / lever_m
    return spread


def _between_markers(
    problem: ClockProblem, x: np.ndarray, own: np.ndarray, own_slope: np.ndarray, sigma: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return each marker's mean residual and derivatives in the hand's frame, less the rigid hand's.

    They count as one detection, because all frames share these errors.
    """
    rig, marker = problem.rig, problem.detections.marker
    angle = hand_pose(rig.chain, rig.clamp, problem.path.at(problem.robot_s(x))).angle_rad
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


def _rigid(
    problem: ClockProblem, sigma: np.ndarray, frame: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return each detection's part in its frame's displacement, where it lies, and the angles' lever.

    (m, 3, 3), (m, 2) from the frame's centre [m], [m].
    """
    position_m, rig = problem.detections.pose.position_m, problem.rig
    weight = 1.0 / sigma[:, 0] ** 2
    frames = int(frame.max()) + 1
    total = np.bincount(frame, weight, frames)
    centre = _sums(frame, frames, weight[:, None] * position_m) / total[:, None]
    about = position_m - centre[frame]
    lever_m = float(rig.size_m.mean())
    turn_weight = 1.0 / sigma[:, 2] ** 2
    turning = np.bincount(frame, weight * (about**2).sum(axis=1) + turn_weight, frames)[frame]
    reduce = np.zeros((len(frame), 3, 3))
    reduce[:, 0, 0] = reduce[:, 1, 1] = weight / total[frame]
    reduce[:, 2, 0] = -lever_m * weight * about[:, 1] / turning
    reduce[:, 2, 1] = lever_m * weight * about[:, 0] / turning
    reduce[:, 2, 2] = lever_m * turn_weight / turning
    return reduce, about, lever_m


def _path_length_m(problem: ClockProblem, robot_s: np.ndarray) -> np.ndarray:
    """Return the length of the hand's path up to each instant by the joints [m]; rest counts a little."""
    hand_m = hand_pose(problem.rig.chain, problem.rig.clamp, problem.path.at(robot_s)).position_m
    steps = np.linalg.norm(np.diff(hand_m, axis=0), axis=1) + REST_M_S * np.diff(robot_s)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _bins(path_m: np.ndarray) -> np.ndarray:
    """Return the bin of each frame, of equal path length; empty bins are skipped."""
    edges = np.linspace(0.0, path_m[-1], min(MOST_BINS, len(path_m)) + 1)[1:-1]
    return np.unique(np.searchsorted(edges, path_m), return_inverse=True)[1]


def _grain(hand: np.ndarray, bins: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Return (3,) the variance within bins over its nominal value."""
    count = np.bincount(bins)
    free = max(len(bins) - len(count), 1)
    grain = np.ones(3)
    for axis in range(3):
        mean = np.bincount(bins, hand[:, axis]) / count
        square = (hand[:, axis] - mean[bins]) ** 2 / noise[:, axis]
        grain[axis] = square.sum() / free
    return np.maximum(grain, 1e-4)


def _sums(frame: np.ndarray, frames: int, values: np.ndarray) -> np.ndarray:
    """Return the sums (frames, c) of the values (m, c) of each frame."""
    return np.stack([np.bincount(frame, column, frames) for column in values.T], axis=1)
