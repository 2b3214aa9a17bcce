"""The command that shows the state of experiments: status."""

import sys
from collections.abc import Iterator
from dataclasses import asdict
from itertools import groupby
from typing import Any

import typer

from strandcast.cli.common import ROOT, AsJson, Experiments, show, table_lines
from strandcast.errors import StrandcastError

# A word and a sign for each state; the colour only repeats them.
SIGNS = {
    "done": ("✓", "green"),
    "stale": ("↻", "yellow"),
    "missing": ("○", "cyan"),
    "failed": ("✗", "bold red"),
    "damaged": ("!", "bold red"),
    "excluded": ("–", "dim"),
}
MOST_REASONS = 3  # in a row of the table; --json prints all


def status(
    experiments: Experiments = None,
    as_json: AsJson = False,
) -> None:
    """Show what is done, stale (and why), missing or failed, what was thrown, and the next command."""
    from strandcast.config.find import overlooked_experiments
    from strandcast.workflow.status import Status, status_of
    from strandcast.workflow.targets import default_experiments

    found: list[Status] = []
    refused: list[StrandcastError] = []
    for name in experiments or default_experiments(ROOT):
        try:
            found.append(status_of(ROOT, name))
        except StrandcastError as problem:
            refused.append(problem)
    overlooked = [] if experiments else overlooked_experiments(ROOT)
    data: dict[str, Any] = {
        "experiments": [asdict(one) | {"damaged": [each._asdict() for each in one.damaged]} for one in found],
        "problems": [each.to_json() for each in refused],
        "overlooked": [each.to_json() for each in overlooked],
    }
    show(as_json, data, (line for one in found for line in _lines(one)))
    for message in (*map(str, refused), *(each.message("WARNING") for each in overlooked)):
        print(message, file=sys.stderr)
    raise typer.Exit(max((each.exit_code for each in refused), default=0))


def _lines(status: Any) -> Iterator[str]:
    """Yield a table with a row for all stages of a trial that share a state, then the next steps."""
    yield from table_lines(status.experiment, ("trial", "thrown", "stages", "state", "why"), _rows(status))
    yield from (f"next: {step}" for step in status.next_steps)


def _rows(status: Any) -> Iterator[tuple[str, ...]]:
    for trial in status.trials:
        label, thrown = str(trial.trial or "all"), str(trial.throw or "")
        for state, group in groupby(trial.stages, key=lambda stage: stage.state):
            stages = list(group)
            sign, colour = SIGNS[state]
            names = ", ".join(stage.name for stage in stages) if state != "done" else _range(stages)
            reasons = list(dict.fromkeys(_why(stages)))
            more = [f"{len(reasons) - MOST_REASONS} more"] if len(reasons) > MOST_REASONS else []
            why = "; ".join(reasons[:MOST_REASONS] + more)
            yield label, thrown, names, f"[{colour}]{sign} {state}[/]", why.replace("[", r"\[")
            label = thrown = ""


def _range(stages: list[Any]) -> str:
    first, last = stages[0].name, stages[-1].name
    return first if first == last else f"{first} … {last}"


def _why(stages: list[Any]) -> Iterator[str]:
    """Yield the stages' own reasons; if the first has none, the stage that it follows."""
    if stages[0].after and not stages[0].why:
        yield f"{stages[0].after} runs again"
    for stage in stages:
        yield from (f"{stage.code} {reason}" if stage.code else reason for reason in stage.why)
