"""Score the tracker on filmed videos whose truth is known.

    python -m strandcast.bench.video_score --work DIR [--only NAME]

prints a line per video and a summary against the targets. What each number means is told in
docs/tracking-benchmark.md.
"""

from __future__ import annotations

import argparse
import json
import resource
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from strandcast.arm.load import Arm, load_arm
from strandcast.bench.video_scenes import ARM_FILE, read_case
from strandcast.bench.video_truth import ON_THE_STRING_M, Truth
from strandcast.records.camera import Camera
from strandcast.records.files import atomic_write
from strandcast.records.track import OCCLUDED, PREDICTED, UNSURE
from strandcast.tracking.hand import HandMarker
from strandcast.tracking.result import StringHint, Tracked
from strandcast.tracking.track import Options, track_video
from strandcast.video.ingest import inspect_video

FAR_PX = 5.0
ON_STRING_PX, OTHER_BRANCH_PX = 2.0, 12.0
VISIBLE_SHARE = 0.8  # of the mass points, from which a frame counts as visible
FLAGGED = UNSURE | OCCLUDED | PREDICTED
CROSSING_REACH_M = 0.03  # along the string, before and behind a loop, where its order is checked


class Track(Protocol):
    """What is scored: (F, n + 1, 2) places [m], (F, n + 1) sigmas [m] and flags; point 0 is the hand."""

    points_m: np.ndarray
    sigma_m: np.ndarray
    flags: np.ndarray


@dataclass(frozen=True, eq=False)
class Errors:
    """A track against the truth, point by point: (F, n) each, mass points 1 to n.

    Attributes
    ----------
    along_px, across_px
        Error along and across the true string; NaN where the track has no place.
    visible
        Whether the true point can be seen.
    placed, flagged
        Whether the track has a place, and whether it says that the place is doubtful, or has none.
    sigma_along_px, sigma_across_px
        As the track states them.
    """

    along_px: np.ndarray
    across_px: np.ndarray
    visible: np.ndarray
    placed: np.ndarray
    flagged: np.ndarray
    sigma_along_px: np.ndarray
    sigma_across_px: np.ndarray

    @property
    def overall_px(self) -> np.ndarray:
        """Return the distance to the true point."""
        return np.hypot(self.along_px, self.across_px)


@dataclass(frozen=True)
class Calibration:
    """Errors over stated sigmas, of some points: rms, of each axis too, shares within 1 and 2 sigma."""

    points: int
    rms: float
    rms_along: float
    rms_across: float
    within_1: float
    within_2: float
    within_1_along: float
    within_1_across: float


@dataclass(frozen=True)
class Score:
    """One video's score; lengths in px of the string's plane. See docs/tracking-benchmark.md."""

    name: str
    frames: int
    visible_frames: int
    across_median_px: float
    along_mean_px: float
    along_rms_px: float
    mean_px: float
    rms_px: float
    every_mean_px: float
    every_rms_px: float
    unflagged_mean_px: float
    unflagged_rms_px: float
    tip_rms_px: float
    hand_rms_px: float
    far_share: float
    far_flagged_share: float
    misplaced_share: float
    silent_frames: int
    placed_share: float
    unflagged_share: float
    crossing_frames: int
    wrong_order_frames: int
    wrong_order_unflagged: int
    unflagged: Calibration
    flagged: Calibration
    length_error_m: float
    worst_frame: int
    cpu_ms_per_frame: float


