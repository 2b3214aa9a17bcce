"""Commands that write trials and fitted strings for other programs."""

from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from strandcast.cli.common import ROOT, AsJson, ExperimentName, TrialNumber, show
from strandcast.cli.exchange import export_motion

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
    filmed = (out / "videos").is_dir()
    note = "" if filmed else "; no video: not every throw has an MP4 with time stamps at the rate of filming"
    show(as_json, {"folder": out, "frames": frames, "video": filmed}, [f"{out}: {frames} frames{note}"])


def export_crate(
    experiment: ExperimentName,
    out: Annotated[
        Path | None, typer.Option(help="Output folder, or .zip file.  [default: EXPERIMENT-crate.zip]")
    ] = None,
    without_video: Annotated[
        bool, typer.Option("--without-video", help="Leave the raw videos out, but give their hashes.")
    ] = False,
    date: Annotated[
        datetime | None,
        typer.Option(
            formats=["%Y-%m-%d"],
            metavar="YYYY-MM-DD",
            help="Date of publication.  [default: the day of the newest raw file]",
        ),
    ] = None,
    licence: Annotated[
        str | None, typer.Option("--license", help="SPDX identifier of the data's licence, e.g. CC-BY-4.0.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write an experiment as an RO-Crate for an archive: raw files, results and their provenance.

    Refused if a file is not as it was recorded or made. In the unpacked crate `strandcast verify` works.
    """
    import strandcast
    from strandcast.exports.crate import export_crate as export
    from strandcast.workflow.verify import refuse_changed_files

    target = out or Path(f"{experiment}-crate.zip")
    view = strandcast.open(ROOT)[experiment]
    refuse_changed_files(ROOT, experiment)
    published = None if date is None else date.date()
    count = export(view, target, without_video=without_video, published=published, licence=licence)
    show(as_json, {"crate": target, "files": count}, [f"{target}: {count} files"])


def _trial(experiment: str, trial: int) -> "TrialView":
    import strandcast

    return strandcast.open(ROOT)[experiment].trial(trial)


EXPORTS: dict[str, Callable[..., Any]] = {
    "motion": export_motion,
    "csv": export_csv,
    "mjcf": export_mjcf,
    "rerun": export_rerun,
    "mcap": export_mcap,
    "dataset": export_dataset,
    "crate": export_crate,
}
