"""Films that no single frame rate fits, such as exports with a speed ramp, and the clock that does."""

from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from strandcast.alignment.coarse_search import MOST_DETECTIONS, STEP_S, AlignmentData
from strandcast.core.interpolation import resampled
from strandcast.errors import StrandcastError
from strandcast.rig.model import RigError, marker_poses

RATES = np.array([1 / 8, 1 / 6, 1 / 4, 1 / 3, 1 / 2, 1, 2, 3, 4, 6, 8])  # robot time over the film's
# Chosen. A change of rate must save as much as three frames that are 13 mm off. Sound synthetic throws, also
# with worn encoders or one marker hidden, save less than 65 by any number of changes.
SIGMA_M, MOST_SIGMAS = 0.003, 10.0
CHANGE, LEAST_SAVED = 60.0, 240.0
MOST_PARTS = 3  # in a message


@dataclass(frozen=True, eq=False)
class UnevenClock:
    """The clock of piecewise constant rate that fits the hand best.

    Attributes
    ----------
    time_s, robot_s
        (F,) instants of the film on both clocks [s].
    rate
        (F - 1,) of `RATES`, between them.
    """

    time_s: np.ndarray
    robot_s: np.ndarray
    rate: np.ndarray

    def corrected(self, data: AlignmentData) -> AlignmentData:
        """Return the data as they would be with an even clock."""
        robot_s = np.interp(data.detections.time_s, self.time_s, self.robot_s)
        return replace(data, detections=replace(data.detections, time_s=robot_s))

    def error(self, off: str, cost: str) -> StrandcastError:
        """Return the refusal of the film (SC-V017)."""
        steps_s = np.diff(self.time_s)
        usual = max(RATES, key=lambda rate: float(steps_s[self.rate == rate].sum()))
        end, parts = 0, []
        for rate, run in groupby((self.rate / usual).tolist()):
            begin, end = end, end + len(list(run))
            pace = f"{rate:.2g} times as fast" if rate > 1.0 else f"{1.0 / rate:.2g} times as slow"
            if rate != 1.0:
                parts.append(f"{pace} from {self.time_s[begin]:.3f} to {self.time_s[end]:.3f} s")
        return StrandcastError(
            "SC-V017",
            f"{off}; no single frame rate fits: parts of the film play at another speed, about "
            f"{', '.join(parts[:MOST_PARTS])}{' …' * (len(parts) > MOST_PARTS)}",
            field="camera.frame_rate_hz",
            cost=cost,
            fix="give the camera's original film, not an export with a speed ramp or lost frames "
            "(docs/how-to/film-with-a-phone.md); if it is the original, check the joint log's time stamps",
        )


def uneven_clock(data: AlignmentData, error: RigError) -> UnevenClock | None:
    """Return the uneven clock if it fits much better than the best single rate.

    The cheapest line through a table of frames and robot times is found by dynamic programming: each frame
    costs its squared distance from the hand's path, with a limit for misread markers, each change of rate
    `CHANGE`. Before and after the log the arm is assumed to stand still.
    """
    time_s = np.unique(data.detections.time_s)
    time_s = time_s[np.unique(np.linspace(0, len(time_s) - 1, MOST_DETECTIONS).astype(int))]
    grid_s, cost = _costs(data, error, time_s)
    moved = np.round(RATES[:, None] * (time_s - time_s[0]) / STEP_S).astype(int)
    moves = np.diff(moved, axis=1)
    rates = np.arange(len(RATES))[:, None]
    best, single = (np.tile(cost[0], (len(RATES), 1)) for _ in range(2))
    before = np.zeros((len(time_s), *best.shape), np.int8)  # the rate until each frame, by that after it
    for k in range(1, len(time_s)):
        changed = best.min(axis=0) + CHANGE
        before[k] = np.where(best <= changed, rates, best.argmin(axis=0))
        best = _moved(np.minimum(best, changed), moves[:, k - 1]) + cost[k]
        single = _moved(single, moves[:, k - 1]) + cost[k]
    if float(single.min() - best.min()) < LEAST_SAVED:
        return None
    which, place = (int(each) for each in np.unravel_index(best.argmin(), best.shape))
    robot_s, rate = np.full(len(time_s), grid_s[place]), np.zeros(len(time_s) - 1)
    for k in range(len(time_s) - 1, 0, -1):
        place -= int(moves[which, k - 1])
        robot_s[k - 1], rate[k - 1] = grid_s[place], RATES[which]
        which = int(before[k, which, place])
    return UnevenClock(time_s, robot_s, rate)


def capped_cost(off_m: np.ndarray) -> np.ndarray:
    """Return the cost of distances from the hand's path (..., 2) [m]."""
    return np.asarray(np.minimum((off_m**2).sum(axis=-1) / SIGMA_M**2, MOST_SIGMAS**2))


def _costs(data: AlignmentData, error: RigError, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a grid of robot times (U,) [s], and the cost of each frame (F, U) at each of them."""
    rows, some = data.rows, data.detections.where(np.isin(data.detections.time_s, time_s))
    margin_s = np.ptp(time_s)
    grid_s = np.arange(rows.time_s[0] - margin_s, rows.time_s[-1] + margin_s, STEP_S)
    frame, cost = np.searchsorted(time_s, some.time_s), np.zeros((len(time_s), len(grid_s)))
    for marker in np.unique(some.marker):
        mine = some.marker == marker
        path = marker_poses(data.rig, rows.q_rad, np.full(len(rows.time_s), marker), error).position_m
        path_m = resampled(grid_s, rows.time_s, path)
        np.add.at(cost, frame[mine], capped_cost(some.pose.position_m[mine][:, None] - path_m))
    return grid_s, cost


def _moved(cost: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """Return rows of costs (R, U) moved along by (R,) places; what enters is impossible."""
    after = np.full(cost.shape, np.inf)
    for row, move in enumerate(moves.tolist()):
        after[row, move:] = cost[row, : cost.shape[1] - move]
    return after