def score(name: str, truth: Truth, track: Track, taken_s: float = float("nan")) -> Score:
    """Score a track of a video.

    Parameters
    ----------
    name
        The video's.
    truth
        What was filmed.
    track
        What was found in it.
    taken_s
        CPU time that finding it took [s].
    """
    errors = errors_of(truth, track)
    off, along, across = errors.overall_px, np.abs(errors.along_px), np.abs(errors.across_px)
    frames = visible_frames(errors)
    every = errors.visible & errors.placed
    sure = every & ~errors.flagged
    seen = every & frames[:, None]
    far = errors.visible & (~errors.placed | (off > FAR_PX))
    far_frames = frames & far.any(axis=1)
    owned = np.asarray((errors.flagged | ~far).all(axis=1))
    order = wrong_order(truth, track, errors)
    stated_m = getattr(track, "choices", {}).get("length_m", float("nan"))
    worst = np.where(seen, off, 0.0).max(axis=1)
    return Score(
        name=name,
        frames=len(off),
        visible_frames=int(frames.sum()),
        across_median_px=_of(np.median, across[seen]),
        along_mean_px=_of(np.mean, along[seen]),
        along_rms_px=_of(_rms, along[seen]),
        mean_px=_of(np.mean, off[seen]),
        rms_px=_of(_rms, off[seen]),
        every_mean_px=_of(np.mean, off[every]),
        every_rms_px=_of(_rms, off[every]),
        unflagged_mean_px=_of(np.mean, off[sure]),
        unflagged_rms_px=_of(_rms, off[sure]),
        tip_rms_px=_of(_rms, off[:, -1][seen[:, -1]]),
        hand_rms_px=hand_rms_px(truth, track),
        far_share=float(far_frames.sum() / max(frames.sum(), 1)),
        far_flagged_share=float(owned[far_frames].mean()) if far_frames.any() else 1.0,
        misplaced_share=float((frames & (seen & (off > FAR_PX)).any(axis=1)).sum() / max(frames.sum(), 1)),
        silent_frames=int((sure & (off > FAR_PX)).any(axis=1).sum()),
        placed_share=float(errors.placed[errors.visible].mean()),
        unflagged_share=float((~errors.flagged)[errors.visible].mean()),
        crossing_frames=len(order),
        wrong_order_frames=sum(one.wrong for one in order),
        wrong_order_unflagged=sum(one.wrong and not one.flagged for one in order),
        unflagged=calibration(errors, sure),
        flagged=calibration(errors, every & errors.flagged),
        length_error_m=float(stated_m - truth.arrays.length_m),
        worst_frame=int(np.argmax(worst)),
        cpu_ms_per_frame=1e3 * taken_s / len(off),
    )


def errors_of(truth: Truth, track: Track) -> Errors:
    """Compare a track with the truth, point by point."""
    count = track.points_m.shape[1] - 1
    shares = truth.shares_m(count)
    true = truth.points_m(count)
    pixel_m = truth.metre_per_pixel(true)
    off = (np.asarray(track.points_m)[:, 1:] - true) / pixel_m[..., None]
    along = truth.directions(shares)
    placed = np.isfinite(off).all(axis=2)
    flags = np.asarray(track.flags)[:, 1:]
    return Errors(
        along_px=(off * along).sum(axis=2),
        across_px=off[..., 1] * along[..., 0] - off[..., 0] * along[..., 1],
        visible=truth.visible(shares),
        placed=placed,
        flagged=~placed | ((flags & FLAGGED) != 0),
        sigma_along_px=_sigma_m(track, "along")[:, 1:] / pixel_m,
        sigma_across_px=_sigma_m(track, "across")[:, 1:] / pixel_m,
    )


def hand_rms_px(truth: Truth, track: Track) -> float:
    """Return the rms distance between the track's point 0 and where the arm's clamp is."""
    hand = truth.arrays.hand[:, :2]
    off = np.linalg.norm(np.asarray(track.points_m)[:, 0] - hand, axis=1) / truth.metre_per_pixel(hand)
    return _of(_rms, off[np.isfinite(off)])


def _sigma_m(track: Track, axis: str) -> np.ndarray:
    """Return the stated sigma along or across the string, where a track tells them apart."""
    own = getattr(track, f"sigma_{axis}_m", None)
    return np.asarray(track.sigma_m if own is None else own)


def visible_frames(errors: Errors) -> np.ndarray:
    """Tell in which frames (F,) the string is to be seen."""
    return np.asarray(errors.visible.mean(axis=1) >= VISIBLE_SHARE)


def calibration(errors: Errors, chosen: np.ndarray) -> Calibration:
    """Hold errors against stated sigmas at the chosen points (F, n)."""
    along = np.abs(errors.along_px[chosen]) / errors.sigma_along_px[chosen]
    across = np.abs(errors.across_px[chosen]) / errors.sigma_across_px[chosen]
    both = np.concatenate([along, across])
    return Calibration(
        points=int(chosen.sum()),
        rms=_of(_rms, both),
        rms_along=_of(_rms, along),
        rms_across=_of(_rms, across),
        within_1=_of(np.mean, both < 1.0),
        within_2=_of(np.mean, both < 2.0),
        within_1_along=_of(np.mean, along < 1.0),
        within_1_across=_of(np.mean, across < 1.0),
    )


