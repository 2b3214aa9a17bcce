"""Why a log does not fit a video: the usual mistakes, each tried until one explains the hand's path."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from strandcast.alignment.fit import moving_rms_m, robust_fit, wrong_of
from strandcast.alignment.joints import joint_path
from strandcast.alignment.problem import Priors
from strandcast.alignment.rig import Rig, Seen, marker_poses, no_misfit
from strandcast.alignment.rows import MOVES, Rows, end_speeds
from strandcast.alignment.search import candidate_offsets
from strandcast.errors import StrandcastError

MOST_PERMUTED = 4  # joints; of more, pairs alone are exchanged
EXPLAINS_M = 0.005
EXPLAINS_SHARE = 0.25  # of the residual that is to be explained
LEAST_SIGHTINGS = 20
RATE_STEPS = np.linspace(0.88, 1.12, 25)
WIDE = Priors(link_length_m=0.05, marker_shift_m=0.05, marker_turn_rad=0.3)
LENGTHS_EXPLAIN_M, LENGTHS_EXPLAIN_SHARE = 0.002, 0.15  # so many free numbers must explain more
LARGEST_MISTAKE_M = 0.2
USUAL_HZ = (
    *(24, 25, 30, 48, 50, 60, 100, 120, 125, 150, 200, 240, 250, 300, 400, 480, 500, 600, 700, 750),
    *(800, 960, 1000, 1200, 1500, 2000, 2500, 3000, 4000, 5000, 10000),
)
SAME_RATE = 0.03  # clocks whose rates differ by less drift


@dataclass(frozen=True, eq=False)
class Suspect:
    """A mistake that would make this rig, these rows and these sightings right."""

    code: str
    what: str
    fix: str
    field: str | None
    rig: Rig
    rows: Rows
    seen: Seen


@dataclass(frozen=True, eq=False)
class Trial:
    """What does not fit: rig, rows, sightings, and the window of the offset."""

    rig: Rig
    rows: Rows
    seen: Seen
    names: tuple[str, ...]
    largest_offset_s: float | None


def offset_window(rows: Rows, seen: Seen, largest_offset_s: float | None) -> tuple[float, float]:
    """Return least and greatest offset at which log and video overlap."""
    least, greatest = rows.time_s[0] - seen.time_s[-1], rows.time_s[-1] - seen.time_s[0]
    if largest_offset_s is None:
        return float(least), float(greatest)
    same_start = rows.time_s[0] - seen.time_s[0]
    return float(max(least, same_start - largest_offset_s)), float(
        min(greatest, same_start + largest_offset_s)
    )


def why_not(trial: Trial, residual_m: float, file: str | None, arm_file: str | None) -> StrandcastError:
    """Return the refusal that names the mistake, or the log of another trial where none explains it.

    Parameters
    ----------
    trial
        As it was handed in.
    residual_m
        Of the best fit, or of the coarse search.
    file, arm_file
        For the message.
    """
    cost = f"the string's fit would be off by about {residual_m * 1e3:.0f} mm"
    cut = cut_log(trial.rows, file)
    if cut is not None:
        return cut
    off = f"the hand in the video stays {residual_m * 1e3:.1f} mm rms from where this log puts it"
    most_m = min(EXPLAINS_M, EXPLAINS_SHARE * residual_m)
    found = [(_explained_m(suspect, trial), suspect) for suspect in _suspects(trial)]
    found += _rate(trial)
    best_m, best = min(found, key=lambda pair: pair[0])
    if best_m < most_m:
        return StrandcastError(
            best.code,
            f"{off}; {best.what}, {best_m * 1e3:.1f} mm remain",
            file=arm_file if best.code == "SC-A015" else file,
            field=best.field,
            cost=cost,
            fix=best.fix,
        )
    wrong = wrong_lengths(trial)
    if wrong is not None and wrong[0] < min(LENGTHS_EXPLAIN_M, LENGTHS_EXPLAIN_SHARE * residual_m):
        return wrong_arm(wrong[1], f"{off}; ", cost, arm_file)
    return StrandcastError(
        "SC-A007",
        f"{off}, at the best offset; at most {EXPLAINS_M * 1e3:.0f} mm are believed, and no usual mistake "
        "(joints' order, signs, degrees, arm, frame rate, mirrored) explains it",
        file=file,
        cost=cost,
        fix="it looks like the log of another trial: give the one that was written during this video",
    )


def cut_log(rows: Rows, file: str | None, more: str = "") -> StrandcastError | None:
    """Return the refusal of a log that begins or ends while the joints move."""
    for place, instant_s, share in zip(
        ("begins", "ends"), (rows.time_s[0], rows.time_s[-1]), end_speeds(rows), strict=True
    ):
        if share > MOVES:
            return StrandcastError(
                "SC-A010",
                f"the log {place} at {instant_s:.3f} s while the joints move at {share:.0%} of their "
                f"greatest speed{more}",
                file=file,
                cost="where the hand is in the rest of the throw is not known",
                fix="the log is cut: copy the whole log of this throw",
            )
    return None


def wrong_arm(words: str, off: str, cost: str, arm_file: str | None) -> StrandcastError:
    """Return the refusal of an arm's file whose lengths the video denies."""
    return StrandcastError(
        "SC-A015",
        f"{off}this arm's file does not fit: {words}",
        file=arm_file,
        field="urdf, clamp, markers.hand",
        cost=cost,
        fix="is it the file of this arm? else measure that length, and the markers' places on the hand",
    )


