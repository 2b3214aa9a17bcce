"""The command that shows how much throws differ on a rig: rig."""

from collections.abc import Iterator
from typing import Any

from strandcast.cli.common import ROOT, AsJson, ExperimentName, show


def rig(experiment: ExperimentName, as_json: AsJson = False) -> None:
    """Show how much throws differ on the rig: what was expected, what each trial showed, what is learnt."""
    from strandcast.stages.context import context_of
    from strandcast.stages.rig import rig_state

    state = rig_state(context_of(ROOT, experiment))
    data = {
        "experiment": experiment,
        "trials": state.trials,
        "planned_with": state.planned_with,
        "scatter": [one.model_dump() for one in state.scatter],
        "repeats": [one._asdict() for one in state.repeats],
        "warnings": [warning for one in state.scatter for warning in one.warnings],
    }
    show(as_json, data, _lines(experiment, state))


def _lines(experiment: str, state: Any) -> Iterator[str]:
    """Yield a table with a row for each quantity, repeated motions, warnings, and what the planner uses."""
    from rich.console import Console
    from rich.table import Table

    from strandcast.report.panels.rig_scatter import scatter_rows

    heads, rows = scatter_rows(state.scatter, state.trials)
    table = Table(*heads, box=None, pad_edge=False, header_style="bold")
    for row in rows:
        table.add_row(*(cell.replace("[", r"\[") for cell in row))
    console = Console()
    if not console.is_terminal:
        console = Console(width=10_000, color_system=None)  # one line for each row
    with console.capture() as capture:
        console.print(f"[bold]{experiment}[/bold]", table, sep="\n", highlight=False)
    yield from (line.rstrip() for line in capture.get().splitlines())
    for repeat in state.repeats:
        pair = f"trials {repeat.trials[0]} and {repeat.trials[1]}"
        yield f"{pair} repeat a motion: the tips were {1e3 * repeat.tip_m:.1f} mm apart (rms)"
    yield from (f"warning: {warning}" for one in state.scatter for warning in one.warnings)
    if state.planned_with != "learnt":
        yield f"The planner takes {state.planned_with:g} × the scatter of a typical rig (plan.disturbances)."
        yield "With `plan.disturbances: learnt` it takes what is learnt here."
