"""Missing data are skipped with a reason; existing data give figures as JSON."""

import json

import pytest

from strandcast_studies.evidence import run
from strandcast_studies.evidence.figure import Figure


def test_without_data_everything_is_skipped(monkeypatch, capsys):
    monkeypatch.delenv(run.VARIABLE, raising=False)
    run.main([])
    printed = capsys.readouterr()
    records = json.loads(printed.out)
    assert {record["name"] for record in records} == set(run.PARTS)
    assert all(run.VARIABLE in record["skipped"] for record in records)
    assert "skipped" in printed.err


def test_a_missing_folder_is_named(tmp_path):
    assert all("pac_cable" in s.reason for s in run.measure_all(tmp_path) if s.name.startswith("pac_cable"))


def test_an_existing_part_is_measured(tmp_path, monkeypatch):
    (tmp_path / "deform_dlo").mkdir()
    monkeypatch.setitem(run.PARTS, "deform_dlo", ("deform_dlo", lambda folder: [Figure("a", 2.0, "mm", 1.0)]))
    measured = run.measure_all(tmp_path)[-1]
    assert measured.record() == {"name": "a", "value": 2.0, "unit": "mm", "target": 1.0, "met": False}
    assert run.in_words(measured) == "a: 2 mm (target 1: MISSED)"


@pytest.mark.parametrize(
    ("value", "target", "met"), [(-9.0, 10.0, True), (11.0, 10.0, False), (1.0, None, None)]
)
def test_a_target_bounds_the_magnitude(value, target, met):
    assert Figure("a", value, "%", target).met is met
