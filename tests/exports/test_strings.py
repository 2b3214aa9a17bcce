"""`strandcast strings`: the strings that a project has fitted."""

import json
import shutil
from pathlib import Path

from tests.forked import run_module

import strandcast


def test_each_fitted_string_is_listed_with_its_newest_fit(project, tmp_path):
    root = Path(shutil.copytree(project, tmp_path / "project"))
    shown = run_module(root, "strandcast", "strings")
    assert "small: 300 mm long" in shown.stdout
    assert "start_string: {from: small}" in shown.stdout
    (row,) = json.loads(run_module(root, "strandcast", "strings", "--json").stdout)["strings"]
    estimate = strandcast.open(root)["small"].trials[1].estimate.record
    assert (row["name"], row["trial"], row["arm"]) == ("small", 1, "planar3")
    assert row["E_m"] == estimate.E_m
    assert [each["value"] for each in row["parameters"]] == [each.value for each in estimate.parameters]
    (root / "results" / "small" / "trial-01" / "estimate.json").write_text("{")
    damaged = run_module(root, "strandcast", "strings")
    assert damaged.returncode == 0
    assert "no string has been fitted here" in damaged.stdout
    assert "estimate.json" in damaged.stdout
