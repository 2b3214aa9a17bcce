"""Score the tracker on filmed videos whose truth is known.

    python -m strandcast_studies.benchmarks.video.score --work DIR [--only NAME]

prints a line per video and a summary of the targets. docs/explanation/tracking-benchmark.md explains the
numbers.
"""

import argparse
import json
import resource
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from strandcast.arm.load import PlanarArm, load_arm
from strandcast.config.string import String
from strandcast.config.track import TrackSettings
from strandcast.records.camera import Camera
from strandcast.records.files import atomic_write
from strandcast.records.track import OCCLUDED, PREDICTED, UNSURE
from strandcast.tracking.result import Tracked
from strandcast.tracking.track_video import track_video
from strandcast.tracking.tracker import TrackerInput
from strandcast.video.ingest import inspect_video
from strandcast_studies.benchmarks.video.peers import PeerTrack
from strandcast_studies.benchmarks.video.scenes import ARM_FILE, read_case
from strandcast_studies.benchmarks.video.truth import ON_THE_STRING_M, Truth

FAR_PX = 5.0  # larger errors count as lost; chosen
ON_STRING_PX, OTHER_BRANCH_PX = 2.0, 12.0  # see `wrong_order`; chosen
VISIBLE_SHARE = 0.8  # of the mass points, from which a frame counts as visible; chosen
FLAGGED = UNSURE | OCCLUDED | PREDICTED
CROSSING_REACH_M = 0.03  # the order is also checked this far along the string before and after a loop


