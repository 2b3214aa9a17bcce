"""The streaming benchmark reports its measurements; this machine's jitter is not tested."""

import json
import sys

import pytest

from strandcast_studies.benchmarks import streaming


@pytest.mark.thorough
def test_the_benchmark_reports_every_loop(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(streaming, "RATES_HZ", (125.0,))
    monkeypatch.setattr(sys, "argv", ["streaming", "--seconds", "0.4", "--out", str(tmp_path / "late.json")])
    streaming.main()
    rows = json.loads((tmp_path / "late.json").read_text())["loops"]
    assert [row["loop"] for row in rows] == [streaming.WAKE, streaming.PLAYER] * 2
    for row in rows:
        assert 0.0 <= row["p50_ms"] <= row["p99_ms"] <= row["p999_ms"] <= row["max_ms"]
    # Half a second, the swing and the tail, unless the machine stalled and the throw was stopped.
    assert all(
        row["stopped"] or row["cycles"] + row["missed"] == pytest.approx(2.1 * 125, abs=2)
        for row in rows
        if row["loop"] == streaming.PLAYER
    )
    assert capsys.readouterr().out.count("\n| ") == 4
