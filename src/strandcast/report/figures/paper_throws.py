"""First and hitting throws as the paper shows them: strobes (7, 9, 10), tip (8a), hand (8b)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from matplotlib.patches import Circle

from strandcast.errors import StrandcastError
from strandcast.records.motion import Motion
from strandcast.records.summary import Summary
from strandcast.report.drawing import FITTED, MEASURED, PLANNED, TARGET, legend_below, new_figure, to_svg
from strandcast.report.figures.paper_counts import NAMES
from strandcast.report.figures.strobe import strobe
from strandcast.report.figures.throws import hand_paths
from strandcast.report.measures import rms, tip_error_m
from strandcast.report.numbers import millimetres
from strandcast.report.paper_runs import RunResults
from strandcast.report.reportlet import Reportlet
from strandcast.report.results import Results, read_results

TIP_STYLES = {"planned": (PLANNED, "as planned"), "fitted": (FITTED, "fitted")}


def first_and_last(key: str, title: str, each: RunResults | None, wanted: str) -> Reportlet:
    """Return the strobes of a run's first throw and of the one that hit, or came next (or of its last)."""
    each = _there(each, wanted)
    first, last = _throws(each)
    results = read_results(each.trial(last))
    before = read_results(each.trial(first)) if first != last else None
    made = strobe(key, title, results, before)
    shown = f"Trials {first} and {last}" if before is not None else f"Trial {last}, the first"
    told = replace(
        made,
        finding=f"{_who(each)} {_outcome(each)} {shown}; the closest approach is bold.",
        reading="Good: the dashed string covers the solid one up to the closest approach. The defaults fit "
        "no further: what comes after it is foretold, not fitted.",
    )
    return _own(told, each, "")


def tip(key: str, title: str, each: RunResults | None, wanted: str) -> Reportlet:
    """Return the tip's path up to its closest approach, measured and simulated: Fig. 8a."""
    each = _there(each, wanted)
    hit = each.last()
    assert hit is not None
    results = read_results(each.trial(hit))
    start_s, until_s = results.need("alignment").motion_start_s, _closest_s(results)
    figure = new_figure(10.0, 4.6, left=0.07, top=0.97, bottom=0.2, wspace=0.22)
    path_axes, apart_axes = figure.subplots(1, 2)
    time_s = results.robot_time_s()
    shown = (time_s >= start_s) & (time_s <= until_s)
    path_axes.plot(*results.need("track").points_m[shown, -1].T, **MEASURED, label="measured")
    told = []
    for name, throw in results.need("simulated").items():
        style, label = TIP_STYLES[name]
        inside = (throw.robot_time_s >= start_s) & (throw.robot_time_s <= until_s)
        path_axes.plot(*throw.points_m[inside, -1].T, **style, label=label)
        at_s, apart_m = tip_error_m(results, throw)
        mine = (at_s >= start_s) & (at_s <= until_s)
        apart_axes.plot((at_s[mine] - start_s) * 1e3, apart_m[mine] * 1e3, **style)
        told.append(f"{label} {millimetres(rms(apart_m[mine]))} rms from the measured tip")
    verdict = results.need("verdict")
    ring = Circle(verdict.target_m, verdict.hit_radius_m, facecolor="none", edgecolor=TARGET, lw=2.0)
    path_axes.add_patch(ring)
    path_axes.set(xlabel="x [m]", ylabel="y [m]")
    path_axes.set_aspect("equal", adjustable="datalim")
    apart_axes.set(
        xlabel="time from the motion’s start [ms]", ylabel="distance of the tips [mm]", ylim=(0, None)
    )
    legend_below(figure, path_axes)
    finding = f"{_who(each)} {_outcome(each)} Up to the closest approach: {'; '.join(told)}."
    made = Reportlet(
        key,
        title,
        finding,
        "Of the throw that hit, or the last. “As planned”: the string with which the motion was planned, "
        "moved by the measured joints; “fitted”: the string after this throw. Ring: hit radius.",
        to_svg(figure, key, f"Tip path up to the closest approach. {finding}"),
        sources=["track.parquet", "simulated.parquet"],
    )
    return _own(made, each, "")


