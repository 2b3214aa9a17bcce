"""A capture without a target is fitted as a whole; nothing is scored or planned."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from strandcast.core.trial_names import trial_name
from strandcast.errors import StrandcastError
from strandcast.records.estimate import CARRIED, HANGING, SIMULATED, UNDER_PREVIOUS, Estimate
from strandcast.records.summary import ExperimentSummary
from strandcast.records.tables import read_table
from strandcast.records.verdict import Verdict
from strandcast.stages.predict import predict
from strandcast.stages.run import run_stage
from strandcast.workflow.campaign import write_campaign
from strandcast.workflow.runner import table

from .test_register_track import SETTINGS, TIME_S, supplied_in

QUICK = "estimate: {evaluations: 100, profiles: false}\n"
STAGES = ("register_track", "score", "estimate", "report")


@pytest.fixture(scope="module")
def captured(tmp_path_factory: pytest.TempPathFactory, project_root: Path) -> Path:
    """Return a project with two trials of the same swing, fitted, with their pages."""
    root = tmp_path_factory.mktemp("captured")
    for trial in (1, 2):
        made = supplied_in(root, project_root, trial)
    settings = SETTINGS.replace("target_m: [0.5, 0.5]\n", QUICK)
    assert "target_m" not in settings
    (made.folder.parent / "experiment.yaml").write_text(settings)
    for trial in (1, 2):
        for stage in STAGES:
            run_stage(stage, root, "swung", trial)
    run_stage("summary", root, "swung", trials=(1, 2))
    return root


def result(root: Path, trial: int, name: str) -> Path:
    return root / "results" / "swung" / trial_name(trial) / name


def test_the_whole_capture_is_fitted_and_predicted_before(captured: Path) -> None:
    first, second = (Estimate.read(result(captured, trial, "estimate.json")) for trial in (1, 2))
    assert first.window_s is not None
    assert first.window_s[1] == pytest.approx(TIME_S[-1])
    assert first.frames_used > 0.9 * len(TIME_S)
    assert first.held_out_m(UNDER_PREVIOUS) is None
    # The same motion again: what was fitted to it predicts it as well as it fits.
    assert second.held_out_m(UNDER_PREVIOUS) == pytest.approx(first.E_m, rel=0.02)
    for estimate in (first, second):
        guesses = [estimate.held_out_m(HANGING), estimate.held_out_m(CARRIED)]
        assert all(guess is not None and np.isfinite(guess) and guess > 0 for guess in guesses)


def test_a_capture_is_predicted_without_a_fit_as_before_its_fit(captured: Path, tmp_path: Path) -> None:
    second = Estimate.read(result(captured, 2, "estimate.json"))
    found = predict(captured, "swung", 2, result(captured, 1, "estimate.json"), tmp_path)
    assert found.E_m == pytest.approx(second.held_out_m(UNDER_PREVIOUS), rel=1e-6)
    assert found.tip_m is not None
    assert found.tip_share == pytest.approx(found.tip_m / second.length_m)
    rows = read_table(found.file, SIMULATED)
    assert set(rows["source"]) == {"predicted"}
    assert "z_m" not in rows


def test_no_trial_hits_or_misses_and_no_motion_is_planned(captured: Path) -> None:
    verdict = Verdict.read(result(captured, 1, "verdict.json"))
    assert (verdict.target_m, verdict.hit, verdict.miss_m) == (None, None, None)
    assert (verdict.closest_frame, verdict.closest_robot_time_s) == (None, None)
    with pytest.raises(StrandcastError, match="SC-F014"):
        run_stage("plan", captured, "swung", 3)
    assert not (captured / "results" / "swung" / "trial-03" / "motion.json").exists()


def test_summary_and_table_name_the_fit(captured: Path) -> None:
    summary = ExperimentSummary.read(captured / "results" / "swung" / "summary.json")
    assert (summary.verdict, summary.target_m, summary.unread) == ("no target", None, {})
    lines = table(captured, summary)
    fitted_mm = [1e3 * Estimate.read(result(captured, trial, "estimate.json")).E_m for trial in (1, 2)]
    assert lines[0] == "swung: string of 0.4 m, no target"
    assert lines[1] == f"  trial 1: fitted to E = {fitted_mm[0]:.1f} mm"
    (second,) = (
        line for line in lines if line.startswith(f"  trial 2: fitted to E = {fitted_mm[1]:.1f} mm; ")
    )
    assert second.endswith(" mm predicted from the trials before")
    assert write_campaign(captured)[0].captured == 1


def test_the_place_of_the_markers_is_fitted_in_the_plane_too(captured: Path, tmp_path: Path) -> None:
    root = Path(shutil.copytree(captured, tmp_path / "project", symlinks=True))
    file = root / "data" / "swung" / "experiment.yaml"
    file.write_text(file.read_text().replace("{evaluations", "{forces: [marker_shift], evaluations"))
    run_stage("estimate", root, "swung", 1)
    shift = Estimate.read(result(root, 1, "estimate.json")).options["marker_shift"]
    assert abs(shift) < 0.05  # declared where they are
