"""The command that fits one string to several experiments."""

from typing import Annotated, Any

import typer

from strandcast.cli.common import ROOT, AsJson, complete_experiment, show


def together(
    experiments: Annotated[
        list[str], typer.Argument(metavar="EXPERIMENT", autocompletion=complete_experiment)
    ],
    as_json: AsJson = False,
) -> None:
    """Fit one string to experiments that share it, for example without a weight and with one."""
    from strandcast.stages.together import together as fitted_together

    found = fitted_together(ROOT, experiments)
    lines = ["shared:", *(_line(name, number) for name, number in found["shared"].items())]
    for name, own in found["experiments"].items():
        lines.append(f"{name}: fitted to E = {1e3 * own['E_m']:.1f} mm")
        lines += [_line(unknown, number) for unknown, number in own["unknowns"].items()]
        lines += [f"  weight at {1e3 * each['place_m']:.0f} mm: {each['words']}" for each in own["weights"]]
    show(as_json, found, [*lines, *(f"warning: {warning}" for warning in found["warnings"])])


def _line(name: str, number: dict[str, Any]) -> str:
    below, above = ("≤ " * number["open"][0], "≥ " * number["open"][1])
    return f"  {name}: {number['value']:.3g} [{below}{number['low']:.3g}, {above}{number['high']:.3g}]"
