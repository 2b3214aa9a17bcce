"""The next motion, for approval before the arm moves: curves, limits, predicted path and misses."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.motion import Motion, Prediction
from strandcast.report import drawing as draw
from strandcast.report.expected import expected_miss
from strandcast.report.facts import Facts
from strandcast.report.numbers import UNKNOWN, millimetres, milliseconds, percent, place, significant
from strandcast.report.panels.content import PanelContent, Table
from strandcast.report.panels.page_data import ExperimentPageData, TrialPageData, with_caveat


def next_motion(page: TrialPageData | ExperimentPageData) -> PanelContent:
    """Return the joint velocities with their control points, and the prediction."""
    path, played, facts = planned_next(page), page.played, page.facts
    place_of_file = os.path.relpath(path, page.folder)
    try:
        motion = Motion.read(path)
    except StrandcastError as problem:
        problem.file = place_of_file
        raise
    joints = len(motion.joint_names)
    height = 1.1 + 1.75 * joints
    figure = draw.new_figure(10.0, height)
    room = {"top": 0.95, "bottom": 0.85 / height}
    curves = figure.add_gridspec(joints, 1, left=0.07, right=0.56, hspace=0.28, **room)
    for joint in range(joints):
        axes = figure.add_subplot(curves[joint])
        _draw_joint(axes, motion, played, joint, facts.speed_limits_rad_s)
        if joint < joints - 1:
            axes.tick_params(labelbottom=False)
    axes.set_xlabel("time [ms]")
    draw.legend_below(figure, axes)
    if motion.predicted is not None:
        views = draw.views(len(motion.target_m))
        cells = figure.add_gridspec(len(views), 1, left=0.64, right=0.985, hspace=0.35, **room)
        for k, seen in enumerate(views):
            _draw_prediction(figure.add_subplot(cells[k]), motion, facts, seen)
    finding = with_caveat(page, expectation(motion))
    return PanelContent(
        finding,
        draw.Drawing(figure, f"The next motion. {finding}"),
        [_table(motion, page.caveat or facts.play_command)],
        [place_of_file],
    )


def planned_next(page: TrialPageData | ExperimentPageData) -> Path:
    """Return the file of the next motion (SC-W030 if none was planned)."""
    if page.next_motion is None:
        fix = "`strandcast plan` makes it from this trial's estimate"
        raise StrandcastError("SC-W030", "no next motion was planned", fix=fix)
    return page.next_motion


def _draw_joint(
    axes: Any, motion: Motion, played: Motion | None, joint: int, limits_rad_s: list[float]
) -> None:
    drawn = [(motion, draw.MEASURED)]
    if played is not None and played.joint_names == motion.joint_names:
        drawn.append((played, draw.PLANNED))
    for each, style in drawn:
        curve = each.trajectory()
        label = f"motion of trial {each.trial}"
        axes.plot(curve.time_s * 1e3, curve.qd_rad_s[:, joint], **style, label=label)
    if motion.bezier is not None and joint < len(motion.bezier.heights_rad_s):
        heights = motion.bezier.heights_rad_s[joint]
        at_ms = np.linspace(0.0, motion.bezier.duration_s * 1e3, len(heights))
        style = {"color": draw.FITTED["color"], "linewidth": 0.8, "markerfacecolor": "none"}
        axes.plot(at_ms, heights, **draw.marks("o", 4, **style, linestyle=":"), label="control points")
    if joint < len(limits_rad_s):
        for k, sign in enumerate((-1, 1)):
            dashed = {"color": draw.INK, "linewidth": 1.0, "linestyle": (0, (6, 3))}
            axes.axhline(sign * limits_rad_s[joint], **dashed, label=None if k else "limit")
    axes.set_ylabel("[rad/s]")
    axes.set_title(f"{motion.joint_names[joint]}: velocity", fontsize=8.5)


def _draw_prediction(axes: Any, motion: Motion, facts: Facts, seen: list[int]) -> None:
    predicted = motion.predicted
    assert predicted is not None
    paths = [np.array(path).reshape(-1, len(motion.target_m)) for path in (predicted.hand_m, predicted.tip_m)]
    hand_m, tip_m = (path_m[:, seen] for path_m in paths)
    axes.plot(*hand_m.T, **draw.TRUE, label="hand")
    axes.plot(*tip_m.T, **draw.FITTED, label="tip, predicted")
    draw_aims(axes, motion, facts, seen)
    draw.equal_axes(axes, seen)
    axes.set_title("predicted throw", fontsize=8.5)
    axes.legend(loc="best", fontsize=7.5)


def draw_aims(axes: Any, motion: Motion, facts: Facts, seen: Sequence[int] = (0, 1)) -> None:
    """Draw the places that a motion aims at in a view, each with the hit radius."""
    aims_m = [tuple(motion.target_m[k] for k in seen)] if facts.aims_m is None else facts.aims_m
    for x_m, y_m in aims_m:
        draw.ring(axes, (x_m, y_m), facts.hit_radius_m, width=1.5)
    if aims_m:
        crosses = draw.marks("+", 10, color=draw.TARGET, linestyle="none" if len(aims_m) == 1 else "-")
        axes.plot(*np.array(aims_m).T, **crosses, label="target")


def expectation(motion: Motion) -> str:
    """Return in a sentence what is expected of a motion."""
    expected = expected_miss(motion)
    if expected is None:
        return f"Motion for trial {motion.trial}; without a prediction."
    return f"Predicted miss of trial {motion.trial}: {expected}."


def _table(motion: Motion, command: str | None) -> Table:
    rows = [
        ["target", place(motion.target_m)],
        ["duration", milliseconds(motion.trajectory().end_s, digits=0)],
        ["content hash (sha256)", motion.content_sha256()],
        ["arm", motion.robot.name],
    ]
    predicted, source = motion.predicted, motion.provenance
    if predicted is not None:
        speeds = ", ".join(map(significant, predicted.peak_speed_rad_s))
        accelerations = ", ".join(map(significant, predicted.peak_acceleration_rad_s2))
        bend_deg = np.degrees(predicted.largest_bend_rad)
        expected = expected_miss(motion)
        counted = "as throws like this one missed in the lab" if predicted.calibrated else "simulated"
        rows += [
            ["predicted time of the hit, from the start", milliseconds(predicted.hit_time_s, digits=0)],
            ["peak joint speed", f"{speeds} rad/s"],
            ["peak joint acceleration", f"{accelerations} rad/s²"],
            *([[f"predicted miss, {counted}", str(expected)]] if expected is not None else []),
            *_limits(motion, predicted),
            ["peak speed of the tip", f"{predicted.peak_tip_speed_m_s:.1f} m/s"],
            ["largest bend between neighbours before the hit", f"{bend_deg:.0f}°"],
        ]
    if source is not None:
        planner = f"{source.planner} ({source.kind}), {source.simulations} simulations, seed {source.seed}"
        rows += [
            ["objective", source.objective or "point"],
            ["planner", planner],
            ["planner's flags", ", ".join(source.flags) or "none"],
        ]
    rows.append(["command to play it", command or UNKNOWN])
    return Table(["next motion", "value"], rows)


def _limits(motion: Motion, predicted: Prediction) -> list[list[str]]:
    """Return the largest use of each kind of limit, and the least distance to the workspace's edge."""
    rows = [
        [f"most of a limit of {kind} used", f"{percent(share)} ({who})"]
        for kind, who, share in motion.limits_used()
    ]
    if predicted.workspace_room_m is not None:
        rows.append(["least room to the workspace's edge", millimetres(predicted.workspace_room_m, digits=0)])
    return rows