@dataclass(frozen=True)
class Order:
    """A frame in which the string crosses itself: whether branches were exchanged, and whether it says so."""

    frame: int
    wrong: bool
    flagged: bool


def wrong_order(truth: Truth, track: Track, errors: Errors) -> list[Order]:
    """Tell of each frame with a visible self-crossing whether points sit on another branch than their own.

    A point does if it lies on the true string, but at a place along it that is more than OTHER_BRANCH_PX
    from its own and about as far behind the crossing as its own is before it. It is checked in the loop
    and a little around it.
    """
    dense = np.arange(0.0, float(truth.arrays.length_m), ON_THE_STRING_M)
    curves = truth.at(dense)
    shares = truth.shares_m(track.points_m.shape[1] - 1)
    wrong: dict[int, np.ndarray] = {}
    for crossing in truth.crossings:
        frame, pair = crossing.frame, (crossing.first_m, crossing.second_m)
        near = (shares > pair[0] - CROSSING_REACH_M) & (shares < pair[1] + CROSSING_REACH_M)
        near &= errors.visible[frame] & errors.placed[frame] & (errors.overall_px[frame] > FAR_PX)
        pixel_m = float(truth.metre_per_pixel(curves[frame].mean(axis=0)))
        points = np.asarray(track.points_m)[frame, 1:]
        swapped = _exchanged(points, near, shares, dense, curves[frame], sum(pair), pixel_m)
        wrong[frame] = wrong.get(frame, np.zeros(len(shares), bool)) | swapped
    return [
        Order(frame, bool(points.any()), bool(errors.flagged[frame][points].all()))
        for frame, points in wrong.items()
    ]


def _exchanged(
    points_m: np.ndarray, near: np.ndarray, shares_m: np.ndarray, dense_m: np.ndarray, curve_m: np.ndarray,
    both_m: float, pixel_m: float,
) -> np.ndarray:  # fmt: skip
    """Tell which points (n,) lie on the other branch of a crossing whose two places add up to `both_m`.

    What has gone round the loop the wrong way, or has left by the wrong end, lies on the true curve (D, 2)
    near its own place's mirror image: as far behind the crossing as it should be before it. One point of
    a string that has merely slid along may do so too; then most of its neighbours do not.
    """
    apart = np.linalg.norm(points_m[:, None] - curve_m[None], axis=2)
    apart = np.where(np.isfinite(apart) & near[:, None], apart, np.inf)
    closest = dense_m[apart.argmin(axis=1)]
    slid = np.abs(closest - shares_m)
    moved = (apart.min(axis=1) < ON_STRING_PX * pixel_m) & (slid > OTHER_BRANCH_PX * pixel_m)
    mirrored = moved & (np.abs(closest - (both_m - shares_m)) < 0.5 * slid)
    return np.asarray(mirrored & (2 * mirrored.sum() >= moved.sum()))


def _of(measure: Callable[[np.ndarray], float], values: np.ndarray) -> float:
    return float(measure(values)) if len(values) else float("nan")


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@dataclass(frozen=True)
class Target:
    """A target of the tracker: which number of a score, and between what it must lie."""

    name: str
    of: Callable[[Score], float]
    most: float
    least: float = -np.inf

    def met(self, one: Score) -> bool:
        """Tell whether a video meets the target; a number that could not be had does not."""
        return bool(self.least <= self.of(one) <= self.most)


TARGETS = (
    Target("across, median [px]", lambda s: s.across_median_px, 0.1),
    Target("along, mean [px]", lambda s: s.along_mean_px, 0.7),
    Target("along, rms [px]", lambda s: s.along_rms_px, 2.0),
    Target("overall, mean [px]", lambda s: s.mean_px, 0.7),
    Target("overall, rms [px]", lambda s: s.rms_px, 2.0),
    Target("visible frames off by 5 px or lost", lambda s: s.far_share, 0.01),
    Target("of those, flagged", lambda s: s.far_flagged_share, 1.0, 0.95),
    Target("wrong order without a flag [frames]", lambda s: s.wrong_order_unflagged, 0),
    Target("error over sigma, rms", lambda s: s.unflagged.rms, 1.5, 1 / 1.5),
)


