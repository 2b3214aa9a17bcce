"""Whether this computer can run a workflow: results can be written, there is room, no file is of tomorrow."""

import os
import tempfile
from collections.abc import Iterable
from pathlib import Path

from strandcast.errors import ENVIRONMENT, StrandcastError
from strandcast.records.files import check_room, existing_folder
from strandcast.records.folders import ExperimentFolder

LEAST_FREE_BYTES = 150_000_000  # a trial of the demo: a film of 45 MB, twice while it is written, and results
MOST_AHEAD_S = 5.0  # chosen: jobs take longer, so that their results are newer than their inputs


def check_host(root: Path, experiments: Iterable[str]) -> None:
    """Refuse to start a workflow that this computer could not finish.

    Raises
    ------
    StrandcastError
        SC-R041 the disk is full; SC-W002 results cannot be written; SC-W007 files are dated in the future.
    """
    folders = [ExperimentFolder(root, name) for name in experiments]
    for place in (root / ".snakemake", *(folder.results for folder in folders)):
        check_room(place, LEAST_FREE_BYTES)
    for folder in folders:
        places = [place for place in (root / "config", folder.data, folder.results) if place.exists()]
        _check_dates(places, _now(folder.results))


def _now(folder: Path) -> float:
    """Return the time with which a folder's file system dates files: a file server's may differ from ours."""
    with tempfile.TemporaryFile(dir=existing_folder(folder)) as probe:
        return os.fstat(probe.fileno()).st_mtime


def _check_dates(places: list[Path], now_s: float) -> None:
    """Refuse files from the future: Snakemake deletes a new result that is older than its input."""
    dated = ((path.stat().st_mtime, path) for place in places for path in place.rglob("*") if path.is_file())
    ahead = sorted(each for each in dated if each[0] > now_s + MOST_AHEAD_S)
    if ahead:
        changed_s, path = ahead[-1]
        others = f", and {len(ahead) - 1} other files" if len(ahead) > 1 else ""
        raise StrandcastError(
            "SC-W007",
            f"is dated {changed_s - now_s:.0f} s in the future{others}",
            file=path,
            cost="results made from it would be deleted, because they seem older than it",
            fix="set the clock if it is wrong; otherwise date the files now: "
            f"find {' '.join(map(str, places))} -newermt now -exec touch {{}} +",
            exit_code=ENVIRONMENT,
        )
