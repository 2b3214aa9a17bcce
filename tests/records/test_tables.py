"""Tables: round trip, units in the metadata, and every flipped bit that matters is caught."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from strandcast.errors import StrandcastError
from strandcast.records.alignment import HAND, read_hand
from strandcast.records.estimate import ENSEMBLE
from strandcast.records.tables import (
    ARROW_TYPES,
    read_facts,
    read_table,
    scattered,
    table_sha256,
    write_table,
)
from strandcast.records.track import MARKERS, TRACK, Track, read_track

FLOATS = st.floats(-1e3, 1e3)


@given(
    points=hnp.arrays(float, st.tuples(st.integers(1, 6), st.integers(2, 5), st.just(2)), elements=FLOATS),
    seed=st.integers(0, 99),
)
@settings(max_examples=40, deadline=None)
def test_track_round_trip_with_gaps(tmp_path_factory, points, seed):
    path = tmp_path_factory.mktemp("track") / "track.parquet"
    frames, count, _ = points.shape
    random = np.random.default_rng(seed)
    points[random.random((frames, count)) < 0.3] = np.nan
    points[:, 0] = 0.25  # the hand is always there
    track = Track(
        np.arange(frames) * 2,
        np.arange(frames) / 500,
        points,
        np.full((frames, count), 1e-3),
        random.integers(0, 8, (frames, count)).astype(np.int32),
    )
    write_table(path, TRACK, track.columns())
    again = read_track(path, count - 1)
    np.testing.assert_array_equal(again.points_m, points)
    np.testing.assert_array_equal(again.frame, track.frame)
    known = np.isfinite(points[..., 0])
    np.testing.assert_array_equal(again.flags[known], track.flags[known])


def hand_columns():
    time_s = np.linspace(0, 1, 50)
    return {
        "source": ["measured"] * 25 + ["seen"] * 25,
        "robot_time_s": time_s,
        "x_m": np.cos(time_s),
        "y_m": np.sin(time_s),
        "angle_rad": time_s,
    }


def test_units_facts_and_text_columns(tmp_path):
    path = tmp_path / "hand.parquet"
    write_table(path, HAND, hand_columns(), facts={"arm": "planar3"})
    assert pq.read_schema(path).field("angle_rad").metadata[b"unit"] == b"rad"
    assert read_facts(path, HAND) == {"arm": "planar3"}
    time_s, pose = read_hand(path, "seen")
    assert pose.array().shape == (25, 3)
    assert time_s[0] == pytest.approx(25 / 49)


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="counts threads, on Linux")
def test_reading_a_table_starts_no_threads_and_loads_no_pandas(tmp_path):
    write_table(tmp_path / "hand.parquet", HAND, hand_columns())
    script = """if True:
        import os, sys
        from strandcast.records.tables import arrow_sha256, read_parquet
        before = len(os.listdir("/proc/self/task"))
        arrow_sha256(read_parquet(sys.argv[1]))
        print(len(os.listdir("/proc/self/task")) - before, "pandas" in sys.modules)
    """
    line = [sys.executable, "-c", script, str(tmp_path / "hand.parquet")]
    assert subprocess.run(line, capture_output=True, text=True, check=True).stdout == "0 False\n"


def test_same_columns_same_bytes(tmp_path):
    for name in ("a", "b"):
        write_table(tmp_path / name, HAND, hand_columns())
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


@pytest.mark.parametrize("spec", [TRACK, MARKERS])
def test_a_foreign_table_is_refused(tmp_path, spec):
    path = tmp_path / "hand.parquet"
    write_table(path, HAND, hand_columns())
    with pytest.raises(StrandcastError, match=r"SC-R002.*hand\.parquet"):
        read_table(path, spec)


def test_a_cut_or_missing_table_is_refused(tmp_path):
    path = tmp_path / "hand.parquet"
    with pytest.raises(StrandcastError, match="not there"):
        read_table(path, HAND)
    write_table(path, HAND, hand_columns())
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(StrandcastError, match="SC-R001"):
        read_table(path, HAND)


def test_only_open_ended_tables_take_further_columns(tmp_path):
    with pytest.raises(ValueError, match="hand"):
        write_table(tmp_path / "x", HAND, hand_columns() | {"more_m": np.zeros(50)})
    write_table(tmp_path / "y", ENSEMBLE, {"member": [0, 1], "E_m": [0.1, 0.2], "k_s": [1e3, 1e4]})
    np.testing.assert_array_equal(read_table(tmp_path / "y", ENSEMBLE)["k_s"], [1e3, 1e4])


def damaged_track(path, change):
    """Write a small track, changed as an Arrow table and without a hash, as another program would."""
    table = pa.table({name: pa.array([1], column_type) for name, column_type in TRACK_TYPES})
    pq.write_table(change(table).replace_schema_metadata({"schema": TRACK.schema, "version": "1"}), path)
    return path


TRACK_TYPES = [(name, ARROW_TYPES[column.dtype]) for name, column in TRACK.columns.items()]


@pytest.mark.parametrize(
    ("change", "code", "words"),
    [
        (
            lambda table: table.append_column("x_m", table["y_m"]),
            "SC-R001",
            "two of its columns",
        ),
        (
            lambda table: table.set_column(0, "frame", pa.nulls(1, pa.int32())),
            "SC-R001",
            "1 of its 1",
        ),
        (lambda table: table.append_column("var_xx_m2", table["y_m"]), "SC-R001", "others of the covariance"),
        (lambda table: table.set_column(0, "frame", table["point"]), None, ""),
    ],
)
def test_a_table_that_another_program_wrote_wrongly_is_refused(tmp_path, change, code, words):
    path = damaged_track(tmp_path / "track.parquet", change)
    if code is None:
        assert read_track(path, 3).points_m.shape == (1, 4, 2)
        return
    with pytest.raises(StrandcastError, match=f"{code}.*{words}"):
        read_track(path, 3)


def test_an_array_that_a_track_cannot_fill_is_refused(tmp_path):
    path = damaged_track(tmp_path / "track.parquet", lambda table: table)
    with pytest.raises(StrandcastError, match="SC-R001.*at most"):
        read_track(path, 10**9)
    with pytest.raises(IndexError):
        scattered((3,), np.array([-1]), 1.0)


@pytest.mark.parametrize("facts", [b'{"maker": "\xed\xa0\x80"}', b'{"maker": "\xff"}', b'{"maker"', b"[3]"])
def test_facts_that_are_not_text_are_refused_by_every_reader(tmp_path, facts):
    path = tmp_path / "hand.parquet"
    write_table(path, HAND, hand_columns(), facts={"maker": "lab"})
    table = pq.read_table(path)
    damaged = table.replace_schema_metadata(dict(table.schema.metadata) | {b"facts": facts})
    pq.write_table(damaged, path, write_page_checksum=True)
    for read in (lambda: read_facts(path, HAND), lambda: read_table(path, HAND), lambda: table_sha256(path)):
        with pytest.raises(StrandcastError, match="SC-R001"):
            read()
