"""Compare two experiments, or two folders of results, e.g. a copy from before a change."""

import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from strandcast.config.find import NAME, find_experiment
from strandcast.errors import StrandcastError
from strandcast.records.folders import trial_folders
from strandcast.report.comparison import Comparison, TrialRecords, compare, read_records
from strandcast.workflow.events import benchmarks


def compare_results(root: Path, a: str, b: str) -> Comparison:
    """Return the comparison of two experiments or folders of results.

    Raises
    ------
    StrandcastError
        SC-W022 there are no results, both are the same folder, or no trial is in both.
    """
    folders = [_folder(root, name) for name in (a, b)]
    if folders[0].resolve() == folders[1].resolve():
        raise StrandcastError(
            "SC-W022",
            f"{a} and {b} are the same results",
            file=folders[0],
            fix="name two; to compare before and after a change, copy the results first: "
            f"cp -r {folders[0]} {folders[0]}-before",
        )
    with _as_copy(folders[0]) as one, _as_copy(folders[1]) as other:
        return compare((a, b), _trials(one), _trials(other))


def _folder(root: Path, name: str) -> Path:
    """Return the folder of results that a name or a path stands for."""
    by_name = root / "results" / name
    is_name = re.fullmatch(NAME, name) is not None
    folder = by_name if is_name and by_name.is_dir() else Path(name)
    if not any(any(each.glob("*.json")) for each in trial_folders(folder).values()):
        if is_name:
            find_experiment(name, root)  # or else says which names there are
        fix = f"strandcast run {name}" if is_name else "give an experiment, or results/EXPERIMENT"
        raise StrandcastError("SC-W022", f"there are no results of {name!r}", file=folder, fix=fix)
    return folder


@contextmanager
def _as_copy(folder: Path) -> Iterator[Path]:
    """Yield a folder under a path outside of any project, where results are not compared with their inputs.

    A copy of older results is meant to differ from the inputs that are there now, and may have another name.
    """
    with tempfile.TemporaryDirectory(prefix="strandcast-") as place:
        link = Path(place) / "copy"
        link.symlink_to(folder.resolve(), target_is_directory=True)
        yield link


def _trials(folder: Path) -> dict[int, TrialRecords]:
    times_s: dict[str, dict[str, float]] = {}
    for trial, stage, seconds in benchmarks(folder):
        times_s.setdefault(trial, {})[stage] = seconds
    found = {}
    for number, path in trial_folders(folder).items():
        records = read_records(path)
        if "verdict" in records or "estimate" in records:  # else it is only planned
            found[number] = TrialRecords(records, times_s.get(path.name, {}))
    return found
