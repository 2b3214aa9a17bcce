"""Files of older versions are migrated when they are read; newer ones are refused."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from strandcast.errors import StrandcastError
from strandcast.records.estimate import Estimate
from strandcast.records.tables import Column, TableSpec, read_table, write_table

# Written by strandcast 0.1.0: version 1 has `knowledge` where version 2 has `uncertainty`, and no versions.
OLD_ESTIMATE = Path(__file__).with_name("estimate-v1.json")
OLD = TableSpec("test/places", {"x_mm": Column("f8", "mm")})


def _in_metres(table: pa.Table) -> pa.Table:
    x_m = pa.array(table.column("x_mm").to_numpy() * 1e-3)
    return pa.table({"x_m": x_m}).replace_schema_metadata(table.schema.metadata)


NEW = TableSpec("test/places", {"x_m": Column("f8", "m")}, version=2, migrations={1: _in_metres})


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


def test_an_old_table_is_migrated(tmp_path) -> None:
    write_table(tmp_path / "a.parquet", OLD, {"x_mm": [1.0, 2.5]})
    assert read_table(tmp_path / "a.parquet", NEW)["x_m"] == pytest.approx(np.array([0.001, 0.0025]))


def test_a_newer_table_is_refused(tmp_path) -> None:
    write_table(tmp_path / "a.parquet", NEW, {"x_m": [1.0]})
    with pytest.raises(StrandcastError, match="SC-R003"):
        read_table(tmp_path / "a.parquet", OLD)
