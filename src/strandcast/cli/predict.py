"""The command that predicts trials without fitting them."""

from pathlib import Path
from typing import Annotated

import typer

from strandcast.cli.common import ROOT, AsJson, ExperimentName, complete_trial, show
from strandcast.core.trial_names import LAST_TRIAL


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
