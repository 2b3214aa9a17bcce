"""Commands on which trials count: exclude, include."""

from typing import Annotated

import typer

from strandcast.cli.common import ROOT, AsJson, ExperimentName, TrialNumber, show


def exclude(
    experiment: ExperimentName,
    trial: TrialNumber,
    reason: Annotated[str, typer.Option(help="Why it does not count; the pages show it.")],
    as_json: AsJson = False,
) -> None:
    """Exclude a trial that went wrong from fit and planning: writes it to the experiment's file."""
    printable = "".join(letter if letter.isprintable() else " " for letter in reason)
    _set(experiment, trial, " ".join(printable.split()), as_json)


def include(experiment: ExperimentName, trial: TrialNumber, as_json: AsJson = False) -> None:
    """Let an excluded trial count again."""
    _set(experiment, trial, None, as_json)


def _set(experiment: str, trial: int, reason: str | None, as_json: bool) -> None:
    from strandcast.config.exclude import set_excluded
    from strandcast.config.find import find_experiment
    from strandcast.stages.context import context_of, refuse_unknown_trial
    from strandcast.workflow.locks import refuse_if_held

    file = find_experiment(experiment, ROOT)
    context = context_of(ROOT, experiment)
    if context.settings.excluded_reason(trial) is None:
        refuse_unknown_trial(context, trial)
    refuse_if_held(ROOT, experiment)
    changed = set_excluded(file, trial, reason)
    held_out = trial in context.settings.held_out
    state = "is excluded" if reason else "is held out: take it from held_out" if held_out else "counts"
    command = f"strandcast run {experiment}"
    data = {"experiment": experiment, "trial": trial, "excluded": reason, "file": file, "changed": changed}
    lines = [f"trial {trial} of {experiment} {state}: {file}{'' if changed else ' (nothing to change)'}"]
    show(as_json, data | {"next": command}, [*lines, f"next: {command}"])
