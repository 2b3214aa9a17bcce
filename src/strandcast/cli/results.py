"""Commands on what is known from results: strings, compare, rig, predict, together."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from strandcast.cli.common import (
    ROOT,
    AsJson,
    ExperimentName,
    complete_experiment,
    complete_trial,
    show,
    table_lines,
)
from strandcast.core.trial_names import LAST_TRIAL

COMPARED = "An experiment, or a folder of results, e.g. a copy from before a change."


def strings(as_json: AsJson = False) -> None:
    """List the strings of a project: what is known and fitted of each, and where; for start_string."""
    import strandcast
    from strandcast.errors import StrandcastError

    project = strandcast.open(ROOT)
    rows, unread = [], []
    for name in project:
        try:
            if (row := _fitted_string(project[name])) is not None:
                rows.append(row)
        except StrandcastError as problem:
            unread.append(str(problem))
    lines = [line for row in rows for line in _string_lines(row)]
    lines = lines or ["no string has been fitted here: `strandcast run EXPERIMENT` fits one"]
    show(as_json, {"strings": rows, "unread": unread}, [*lines, *unread])


def _fitted_string(experiment: Any) -> dict[str, Any] | None:
    """Return what an experiment knows of its string, by its newest fit; None before the first."""
    trials = experiment.trials.items()
    fitted = [number for number, trial in trials if (trial.folder.results / "estimate.json").is_file()]
    if not fitted:
        return None
    newest, settings = experiment.trials[max(fitted)], experiment.settings
    estimate, summary = newest.estimate.record, newest.record("track.json")
    thickness_m = settings.string.thickness_m or summary.choices.get("thickness_m")
    lab = None if settings.lab is None else settings.lab.string
    return {
        "name": experiment.name,
        "length_m": estimate.length_m,
        "thickness_m": thickness_m,
        "mass_per_length_kg_m": settings.string.mass_per_length_kg_m
        or getattr(lab, "linear_density_kg_m", None),
        "weights": [weight.model_dump() | {"words": weight.words} for weight in estimate.weights],
        "parameters": [each.model_dump() for each in estimate.parameters],
        "arm": experiment.arm.name,
        "camera": ", ".join(settings.cameras),
        "trial": max(fitted),
        "trials_used": estimate.trials_used,
        "E_m": estimate.E_m,
    }


def _string_lines(row: dict[str, Any]) -> list[str]:
    """Return a string's row in words."""
    known = [f"{1e3 * row['length_m']:.0f} mm long"]
    if row["thickness_m"]:
        known.append(f"{1e3 * row['thickness_m']:.1f} mm thick")
    if row["mass_per_length_kg_m"]:
        known.append(f"{1e3 * row['mass_per_length_kg_m']:.1f} g/m")
    known += [
        f"{weight['kind']} at {1e3 * weight['place_m']:.0f} mm of {weight['words']}"
        for weight in row["weights"]
    ]
    trials = ", ".join(map(str, row["trials_used"]))
    return [
        f"{row['name']}: {', '.join(known)}",
        f"  fitted to trial {trials} with {row['arm']}, to {1e3 * row['E_m']:.1f} mm; "
        f"start_string: {{from: {row['name']}}}",
    ]


def compare(
    a: Annotated[str, typer.Argument(metavar="A", help=COMPARED, autocompletion=complete_experiment)],
    b: Annotated[str, typer.Argument(metavar="B", help=COMPARED, autocompletion=complete_experiment)],
    out: Annotated[Path | None, typer.Option(help="The page (default: results/compare-A-B.html).")] = None,
    as_json: AsJson = False,
) -> None:
    """Compare two settings, versions or experiments, trial by trial, as a table and a page."""
    from strandcast.records.page import write_page
    from strandcast.report.comparison_page import comparison_lines, comparison_page
    from strandcast.workflow.comparison import compare_results

    found = compare_results(ROOT, a, b)
    page = out or ROOT / "results" / f"compare-{Path(a).name}-{Path(b).name}.html"
    write_page(page, comparison_page(found))
    lines = [*comparison_lines(found), f"page: {page}"]
    show(as_json, found.to_json() | {"page": page}, lines)


