"""Rows 28 and 29 of the fault list: a trial's joint log is missing, empty or cut beside a good video."""

from collections.abc import Callable
from pathlib import Path

import pytest

from .conftest import Trial, write_film


def without_rows(log: Path) -> None:
    log.write_text(log.read_text().split("\n", 1)[0] + "\n")


def halved(log: Path) -> None:
    log.write_bytes(log.read_bytes()[: log.stat().st_size // 2])


def without_its_last_row(log: Path) -> None:
    text = log.read_text()
    log.write_text(text[: text.rindex("\n", 0, -1) + 1])


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (Path.unlink, "SC-V020"),
        (without_rows, "SC-X020"),
        (halved, "SC-X020"),
        (without_its_last_row, "SC-X020"),
    ],
)
def test_rows28_and_29_a_damaged_log_stops_the_trial(
    trial: Trial, change: Callable[[Path], None], code: str
) -> None:
    write_film(trial.folder / "video.mp4")
    trial.log(60 / 500)
    assert trial.outcome().error is None
    change(trial.folder / "joints.csv")
    error = trial.outcome().refused(code)
    assert error.file == str(trial.folder / "joints.csv")
    assert error.fix
