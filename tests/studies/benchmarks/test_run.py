"""The benchmark from end to end, on a few strings."""

import json
import sys

import pytest

from strandcast_studies.benchmarks.simulation import run

PEERS = "strandcast_studies.benchmarks.simulation"

HEADLINES = {
    "string_seconds_per_s",
    "tip_error_mm",
    "ratio_mujoco_hinge",
    "ratio_mujoco_flex",
    "ratio_pyelastica",
    "ratio_numba_scalar",
    "peak_fraction",
}


def test_quick_run_writes_every_headline_once(tmp_path, capsys):
    pytest.importorskip("elastica", reason="needs the packages of `make bench`")
    out = tmp_path / "results" / "bench.json"
    run.main(["--quick", "--threads", "2", "--out", str(out)])
    entries = json.loads(out.read_text())
    assert all(list(entry) == ["name", "value", "unit", "peer", "min", "max"] for entry in entries)
    keys = [(entry["name"], entry["peer"]) for entry in entries]
    assert len(set(keys)) == len(keys)
    found = {entry["name"]: entry for entry in entries if entry["name"] in HEADLINES}
    assert set(found) == HEADLINES
    assert all(entry["min"] <= entry["value"] <= entry["max"] for entry in found.values())
    assert found["tip_error_mm"]["value"] > 0.0
    costs = [entry["value"] for entry in entries if entry["name"].startswith("cpu_s_per_string_s")]
    assert min(costs) > 0.0
    assert "string_seconds_per_s" in capsys.readouterr().out


def test_a_missing_peer_is_left_out_with_a_note(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "strandcast_studies.benchmarks.simulation.pyelastica", None)
    found = list(run.peer_setups())
    assert [entry.peer for entry in found if isinstance(entry, run.Entry)] == ["pyelastica"]
    assert "not installed" in capsys.readouterr().err