def rig(experiment: ExperimentName, as_json: AsJson = False) -> None:
    """Show what the arm's file states wrongly, and how well throws repeat.

    From two trials on. A dash marks a number that these trials cannot separate from others; of several that
    may be wrong, all are named.
    """
    from strandcast.stages.context import context_of
    from strandcast.stages.rig import rig_state

    state = rig_state(context_of(ROOT, experiment))
    data = {
        "experiment": experiment,
        "trials": state.trials,
        "offsets": None if state.offsets is None else state.offsets.model_dump(),
        "repeats": [one._asdict() for one in state.repeats],
        "warnings": [] if state.offsets is None else state.offsets.warnings,
    }
    show(as_json, data, _rig_lines(experiment, state))


def _rig_lines(experiment: str, state: Any) -> Iterator[str]:
    """Yield the table, what it says, and repeated motions."""
    from strandcast.report.panels.rig_offsets import HEADS, offset_rows, offsets_finding

    if state.offsets is None:
        yield "What the arm's file states wrongly is estimated from two trials with a joint log on."
    else:
        rows = ([cell.replace("[", r"\[") for cell in row] for row in offset_rows(state.offsets))
        yield from table_lines(f"{experiment}: the arm's file against the video", HEADS, rows)
        warnings = [f"warning: {words}" for words in state.offsets.warnings]
        yield from warnings or [offsets_finding(state.offsets)]
    for repeat in state.repeats:
        pair = f"trials {repeat.trials[0]} and {repeat.trials[1]}"
        yield f"{pair} repeat a motion: the tips were {1e3 * repeat.tip_m:.1f} mm apart (rms)"


def predict(
    experiment: ExperimentName,
    trials: Annotated[
        list[int],
        typer.Argument(metavar="TRIAL", min=1, max=LAST_TRIAL, autocompletion=complete_trial),
    ],
    estimate: Annotated[
        Path, typer.Option("--from", help="The fitted string: estimate.json of a trial of any experiment.")
    ],
    out: Annotated[
        Path | None, typer.Option(help="Output folder.  [default: results/EXPERIMENT/predictions]")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Predict recorded trials from a fitted string, without fitting: series and errors."""
    from dataclasses import asdict

    from strandcast.records.folders import ExperimentFolder
    from strandcast.stages.predict import predict as predicted

    folder = out or ExperimentFolder(ROOT, experiment).results / "predictions"
    done = [predicted(ROOT, experiment, trial, estimate, folder) for trial in trials]
    lines = []
    for each in done:
        tip = "tip not measured"
        if each.tip_m is not None and each.tip_share is not None:
            tip = f"tip {1e3 * each.tip_m:.1f} mm ({100 * each.tip_share:.1f} % of the length)"
        points = f"all points {1e3 * each.points_m:.1f} mm, E {1e3 * each.E_m:.1f} mm"
        lines.append(f"trial {each.trial}: {tip}, {points}: {each.file}")
    show(as_json, {"estimate": estimate, "predictions": [asdict(each) for each in done]}, lines)


def together(
    experiments: Annotated[
        list[str], typer.Argument(metavar="EXPERIMENT", autocompletion=complete_experiment)
    ],
    as_json: AsJson = False,
) -> None:
    """Fit one string to experiments that share it, for example without a weight and with one."""
    from strandcast.stages.together import together as fitted_together

    found = fitted_together(ROOT, experiments)
    lines = ["shared:", *(_unknown_line(name, number) for name, number in found["shared"].items())]
    for name, own in found["experiments"].items():
        lines.append(f"{name}: fitted to E = {1e3 * own['E_m']:.1f} mm")
        lines += [_unknown_line(unknown, number) for unknown, number in own["unknowns"].items()]
        lines += [f"  weight at {1e3 * each['place_m']:.0f} mm: {each['words']}" for each in own["weights"]]
    show(as_json, found, [*lines, *(f"warning: {warning}" for warning in found["warnings"])])


def _unknown_line(name: str, number: dict[str, Any]) -> str:
    below, above = ("≤ " * number["open"][0], "≥ " * number["open"][1])
    return f"  {name}: {number['value']:.3g} [{below}{number['low']:.3g}, {above}{number['high']:.3g}]"
