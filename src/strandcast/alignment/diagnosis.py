"""The diagnosis of a log that does not fit its video: undo each usual mistake until one explains the path."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, permutations
from typing import NamedTuple

import numpy as np

from strandcast.alignment.changing_rate import uneven_clock
from strandcast.alignment.coarse_search import AlignmentData, candidate_offsets
from strandcast.alignment.fine_fit import moving_rms_m, outliers, robust_fit
from strandcast.alignment.frame_rate import coarse_rate, rate_words
from strandcast.alignment.log_rows import MOVES, LogRows, end_speeds
from strandcast.alignment.problem import Priors
from strandcast.alignment.single_error import FIRST_ZERO, FREED
from strandcast.core.pose import Pose
from strandcast.errors import StrandcastError
from strandcast.rig.faults import length_words, wrong_arm_error, zero_words
from strandcast.rig.model import Detections, RigError

# Chosen; not sensitive: a mistake leaves decimetres, its correction millimetres.
MOST_PERMUTED = 4  # joints; of more, only pairs are exchanged
EXPLAINS_M = 0.005
EXPLAINS_SHARE = 0.25  # of the residual to be explained
WIDE = Priors(link_length_m=0.05, marker_shift_m=0.05, marker_turn_rad=0.3)
ANY_RATE_DRIFT = 0.02
LENGTHS_EXPLAIN_M, LENGTHS_EXPLAIN_SHARE = 0.002, 0.15  # stricter, because many numbers are free
LARGEST_MISTAKE_M = 0.2
COARSE_ENOUGH_M = 0.03  # a hypothesis that the coarse search leaves further off is not fitted
SAME_RATE = 0.03  # rates that differ by less differ by the clocks' drift


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A mistake, in words, and the data as they would be without it."""

    code: str
    what: str
    fix: str
    field: str | None
    corrected: AlignmentData


class _Fitted(NamedTuple):
    """Residual of a robust fit [m], and (offset, drift, rig errors); infinite and None without a fit."""

    residual_m: float
    full: np.ndarray | None


def diagnose(data: AlignmentData, residual_m: float) -> StrandcastError:
    """Return the refusal that names the mistake; if none explains the path, the log of another trial.

    `residual_m` is that of the best fit, or of the coarse search.
    """
    cost = f"the string's fit would be off by about {residual_m * 1e3:.0f} mm"
    truncated = truncated_log_error(data.rows, data.log_file)
    if truncated is not None:
        return truncated
    off = f"the hand in the video stays {residual_m * 1e3:.1f} mm rms from where this log puts it"
    most_m = min(EXPLAINS_M, EXPLAINS_SHARE * residual_m)
    found = [(_remaining_m(hypothesis), hypothesis) for hypothesis in _hypotheses(data)]
    found += [*_frame_rate(data), *_later_start(data)]
    best_m, best = min(found, key=lambda pair: pair[0])
    if best_m < most_m:
        return StrandcastError(
            best.code,
            f"{off}; {best.what}, {best_m * 1e3:.1f} mm remain",
            file=data.log_file if best.code == "SC-A012" else None,
            field=best.field,
            cost=cost,
            fix=best.fix,
        )
    for wrong in (_wrong_zero_or_length, _wrong_lengths):
        of_arm = wrong(data)
        if of_arm is not None and of_arm[0] < min(LENGTHS_EXPLAIN_M, LENGTHS_EXPLAIN_SHARE * residual_m):
            return wrong_arm_error(of_arm[1], f"{off}; ", cost, data.arm_file)
    clock = uneven_clock(data, RigError.none(data.rig))
    if clock is not None and _fit(clock.corrected(data), 0.0, Priors()).residual_m < most_m:
        return clock.error(off, cost)
    return StrandcastError(
        "SC-A007",
        f"{off}, at the best offset; at most {EXPLAINS_M * 1e3:.0f} mm are accepted, and no usual mistake "
        "(joints' order, signs, degrees, arm, frame rate, mirrored) explains it",
        file=data.log_file,
        cost=cost,
        fix="it looks like the log of another trial: use the one that was written during this video",
    )


