"""The first pass: track the string both ways from its clearest frame."""

import itertools
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from strandcast.progress import Progress
from strandcast.tracking.chain.detection import Detection, detect_string
from strandcast.tracking.chain.fit import FrameFit
from strandcast.tracking.chain.frames import StringFrames
from strandcast.tracking.chain.motion import ChainState
from strandcast.tracking.chain.tracker import BETTER, GOOD, ChainTracker
from strandcast.tracking.tracker import StringHint

# Frames in which the string is detected without its neighbours: the larger number only where the smaller one
# shows the string's end in fewer than SHOWN good frames. Chosen; not sensitive.
SURVEYED = (6, 24)
SHOWN = 4
CLEAR_REWARD = 0.5  # chosen: reward from which a node counts as the first visible one
THREADS = 2  # as many as there are directions
ANCHORS = 4  # chosen: best detections tried as the start


def survey(
    frames: StringFrames, candidates: np.ndarray, string: StringHint, polarity: float | None
) -> list[Detection]:
    """Return detections of the string in frames spread over the candidates (K,)."""
    found: dict[int, Detection | None] = {}

    def detect(index: int) -> Detection | None:
        frame = frames.at(index)
        return None if frame is None else detect_string(index, frame, string, polarity)

    for count in SURVEYED:
        spread = np.unique(np.linspace(0, len(candidates) - 1, count).astype(int))
        new = [index for index in candidates[spread].tolist() if index not in found]
        with ThreadPoolExecutor(THREADS) as pool:
            found |= dict(zip(new, pool.map(detect, new), strict=True))
        detections = [one for index in sorted(found) if (one := found[index]) is not None]
        good = [one for one in detections if one.fit.value >= GOOD]
        if len(good) >= SHOWN and sum(np.isfinite(one.end_m) for one in good) >= SHOWN:
            break
    return detections


def track_bidirectional(
    frames: StringFrames, detections: list[Detection], tracker: ChainTracker
) -> tuple[int, list[FrameFit | None]]:
    """Track the string both ways from the best detection.

    Returns that frame, and the fit per frame, None where the string was not found.

    The tracker knows the string's appearance and length, and counts its redetections.
    """
    count = len(frames)
    progress, done = Progress("track: string", total=count), itertools.count(2)
    anchor, fit = best_anchor(frames, detections, tracker)
    fits: list[FrameFit | None] = [None] * count
    fits[anchor] = fit

    def one_way(order: range) -> int:
        own = tracker.copy()
        own.restart([ChainState(float(frames.time_s[anchor]), fit.root, fit.heading)])
        for index in order:
            frame = frames.at(index)
            fits[index] = own.step(frame) if frame is not None else None
            progress(next(done))
        return own.redetections

    # The kernels release the GIL; the two directions run in parallel and write to different frames.
    with ThreadPoolExecutor(THREADS) as pool:
        ways = pool.map(one_way, (range(anchor + 1, count), range(anchor - 1, -1, -1)))
        tracker.redetections += sum(ways)
    return anchor, fits


def take_corrections(
    frames: StringFrames, fits: list[FrameFit | None], corrected: Sequence[int], tracker: ChainTracker
) -> None:
    """Fit the corrected frames through their given places, and those around them from there, in place.

    The latter as long as that makes them better.
    """
    for start in corrected:
        frame = frames.at(start)
        if frame is None:
            continue
        tried = []
        for around in ([start], [start - 1], [start + 1], []):
            tracker.restart(states_at(frames, fits, around))
            tried.append(tracker.through_given(frame))
        fits[start] = max(tried, key=lambda fit: fit.value)
        for way in (-1, 1):
            tracker.restart(states_at(frames, fits, [start]))
            for index in range(start + way, len(frames) if way > 0 else -1, way):
                ahead, old = frames.at(index), fits[index]
                new = None if ahead is None or index in corrected else tracker.step(ahead)
                if new is None or (old is not None and new.value < old.value + BETTER):
                    break
                fits[index] = new


def states_at(frames: StringFrames, fits: list[FrameFit | None], indices: list[int]) -> list[ChainState]:
    """Return the chain at the given frames, without those in which it was not found."""
    states = []
    for index in indices:
        fit = fits[index] if 0 <= index < len(fits) else None
        if fit is not None:
            states.append(ChainState(float(frames.time_s[index]), fit.root, fit.heading))
    return states


def best_anchor(
    frames: StringFrames, detections: list[Detection], tracker: ChainTracker
) -> tuple[int, FrameFit]:
    """Return the frame that shows the string best, and the string there."""
    ranked = sorted(detections, key=lambda one: one.fit.value * one.fit.open_share, reverse=True)[:ANCHORS]
    tried = []
    for detection in ranked:
        frame = frames.at(detection.frame)
        assert frame is not None
        tried.append((detection.frame, tracker.fit(frame, detection.fit.heading)))
    return max(tried, key=lambda one: one[1].value * one[1].open_share)


def clear_paths(
    frames: StringFrames, fits: list[FrameFit | None]
) -> Iterator[tuple[FrameFit, int, float, float]]:
    """Yield fits that show the tip, the first visible node, and path and direction for `fit_clamp`."""
    for index, fit in enumerate(fits):
        if fit is None or fit.end_is_off or fit.value < GOOD:
            continue
        clear = np.flatnonzero(fit.reward[:-1] >= CLEAR_REWARD)
        if len(clear) and np.isfinite(fit.tip_slide_m):
            first = clear[0]
            hidden_m = float(np.hypot(*(fit.nodes()[first] - frames.clamp_m(index))))
            along_m = fit.link_m * (len(fit.heading) - first) + fit.tip_slide_m
            yield fit, first, hidden_m + along_m, fit.heading[first] - frames.hand.pose.angle_rad[index]


def clamp_paths(frames: StringFrames, fits: list[FrameFit | None]) -> tuple[np.ndarray, np.ndarray]:
    """Return path lengths and directions (K,) as `fit_clamp` takes them, from frames that show the tip."""
    both = np.array([path for _, _, *path in clear_paths(frames, fits)]).reshape(-1, 2)
    return both[:, 0], both[:, 1]
