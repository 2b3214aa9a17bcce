"""The closest approach of a tracked path to a target or a bar."""

from dataclasses import dataclass, replace

import numpy as np

GAP_STEPS = 2.5  # a step of more than this many usual ones is a gap: one lost frame is bridged, two are not
GAP_SAMPLES = 50  # of the path across a gap; chosen, not sensitive
NEVER_TRACKED = "the tip was not tracked in two neighbouring frames of the throw"


@dataclass(frozen=True)
class Approach:
    """A path's closest approach to a target: after sample `index`, at `share` of the step to the next."""

    index: int
    share: float
    distance_m: float
    place_m: np.ndarray


def closest_approach(
    time_s: np.ndarray,
    tip_m: np.ndarray,
    target_m: np.ndarray,
    usual_step_s: float,
    window_s: tuple[float, float],
    touch_m: float = 0.0,
) -> tuple[Approach | None, str | None]:
    """Return the closest approach of the tracked path, or why the true one was not tracked.

    Parameters
    ----------
    time_s, tip_m
        (F,) rising, (F, 2 or 3): the tracked samples within the window.
    target_m
        (2,), or (3,) in space, or (2, 2): both ends of a bar.
    usual_step_s
        Spacing of the frames.
    window_s
        The time that counts.
    touch_m
        An approach counts only after the tip has been farther from the target than this.

    Notes
    -----
    Between neighbouring frames the path is the straight segment. Across a gap nothing is known: there is no
    answer where the path could have been closest there, that is, where the best tracked place is at the edge
    of a gap, or a cubic through both edges comes nearer.
    """
    if len(tip_m) < 2:
        return None, NEVER_TRACKED
    away_m = np.linalg.norm(tip_m - nearest_of_bar(tip_m, np.atleast_2d(target_m)), axis=1)
    clear = int(np.argmax(away_m > touch_m))
    if away_m[clear] <= touch_m or clear == len(tip_m) - 1:
        return None, "the tip was at the target from the start, and never clear of it"
    if clear:
        rest = time_s[clear:], tip_m[clear:]
        found, reason = closest_approach(*rest, target_m, usual_step_s, (time_s[clear], window_s[1]))
        return (None if found is None else replace(found, index=found.index + clear)), reason
    approaches = segment_approaches(tip_m, target_m)
    gaps = np.diff(time_s) > GAP_STEPS * usual_step_s
    distance = np.where(gaps, np.inf, [found.distance_m for found in approaches])
    if not np.isfinite(distance).any():
        return None, NEVER_TRACKED
    best = approaches[int(np.argmin(distance))]
    sample = best.index + round(best.share) if best.share in (0.0, 1.0) else None
    for gap in np.flatnonzero(gaps):
        if sample in (gap, gap + 1) or _gap_distance_m(time_s, tip_m, target_m, int(gap)) < best.distance_m:
            return None, gap_message(
                "the tip was not tracked at the closest approach", time_s[gap], time_s[gap + 1]
            )
    if sample == 0 and time_s[0] - window_s[0] > GAP_STEPS * usual_step_s:
        return None, gap_message("the tip was not tracked at the closest approach", window_s[0], time_s[0])
    if sample == len(time_s) - 1 and window_s[1] - time_s[-1] > GAP_STEPS * usual_step_s:
        return None, gap_message("the track ends while the tip still comes nearer", time_s[-1], window_s[1])
    return best, None


def segment_approaches(path_m: np.ndarray, target_m: np.ndarray) -> list[Approach]:
    """Return the closest approach of each segment of a path to a target or a bar; see `closest_approach`."""
    step = np.diff(path_m, axis=0)
    ends = np.atleast_2d(target_m)
    if len(ends) == 1:
        shares = _shares(path_m, step, ends[0])[None]
    else:
        # Two segments that do not cross are nearest at an end of one of them.
        none, all_ = np.zeros(len(step)), np.ones(len(step))
        shares = np.array(
            [none, all_, *(_shares(path_m, step, e) for e in ends), _crossings(path_m, step, ends)]
        )
    places = path_m[:-1] + shares[..., None] * step
    distances = np.linalg.norm(places - nearest_of_bar(places, ends), axis=2)
    best, every = distances.argmin(axis=0), np.arange(len(step))
    share, distance, place = (values[best, every] for values in (shares, distances, places))
    return [Approach(k, float(share[k]), float(distance[k]), place[k]) for k in range(len(step))]


def _shares(path_m: np.ndarray, step: np.ndarray, target_m: np.ndarray) -> np.ndarray:
    """Return at which share of each step the path is nearest to a place."""
    square = np.maximum((step**2).sum(axis=1), 1e-300)
    return np.asarray(np.clip(((target_m - path_m[:-1]) * step).sum(axis=1) / square, 0.0, 1.0))


def _crossings(path_m: np.ndarray, step: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return at which share of each step the path crosses the bar's line, 0 where it does not."""
    across = np.array([ends[0, 1] - ends[1, 1], ends[1, 0] - ends[0, 0]])
    height, rise = (path_m[:-1] - ends[0]) @ across, step @ across
    share = -height / np.where(rise == 0.0, np.inf, rise)
    return np.where((share >= 0.0) & (share <= 1.0), share, 0.0)


def nearest_of_bar(places: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return the places of a bar, or the target, that are nearest to other places (..., 2 or 3)."""
    along = ends[-1] - ends[0]
    square = max(float(along @ along), 1e-300)
    return np.asarray(ends[0] + np.clip((places - ends[0]) @ along / square, 0.0, 1.0)[..., None] * along)


def _gap_distance_m(time_s: np.ndarray, tip_m: np.ndarray, target_m: np.ndarray, gap: int) -> float:
    """Return how near the cubic with the speeds at both edges of a gap comes to the target."""
    before, after = max(gap - 1, 0), min(gap + 2, len(time_s) - 1)
    span = time_s[gap + 1] - time_s[gap]
    leave = _speed(time_s, tip_m, before, gap) * span
    arrive = _speed(time_s, tip_m, gap + 1, after) * span
    s = np.linspace(0.0, 1.0, GAP_SAMPLES)[:, None]
    path = (
        (1 + 2 * s) * (1 - s) ** 2 * tip_m[gap]
        + s * (1 - s) ** 2 * leave
        + s**2 * (3 - 2 * s) * tip_m[gap + 1]
        + s**2 * (s - 1) * arrive
    )
    return min(found.distance_m for found in segment_approaches(path, target_m))


def _speed(time_s: np.ndarray, tip_m: np.ndarray, first: int, last: int) -> np.ndarray:
    if last == first:
        return np.zeros_like(tip_m[0])
    return np.asarray((tip_m[last] - tip_m[first]) / (time_s[last] - time_s[first]))


def gap_message(what: str, from_s: float, to_s: float) -> str:
    """Return the message that something was not tracked, and when."""
    return f"{what} (nothing between {from_s:.3f} and {to_s:.3f} s, robot time)"
