"""The command that shows what an arm's file states wrongly, and how much throws differ on a rig: rig."""

from collections.abc import Iterator
from typing import Any

from strandcast.cli.common import ROOT, AsJson, ExperimentName, show


def rig(experiment: ExperimentName, as_json: AsJson = False) -> None:
    """Show how much throws differ on the rig, and what the arm's file states wrongly.

    Scatter: what was expected, what each trial showed, what is learnt. The arm's file: how far each of its
    numbers is off, in the same way in all trials, from two trials on.
    """
    from strandcast.stages.context import context_of
    from strandcast.stages.rig import rig_state

    state = rig_state(context_of(ROOT, experiment))
    data = {
        "experiment": experiment,
        "trials": state.trials,
        "planned_with": state.planned_with,
        "offsets": None if state.offsets is None else state.offsets.model_dump(),
        "scatter": [one.model_dump() for one in state.scatter],
        "repeats": [one._asdict() for one in state.repeats],
        "warnings": _warnings(state),
    }
    show(as_json, data, _lines(experiment, state))


def _warnings(state: Any) -> list[str]:
    offsets = [] if state.offsets is None else state.offsets.warnings
    return [*offsets, *(warning for one in state.scatter for warning in one.warnings)]


def _lines(experiment: str, state: Any) -> Iterator[str]:
    """Yield both tables, repeated motions, warnings, and what the planner uses."""
    from strandcast.report.panels.rig_offsets import HEADS, offset_rows, offsets_finding
    from strandcast.report.panels.rig_scatter import scatter_rows

    yield from _table(f"[bold]{experiment}[/bold]", *scatter_rows(state.scatter, state.trials))
    if state.offsets is None:
        yield "What the arm's file states wrongly is estimated from two trials with a joint log on."
    else:
        yield from _table("[bold]the arm's file against the video[/bold]", HEADS, offset_rows(state.offsets))
        yield from [] if state.offsets.warnings else [offsets_finding(state.offsets)]
    for repeat in state.repeats:
        pair = f"trials {repeat.trials[0]} and {repeat.trials[1]}"
        yield f"{pair} repeat a motion: the tips were {1e3 * repeat.tip_m:.1f} mm apart (rms)"
    yield from (f"warning: {warning}" for warning in _warnings(state))
    if state.planned_with != "learnt":
        yield f"The planner takes {state.planned_with:g} × the scatter of a typical rig (plan.disturbances)."
        yield "With `plan.disturbances: learnt` it takes what is learnt here."


def _table(title: str, heads: list[str], rows: list[list[str]]) -> Iterator[str]:
    """Yield the lines of a table; off a terminal each row is one line."""
    from rich.console import Console
    from rich.table import Table

    table = Table(*heads, box=None, pad_edge=False, header_style="bold")
    for row in rows:
        table.add_row(*(cell.replace("[", r"\[") for cell in row))
    console = Console()
    if not console.is_terminal:
        console = Console(width=10_000, color_system=None)
    with console.capture() as capture:
        console.print(title, table, sep="\n", highlight=False)
    yield from (line.rstrip() for line in capture.get().splitlines())
