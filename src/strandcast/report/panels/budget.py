"""Where the miss came from, from the target to the measured tip, and how to make it smaller."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strandcast.errors import StrandcastError
from strandcast.records.motion import Motion
from strandcast.records.verdict import Verdict
from strandcast.report import drawing as draw
from strandcast.report.causes import probable_causes
from strandcast.report.numbers import signed
from strandcast.report.panels.content import PanelContent, Table
from strandcast.report.panels.page_data import TrialPageData
from strandcast.report.results import FILES, SimulatedThrow, TrialResults

Array = NDArray[np.float64]
BETTER = {
    "plan": "the planned motion passes the target at this distance: more plan.evaluations, or a target "
    "farther from the limits",
    "arm and start": "hand or string moved otherwise than predicted: let the string hang still, check "
    "payload and servo; the next plan uses the joints' response to this throw",
    "string": "the estimate of this throw has removed it: the next throw is planned with the new string",
    "unexplained": "no string of the model moves like this one: check tracking and alignment, or add what is "
    "missing (a weight's place, a stiff section, bend friction)",
}


class MissStep(NamedTuple):
    """One step from the target to the measured tip: its name, its length across the path, its ends."""

    name: str
    across_m: float
    what: str


def budget(page: TrialPageData) -> PanelContent:
    """Return the parts of the miss, across the tip's path at the closest approach; their sum is the miss."""
    steps, normal_miss_m = miss_steps(page.results)
    figure = draw.new_figure(8.4, 2.6, left=0.2, top=0.97, bottom=0.2)
    axes = figure.add_subplot()
    lengths_mm = [step.across_m * 1e3 for step in steps] + [normal_miss_m * 1e3]
    colours = [draw.MEASURED["color"]] * len(steps) + [draw.FITTED["color"]]
    axes.barh([step.name for step in steps] + ["sum: the miss"], lengths_mm, 0.6, color=colours)
    axes.axvline(0.0, color=draw.INK, linewidth=0.8)
    radius_mm = page.need("verdict").hit_radius_m * 1e3
    for side_mm in (-radius_mm, radius_mm):
        axes.axvline(side_mm, **draw.HIT_RADIUS)
    axes.set(xlabel="across the tip’s path at the closest approach [mm] (dashed: hit radius)")
    if max(map(abs, lengths_mm)) > 20 * radius_mm:
        axes.set_xscale("symlog", linthresh=radius_mm)
        axes.xaxis.set_major_formatter("{x:g}")
    axes.invert_yaxis()
    largest = max(steps, key=lambda step: abs(step.across_m))
    others_m = normal_miss_m - largest.across_m
    finding = (
        f"Largest part of the miss: {largest.name}, {_length(largest.across_m)}; the other parts "
        f"{'take' if others_m * largest.across_m < 0 else 'add'} {_length(others_m)}"
        f"{' back' if others_m * largest.across_m < 0 else ''}, the sum is {_length(normal_miss_m)}. "
    )
    if abs(largest.across_m) * 1e3 <= radius_mm / 2:
        finding += "Every part is within half of the hit radius: nothing needs to change."
    else:
        finding += f"For the next throw: {BETTER[largest.name]}."
    if probable_causes(page.results):
        finding += " But first remove the fault that the top of this page names: it may be the reason."
    rows = [[step.name, _length(step.across_m), step.what, BETTER[step.name]] for step in steps]
    return PanelContent(
        finding,
        draw.Drawing(figure, f"Parts of the miss. {finding}"),
        [Table(["part", "across the path", "from … to", "what makes it smaller"], rows)],
        ["motion.json", "simulated.parquet", "track.parquet", "verdict.json"],
    )


def miss_steps(results: TrialResults) -> tuple[list[MissStep], float]:
    """Return the steps from the target to the measured tip, and the signed miss; both across the tip's path.

    Along the path a difference only shifts the time of the closest approach, so that it is left out.
    """
    verdict: Verdict = results.need("verdict")
    if verdict.closest_robot_time_s is None or verdict.closest_m is None:
        raise StrandcastError(
            "SC-H012",
            f"the closest approach was not detected: {verdict.reason}",
            file=FILES["verdict"],
            fix="see the tracking quality below",
        )
    motion: Motion = results.need("motion")
    throws = results.need("simulated")
    if motion.predicted is None or "planned" not in throws or "fitted" not in throws:
        raise StrandcastError(
            "SC-H051",
            "the motion was not planned here, so that nothing was predicted",
            file=FILES["motion"],
            fix="plan the next motion: `strandcast plan`",
        )
    since_s = verdict.closest_robot_time_s - results.need("alignment").motion_start_s
    predicted_m = _at(np.array(motion.predicted.time_s), np.array(motion.predicted.tip_m), since_s)
    planned_m, fitted_m = (
        _tip_at(throws[name], verdict.closest_robot_time_s) for name in ("planned", "fitted")
    )
    measured_m = np.array(verdict.closest_m)
    normal = _normal(throws["fitted"], verdict.closest_robot_time_s)
    target_m = _nearest_of_target(verdict, measured_m)
    places = [target_m, predicted_m, planned_m, fitted_m, measured_m]
    whats = (
        "target … predicted tip",
        "predicted tip … the planning string, moved by the measured hand",
        "the planning string … the fitted one, both moved by the measured hand",
        "fitted string … measured tip",
    )
    steps = [
        MissStep(name, float((after - before) @ normal), what)
        for name, before, after, what in zip(BETTER, places, places[1:], whats, strict=False)
    ]
    return steps, float((measured_m - target_m) @ normal)


def _nearest_of_target(verdict: Verdict, place_m: Array) -> Array:
    """Return the target, or the place of the bar that is nearest to a place."""
    ends = np.array(verdict.bar_m or [verdict.target()])
    along = ends[-1] - ends[0]
    share = np.clip((place_m - ends[0]) @ along / max(float(along @ along), 1e-30), 0.0, 1.0)
    return np.asarray(ends[0] + share * along)


def _at(time_s: Array, places_m: Array, at_s: float) -> Array:
    return np.array([np.interp(at_s, time_s, places_m[:, k]) for k in (0, 1)])


def _tip_at(throw: SimulatedThrow, at_s: float) -> Array:
    return _at(throw.robot_time_s, throw.points_m[:, -1], at_s)


def _normal(throw: SimulatedThrow, at_s: float) -> Array:
    """Return the unit normal (2,) to a simulated tip's path at a time, over 4 ms."""
    step = _tip_at(throw, at_s + 0.002) - _tip_at(throw, at_s - 0.002)
    length = float(np.linalg.norm(step))
    return np.array([-step[1], step[0]]) / length if length > 0 else np.array([1.0, 0.0])


def _length(value_m: float) -> str:
    return signed(f"{value_m * 1e3:+.1f}") + "\u00a0mm"
