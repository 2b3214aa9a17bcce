"""Records of older versions are migrated when they are read; other tables and newer records are refused."""

import json
from pathlib import Path

import pytest

from strandcast.errors import StrandcastError
from strandcast.records.estimate import Estimate
from strandcast.records.tables import Column, TableSpec, read_table, write_table

# Written by strandcast 0.1.0: version 1 has `knowledge` where version 2 has `uncertainty`, and no versions.
OLD_ESTIMATE = Path(__file__).with_name("estimate-v1.json")
OLD = TableSpec("test/places", {"x_mm": Column("f8", "mm")})


NEW = TableSpec("test/places", {"x_mm": Column("f8", "mm")}, version=2)


def test_an_old_estimate_is_migrated(tmp_path) -> None:
    old = json.loads(OLD_ESTIMATE.read_text())
    estimate = Estimate.read(OLD_ESTIMATE)
    assert old["version"] == 1
    assert estimate.uncertainty is not None
    assert estimate.uncertainty.unknowns == old["knowledge"]["unknowns"]
    assert estimate.uncertainty.marginal_sd == old["knowledge"]["marginal_sd"]
    assert "knowledge" not in estimate.content()
    assert estimate.E_m == old["E_m"]
    assert estimate.made_by == {}
    estimate.write(tmp_path / "estimate.json")
    new = json.loads((tmp_path / "estimate.json").read_text())
    assert new["version"] == 2
    assert Estimate.read(tmp_path / "estimate.json") == estimate


def test_an_old_estimate_is_verified_before_it_is_migrated(tmp_path) -> None:
    path = tmp_path / "estimate.json"
    path.write_text(OLD_ESTIMATE.read_text().replace('"knowledge"', '"uncertainty"'))
    with pytest.raises(StrandcastError, match="SC-R001"):
        Estimate.read(path)


@pytest.mark.parametrize("version", [0, 3, "1", 1.0, True, None])
def test_versions_without_migration_are_refused(tmp_path, version) -> None:
    path = tmp_path / "estimate.json"
    path.write_text(json.dumps(json.loads(OLD_ESTIMATE.read_text()) | {"version": version}))
    with pytest.raises(StrandcastError, match=r"SC-R003.*this strandcast reads version 2"):
        Estimate.read(path)


@pytest.mark.parametrize(("written", "read"), [(OLD, NEW), (NEW, OLD)])
def test_a_table_of_another_version_is_refused(tmp_path, written: TableSpec, read: TableSpec) -> None:
    write_table(tmp_path / "a.parquet", written, {"x_mm": [1.0]})
    with pytest.raises(StrandcastError, match="SC-R003"):
        read_table(tmp_path / "a.parquet", read)