def _suspects(trial: Trial) -> Iterator[Suspect]:
    rig, rows, seen, names = trial.rig, trial.rows, trial.seen, trial.names
    yield Suspect(
        "SC-A013",
        "with the log's angles taken as degrees",
        "import the log again with its angle unit: degrees",
        "q",
        rig,
        replace(rows, q_rad=np.radians(rows.q_rad)),
        seen,
    )
    for order in _orders(len(names)):
        told = ", ".join(names[k] for k in order)
        yield Suspect(
            "SC-A012",
            f"with the log's columns for {', '.join(names)} taken as {told}",
            f"the columns hold, in this order: {_inverse(order, names)}; import the log with these names",
            "joint_names",
            rig,
            replace(rows, q_rad=rows.q_rad[:, list(order)]),
            seen,
        )
    # Turned about at once, all joints make the mirror's path: a mirrored world is the likelier mistake.
    for joint in range(len(names)) if len(names) > 1 else ():
        sign = np.ones(len(names))
        sign[joint] = -1.0
        yield Suspect(
            "SC-A014",
            f"with the sign of {names[joint]} turned about",
            f"turn the axis of {names[joint]} about in the arm's URDF, or its sign in the import",
            names[joint],
            rig,
            replace(rows, q_rad=rows.q_rad * sign),
            seen,
        )
    for axis, word in ((0, "left and right"), (1, "up and down")):
        yield Suspect(
            "SC-A017",
            f"with {word} exchanged in the video",
            f"the world is mirrored: check the signs of {'xy'[axis]}_m of camera.plane.markers, plane_x and "
            "plane_y of the arm's file (and whether all joints count the other way), and that the video is "
            "not flipped",
            "camera.plane.markers",
            rig,
            rows,
            _mirrored(seen, axis),
        )


def _orders(joints: int) -> list[tuple[int, ...]]:
    same = tuple(range(joints))
    if joints <= MOST_PERMUTED:
        return [order for order in permutations(same) if order != same]
    swaps = []
    for a in range(joints):
        for b in range(a + 1, joints):
            order = list(same)
            order[a], order[b] = b, a
            swaps.append(tuple(order))
    return [*swaps, same[::-1]]


def _inverse(order: tuple[int, ...], names: tuple[str, ...]) -> str:
    """Return what each column really holds: column order[k] is joint k."""
    holds = [""] * len(names)
    for joint, column in enumerate(order):
        holds[column] = names[joint]
    return ", ".join(holds)


