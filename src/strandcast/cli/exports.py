"""Commands that write trials and fitted strings for other programs."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from strandcast.cli.common import ROOT, AsJson, ExperimentName, TrialNumber, show

if TYPE_CHECKING:
    from strandcast.api import TrialView

OutFile = Annotated[Path, typer.Option(help="Output file.")]
OutFolder = Annotated[Path, typer.Option(help="Output folder.")]


def export_csv(
    experiment: ExperimentName, trial: TrialNumber, out: OutFolder, as_json: AsJson = False
) -> None:
    """Write a trial's tables as CSV, on the robot's clock too."""
    from strandcast.exports.csv import export_csv as export

    files = export(_trial(experiment, trial), out)
    show(as_json, {"files": files}, map(str, files))


def export_mjcf(
    experiment: ExperimentName,
    trial: TrialNumber,
    out: OutFile,
    mass: Annotated[
        float,
        typer.Option(min=1e-6, help="Mass of the string with its weights [kg]; no effect on its motion."),
    ] = 0.01,
    as_json: AsJson = False,
) -> None:
    """Write the string fitted after a trial, on the experiment's arm, as a MuJoCo model."""
    from strandcast.exports.fitted_model import export_mjcf as export

    done = export(_trial(experiment, trial), out, mass)
    found = {"file": done.file, "E_m": done.E_m, "own_E_m": done.own_E_m}
    ours, theirs = (f"{1e3 * value:.2f} mm" for value in (done.own_E_m, done.E_m))
    show(as_json, found, [f"{out}: E on trial {trial} is {theirs} in MuJoCo, {ours} in strandcast"])


def export_rerun(
    experiment: ExperimentName, trial: TrialNumber, out: OutFile, as_json: AsJson = False
) -> None:
    """Write a throw as a recording for the Rerun viewer (.rrd): arm, strings, video, curves."""
    from strandcast.exports.rerun import export_rerun as export
    from strandcast.exports.throw import read_throw

    export(read_throw(_trial(experiment, trial)), out)
    show(as_json, {"file": out}, [f"{out}: open it with `rerun {out}`"])


def export_mcap(
    experiment: ExperimentName, trial: TrialNumber, out: OutFile, as_json: AsJson = False
) -> None:
    """Write a throw as ROS 2 messages in an MCAP file, for Foxglove, RViz and ros2 bag."""
    from strandcast.exports.mcap import export_mcap as export
    from strandcast.exports.throw import read_throw

    count = export(read_throw(_trial(experiment, trial)), out)
    show(as_json, {"file": out, "messages": count}, [f"{out}: {count} messages"])


def export_dataset(experiment: ExperimentName, out: OutFolder, as_json: AsJson = False) -> None:
    """Write an experiment's throws as a LeRobot dataset (v3.0), one episode per trial."""
    import strandcast
    from strandcast.exports.dataset import export_dataset as export

    frames = export(strandcast.open(ROOT)[experiment], out)
    show(as_json, {"folder": out, "frames": frames}, [f"{out}: {frames} frames"])


def _trial(experiment: str, trial: int) -> "TrialView":
    import strandcast

    return strandcast.open(ROOT)[experiment].trial(trial)


EXPORTS: dict[str, Callable[..., Any]] = {
    "csv": export_csv,
    "mjcf": export_mjcf,
    "rerun": export_rerun,
    "mcap": export_mcap,
    "dataset": export_dataset,
}
