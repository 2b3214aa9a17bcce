"""Where the miss came from, closest approach by closest approach."""

from typing import NamedTuple

import numpy as np

from strandcast.core.closest_approach import Approach, closest_approach, nearest_of_bar, segment_approaches
from strandcast.errors import StrandcastError
from strandcast.records.motion import Motion
from strandcast.records.verdict import Verdict
from strandcast.report import drawing as draw
from strandcast.report.causes import probable_causes
from strandcast.report.measures import target_ends_m
from strandcast.report.numbers import millimetres, milliseconds, scaled
from strandcast.report.panels.content import PanelContent, Table
from strandcast.report.panels.page_data import TrialPageData
from strandcast.report.results import FILES, Array, TrialResults

PARTS = {
    "plan": "target … tip of the planned throw",
    "arm and start": "… the string that planned it, moved by the measured hand",
    "string": "… the fitted string, moved by the measured hand",
    "unexplained": "… measured tip",
}
# The only part after which the next throw of the lab was seen to miss by less.
AGAIN = "Next: throw again, the next motion is planned with the string that this throw showed."


class Passage(NamedTuple):
    """A tip's closest approach: its time after the motion's start, and its place from the target (2,)."""

    since_s: float
    off_m: Array


class MissPart(NamedTuple):
    """What one difference adds to the miss and to its time, and the closest approach that it leads to."""

    name: str
    part_m: float
    later_s: float
    passage: Passage
    what: str


def budget(page: TrialPageData) -> PanelContent:
    """Return the parts of the miss, in its direction; their sum is the miss."""
    verdict: Verdict = page.need("verdict")
    parts, miss_m = miss_parts(page.results)
    figure = draw.new_figure(8.4, 2.6, left=0.2, top=0.97, bottom=0.2)
    axes = figure.add_subplot()
    lengths_mm = [1e3 * part.part_m for part in parts] + [1e3 * miss_m]
    colours = [draw.MEASURED["color"]] * len(parts) + [draw.FITTED["color"]]
    sigma_mm = 1e3 * (verdict.miss_sigma_m or 0.0)  # the measured tip's, which ends the last part and the sum
    sigmas_mm = [0.0] * (len(parts) - 1) + [sigma_mm] * 2
    names = [*(part.name for part in parts), "sum: the miss"]
    axes.barh(names, lengths_mm, 0.6, color=colours, xerr=sigmas_mm)
    axes.axvline(0.0, color=draw.INK, linewidth=0.8)
    radius_mm = verdict.hit_radius_m * 1e3
    for side_mm in (-radius_mm, radius_mm):
        axes.axvline(side_mm, **draw.HIT_RADIUS)
    axes.set(xlabel="in the direction of the miss [mm] (dashed: hit radius)")
    if max(map(abs, lengths_mm)) > 20 * radius_mm:
        axes.set_xscale("symlog", linthresh=radius_mm)
        axes.xaxis.set_major_formatter("{x:g}")
    axes.invert_yaxis()
    finding = _finding(page.results, parts, miss_m)
    rows = [_row(part, verdict.miss_sigma_m if part is parts[-1] else None) for part in parts]
    return PanelContent(
        finding,
        draw.Drawing(figure, f"Parts of the miss. {finding}"),
        [Table(["part", "adds to the miss", "and to its time", "so that the tip passes", "from … to"], rows)],
        ["motion.json", "simulated.parquet", "track.parquet", "verdict.json"],
    )


def _row(part: MissPart, sigma_m: float | None) -> list[str]:
    off_m, since_s = part.passage.off_m, part.passage.since_s
    passes = f"{millimetres(float(np.linalg.norm(off_m)))} off at {milliseconds(since_s, digits=0)}"
    later = scaled(part.later_s, 1e3, 0, "ms", sign="+")
    return [part.name, scaled(part.part_m, 1e3, 1, "mm", sigma_m, "+"), later, passes, part.what]


def _finding(results: TrialResults, parts: list[MissPart], miss_m: float) -> str:
    """Return the largest part, and what to do about it if that was seen to help."""
    verdict: Verdict = results.need("verdict")
    largest = max(parts, key=lambda part: abs(part.part_m))
    sigma_m = verdict.miss_sigma_m if largest is parts[-1] else None
    finding = (
        f"Largest part of the miss of {millimetres(miss_m, verdict.miss_sigma_m)}: {largest.name}, "
        f"{scaled(largest.part_m, 1e3, 1, 'mm', sigma_m, '+')}."
    )
    if verdict.hit:
        return f"{finding} The throw hit: nothing needs to change."
    if probable_causes(results):
        return f"{finding} First remove the fault that the top of this page names: it may be the reason."
    return f"{finding} {AGAIN}" if largest.name == "string" else finding


