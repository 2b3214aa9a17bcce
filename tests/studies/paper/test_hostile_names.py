"""Row 76 of the fault list and an experiment without trials, in the paper's pages."""

from pathlib import Path

import pytest

from strandcast.errors import StrandcastError
from strandcast.records.summary import ExperimentSummary
from strandcast_studies.paper import page_stage, transfer_stage


@pytest.mark.parametrize("form", ["../../x", "/tmp/x", "", "paper/../x"])
def test_a_page_is_written_nowhere_else(tmp_path: Path, form: str) -> None:
    with pytest.raises(StrandcastError, match="SC-Z006") as caught:
        page_stage.run(tmp_path, form)
    assert repr(form) in caught.value.what
    assert list(tmp_path.rglob("*")) == []


def test_a_transfer_from_an_experiment_without_trials_is_refused(tmp_path: Path, project_root: Path) -> None:
    (tmp_path / "data/x").mkdir(parents=True)
    (tmp_path / "data/x/experiment.yaml").write_text("string: {length_m: 0.3}\ntarget_m: [0.5, 0.5]\n")
    (tmp_path / "config").symlink_to(project_root / "config")
    ExperimentSummary(
        experiment="x",
        string_length_m=0.3,
        target_m=[0.5, 0.5],
        hit_radius_m=0.02,
        verdict="no hit",
        hit_trial=None,
        trials=[],
        next_motion_sha256=None,
        versions=[],
    ).write(tmp_path / "results/x/summary.json")
    with pytest.raises(StrandcastError, match="SC-Z005") as caught:
        transfer_stage.run(tmp_path, "x", [])
    assert caught.value.file == str(tmp_path / "results/x")