def truncated_log_error(rows: LogRows, file: str | None, more: str = "") -> StrandcastError | None:
    """Return the refusal of a log that begins or ends while the joints move, or None."""
    for place, instant_s, share in zip(
        ("begins", "ends"), (rows.time_s[0], rows.time_s[-1]), end_speeds(rows), strict=True
    ):
        if share > MOVES:
            return StrandcastError(
                "SC-A007",
                f"the log {place} at {instant_s:.3f} s while the joints move at {share:.0%} of their "
                f"greatest speed{more}",
                file=file,
                cost="the hand's path in the rest of the throw is not known",
                fix="the log is cut: copy the whole log of this throw",
            )
    return None


def _hypotheses(data: AlignmentData) -> Iterator[Hypothesis]:
    yield Hypothesis(
        "SC-A012",
        "with the log's angles taken as degrees",
        "import the log again with its angle unit: degrees",
        "q",
        _with_joints(data, np.radians(data.rows.q_rad)),
    )
    names = data.joint_names
    yield from (_reordered(data, order) for order in _orders(len(names)))
    # With all signs reversed the path is mirrored: a mirrored world is the likelier mistake.
    if len(names) > 1:
        yield from (_reversed(data, joint) for joint in range(len(names)))
    for axis, words in ((0, "left and right"), (1, "up and down")):
        yield Hypothesis(
            "SC-C027",
            f"with {words} exchanged in the video",
            f"the world is mirrored: check the signs of {'xy'[axis]}_m of camera.plane.markers, plane_x and "
            "plane_y of the arm's file (and whether all joints count the other way), and that the video is "
            "not flipped",
            "camera.plane.markers",
            replace(data, detections=_mirrored(data.detections, axis)),
        )


def _with_joints(data: AlignmentData, q_rad: np.ndarray) -> AlignmentData:
    return replace(data, rows=replace(data.rows, q_rad=q_rad))


def _reordered(data: AlignmentData, order: tuple[int, ...]) -> Hypothesis:
    names = data.joint_names
    held = ", ".join(names[order.index(k)] for k in range(len(names)))  # column order[k] holds joint k
    return Hypothesis(
        "SC-A012",
        f"with the log's columns for {', '.join(names)} taken as {held}",
        f"the columns hold, in this order: {held}; import the log with these names",
        "joint_names",
        _with_joints(data, data.rows.q_rad[:, list(order)]),
    )


def _reversed(data: AlignmentData, joint: int) -> Hypothesis:
    name = data.joint_names[joint]
    sign = np.ones(len(data.joint_names))
    sign[joint] = -1.0
    return Hypothesis(
        "SC-A012",
        f"with the sign of {name} reversed",
        f"reverse the axis of {name} in the arm's URDF, or its sign in the import",
        name,
        _with_joints(data, data.rows.q_rad * sign),
    )


def _orders(joints: int) -> list[tuple[int, ...]]:
    same = tuple(range(joints))
    if joints <= MOST_PERMUTED:
        return [order for order in permutations(same) if order != same]
    swaps = []
    for a, b in combinations(same, 2):
        order = list(same)
        order[a], order[b] = b, a
        swaps.append(tuple(order))
    return [*swaps, same[::-1]]


def _mirrored(detections: Detections, axis: int) -> Detections:
    position_m = detections.pose.position_m.copy()
    position_m[:, axis] *= -1.0
    # The printed marker is not mirrored: its own axis would point the other way, so the angle proves nothing.
    angle_rad = (np.pi if axis == 0 else 0.0) - detections.pose.angle_rad
    return replace(detections, pose=Pose(position_m, angle_rad))


