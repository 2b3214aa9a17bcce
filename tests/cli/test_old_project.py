"""A project of version 0.2 opens: its settings, arm, and the records of a throw in the lab."""

import zipfile
from pathlib import Path

import pytest
from tests.forked import run_module

import strandcast
from strandcast.config.load import load_experiment
from strandcast.records.motion import Motion
from strandcast.records.verified import READERS

SETTINGS = "data/old/experiment.yaml"


@pytest.fixture
def root(tmp_path, project_root) -> Path:
    with zipfile.ZipFile(project_root / "tests/recorded/project-0.2.zip") as recorded:
        recorded.extractall(tmp_path)
    return tmp_path


def test_settings_are_rewritten_and_nothing_else(root, caplog):
    before = {path: path.read_bytes() for path in root.rglob("*.*") if path.is_file()}
    settings = load_experiment(root / SETTINGS)
    assert len(caplog.records) == 12  # settings that were renamed or dropped
    fixed = run_module(root, "strandcast", "check", "old", "--fix")
    assert fixed.stdout.startswith(f"{SETTINGS}: 12 former settings written as they are now\nold: ")
    caplog.clear()
    assert load_experiment(root / SETTINGS) == settings
    assert not caplog.text
    now = (root / SETTINGS).read_text()
    assert "# how the string is fitted" in now
    assert "finer" not in now
    assert "camera: {size_px: [640, 360], frame_rate_hz: 100}" in now
    changed = [path for path, content in before.items() if path.read_bytes() != content]
    assert changed == [root / SETTINGS]


def test_records_and_motions_are_read(root):
    trial = strandcast.open(root)["old"].trials[1]
    assert trial.verdict.miss_m == pytest.approx(0.0275, abs=1e-4)
    assert trial.estimate.record.E_m == pytest.approx(0.0016, abs=1e-4)
    assert Motion.read(root / "data/old/trial-01/motion.json").predicted is not None
    read = [READERS[path.suffix](path)[0] for path in (root / "results").rglob("*.*") if path.is_file()]
    assert len(read) == 8
    assert None not in read
