"""The next motion, to be approved before metal moves: curves, limits, predicted path and misses."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.patches import Circle
from numpy.typing import NDArray

from strandcast.errors import StrandcastError
from strandcast.records.motion import Motion, Prediction
from strandcast.report.drawing import (
    FITTED,
    INK,
    MEASURED,
    PLANNED,
    TARGET,
    TRUE,
    legend_below,
    new_figure,
    to_svg,
)
from strandcast.report.facts import Facts
from strandcast.report.numbers import UNKNOWN, millimetres, milliseconds, percent, place, significant
from strandcast.report.reportlet import Reportlet, Table

Array = NDArray[np.float64]


def next_motion(
    key: str, title: str, path: Path | None, page: Path, played: Motion | None, facts: Facts
) -> Reportlet:
    """Return the joint velocities with their control points, and what is expected, for a page's folder."""
    if path is None:
        raise StrandcastError(
            "SC-H051",
            "no next motion was planned",
            fix="`strandcast plan` makes it from this trial's estimate",
        )
    place_of_file = os.path.relpath(path, page)
    try:
        motion = Motion.read(path)
    except StrandcastError as problem:
        problem.file = place_of_file
        raise
    joints = len(motion.joint_names)
    height = 1.1 + 1.75 * joints
    figure = new_figure(10.0, height)
    curves = figure.add_gridspec(
        joints, 1, left=0.07, right=0.56, top=0.95, bottom=0.85 / height, hspace=0.28
    )
    expected = figure.add_gridspec(
        2, 1, left=0.64, right=0.985, top=0.95, bottom=0.85 / height, hspace=0.4, height_ratios=[2, 1]
    )
    for joint in range(joints):
        axes = figure.add_subplot(curves[joint])
        _draw_joint(axes, motion, played, joint, facts.speed_limits_rad_s)
        if joint < joints - 1:
            axes.tick_params(labelbottom=False)
    axes.set_xlabel("time [ms]")
    legend_below(figure, axes)
    if motion.predicted is not None:
        _draw_prediction(figure.add_subplot(expected[0]), motion, facts)
        _draw_misses(figure.add_subplot(expected[1]), motion)
    finding = _finding(motion)
    return Reportlet(
        key,
        title,
        finding,
        "Good: the predicted path ends in the target, the ensemble's misses crowd below the hit radius, "
        "the curves stay inside the limits. Bad: misses spread over decimetres: the string is not known "
        "well enough there.",
        to_svg(figure, key, f"The next motion. {finding}"),
        [_table(motion, facts.play_command)],
        [place_of_file],
    )


def _draw_joint(
    axes: Any, motion: Motion, played: Motion | None, joint: int, limits_rad_s: list[float]
) -> None:
    axes.plot(
        motion.time_s() * 1e3,
        motion.joints()[1][:, joint],
        **MEASURED,
        label=f"motion of trial {motion.trial}",
    )
    if played is not None and played.joint_names == motion.joint_names:
        axes.plot(
            played.time_s() * 1e3,
            played.joints()[1][:, joint],
            **PLANNED,
            label=f"motion of trial {played.trial}",
        )
    if motion.bezier is not None and joint < len(motion.bezier.heights_rad_s):
        heights = motion.bezier.heights_rad_s[joint]
        at_ms = np.linspace(0.0, motion.bezier.duration_s * 1e3, len(heights))
        axes.plot(
            at_ms,
            heights,
            color=FITTED["color"],
            linestyle=":",
            linewidth=0.8,
            marker="o",
            markersize=4,
            markerfacecolor="none",
            label="control points",
        )
    if joint < len(limits_rad_s):
        for k, sign in enumerate((-1, 1)):
            axes.axhline(
                sign * limits_rad_s[joint],
                color=INK,
                linewidth=1.0,
                linestyle=(0, (6, 3)),
                label=None if k else "limit",
            )
    axes.set_ylabel("[rad/s]")
    axes.set_title(f"{motion.joint_names[joint]}: velocity", fontsize=8.5)


