"""The throws that the planner expected of a motion: of the one that was thrown, and of the next."""

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strandcast.errors import StrandcastError
from strandcast.records.motion import Motion
from strandcast.records.predicted import PredictedThrows, read_predicted
from strandcast.records.verdict import Verdict
from strandcast.report import drawing as draw
from strandcast.report.expected import expected_miss, expected_shares
from strandcast.report.measures import target_distance_m
from strandcast.report.numbers import millimetres, percent
from strandcast.report.panels.content import PanelContent
from strandcast.report.panels.next_motion import draw_aims, expectation, planned_next
from strandcast.report.panels.page_data import TrialPageData, with_caveat
from strandcast.report.panels.strobe import draw_target, mark_closest
from strandcast.report.results import FILES, Array, TrialResults

AFTER_HIT_S = 0.1  # drawn after the closest approach; chosen
ROOM = 1.5  # of the view of the target around the misses; chosen
LOW, HIGH = 0.1, 0.9  # quantiles that bound four of five throws
ONE_THROW = {"color": draw.PLANNED["color"], "linewidth": 0.9, "alpha": 0.5}
BAND = {"facecolor": draw.PLANNED["color"], "alpha": 0.3, "linewidth": 0}


def predicted_throw(page: TrialPageData) -> PanelContent:
    """Return the throw as it was expected, with every plausible string, and as it was measured."""
    results = page.results
    motion = results.need("motion")
    throws = throws_of(motion, results.need("predicted"), FILES["predicted"])
    verdict, start_s = results.need("verdict"), results.need("alignment").motion_start_s
    window = results.in_window()
    tip_m, since_s = results.need("track").points_m[window, -1], results.robot_time_s()[window] - start_s
    expected_m = target_distance_m(verdict, throws.tip_m)
    until_s = AFTER_HIT_S + max(
        float(np.median(throws.time_s[_nearest(expected_m)])),
        0.0 if verdict.closest_robot_time_s is None else verdict.closest_robot_time_s - start_s,
    )
    shown, expected = since_s <= until_s, throws.time_s <= until_s
    figure = draw.new_figure(10.0, 7.2, left=0.07, top=0.96, bottom=0.13)
    grid = figure.add_gridspec(2, 2, width_ratios=[1.3, 1], height_ratios=[1.5, 1], wspace=0.2, hspace=0.3)
    path_axes, near_axes, time_axes, miss_axes = (figure.add_subplot(grid[k]) for k in range(4))
    half_m = _half_width_m(throws, max(verdict.hit_radius_m, verdict.miss_m or 0.0))
    _draw_fan(path_axes, throws, throws.tip_m[:, expected])
    path_axes.plot(*tip_m[shown].T, **draw.MEASURED, label="measured")
    _draw_fan(near_axes, throws, _near(throws.tip_m[:, expected], verdict.target_m, half_m))
    near_axes.plot(*_near(tip_m[shown], verdict.target_m, half_m).T, **draw.MEASURED, marker=".")
    _frame_target(near_axes, verdict.target_m, half_m)
    for axes in (path_axes, near_axes):
        draw_target(axes, verdict)
    band_m = [_quantile(expected_m, share) for share in (LOW, HIGH)]
    apart_m = target_distance_m(verdict, tip_m)
    since_ms = 1e3 * throws.time_s[expected]
    low_mm, high_mm = (1e3 * edge_m[expected] for edge_m in band_m)
    time_axes.fill_between(since_ms, low_mm, high_mm, **BAND)
    time_axes.plot(1e3 * since_s[shown], 1e3 * apart_m[shown], **draw.MEASURED)
    time_axes.set(xlabel=draw.SINCE_START, ylabel="tip – target [mm]", xlim=(0, 1e3 * until_s))
    draw.log_if_wide(time_axes, "y", 1e3 * apart_m[shown & (apart_m > 0)])
    mark_closest(time_axes, verdict, start_s)
    _draw_misses(miss_axes, motion, verdict.hit_radius_m)
    if verdict.miss_m is not None:
        place_m = np.array(verdict.closest_m if verdict.closest_m is not None else verdict.target_m)
        for axes in (path_axes, near_axes):
            axes.plot(*place_m, **draw.marks("D", 6, color=draw.MEASURED["color"]), label="closest approach")
        miss_axes.axvline(1e3 * verdict.miss_m, color=draw.MEASURED["color"], linewidth=2.0)
    draw.legend_below(figure, path_axes)
    finding = _finding(motion, verdict) + _within(results, throws, band_m, apart_m, since_s)
    return PanelContent(
        finding,
        draw.Drawing(figure, f"The throw as predicted and as measured. {finding}", (time_axes,)),
        sources=["predicted.parquet", "track.parquet", "verdict.json"],
    )