def _closest_s(results: Results) -> float:
    """Return the robot time of the closest approach; of the motion's end, where none was seen."""
    verdict, alignment = results.need("verdict"), results.need("alignment")
    closest_s = verdict.closest_robot_time_s
    return float(alignment.motion_end_s if closest_s is None else closest_s)


def hand(key: str, title: str, each: RunResults | None, wanted: str) -> Reportlet:
    """Return the hand's paths in the first throw and in the one that hit, or came next: Fig. 8b."""
    each = _there(each, wanted)
    summary = Summary.read(each.folder / "summary.json")
    folders = {number: read_results(each.trial(number)) for number in set(_throws(each))}
    return _own(hand_paths(key, title, summary, folders), each, f"{_who(each)} ")


def joints(key: str, title: str, each: RunResults | None, wanted: str) -> Reportlet:
    """Return the joints' angles and speeds as planned for the first throw and the hit, or the next."""
    each = _there(each, wanted)
    first, last = _throws(each)
    motions = {
        number: Motion.read(each.trial(number) / "motion.json") for number in dict.fromkeys((first, last))
    }
    names = motions[last].joint_names
    figure = new_figure(10.0, 4.6, left=0.07, top=0.93, bottom=0.2, wspace=0.25, hspace=0.25)
    grid = figure.subplots(2, len(names), sharex=True, squeeze=False)
    for number, motion in motions.items():
        style = MEASURED if number == last else PLANNED
        what = "hit" if number == each.run.hit_trial else "first" if number == first else "later"
        time_ms, (q, qd, _) = motion.time_s() * 1e3, motion.joints()
        for column in range(len(names)):
            grid[0][column].plot(time_ms, q[:, column], **style, label=f"trial {number} ({what})")
            grid[1][column].plot(time_ms, qd[:, column], **style)
    for column, name in enumerate(names):
        grid[0][column].set_title(name)
        grid[1][column].set_xlabel("time from the motion’s start [ms]")
    grid[0][0].set_ylabel("angle [rad]")
    grid[1][0].set_ylabel("speed [rad/s]")
    legend_below(figure, grid[0][0])
    finding = f"{_who(each)} " + "; ".join(
        f"trial {number}: {motion.time_s()[-1] * 1e3:.0f} ms, at most {abs(motion.joints()[1]).max():.1f} "
        "rad/s"
        for number, motion in motions.items()
    )
    return Reportlet(
        key,
        title,
        f"{finding}.",
        "As planned. The paper keeps posture and duration and alters heights by up to 0.5 rad/s; the "
        "defaults may go further, or plan anew.",
        to_svg(figure, key, f"Joint angles and speeds of two throws. {finding}."),
        sources=[f"../{each.run.experiment}/trial-{number:02d}/motion.json" for number in motions],
    )


def _there(each: RunResults | None, wanted: str) -> RunResults:
    if each is None or each.last() is None:
        raise StrandcastError("SC-H077", f"there is no finished run of {wanted}", fix="strandcast paper")
    return each


def _throws(each: RunResults) -> tuple[int, int]:
    """Return the first counted trial, and the one that hit or the last; the second, where the first hit."""
    last, counted = each.last(), each.counted()
    assert last is not None
    return counted[0], last if last != counted[0] else counted[:2][-1]


def _who(each: RunResults) -> str:
    run = each.run
    return f"String {run.string} at target {run.target}, {NAMES[run.method]}, seed {run.seed}."


def _outcome(each: RunResults) -> str:
    run = each.run
    return f"Hit at trial {run.hit_trial}." if run.hit_trial else f"No hit in {len(run.trials)} trials."


def _own(made: Reportlet, each: RunResults, before: str) -> Reportlet:
    """Return a reportlet of a run as it stands on this page: it says whose it is, and links to there."""
    last = each.last()
    folder = Path("..") / each.run.experiment

    def place(source: str) -> str:
        inside: Any = folder if source.startswith("trial-") else folder / f"trial-{last:02d}"
        return (inside / source).as_posix()

    return replace(made, finding=before + made.finding, sources=[place(source) for source in made.sources])