def miss_parts(results: TrialResults) -> tuple[list[MissPart], float]:
    """Return the parts of the miss in its direction, and their sum, the miss.

    Every path is compared at its own closest approach: that of a later path is only a difference in time.
    The planning string's are its closest of all, the fitted one's that in the pass of the measured tip.
    """
    verdict: Verdict = results.need("verdict")
    if verdict.closest_robot_time_s is None or verdict.closest_m is None:
        raise StrandcastError(
            "SC-T004",
            f"the closest approach was not detected: {verdict.reason}",
            file=FILES["verdict"],
            fix="see the tracking quality below",
        )
    motion: Motion = results.need("motion")
    throws = results.need("simulated")
    if motion.predicted is None or "planned" not in throws or "fitted" not in throws:
        raise StrandcastError(
            "SC-W030",
            "the motion was not planned here, so that nothing was predicted",
            file=FILES["motion"],
            fix="plan the next motion: `strandcast plan`",
        )
    start_s, ends_m = results.need("alignment").motion_start_s, target_ends_m(verdict)
    closest_m = np.array(verdict.closest_m)
    measured = Passage(verdict.closest_robot_time_s - start_s, closest_m - nearest_of_bar(closest_m, ends_m))
    planned, fitted = (
        (throws[name].robot_time_s - start_s, throws[name].points_m[:, -1]) for name in ("planned", "fitted")
    )
    predicted = np.array(motion.predicted.time_s), np.array(motion.predicted.tip_m)
    passages = [
        Passage(0.0, np.zeros_like(closest_m)),
        _closest(*predicted, verdict),
        _closest(*planned, verdict),
        _in_pass(*fitted, ends_m, measured.since_s),
        measured,
    ]
    miss_m = float(np.linalg.norm(measured.off_m))
    across = measured.off_m / max(miss_m, 1e-12)
    parts = [
        MissPart(
            name, float((after.off_m - before.off_m) @ across), after.since_s - before.since_s, after, what
        )
        for (name, what), before, after in zip(PARTS.items(), passages, passages[1:], strict=False)
    ]
    return parts, miss_m


def _closest(since_s: Array, tip_m: Array, verdict: Verdict) -> Passage:
    """Return a simulated tip's closest approach, found as that of a measured one."""
    since_s, tip_m = _known(since_s, tip_m)
    ends_m, step_s = target_ends_m(verdict), float(np.median(np.diff(since_s)))
    window_s = float(since_s[0]), float(since_s[-1])
    found, reason = closest_approach(since_s, tip_m, ends_m, step_s, window_s, verdict.hit_radius_m)
    if found is None:
        raise StrandcastError("SC-E003", f"a simulated throw has no closest approach: {reason}")
    return _passage(since_s, found, ends_m)


def _in_pass(since_s: Array, tip_m: Array, ends_m: Array, at_s: float) -> Passage:
    """Return a simulated tip's approach to the target, of several the one nearest to a time."""
    since_s, tip_m = _known(since_s, tip_m)
    approaches = segment_approaches(tip_m, ends_m)
    away_m = np.array([np.inf, *(each.distance_m for each in approaches), np.inf])
    lowest = np.flatnonzero((away_m[1:-1] <= away_m[:-2]) & (away_m[1:-1] <= away_m[2:]))
    if not len(lowest):
        raise StrandcastError("SC-E003", "the fitted throw has no closest approach: it diverged")
    passages = [_passage(since_s, approaches[k], ends_m) for k in lowest]
    return min(passages, key=lambda each: abs(each.since_s - at_s))


def _known(since_s: Array, tip_m: Array) -> tuple[Array, Array]:
    known = np.isfinite(tip_m).all(axis=1)
    return since_s[known], tip_m[known]


def _passage(since_s: Array, found: Approach, ends_m: Array) -> Passage:
    before_s, after_s = since_s[found.index : found.index + 2]
    off_m = found.place_m - nearest_of_bar(found.place_m, ends_m)
    return Passage(float(before_s + found.share * (after_s - before_s)), off_m)
