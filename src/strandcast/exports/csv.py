"""`export csv`: a trial's tables as CSV files, with the units in the columns' names."""

from pathlib import Path

from strandcast.api import TrialView
from strandcast.errors import StrandcastError
from strandcast.records.files import write_bytes

TABLES = ("track", "observations", "hand", "joints", "simulated")


def export_csv(trial: TrialView, folder: Path) -> list[Path]:
    """Write the trial's tables to a folder; `track.csv` has the robot's clock too. Return the files.

    A table that the trial does not have, such as the pixels of an imported track, is left out.

    Raises
    ------
    StrandcastError
        SC-W030 the trial has no table; otherwise as the readers of results.
    """
    written = []
    for name in TABLES:
        raw = {"joints": trial.folder.data / "joints.csv"}
        if not raw.get(name, trial.folder.results / f"{name}.parquet").is_file():
            continue
        table = getattr(trial, name)
        if name == "track":
            robot_time_s = trial.alignment.robot_time_s(table["camera_time_s"])
            table.insert(2, "robot_time_s", robot_time_s)
        written.append(folder / f"{name}.csv")
        write_bytes(written[-1], table.to_csv(index=name == "joints").encode())
    if not written:
        what, fix = "has no table to export", f"strandcast run {trial.context.name}"
        raise StrandcastError("SC-W030", what, file=trial.folder.results, fix=fix)
    return written