ScoredTrack = Tracked | PeerTrack  # point 0 is the hand


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of a track by point: (F, n) each, mass points 1 to n."""

    along_px: np.ndarray  # along the true string; NaN where the track has no place
    across_px: np.ndarray
    visible: np.ndarray  # whether the true point is visible
    placed: np.ndarray  # whether the track has a place
    flagged: np.ndarray  # whether the place is flagged as uncertain or missing
    sigma_along_px: np.ndarray  # stated by the track
    sigma_across_px: np.ndarray

    @property
    def overall_px(self) -> np.ndarray:
        """Distance to the true point."""
        return np.asarray(np.hypot(self.along_px, self.across_px))


@dataclass(frozen=True)
class Calibration:
    """Ratios of errors to stated sigmas: rms, overall and by axis, and shares within 1 and 2 sigma."""

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
    """One video's score; lengths in px of the string's plane. See docs/explanation/tracking-benchmark.md."""

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


def score(name: str, truth: Truth, track: ScoredTrack, taken_s: float = float("nan")) -> Score:
    """Score a track of a video; `taken_s` is the CPU time of tracking [s]."""
    errors = errors_of(truth, track)
    off, along, across = errors.overall_px, np.abs(errors.along_px), np.abs(errors.across_px)
    frames = visible_frames(errors)
    every = errors.visible & errors.placed
    sure = every & ~errors.flagged
    scored = every & frames[:, None]
    far = errors.visible & (~errors.placed | (off > FAR_PX))
    far_frames = frames & far.any(axis=1)
    owned = np.asarray((errors.flagged | ~far).all(axis=1))
    order = wrong_order(truth, track, errors)
    stated_m = getattr(track, "choices", {}).get("length_m", float("nan"))
    worst = np.where(scored, off, 0.0).max(axis=1)
    return Score(
        name=name,
        frames=len(off),
        visible_frames=int(frames.sum()),
        across_median_px=_of(np.median, across[scored]),
        along_mean_px=_of(np.mean, along[scored]),
        along_rms_px=_of(_rms, along[scored]),
        mean_px=_of(np.mean, off[scored]),
        rms_px=_of(_rms, off[scored]),
        every_mean_px=_of(np.mean, off[every]),
        every_rms_px=_of(_rms, off[every]),
        unflagged_mean_px=_of(np.mean, off[sure]),
        unflagged_rms_px=_of(_rms, off[sure]),
        tip_rms_px=_of(_rms, off[:, -1][scored[:, -1]]),
        hand_rms_px=hand_rms_px(truth, track),
        far_share=float(far_frames.sum() / max(frames.sum(), 1)),
        far_flagged_share=float(owned[far_frames].mean()) if far_frames.any() else 1.0,
        misplaced_share=float((frames & (scored & (off > FAR_PX)).any(axis=1)).sum() / max(frames.sum(), 1)),
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


def errors_of(truth: Truth, track: ScoredTrack) -> Errors:
    """Compare a track with the truth, point by point."""
    count = track.points_m.shape[1] - 1
    shares = truth.shares_m(count)
    true = truth.points_m(count)
    pixel_m = truth.metre_per_pixel(true)
    off = (track.points_m[:, 1:] - true) / pixel_m[..., None]
    along = truth.directions(shares)
    placed = np.isfinite(off).all(axis=2)
    flags = track.flags[:, 1:]
    return Errors(
        along_px=(off * along).sum(axis=2),
        across_px=off[..., 1] * along[..., 0] - off[..., 0] * along[..., 1],
        visible=truth.visible(shares),
        placed=placed,
        flagged=~placed | ((flags & FLAGGED) != 0),
        sigma_along_px=_sigma_m(track, "along")[:, 1:] / pixel_m,
        sigma_across_px=_sigma_m(track, "across")[:, 1:] / pixel_m,
    )


def hand_rms_px(truth: Truth, track: ScoredTrack) -> float:
    """Return the rms distance between the track's point 0 and the arm's clamp."""
    hand = truth.arrays.hand[:, :2]
    off = np.linalg.norm(track.points_m[:, 0] - hand, axis=1) / truth.metre_per_pixel(hand)
    return _of(_rms, off[np.isfinite(off)])


def _sigma_m(track: ScoredTrack, axis: str) -> np.ndarray:
    """Return the stated sigma along or across the string, or the common one."""
    own = getattr(track, f"sigma_{axis}_m", None)
    return np.asarray(track.sigma_m if own is None else own)


def visible_frames(errors: Errors) -> np.ndarray:
    """Return the frames (F,) in which the string is visible."""
    return np.asarray(errors.visible.mean(axis=1) >= VISIBLE_SHARE)


def calibration(errors: Errors, chosen: np.ndarray) -> Calibration:
    """Compare errors with stated sigmas at the chosen points (F, n)."""
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


class CrossingOrder(NamedTuple):
    """Whether the track exchanged the branches of a self-crossing in a frame, and whether it is flagged."""

    wrong: bool
    flagged: bool


def wrong_order(truth: Truth, track: ScoredTrack, errors: Errors) -> list[CrossingOrder]:
    """Return for each frame with a visible self-crossing whether points are on the wrong branch.

    Such a point is on the true string, but more than OTHER_BRANCH_PX along it from its own place, and about
    as far after the crossing as its own place is before it. Points in and close to the loop are checked.
    """
    dense = np.arange(0.0, float(truth.arrays.length_m), ON_THE_STRING_M)
    curves = truth.at(dense)
    shares = truth.shares_m(track.points_m.shape[1] - 1)
    wrong: dict[int, np.ndarray] = {}
    for crossing in truth.crossings:
        frame = crossing.frame
        near = shares > crossing.first_m - CROSSING_REACH_M
        near &= shares < crossing.second_m + CROSSING_REACH_M
        near &= errors.visible[frame] & errors.placed[frame] & (errors.overall_px[frame] > FAR_PX)
        pixel_m = float(truth.metre_per_pixel(curves[frame].mean(axis=0)))
        points = track.points_m[frame, 1:]
        apart = np.linalg.norm(points[:, None] - curves[frame][None], axis=2)
        apart = np.where(np.isfinite(apart) & near[:, None], apart, np.inf)
        on_string = apart.min(axis=1) < ON_STRING_PX * pixel_m
        mirror = crossing.first_m + crossing.second_m - shares
        swapped = _exchanged(
            on_string, dense[apart.argmin(axis=1)], shares, mirror, OTHER_BRANCH_PX * pixel_m
        )
        wrong[frame] = wrong.get(frame, np.zeros(len(shares), bool)) | swapped
    return [
        CrossingOrder(bool(points.any()), bool(errors.flagged[frame][points].all()))
        for frame, points in wrong.items()
    ]


def _exchanged(
    on_string: np.ndarray, closest_m: np.ndarray, shares_m: np.ndarray, mirror_m: np.ndarray, far_m: float
) -> np.ndarray:
    """Return which points (n,) are on the other branch of a crossing.

    A track that goes round the loop the wrong way, or leaves by the wrong end, is on the true curve, at
    `closest_m`, near the mirror image `mirror_m` of its own place `shares_m`: as far after the crossing as it
    should be before it. A single point of a track that slid along the string may be there too, but then most
    of its neighbours are not.
    """
    slid = np.abs(closest_m - shares_m)
    moved = on_string & (slid > far_m)
    mirrored = moved & (np.abs(closest_m - mirror_m) < 0.5 * slid)
    return np.asarray(mirrored & (2 * mirrored.sum() >= moved.sum()))


def _of(measure: Callable[[np.ndarray], float], values: np.ndarray) -> float:
    return float(measure(values)) if len(values) else float("nan")


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@dataclass(frozen=True)
class TrackingTarget:
    """A target of the tracker: a number of the score and its bounds."""

    name: str
    of: Callable[[Score], float]
    most: float
    least: float = -np.inf

    def met(self, one: Score) -> bool:
        """Return whether a video meets the target; an unavailable number does not."""
        return bool(self.least <= self.of(one) <= self.most)


TARGETS = (
    TrackingTarget("across, median [px]", lambda s: s.across_median_px, 0.1),
    TrackingTarget("along, mean [px]", lambda s: s.along_mean_px, 0.7),
    TrackingTarget("along, rms [px]", lambda s: s.along_rms_px, 2.0),
    TrackingTarget("overall, mean [px]", lambda s: s.mean_px, 0.7),
    TrackingTarget("overall, rms [px]", lambda s: s.rms_px, 2.0),
    TrackingTarget("visible frames off by 5 px or lost", lambda s: s.far_share, 0.01),
    TrackingTarget("of those, flagged", lambda s: s.far_flagged_share, 1.0, 0.95),
    TrackingTarget("wrong order without a flag [frames]", lambda s: s.wrong_order_unflagged, 0),
    TrackingTarget("error over sigma, rms", lambda s: s.unflagged.rms, 1.5, 1 / 1.5),
)


def track_case(folder: Path, arm: PlanarArm, video: Path | None = None) -> tuple[Tracked, float]:
    """Track a filmed video, or another file of the same frames; return the track and its CPU time [s]."""
    case, facts = read_case(folder)
    path = video or folder / "video.mp4"
    given = TrackerInput(
        video=path,
        facts=inspect_video(path),
        camera=Camera.read(folder / "camera.json"),
        string=String(length_m=facts["length_m"], points=facts["points"]),
        free_length_m=facts["length_m"],
        markers=arm.markers,
        marker_dictionary=arm.marker_dictionary,
        exposure_s=case.exposure_s,
    )
    begin_s = cpu_s()
    tracked = track_video(given, TrackSettings())
    return tracked, cpu_s() - begin_s


def cpu_s() -> float:
    """Return the CPU time [s] of this process and its finished children."""
    own, children = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime


def save_track(folder: Path, tracked: Tracked) -> None:
    """Write tracked.npz beside the video, for pictures."""
    with atomic_write(folder / "tracked.npz") as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, points_m=tracked.points_m, sigma_m=tracked.sigma_m, flags=tracked.flags)


def summary(scores: list[Score]) -> str:
    """Return the number of videos that meet each target, as lines of text."""
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


def score_folder(work: Path, only: str | None = None, show: Callable[[str], None] = print) -> list[Score]:
    """Track and score the videos below a folder whose names contain `only`."""
    arm = load_arm(ARM_FILE).planar()
    scores = []
    show(HEAD)
    for folder in sorted(path.parent for path in work.glob("*/case.json")):
        if only is None or only in folder.name:
            tracked, taken_s = track_case(folder, arm)
            save_track(folder, tracked)
            scores.append(score(folder.name, Truth.read(folder), tracked, taken_s))
            show(line(scores[-1]))
    return scores


def main(arguments: list[str] | None = None) -> None:
    """Score from the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="folder of filmed videos")
    parser.add_argument("--only", help="only videos whose name contains this")
    parser.add_argument("--json", type=Path, help="write the scores to this file")
    chosen = parser.parse_args(arguments)
    scores = score_folder(chosen.work, chosen.only, lambda text: print(text, flush=True))
    print(summary(scores))
    if chosen.json is not None:
        chosen.json.write_text(json.dumps([asdict(one) for one in scores], indent=1))


if __name__ == "__main__":
    main()
