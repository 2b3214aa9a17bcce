"""First and hitting throws as the paper shows them: strobes (7, 9, 10), tip (8a), hand (8b)."""

from dataclasses import replace

from matplotlib.patches import Circle

from strandcast.core.trial_names import trial_name
from strandcast.records.motion import Motion
from strandcast.records.summary import ExperimentSummary
from strandcast.report.drawing import FITTED, MEASURED, PLANNED, TARGET, Drawing, legend_below, new_figure
from strandcast.report.measures import rms, tip_error_m
from strandcast.report.numbers import millimetres
from strandcast.report.panels.content import PanelContent
from strandcast.report.panels.page_data import ExperimentPageData, TrialPageData
from strandcast.report.panels.strobe import strobe
from strandcast.report.panels.throws import hand_paths
from strandcast.report.results import read_results
from strandcast_studies.paper.figures.counts import NAMES
from strandcast_studies.paper.report.runs import RunResults

TIP_STYLES = {"planned": (PLANNED, "as planned"), "fitted": (FITTED, "fitted")}


def first_and_last(each: RunResults) -> PanelContent:
    """Return the strobes of a run's first throw and of its hit, or its last throw."""
    first, last = _throws(each)
    results = read_results(each.trial(last))
    before = read_results(each.trial(first)) if first != last else None
    made = strobe(TrialPageData(results, before))
    shown = f"Trials {first} and {last}" if before is not None else f"Trial {last}, the first"
    panel = replace(made, finding=f"{_who(each)} {_outcome(each)} {shown}; the closest approach is bold.")
    return _own(panel, each)


def tip(each: RunResults) -> PanelContent:
    """Return the tip's path up to its closest approach, measured and simulated: Fig. 8a."""
    results = read_results(each.trial(each.last()))
    verdict, alignment = results.need("verdict"), results.need("alignment")
    start_s, until_s = alignment.motion_start_s, verdict.closest_robot_time_s
    until_s = alignment.motion_end_s if until_s is None else until_s
    figure = new_figure(10.0, 4.6, left=0.07, top=0.97, bottom=0.2, wspace=0.22)
    path_axes, apart_axes = figure.subplots(1, 2)
    time_s = results.robot_time_s()
    shown = (time_s >= start_s) & (time_s <= until_s)
    path_axes.plot(*results.need("track").points_m[shown, -1].T, **MEASURED, label="measured")
    distances = []
    for name, throw in results.need("simulated").items():
        style, label = TIP_STYLES[name]
        inside = (throw.robot_time_s >= start_s) & (throw.robot_time_s <= until_s)
        path_axes.plot(*throw.points_m[inside, -1].T, **style, label=label)
        at_s, apart_m = tip_error_m(results, throw)
        mine = (at_s >= start_s) & (at_s <= until_s)
        apart_axes.plot((at_s[mine] - start_s) * 1e3, apart_m[mine] * 1e3, **style)
        distances.append(f"{label} {millimetres(rms(apart_m[mine]))} rms from the measured tip")
    ring = Circle(verdict.target_m, verdict.hit_radius_m, facecolor="none", edgecolor=TARGET, lw=2.0)
    path_axes.add_patch(ring)
    path_axes.set(xlabel="x [m]", ylabel="y [m]")
    path_axes.set_aspect("equal", adjustable="datalim")
    apart_axes.set(
        xlabel="time from the motion’s start [ms]", ylabel="distance of the tips [mm]", ylim=(0, None)
    )
    legend_below(figure, path_axes)
    finding = f"{_who(each)} {_outcome(each)} Up to the closest approach: {'; '.join(distances)}."
    made = PanelContent(
        finding,
        Drawing(figure, f"Tip path up to the closest approach. {finding}"),
        sources=["track.parquet", "simulated.parquet"],
    )
    return _own(made, each)


def hand(each: RunResults) -> PanelContent:
    """Return the hand's paths in the first throw and in the hit, or the last throw: Fig. 8b."""
    summary = ExperimentSummary.read(each.folder / "summary.json")
    folders = {number: read_results(each.trial(number)) for number in set(_throws(each))}
    return _own(hand_paths(ExperimentPageData(summary, folders)), each, f"{_who(each)} ")


def joints(each: RunResults) -> PanelContent:
    """Return the planned joint angles and speeds of the first throw and of the hit, or the last throw."""
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
        trajectory = motion.trajectory()
        time_ms, q, qd = trajectory.time_s * 1e3, trajectory.q_rad, trajectory.qd_rad_s
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
        f"trial {number}: {motion.trajectory().end_s * 1e3:.0f} ms, "
        f"at most {abs(motion.trajectory().qd_rad_s).max():.1f} rad/s"
        for number, motion in motions.items()
    )
    return PanelContent(
        f"{finding}.",
        Drawing(figure, f"Joint angles and speeds of two throws. {finding}."),
        sources=[f"../{each.run.experiment}/{trial_name(number)}/motion.json" for number in motions],
    )


def _throws(each: RunResults) -> tuple[int, int]:
    """Return the first counted trial and the hit or the last; the second, if the first hit."""
    last, counted = each.last(), each.counted()
    return counted[0], last if last != counted[0] else counted[:2][-1]


def _who(each: RunResults) -> str:
    run = each.run
    return f"String {run.string} at target {run.target}, {NAMES[run.method]}, seed {run.seed}."


def _outcome(each: RunResults) -> str:
    run = each.run
    return f"Hit at trial {run.hit_trial}." if run.hit_trial else f"No hit in {len(run.trials)} trials."


def _own(made: PanelContent, each: RunResults, before: str = "") -> PanelContent:
    """Return a run's panel for this page, with the run's name and links to its files."""
    folder = f"../{each.run.experiment}/"
    last = f"{trial_name(each.last())}/"
    sources = [folder + ("" if source.startswith("trial-") else last) + source for source in made.sources]
    return replace(made, finding=before + made.finding, sources=sources)
