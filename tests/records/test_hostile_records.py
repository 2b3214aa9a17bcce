"""Rows 69, 70 and 80 of the fault list, and worse: records and tables made to harm their reader."""

import json
import os
import time
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import strandcast
from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.estimate import Estimate
from strandcast.records.files import content_sha256
from strandcast.records.record import MOST_BYTES, MOST_LEVELS, read_json
from strandcast.records.tables import MOST_CELLS, read_parquet, read_table
from strandcast.records.track import TRACK
from strandcast.records.verdict import Verdict


def refusal(path: Path, read) -> StrandcastError:
    with pytest.raises(StrandcastError) as caught:
        read(path)
    assert caught.value.exit_code == INTEGRITY
    assert caught.value.file == str(path)
    return caught.value


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"a": ' + "[" * 100_000 + "]" * 100_000 + "}", "recursion"),
        ('{"a": ' + "[" * MOST_LEVELS + "]" * MOST_LEVELS + "}", "levels"),
        ('{"a": ' + '{"a": ' * MOST_LEVELS + "1" + "}" * MOST_LEVELS + "}", "levels"),
        ('{"a": ' + "9" * 6000 + "}", "digits"),
        ('{"a": ' + "9" * 400 + "}", "too big"),
        ('{"a": 1e999}', "too large a number"),
        ('{"a": NaN}', "NaN"),
        (r'{"a": "\ud800"}', "surrogates not allowed"),
        (r'{"\udfff": 1}', "surrogates not allowed"),
        ("[]", "no object"),
        ("", "Expecting value"),
    ],
)
def test_hostile_json_is_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "verdict.json"
    path.write_text(text)
    for read in (read_json, Verdict.read):
        error = refusal(path, read)
        assert error.code == "SC-R001"
        assert words in error.what


def test_json_of_any_size_is_refused_before_it_is_parsed(tmp_path: Path) -> None:
    path = tmp_path / "verdict.json"
    with path.open("wb") as file:
        file.truncate(1 << 40)  # a sparse file: no disk, and no memory
    start_s = time.process_time()
    assert f"larger than {MOST_BYTES >> 20} MiB" in refusal(path, read_json).what
    assert time.process_time() - start_s < 2.0


def test_json_at_its_limits_is_read(tmp_path: Path) -> None:
    path = tmp_path / "any.json"
    path.write_text('{"a": ' + "[" * (MOST_LEVELS - 1) + "]" * (MOST_LEVELS - 1) + r', "b": "\ud83d\ude00"}')
    assert read_json(path)["b"] == "😀"
    path.write_text('{"a": [9223372036854775807, -9223372036854775808]}')
    assert read_json(path) == {"a": [2**63 - 1, -(2**63)]}


@pytest.mark.parametrize("content", [{}, {"best": 3}, {"intervals": [], "best": None}])
def test_an_old_record_that_cannot_be_migrated_is_refused(tmp_path: Path, content: dict) -> None:
    path = tmp_path / "estimate.json"
    head = {"schema": Estimate.SCHEMA, "version": 1, "content_sha256": content_sha256(content), "made_by": {}}
    path.write_text(json.dumps(head | content))
    assert refusal(path, Estimate.read).code == "SC-R001"


def test_a_table_of_absurdly_many_rows_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "track.parquet"
    schema = pa.schema([("v", pa.null())])
    group = pa.table({"v": pa.nulls(MOST_CELLS // 10 + 1)}, schema)
    with pq.ParquetWriter(path, schema, write_page_checksum=True) as writer:
        for _ in range(10):
            writer.write_table(group)
    assert path.stat().st_size < 1 << 20
    before = pa.total_allocated_bytes()
    for read in (read_parquet, lambda path: read_table(path, TRACK)):
        error = refusal(path, read)
        assert error.code == "SC-R001"
        assert "100000010 rows of 1 columns; at most 100000000 values are read" in error.what
    assert pa.total_allocated_bytes() == before


def test_names_of_folders_add_no_column(tmp_path: Path) -> None:
    """`point=3` in a path is a column to readers of data sets."""
    folder = tmp_path / "point=3"
    folder.mkdir()
    pq.write_table(pa.table({"v": [1.0]}), folder / "a.parquet")
    assert read_parquet(folder / "a.parquet").column_names == ["v"]


@pytest.mark.parametrize("schema", ["[]", "{}", "3", "null", '"x"'])
def test_a_record_of_any_schema_is_refused(tmp_path: Path, schema: str) -> None:
    path = tmp_path / "a.json"
    path.write_text(f'{{"schema": {schema}}}')
    assert refusal(path, strandcast.load).code == "SC-R002"


def test_a_pipe_is_not_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "verdict.json")
    assert refusal(tmp_path / "verdict.json", Verdict.read).code == "SC-R001"
