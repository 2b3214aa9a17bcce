"""Files store the versions that made them, and these do not change what the files say."""

import json

import numpy as np
import pytest

import strandcast
from strandcast.errors import StrandcastError
from strandcast.records import provenance
from strandcast.records.content_hash import result_sha256
from strandcast.records.estimate import ENSEMBLE
from strandcast.records.manifest import Gap
from strandcast.records.record import Record
from strandcast.records.summary import group_by_versions
from strandcast.records.tables import read_parquet, table_made_by, write_table

OTHER = {"strandcast": "0.1.9", "numpy": "1.0"}


class Sample(Record):
    """A record of this test."""

    SCHEMA = "test/sample"
    gaps: list[Gap] = []
    length_m: float = 0.3


@pytest.fixture
def other_versions(monkeypatch):
    """Make this process write other versions."""

    def use() -> None:
        monkeypatch.setattr(provenance, "_versions", lambda: OTHER)

    return use


def test_a_record_stores_the_versions_that_made_it(tmp_path) -> None:
    Sample().write(tmp_path / "a.json")
    head = json.loads((tmp_path / "a.json").read_text())
    assert list(head)[:4] == ["schema", "version", "content_sha256", "made_by"]
    assert head["made_by"]["strandcast"] == strandcast.__version__
    assert head["made_by"]["numpy"] == np.__version__
    assert Sample.read(tmp_path / "a.json").made_by == head["made_by"]


def test_versions_do_not_enter_the_hash(tmp_path, other_versions) -> None:
    Sample().write(tmp_path / "a.json")
    write_table(tmp_path / "a.parquet", ENSEMBLE, {"member": [0, 1], "E_m": [0.1, 0.2]})
    other_versions()
    Sample().write(tmp_path / "b.json")
    write_table(tmp_path / "b.parquet", ENSEMBLE, {"member": [0, 1], "E_m": [0.1, 0.2]})
    assert (tmp_path / "a.json").read_bytes() != (tmp_path / "b.json").read_bytes()
    assert Sample.read(tmp_path / "b.json").made_by == OTHER
    assert table_made_by(read_parquet(tmp_path / "b.parquet")) == OTHER
    assert Sample.read(tmp_path / "a.json") == Sample.read(tmp_path / "b.json")
    for suffix in ("json", "parquet"):
        assert result_sha256(tmp_path / f"a.{suffix}") == result_sha256(tmp_path / f"b.{suffix}")


def test_the_hash_of_a_table_is_of_all_that_it_says(tmp_path) -> None:
    columns = {"member": [0, 1], "E_m": [0.1, 0.2]}
    hashes = set()
    for changes, facts in (
        ({}, {}),
        ({"E_m": [0.1, np.nextafter(0.2, 1)]}, {}),
        ({"k_s": [1.0, 2.0]}, {}),
        ({}, {"a": 1}),
    ):
        write_table(tmp_path / "a.parquet", ENSEMBLE, columns | changes, facts)
        hashes.add(result_sha256(tmp_path / "a.parquet"))
    assert len(hashes) == 4


def test_a_copied_record_keeps_its_maker(tmp_path, other_versions) -> None:
    other_versions()
    Sample().write(tmp_path / "a.json")
    provenance_of_copy = Sample.read(tmp_path / "a.json")
    provenance_of_copy.write(tmp_path / "b.json")
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()


def test_a_file_from_before_versions_were_stored_is_read(tmp_path) -> None:
    Sample().write(tmp_path / "a.json")
    data = json.loads((tmp_path / "a.json").read_text())
    del data["made_by"]
    (tmp_path / "a.json").write_text(json.dumps(data))
    assert Sample.read(tmp_path / "a.json").made_by == {}


def test_versions_of_another_form_are_refused(tmp_path) -> None:
    Sample().write(tmp_path / "a.json")
    data = json.loads((tmp_path / "a.json").read_text()) | {"made_by": ["numpy"]}
    (tmp_path / "a.json").write_text(json.dumps(data))
    with pytest.raises(StrandcastError, match=r"SC-R001.*made_by"):
        Sample.read(tmp_path / "a.json")


def test_files_are_grouped_by_their_versions() -> None:
    reversed_order = dict(reversed(OTHER.items()))
    groups = group_by_versions([("a", OTHER), ("b", {}), ("c", reversed_order)])
    assert [(group.versions, group.files) for group in groups] == [(OTHER, ["a", "c"]), ({}, ["b"])]