def _remaining_m(hypothesis: Hypothesis) -> float:
    """Return the residual that a robust fit leaves under a hypothesis [m]."""
    corrected = hypothesis.corrected
    offsets, coarse_m = candidate_offsets(corrected)
    if coarse_m[0] > COARSE_ENOUGH_M:
        return float(coarse_m[0])
    return min(_fit(corrected, offset_s, Priors()).residual_m for offset_s in offsets[:2])


def _fit(data: AlignmentData, offset_s: float, priors: Priors, freed: int | None = None) -> _Fitted:
    """Fit from one offset; `freed` is an unknown with a prior that is `FREED` times as wide."""
    problem = data.problem(offset_s, priors)
    if problem is None:
        return _Fitted(np.inf, None)
    if freed is not None:
        problem.scales[freed] *= FREED
    fit = robust_fit(problem)
    off = problem.residual(fit.x)
    return _Fitted(moving_rms_m(off, problem.detections, outliers(off, fit.sigma)), fit.x * problem.scales)


def _frame_rate(data: AlignmentData) -> list[tuple[float, Hypothesis]]:
    """Return the best other frame rate and its residual [m]; empty if there is none."""
    ratio = coarse_rate(data)
    if ratio is None:
        return []
    scaled = replace(data, detections=data.detections.scaled(ratio))
    offsets, _ = candidate_offsets(scaled)
    fitted = _fit(scaled, float(offsets[0]), Priors(drift=ANY_RATE_DRIFT))
    if fitted.full is None:
        return []
    drift = float(fitted.full[1])
    if abs(ratio * (1.0 + drift) - 1.0) < SAME_RATE or abs(drift) > 0.1:
        return []
    what, fix = rate_words(data.detections, ratio * (1.0 + drift))
    hypothesis = Hypothesis("SC-V017", what, fix, "camera.frame_rate_hz", data)
    return [(fitted.residual_m, hypothesis)]


def _later_start(data: AlignmentData) -> list[tuple[float, Hypothesis]]:
    """Return the best offset beyond the largest one and its residual [m]; empty if there is none."""
    free = replace(data, largest_offset_s=None)
    if free.offset_window() == data.offset_window():
        return []
    apart_s = abs(float(candidate_offsets(free)[0][0]) - data.rows.time_s[0])
    what = f"the recordings start {apart_s:.2f} s apart, more than align.largest_offset_s"
    fix = "raise align.largest_offset_s if they do, or use the log that was written during this video"
    hypothesis = Hypothesis("SC-A007", what, fix, "align.largest_offset_s", free)
    return [(_remaining_m(hypothesis), hypothesis)]


def _wrong_zero_or_length(data: AlignmentData) -> tuple[float, str] | None:
    """Return the residual with one joint's zero or one link's length free [m], and that error in words."""
    names, offsets = data.joint_names, candidate_offsets(data)[0][:2]
    freed = range(FIRST_ZERO, FIRST_ZERO + 2 * len(names))
    fits = [(_fit(data, float(offset_s), Priors(), k), k - FIRST_ZERO) for k in freed for offset_s in offsets]
    best, which = min(fits, key=lambda pair: pair[0].residual_m)
    if best.full is None:
        return None
    error = RigError.from_vector(best.full[2:], data.rig)
    if which >= len(names):
        return best.residual_m, length_words(data.rig, names, error)
    return best.residual_m, zero_words(names, which, float(error.zero_rad[which]))


def _wrong_lengths(data: AlignmentData) -> tuple[float, str] | None:
    """Return the residual with the arm's lengths fitted [m], and the most wrong one in words."""
    fits = [_fit(data, float(offset_s), WIDE) for offset_s in candidate_offsets(data)[0]]
    best = min(fits, key=lambda fit: fit.residual_m)
    if best.full is None:
        return None
    error = RigError.from_vector(best.full[2:], data.rig)
    if max(np.abs(error.length_m).max(), np.abs(error.shift_m).max()) > LARGEST_MISTAKE_M:
        return None
    return best.residual_m, length_words(data.rig, data.joint_names, error)