def _draw_prediction(axes: Any, motion: Motion, facts: Facts) -> None:
    predicted = motion.predicted
    assert predicted is not None
    hand_m, tip_m = np.array(predicted.hand_m).reshape(-1, 2), np.array(predicted.tip_m).reshape(-1, 2)
    axes.plot(*hand_m.T, **TRUE, label="hand")
    axes.plot(*tip_m.T, **FITTED, label="tip, predicted")
    aims_m = [tuple(motion.target_m)] if facts.aims_m is None else facts.aims_m
    for x_m, y_m in aims_m:
        ring = Circle((x_m, y_m), facts.hit_radius_m, facecolor="none", edgecolor=TARGET, lw=1.5)
        axes.add_patch(ring)
    if aims_m:
        line = "none" if len(aims_m) == 1 else "-"
        axes.plot(
            *np.array(aims_m).T, linestyle=line, marker="+", color=TARGET, markersize=10, label="target"
        )
    axes.set(xlabel="x [m]", ylabel="y [m]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title("predicted throw", fontsize=8.5)
    axes.legend(loc="best", fontsize=7.5)


def _draw_misses(axes: Any, motion: Motion) -> None:
    predicted = motion.predicted
    assert predicted is not None
    misses_mm = np.sort(np.array(predicted.ensemble_miss_m)) * 1e3
    axes.plot(
        misses_mm,
        np.arange(1, len(misses_mm) + 1),
        linestyle="none",
        marker="D",
        markersize=4.5,
        color=MEASURED["color"],
    )
    axes.axvline(predicted.miss_m * 1e3, color=FITTED["color"], linestyle=FITTED["linestyle"], linewidth=1.3)
    axes.set(xlabel="predicted miss [mm] (dashed: best string)", ylabel="near-best string", xlim=(0, None))
    axes.set_ylim(0.3, len(misses_mm) + 0.7)
    axes.yaxis.get_major_locator().set_params(integer=True)
    axes.set_title("over the ensemble, undisturbed", fontsize=8.5)


def _finding(motion: Motion) -> str:
    if motion.predicted is None:
        return f"Motion for trial {motion.trial}; nothing was predicted of it."
    misses = motion.predicted.ensemble_miss_m
    spread = (
        f", {millimetres(min(misses))} to {millimetres(max(misses))} over {len(misses)} near-best strings"
        if misses
        else ""
    )
    told = f"Predicted miss {millimetres(motion.predicted.miss_m)} with the best string{spread}; "
    hit = percent(motion.predicted.hit_probability)
    if motion.predicted.disturbed_throws is None:
        return f"{told}{hit} of them hit."
    return f"{told}{hit} of {motion.predicted.disturbed_throws} throws hit, disturbances included."


def _table(motion: Motion, command: str | None) -> Table:
    rows = [
        ["target", place(motion.target_m)],
        ["length", milliseconds(float(motion.time_s()[-1]), digits=0)],
        ["content hash (sha256)", motion.content_sha256()],
        ["for the arm", motion.robot.name],
    ]
    predicted, source = motion.predicted, motion.provenance
    if predicted is not None:
        rows += [
            ["predicted time of the hit, from the start", milliseconds(predicted.hit_time_s, digits=0)],
            ["peak joint speed", ", ".join(map(significant, predicted.peak_speed_rad_s)) + " rad/s"],
            [
                "peak joint acceleration",
                ", ".join(map(significant, predicted.peak_acceleration_rad_s2)) + " rad/s²",
            ],
            *_disturbed(predicted),
            *_limits(predicted),
            ["peak speed of the tip", f"{predicted.peak_tip_speed_m_s:.1f} m/s"],
            [
                "largest bend between neighbours before the hit",
                f"{np.degrees(predicted.largest_bend_rad):.0f}°",
            ],
        ]
    if source is not None:
        rows += [
            ["what for", source.objective or "point"],
            [
                "planner",
                f"{source.planner} ({source.kind}), {source.simulations} simulations, seed {source.seed}",
            ],
            ["planner's flags", ", ".join(source.flags) or "none"],
        ]
    rows.append(["to play it", command or UNKNOWN])
    return Table(["next motion", "value"], rows)


def _disturbed(predicted: Prediction) -> list[list[str]]:
    """Return the quantiles of the misses, disturbances included."""
    if not predicted.miss_quantiles_m:
        return []
    told = ", ".join(f"{name} {millimetres(value)}" for name, value in predicted.miss_quantiles_m.items())
    return [["predicted miss over strings and disturbances", told]]


def _limits(predicted: Prediction) -> list[list[str]]:
    """Return how much of each limit a joint uses most, and how near to the workspace's edge it gets."""
    rows = []
    for words, peaks, name in (
        ("speed", predicted.peak_speed_rad_s, "velocity_rad_s"),
        ("acceleration", predicted.peak_acceleration_rad_s2, "acceleration_rad_s2"),
        ("jerk", predicted.peak_jerk_rad_s3, "jerk_rad_s3"),
        ("torque", predicted.peak_torque_n_m, "torque_n_m"),
    ):
        given = predicted.limits.get(name, [])
        used = [peak / most for peak, most in zip(peaks, given, strict=False) if most]
        if used:
            rows.append([f"most of a joint's {words} limit used", percent(max(used))])
    if predicted.workspace_room_m is not None:
        rows.append(["least room to the workspace's edge", millimetres(predicted.workspace_room_m, digits=0)])
    return rows