def _mirrored(seen: Seen, axis: int) -> Seen:
    pose = seen.pose.copy()
    pose[:, axis] *= -1.0
    pose[:, 2] = (np.pi if axis == 0 else 0.0) - pose[:, 2]
    # Printed upright, a mirrored marker's own axis would be turned about: its angle tells nothing here.
    return Seen(seen.time_s, seen.marker, pose, seen.sigma_m)


def _explained_m(suspect: Suspect, trial: Trial) -> float:
    """Return what a robust fit leaves of the hand's path under a suspicion [m]."""
    window = offset_window(suspect.rows, suspect.seen, trial.largest_offset_s)
    offsets, coarse_m = candidate_offsets(
        suspect.rig, suspect.rows.time_s, suspect.rows.q_rad, suspect.seen, window
    )
    left = [coarse_m[0] if coarse_m[0] > 0.03 else np.inf]
    if coarse_m[0] <= 0.03:
        left += [
            _fit_m(suspect.rig, suspect.rows, suspect.seen, offset_s, Priors())[0] for offset_s in offsets[:2]
        ]
    return float(min(left))


def _fit_m(
    rig: Rig, rows: Rows, seen: Seen, offset_s: float, priors: Priors
) -> tuple[float, np.ndarray | None]:
    """Return the residual of a robust fit [m], infinite where there is none, and (offset, drift, misfit)."""
    covered = seen.where(rows.covers(seen.time_s + offset_s))
    if len(covered.time_s) < LEAST_SIGHTINGS:
        return np.inf, None
    robot_s = covered.time_s + offset_s
    path = joint_path(rows.time_s, rows.q_rad, (float(robot_s[0]), float(robot_s[-1])))
    problem, x, sigma, _ = robust_fit(rig, path, covered, offset_s, priors)
    off = problem.residual(x)
    return moving_rms_m(off, covered, wrong_of(off, sigma)), x * problem.scales


def _rate(trial: Trial) -> list[tuple[float, Suspect]]:
    """Return the best frame rate: first by when the hand has come which share of its way, then by search."""
    rows, seen, rig = trial.rows, trial.seen, trial.rig
    marker = int(np.bincount(seen.marker).argmax())
    mine = seen.where(seen.marker == marker)
    told = marker_poses(rig, rows.q_rad, np.full(len(rows.q_rad), marker), no_misfit(rig))[:, :2]
    log_s = _way_times(rows.time_s, told)
    video_s = _way_times(mine.time_s, mine.pose[:, :2])
    if log_s is None or video_s is None:
        return []
    guess = float((log_s[-1] - log_s[0]) / (video_s[-1] - video_s[0]))
    best: tuple[float, float] = (np.inf, 1.0)
    for ratio in guess * RATE_STEPS:
        middle_s = float(np.mean(log_s - ratio * video_s))
        scaled = seen.scaled(ratio)
        _, coarse_m = candidate_offsets(
            rig, rows.time_s, rows.q_rad, scaled, (middle_s - 0.1, middle_s + 0.1)
        )
        best = min(best, (float(coarse_m[0]), float(ratio)))
    ratio = best[1]
    scaled = seen.scaled(ratio)
    offsets, _ = candidate_offsets(
        rig, rows.time_s, rows.q_rad, scaled, offset_window(rows, scaled, trial.largest_offset_s)
    )
    left_m, full = _fit_m(rig, rows, scaled, float(offsets[0]), Priors(drift=0.02))
    if full is None or abs(ratio * (1.0 + full[1]) - 1.0) < SAME_RATE or abs(full[1]) > 0.1:
        return []
    return [(left_m, _rate_suspect(trial, ratio * (1.0 + float(full[1]))))]


def _rate_suspect(trial: Trial, ratio: float) -> Suspect:
    return Suspect(
        "SC-A016", *rate_words(trial.seen, ratio), "camera.frame_rate_hz", trial.rig, trial.rows, trial.seen
    )