def next_throw(page: TrialPageData) -> PanelContent:
    """Return the next throw as it is expected, with every plausible string."""
    path = planned_next(page)
    beside = path.with_name(FILES["predicted"])
    shown = os.path.relpath(beside, page.folder)
    try:
        motion = Motion.read(path)
        throws = throws_of(motion, read_predicted(beside), shown)
    except StrandcastError as problem:
        if problem.file != shown:  # the page must not depend on where the folder is
            problem.file = os.path.relpath(problem.file or beside, page.folder)
        raise
    radius_m = page.facts.hit_radius_m
    figure = draw.new_figure(10.0, 4.6, left=0.07, top=0.95, bottom=0.21)
    grid = figure.add_gridspec(1, 3, width_ratios=[1.4, 1, 1], wspace=0.32)
    path_axes, near_axes, miss_axes = (figure.add_subplot(grid[k]) for k in range(3))
    hit_s = throws.time_s[-1] if motion.predicted is None else motion.predicted.hit_time_s
    until_s = AFTER_HIT_S + hit_s
    half_m = _half_width_m(throws, radius_m)
    tip_m = throws.tip_m[:, throws.time_s <= until_s]
    if tip_m.shape[2] == 2:
        _draw_fan(path_axes, throws, tip_m)
        _draw_fan(near_axes, throws, _near(tip_m, motion.target_m, half_m))
        _frame_target(near_axes, motion.target_m, half_m)
        for axes in (path_axes, near_axes):
            draw_aims(axes, motion, page.facts)
    else:
        for axes, seen in zip((path_axes, near_axes), draw.views(3), strict=True):
            _draw_fan(axes, throws, tip_m[..., seen], seen)
            draw_aims(axes, motion, page.facts, seen)
    _draw_misses(miss_axes, motion, radius_m)
    draw.legend_below(figure, path_axes)
    finding = with_caveat(page, expectation(motion))
    return PanelContent(
        finding, draw.Drawing(figure, f"The next throw as predicted. {finding}"), sources=[shown]
    )


def throws_of(motion: Motion, throws: PredictedThrows, file: str) -> PredictedThrows:
    """Return the predicted throws of a motion, or raise that they are missing or of another one."""
    if not len(throws.throw):
        what = "the prediction of the motion that was played is not there"
    elif throws.motion_sha256 != motion.content_sha256():
        what = "the prediction is of another motion than the one that was played"
    else:
        return throws
    fix = f"copy {FILES['predicted']} with the motion that is played, as `strandcast play` does"
    raise StrandcastError("SC-X020", what, file=file, fix=fix)


def _nearest(distance_m: Array) -> NDArray[np.int64]:
    """Return the sample (M,) at which each throw is nearest to the target."""
    return np.asarray(np.argmin(np.nan_to_num(distance_m, nan=np.inf), axis=1))


def _quantile(values: Array, share: float) -> Array:
    """Return a quantile over the throws (M, T) at each time, NaN where all have failed."""
    known = np.isfinite(values).any(axis=0)
    found = np.full(values.shape[1], np.nan)
    found[known] = np.nanquantile(values[:, known], share, axis=0)
    return found


def _draw_fan(axes: Any, throws: PredictedThrows, tip_m: Array, seen: Sequence[int] = (0, 1)) -> None:
    count, every = len(throws.throw), len(throws.miss_m)
    label = f"predicted: {every} throws" if count == every else f"predicted: {count} of {every} throws"
    for k, path_m in enumerate(tip_m):
        axes.plot(*path_m.T, **ONE_THROW, label=None if k else label)
    draw.equal_axes(axes, seen)


def _half_width_m(throws: PredictedThrows, least_m: float) -> float:
    """Return half the width of the view of the target [m]: it shows most predicted throws pass."""
    return ROOM * max(least_m, float(np.quantile(throws.miss_m, HIGH)))


def _near(path_m: Array, target_m: Sequence[float], half_m: float) -> Array:
    """Return paths (…, T, 2) with NaN far from the target, so that the page holds only what is shown."""
    inside = (np.abs(path_m - np.array(target_m)) < half_m).all(axis=-1)
    kept = inside.copy()  # with one sample on either side: lines reach the edges of the view
    kept[..., 1:] |= inside[..., :-1]
    kept[..., :-1] |= inside[..., 1:]
    return np.where(kept[..., None], path_m, np.nan)


def _frame_target(axes: Any, target_m: Sequence[float], half_m: float) -> None:
    """Set the limits of a view of the target."""
    axes.set(title="near the target", xlabel="x [m]", ylabel="y [m]")
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlim(target_m[0] - half_m, target_m[0] + half_m)
    axes.set_ylim(target_m[1] - half_m, target_m[1] + half_m)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(draw.few_ticks())


def _draw_misses(axes: Any, motion: Motion, radius_m: float) -> None:
    """Draw the share of throws that are predicted to miss by less."""
    misses_m, shares = expected_shares(motion)
    axes.plot(1e3 * misses_m, 100.0 * shares, **draw.PLANNED)
    axes.axvline(1e3 * radius_m, **draw.HIT_RADIUS)
    axes.set(xlabel="miss [mm]", ylabel="throws below [%]", ylim=(0, 103))
    draw.log_if_wide(axes, "x", [*1e3 * misses_m, 1e3 * radius_m], ratio=10.0)


def _finding(motion: Motion, verdict: Verdict) -> str:
    expected = expected_miss(motion)
    if verdict.miss_m is None:
        return f"{expectation(motion)} The miss was not measured."
    compared = "" if expected is None else f", {expected.compared(verdict.miss_m)}"
    return f"{expectation(motion)} Measured: {millimetres(verdict.miss_m, verdict.miss_sigma_m)}{compared}."


def _within(
    results: TrialResults, throws: PredictedThrows, band_m: list[Array], apart_m: Array, since_s: Array
) -> str:
    """Return in how many frames up to the closest approach the tip was as far away as predicted."""
    verdict: Verdict = results.need("verdict")
    if verdict.closest_robot_time_s is None:
        return ""
    counted = since_s <= verdict.closest_robot_time_s - results.need("alignment").motion_start_s
    counted &= np.isfinite(apart_m)
    if not counted.any():
        return ""
    low, high = (np.interp(since_s[counted], throws.time_s, edge) for edge in band_m)
    inside = float(np.mean((apart_m[counted] >= low) & (apart_m[counted] <= high)))
    return (
        f" Up to the closest approach the tip’s distance lay within the band in {percent(inside)} of frames."
    )
