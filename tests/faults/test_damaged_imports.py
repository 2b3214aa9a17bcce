"""Damaged logs and captures: each import ends in one clear error or in the file's own numbers.

STRANDCAST_FUZZ_CASES sets the number of cases of each reader, for long runs.
"""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from strandcast.errors import StrandcastError
from strandcast.imports.capture import CapturedTrial, import_capture
from strandcast.imports.capture_mapping import capture_mapping_of
from strandcast.imports.joints import Reading, import_joints
from strandcast.imports.mapping import JointMapping
from strandcast.records.joint_log import read_run
from strandcast.records.track import read_track

from .fuzzing import ODD

CASES = int(os.environ.get("STRANDCAST_FUZZ_CASES", "100"))
FUZZ = settings(
    max_examples=CASES,
    deadline=None,
    derandomize=CASES == 100,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)

CELLS = [*ODD, '"1"', "9" * 5000, "x" * 140000]
Change = tuple[str, int, int, str]
CHANGES = st.lists(
    st.tuples(
        st.sampled_from(
            ["replace", "insert", "delete", "double", "quote", "line", "twice", "swap", "cut", "byte"]
        ),
        st.integers(0, 9999),
        st.integers(0, 9999),
        st.sampled_from(CELLS),
    ),
    min_size=1,
    max_size=3,
)


def changed_row(row: list[str], what: str, column: int, cell: str) -> list[str]:
    """Return a row after one change at a column."""
    head, own, tail = row[:column], row[column : column + 1], row[column + 1 :]
    middle = {
        "replace": [cell],
        "insert": [cell, *own],
        "delete": [],
        "double": [*own, *own],
        "quote": [f'"{text}' for text in own],
    }
    return head + middle.get(what, own) + tail


def changed_bytes(data: bytes, what: str, where: int, value: int) -> bytes:
    if what == "cut":
        return data[: where % len(data)]
    place = where % len(data)
    return data[:place] + bytes([value % 256]) + data[place + 1 :]


def damaged(text: str, changes: list[Change]) -> bytes:
    """Return a CSV's bytes after changes of cells and rows, and then of bytes."""
    lines = [line.split(",") for line in text.splitlines()]
    for what, where, which, cell in changes:
        at, other = where % len(lines), which % len(lines)
        if what in ("line", "twice"):
            lines.insert(at, [cell] if what == "line" else list(lines[at]))
        elif what == "swap":
            lines[at], lines[other] = lines[other], lines[at]
        else:
            lines[at] = changed_row(lines[at], what, which % max(len(lines[at]), 1), cell)
    data = "\n".join(",".join(row) for row in lines).encode()
    for what, where, which, _ in changes:
        if what in ("cut", "byte") and data:
            data = changed_bytes(data, what, where, which)
    return data


def plain_rows(data: bytes, columns: list[str]) -> dict[float, list[float]]:
    """Return the numbers of the plain rows of a CSV with a header, NaN where empty, by their time.

    A last row that was cut has too few cells; it is left out.
    """
    text = data.decode("utf-8-sig", errors="replace").replace("\r\n", "\n").replace("\r", "\n")
    lines = [line for line in text.split("\n") if line.strip() and line.strip()[0] not in "#%"]
    names, *rows = ([cell.strip().strip('"') for cell in line.split(",")] for line in lines)
    rows = rows[:-1] if rows and len(rows[-1]) < len(names) else rows
    while names[-1] == "":
        names.pop()
    at = [names.index(name) for name in columns]
    read = [
        [float("nan" if row[k].lower() in ("", "na") else row[k]) for k in at]
        for row in rows
        if all("_" not in row[k] and row[k].isascii() for k in at)
    ]
    return {row[0]: row[1:] for row in reversed(read)}


LOG = "t,a,b,ca,cb\n" + "".join(
    f"{1 + 0.01 * k:.2f},{0.1 * k:.3f},{0.2 * k:.3f},{0.1 * k:.3f},{0.2 * k:.3f}\n" for k in range(25)
)
READING = Reading(mapping=JointMapping(time="t", q=["a", "b"], q_cmd=["ca", "cb"], rate_hz=100))


@FUZZ
@given(CHANGES)
def test_a_damaged_log_is_refused_or_read_as_it_stands(tmp_path: Path, changes: list[Change]) -> None:
    data = damaged(LOG, changes)
    (tmp_path / "log.csv").write_bytes(data)
    (tmp_path / "run.json").unlink(missing_ok=True)
    try:
        import_joints(tmp_path / "log.csv", tmp_path, READING)
    except StrandcastError as refusal:
        assert refusal.file is not None
        assert len(refusal.message()) < 1500
        assert not (tmp_path / "run.json").exists()
        return
    _, log = read_run(tmp_path)
    expected = plain_rows(data, ["t", "a", "b"])
    np.testing.assert_array_equal([expected[time_s] for time_s in log.time_s], log.q_rad)


CAPTURE = "t,x,y,w,mx,my,ex,ey\n" + "".join(
    f"{0.01 * k:.2f},{0.01 * k:.2f},0.9,-1.5,{0.01 * k:.2f},0.7,{0.02 * k:.2f},0.5\n" for k in range(25)
)
HELD = capture_mapping_of("x,y,w", ["0.2:mx,my", "0.4:ex,ey"], time="t")


@FUZZ
@given(CHANGES)
def test_a_damaged_capture_is_refused_or_read_as_it_stands(
    tmp_path_factory: pytest.TempPathFactory, changes: list[Change]
) -> None:
    tmp_path = tmp_path_factory.mktemp("capture")
    data = damaged(CAPTURE, changes)
    (tmp_path / "c.csv").write_bytes(data)
    out = tmp_path / "out"
    try:
        import_capture(tmp_path / "c.csv", out, HELD, CapturedTrial("e", 1, 0.4, 4))
    except StrandcastError as refusal:
        assert len(refusal.message()) < 1500
        assert not out.exists()
        return
    track = read_track(out / "track.parquet", 4)
    expected = plain_rows(data, ["t", "x", "y", "mx", "my", "ex", "ey"])
    rows = np.array([expected[time_s] for time_s in track.camera_time_s]).reshape(-1, 3, 2)
    rows[~np.isfinite(rows).all(axis=2)] = np.nan
    np.testing.assert_array_equal(rows, track.points_m[:, [0, 2, 4]])
