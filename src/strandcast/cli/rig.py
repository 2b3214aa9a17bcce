"""The command that shows what an arm's file states wrongly, and how well throws repeat: rig."""

from collections.abc import Iterator
from typing import Any

from strandcast.cli.common import ROOT, AsJson, ExperimentName, show, table_lines


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
    show(as_json, data, _lines(experiment, state))


def _lines(experiment: str, state: Any) -> Iterator[str]:
    """Yield the table, what it says, and repeated motions."""
    from strandcast.report.panels.rig_offsets import HEADS, offset_rows, offsets_finding

    if state.offsets is None:
        yield "What the arm's file states wrongly is estimated from two trials with a joint log on."
    else:
        rows = ([cell.replace("[", r"\[") for cell in row] for row in offset_rows(state.offsets))
        yield from table_lines(f"{experiment}: the arm's file against the video", HEADS, rows)
        yield from [f"warning: {words}" for words in state.offsets.warnings] or [
            offsets_finding(state.offsets)
        ]
    for repeat in state.repeats:
        pair = f"trials {repeat.trials[0]} and {repeat.trials[1]}"
        yield f"{pair} repeat a motion: the tips were {1e3 * repeat.tip_m:.1f} mm apart (rms)"