def rate_words(seen: Seen, ratio: float) -> tuple[str, str]:
    """Return what is wrong with a frame rate and how to mend it, for robot time over camera time."""
    said_hz = 1.0 / float(np.median(np.diff(np.unique(seen.time_s))))
    true_hz = said_hz / ratio
    kind = "a slow-motion export: " if ratio < 0.7 else ""
    return (
        f"with the camera's clock taken {ratio:.4g} times as fast ({kind}the video's times say {said_hz:.4g} "
        f"frames/s, the hand's motion {true_hz:.4g})",
        f"give the camera's true rate: camera.frame_rate_hz: {_round_rate(true_hz):g}",
    )


def _round_rate(rate_hz: float) -> float:
    """Return the usual rate near a fitted one, or the fitted one in four digits."""
    usual = np.array(USUAL_HZ, float)
    near = usual[np.argmin(np.abs(np.log(usual / rate_hz)))]
    return float(near) if abs(near / rate_hz - 1.0) < 0.005 else float(f"{rate_hz:.4g}")


def _way_times(time_s: np.ndarray, place_m: np.ndarray) -> np.ndarray | None:
    """Return when a path has come a tenth, two tenths … of its way; rest and noise add nothing to it."""
    edges = np.linspace(time_s[0], time_s[-1], 120)
    which = np.clip(np.searchsorted(edges, time_s, side="right") - 1, 0, 118)
    full = np.unique(which)
    middle = np.stack([[np.median(place_m[which == k, axis]) for k in full] for axis in (0, 1)], axis=1)
    times = np.array([time_s[which == k].mean() for k in full])
    step = np.linalg.norm(np.diff(middle, axis=0), axis=1)
    step[step < 0.02 * step.max()] = 0.0
    way = np.concatenate([[0.0], np.cumsum(step)])
    if way[-1] <= 0.0:
        return None
    return np.interp(np.arange(1, 10) / 10.0, way / way[-1], times)


def wrong_lengths(trial: Trial) -> tuple[float, str] | None:
    """Return the residual with the arm's lengths freed [m], and the one that is most wrong; None: no fit."""
    window = offset_window(trial.rows, trial.seen, trial.largest_offset_s)
    offsets, _ = candidate_offsets(trial.rig, trial.rows.time_s, trial.rows.q_rad, trial.seen, window)
    fits = [_fit_m(trial.rig, trial.rows, trial.seen, float(offset_s), WIDE) for offset_s in offsets]
    left_m, full = min(fits, key=lambda fit: fit[0])
    joints = len(trial.names)
    if full is None or np.abs(full[7 + joints : -len(trial.rig.ids)]).max() > LARGEST_MISTAKE_M:
        return None
    return left_m, length_words(trial.rig, trial.names, full[2:])


def length_words(rig: Rig, names: tuple[str, ...], vector: np.ndarray) -> str:
    """Return which length is most wrong. The last link, clamp and markers' places are one along the link."""
    joints, markers = len(names), len(rig.place_m)
    longer_m = vector[5 + joints : 5 + 2 * joints]
    shift_m = vector[5 + 2 * joints : 5 + 2 * joints + 2 * markers].reshape(markers, 2).mean(axis=0)
    turn_rad = float(vector[5 + 2 * joints + 2 * markers :].mean())
    hand_m = shift_m + np.array([longer_m[-1], 0.0])
    inner = int(np.argmax(np.abs(longer_m[:-1]))) if joints > 1 else 0
    if joints > 1 and abs(longer_m[inner]) > np.linalg.norm(hand_m):
        said_m = rig.chain.lengths_m[inner]
        return (
            f"the link after {names[inner]} is {said_m * 1e3:.0f} mm by the file, and "
            f"{(said_m + longer_m[inner]) * 1e3:.0f} mm by the video"
        )
    return (
        f"the markers on the hand sit {hand_m[0] * 1e3:+.0f} mm along and {hand_m[1] * 1e3:+.0f} mm across "
        f"the last link from where the file has them, turned by {turn_rad:+.2f} rad (last link, clamp or "
        "markers.hand)"
    )
