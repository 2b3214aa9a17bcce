"""What several commands share: arguments and their completion, and how results are printed."""

import json
import os
import sys
from collections.abc import Iterable, Iterator
from typing import Annotated, Any

import typer

from strandcast.core.trial_names import LAST_TRIAL
from strandcast.records.folders import ExperimentFolder, known_experiments, project_root

ROOT = project_root()


def complete_experiment(incomplete: str) -> list[str]:
    """Return the experiments that a shell may complete a name to."""
    return [name for name in known_experiments(ROOT) if name.startswith(incomplete)]


def complete_trial(context: typer.Context, incomplete: str) -> list[str]:
    """Return the trials, recorded or planned, of the experiment that the command line names."""
    name = context.params.get("experiment") or ""
    found = ExperimentFolder(ROOT, name).all_trials()
    return [str(number) for number in found if str(number).startswith(incomplete)]


def experiment_argument(argument: str) -> str:
    """Return the experiment that an argument names, also as a path: `data/seil/`."""
    from strandcast.config.find import experiment_named

    return experiment_named(argument, ROOT)


ExperimentName = Annotated[
    str,
    typer.Argument(
        metavar="EXPERIMENT",
        help="The experiment's name: its folder under data/.",
        parser=experiment_argument,
        autocompletion=complete_experiment,
    ),
]
Experiments = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="EXPERIMENT",
        help="Names of experiments: their folders under data/.",
        parser=experiment_argument,
        autocompletion=complete_experiment,
    ),
]
TrialNumber = Annotated[
    int,
    typer.Argument(
        metavar="TRIAL",
        min=1,
        max=LAST_TRIAL,
        help="The trial's number, counted from 1.",
        autocompletion=complete_trial,
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of lines.")]


def show(as_json: bool, data: dict[str, Any], lines: Iterable[str]) -> None:
    """Print a command's result: one JSON object, or lines for a person."""
    if as_json:
        # An 8-bit output would lose letters of names.
        plain = (sys.stdout.encoding or "utf-8").lower() != "utf-8"
        print(json.dumps(data, default=os.fspath, ensure_ascii=plain), flush=True)
    else:
        for line in lines:
            print(line)


def table_lines(title: str, heads: Iterable[str], rows: Iterable[Iterable[str]]) -> Iterator[str]:
    """Yield the lines of a table in rich's markup; off a terminal each row is one line."""
    from rich.console import Console
    from rich.table import Table

    table = Table(*heads, box=None, pad_edge=False, header_style="bold")
    for row in rows:
        table.add_row(*row)
    console = Console()
    if not console.is_terminal:
        console = Console(width=10_000, color_system=None)
    with console.capture() as capture:
        console.print(f"[bold]{title}[/bold]", table, sep="\n", highlight=False)
    yield from (line.rstrip() for line in capture.get().splitlines())