def track_case(folder: Path, arm: Arm, video: Path | None = None) -> tuple[Tracked, float]:
    """Track a filmed video, or another file of the same frames; return the track and its CPU time [s]."""
    case, facts = read_case(folder)
    path = video or folder / "video.mp4"
    camera = Camera.read(folder / "camera.json")
    begin_s = cpu_s()
    tracked = track_video(
        path, inspect_video(path), camera, StringHint(facts["length_m"], facts["points"]), hand_markers(arm),
        arm.marker_dictionary, Options(exposure_s=case.exposure_s),
    )  # fmt: skip
    return tracked, cpu_s() - begin_s


def hand_markers(arm: Arm) -> list[HandMarker]:
    """Return the arm's markers as the tracker takes them."""
    return [HandMarker(m.id, m.size_m, m.place_m, m.angle_rad, m.offset_m) for m in arm.markers]


def cpu_s() -> float:
    """Return the CPU time [s] that this process and its ended children have taken."""
    own, children = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime


def save_track(folder: Path, tracked: Tracked) -> None:
    """Write tracked.npz beside the video, for pictures."""
    with atomic_write(folder / "tracked.npz") as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, points_m=tracked.points_m, sigma_m=tracked.sigma_m, flags=tracked.flags)


def summary(scores: list[Score]) -> str:
    """Return how many videos meet each target, in lines."""
    lines = [f"{'target':40s} {'met':>7s}  {'median':>7s} {'worst':>7s}"]
    for target in TARGETS:
        values = [target.of(one) for one in scores]
        bad = min(values) if np.isfinite(target.least) and target.most == 1.0 else np.nanmax(values)
        lines.append(
            f"{target.name:40s} {sum(target.met(one) for one in scores):3d}/{len(scores):<3d}  "
            f"{np.nanmedian(values):7.3f} {bad:7.3f}"
        )
    return "\n".join(lines)


HEAD = (
    "video         across  along: mean   rms  all: mean   rms   tip  far%  flagged  placed unflagged"
    "  cross wrong !flag  e/s along across  ms/frame  length mm"
)


def line(s: Score) -> str:
    """Return a video's score as a line of text."""
    return (
        f"{s.name:12s} {s.across_median_px:7.3f} {s.along_mean_px:11.2f} {s.along_rms_px:6.2f} "
        f"{s.mean_px:9.2f} {s.rms_px:6.2f} {s.tip_rms_px:5.1f} {100 * s.far_share:5.1f} "
        f"{s.far_flagged_share:8.2f} {s.placed_share:7.3f} {s.unflagged_share:9.3f} "
        f"{s.crossing_frames:6d} {s.wrong_order_frames:5d} {s.wrong_order_unflagged:5d} "
        f"{s.unflagged.rms:5.2f} {s.unflagged.rms_along:5.2f} {s.unflagged.rms_across:6.2f} "
        f"{s.cpu_ms_per_frame:9.2f} {1e3 * s.length_error_m:9.2f}"
    )


def score_folder(work: Path, only: str | None = None, tell: Callable[[str], None] = print) -> list[Score]:
    """Track and score the videos below a folder, those whose name holds `only`."""
    arm = load_arm(ARM_FILE)
    scores = []
    tell(HEAD)
    for folder in sorted(path.parent for path in work.glob("*/case.json")):
        if only is None or only in folder.name:
            tracked, taken_s = track_case(folder, arm)
            save_track(folder, tracked)
            scores.append(score(folder.name, Truth.read(folder), tracked, taken_s))
            tell(line(scores[-1]))
    return scores


def main(arguments: list[str] | None = None) -> None:
    """Score from the command line."""
    parser = argparse.ArgumentParser(prog="python -m strandcast.bench.video_score", description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="folder of filmed videos")
    parser.add_argument("--only", help="score the videos whose name holds this")
    parser.add_argument("--json", type=Path, help="write the scores to this file")
    chosen = parser.parse_args(arguments)
    scores = score_folder(chosen.work, chosen.only, lambda text: print(text, flush=True))
    print(summary(scores))
    if chosen.json is not None:
        chosen.json.write_text(json.dumps([asdict(one) for one in scores], indent=1))


if __name__ == "__main__":
    main()
