"""Captures in space are fitted and predicted by the stages, from files of our own simulator and real ones."""

import re
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from strandcast.config.estimate import EstimateSettings
from strandcast.core.trial_names import trial_name
from strandcast.errors import StrandcastError
from strandcast.estimation.estimate import _worse_than_before
from strandcast.imports.capture_mapping import CaptureMapping
from strandcast.imports.mapping import check_mapping
from strandcast.records.alignment import HAND
from strandcast.records.estimate import (
    CARRIED,
    HANGING,
    LAST_PART,
    SIMULATED,
    TIP_UNDER_PREVIOUS,
    UNDER_PREVIOUS,
    Estimate,
)
from strandcast.records.summary import ExperimentSummary
from strandcast.records.tables import read_facts, read_table, write_table
from strandcast.records.track import TRACK, TrackSummary
from strandcast.stages import declarations, import_track
from strandcast.stages.context import context_of
from strandcast.stages.job import Files, Job
from strandcast.stages.predict import predict
from strandcast.stages.run import run_stage
from strandcast.stages.together import together
from strandcast.stages.trials_in_space import read_trial_in_space, series_of
from strandcast.workflow.check import check_experiment
from strandcast.workflow.runner import table

from ..imports import space_captures as captures

STAGES = ("register_track", "score", "estimate", "report")
YAML = "string: {{length_m: {length}}}\nestimate: {{evaluations: 120}}\n"


def project(root: Path, project_root: Path, length_m: float) -> Path:
    data = root / "data" / "cable"
    data.mkdir(parents=True)
    (data / "experiment.yaml").write_text(YAML.format(length=length_m))
    (root / "config").symlink_to(project_root / "config")
    return root


def run_trials(root: Path, trials: range) -> None:
    for trial in trials:
        for stage in STAGES:
            run_stage(stage, root, "cable", trial)
    run_stage("summary", root, "cable", trials=tuple(trials))


def result(root: Path, trial: int, name: str) -> Path:
    return root / "results" / "cable" / trial_name(trial) / name


@pytest.fixture(scope="module")
def captured(tmp_path_factory: pytest.TempPathFactory, project_root: Path) -> Path:
    """Return a project with two trials of a cable between two poses, fitted, with their pages."""
    root = project(tmp_path_factory.mktemp("space"), project_root, captures.LENGTH_M)
    mapping = check_mapping(captures.mapping_data(two_ends=True), CaptureMapping)
    for trial, phase in ((1, 0.2), (2, 1.3)):
        named = captures.columns(phase, seconds=1.5, two_ends=True)
        file = captures.write_csv(root / f"{trial}.csv", named)
        assert import_track.run(root, "cable", trial, file, mapping).warnings == []
    run_trials(root, range(1, 3))
    return root


def test_the_second_trial_is_predicted_from_the_first(captured):
    first, second = (Estimate.read(result(captured, trial, "estimate.json")) for trial in (1, 2))
    assert first.held_out_m(UNDER_PREVIOUS) is None
    predicted_m = second.held_out_m(UNDER_PREVIOUS)
    assert predicted_m is not None
    assert predicted_m < 5e-3
    guess_m = second.held_out_m(CARRIED)
    assert guess_m is not None
    assert predicted_m < 0.2 * guess_m
    assert second.held_out_m(HANGING) is None
    assert all((each.held_out_m(LAST_PART) or 1.0) < 6e-3 for each in (first, second))
    found = {fit.name: fit.value for fit in second.parameters}
    assert found["bending_length"] == pytest.approx(captures.TRUTH["bending_length"], rel=0.15)
    assert len(found) == 9
    assert set(second.string.options) >= {"clamp_offset_left_rad", "far_offset_up_rad", "length_change"}


def test_what_was_read_and_a_search_that_did_not_converge_are_named(captured):
    estimate = Estimate.read(result(captured, 2, "estimate.json"))
    assert [(each.trial, each.recorded_frames) for each in estimate.fitted] == [(1, 75), (2, 75)]
    assert all(0.0 < each.seconds <= each.recorded_s == pytest.approx(1.48) for each in estimate.fitted)
    read = estimate.fitted_in_words()
    assert read is not None
    first = Estimate.read(result(captured, 1, "estimate.json"))
    assert not first.converged
    (unconverged,) = (warning for warning in first.warnings if "did not converge" in warning)
    assert read in result(captured, 2, "report.html").read_text()
    assert unconverged in result(captured, 1, "report.html").read_text()
    lines = "\n".join(table(captured, ExperimentSummary.read(captured / "results/cable/summary.json")))
    assert read in lines
    assert unconverged in lines


def test_settings_that_the_pages_advise_are_accepted(captured, tmp_path):
    root = tmp_path / "project"
    shutil.copytree(captured, root, symlinks=True)
    file = result(root, 1, "estimate.json")
    estimate = Estimate.read(file)
    bound = [fit.model_copy(update={"at_bound": True}) for fit in estimate.parameters]
    estimate.model_copy(update={"parameters": bound}).write(file)
    run_stage("report", root, "cable", 1)
    page = result(root, 1, "report.html").read_text()
    assert "at bound" in page
    # Elsewhere than in sentences, all settings are listed.
    advised = set(re.findall(r"\sestimate\.([a-z_]+)", page)) - {"json"}
    assert "evaluations" in advised
    assert advised <= EstimateSettings.model_fields.keys()


def test_check_says_what_a_capture_in_space_is_and_refuses_what_only_films_have(captured, tmp_path):
    assert "as 20 points, captured in space" in " ".join(check_experiment(captured, "cable").facts)
    root = tmp_path / "project"
    shutil.copytree(captured, root, symlinks=True)
    settings = root / "data/cable/experiment.yaml"
    settings.write_text(settings.read_text().replace("evaluations: 120", "camera_offset_sd_m: 0.01"))
    (problem,) = check_experiment(root, "cable").errors
    assert (problem.code, problem.field) == ("SC-E008", "estimate.camera_offset_sd_m")


def test_places_in_metres_stay_where_the_strings_length_is_corrected(captured, tmp_path):
    root = Path(shutil.copytree(captured, tmp_path / "project", symlinks=True))

    def places(length_m: float) -> np.ndarray:
        (root / "data/cable/experiment.yaml").write_text(YAML.format(length=length_m))
        files = Files(declarations.STAGES["estimate"], Job(context_of(root, "cable"), 1))
        return next(iter(series_of(files, read_trial_in_space(files, 1)).values())).places

    np.testing.assert_allclose(places(1.0), captures.PLACES_M)
    with pytest.raises(StrandcastError, match="SC-I013.*a marker at 0.8 m lies beyond the string's 0.75 m"):
        places(0.75)
    file = result(root, 1, "track.json")
    # The points of two cameras are even along the string.
    TrackSummary.read(file).model_copy(update={"choices": {}}).write(file)
    np.testing.assert_allclose(places(1.0), [0.25, 0.5, 0.75, 1.0])


def test_a_trial_in_the_plane_among_captures_in_space_is_named(captured, tmp_path):
    root = Path(shutil.copytree(captured, tmp_path / "project", symlinks=True))
    file = result(root, 1, "hand.parquet")
    rows = read_table(file, HAND)
    in_plane = {name: rows[name] for name in ("source", "robot_time_s", "x_m", "y_m")}
    write_table(file, HAND, in_plane | {"angle_rad": rows["x_m"]}, {})
    files = Files(declarations.STAGES["estimate"], Job(context_of(root, "cable"), 2))
    with pytest.raises(StrandcastError, match="SC-E009.*track.parquet: trial 1 is in the plane"):
        read_trial_in_space(files, 1)


EVERY = """\
estimate:
  {search: thorough, evaluations: 200, trials: latest, older_trials_weight: 0.5, w: 0.1,
   dt_s: 0.0025, ranges: {bending_length: [0.02, 1.0]}, start_shape: hanging,
   forces: [stiff_bend, bend_friction, marker_shift, drag_along],
   clamp_offset_sd_rad: 0.05, horizon_s: 0.1}
"""


@pytest.mark.thorough
def test_the_settings_of_the_fit_work_in_space_too(captured, tmp_path):
    root = Path(shutil.copytree(captured, tmp_path / "project", symlinks=True))
    sections = "stiff_sections: [{from_m: 0.3, to_m: 0.4}]"
    string = f"string: {{length_m: {captures.LENGTH_M}, {sections}}}\n"
    (root / "data/cable/experiment.yaml").write_text(string + EVERY)
    for trial in (1, 2):
        run_stage("estimate", root, "cable", trial)
    found = Estimate.read(result(root, 2, "estimate.json"))
    assert (found.search, found.start_shape, found.ranges, found.w) == ("thorough", "hanging", "given", 0.1)
    assert found.trials_used == [2]
    assert [each.frames for each in found.fitted] == [0, 75]
    fitted = {fit.name: fit for fit in found.parameters}
    assert fitted.keys() >= {"stiff_bend_factor", "friction_turn_rad", "marker_shift", "far_up_rad"}
    assert not fitted.keys() & {"curl_left_rad", "stick_turn_rad"}
    assert (fitted["bending_length"].minimum, fitted["bending_length"].maximum) == (0.02, 1.0)
    assert abs(fitted["clamp_up_rad"].value) < 0.3
    assert {each.kind for each in found.weights} == {"stiff"}


def test_a_trial_is_predicted_without_a_fit_as_before_its_fit(captured, tmp_path):
    first, second = result(captured, 1, "estimate.json"), Estimate.read(result(captured, 2, "estimate.json"))
    before = first.read_bytes()
    predicted = predict(captured, "cable", 2, first, tmp_path)
    assert first.read_bytes() == before
    assert predicted.E_m == pytest.approx(second.held_out_m(UNDER_PREVIOUS), rel=1e-6)
    # The last marker is at the far body.
    assert predicted.tip_m is predicted.tip_share is second.held_out_m(TIP_UNDER_PREVIOUS) is None
    theirs = read_table(result(captured, 2, "simulated.parquet"), SIMULATED)
    rows, same = read_table(predicted.file, SIMULATED), theirs["source"] == "predicted"
    for axis in ("x_m", "y_m", "z_m", "robot_time_s"):
        np.testing.assert_allclose(rows[axis], theirs[axis][same], atol=1e-9)
    assert read_facts(predicted.file, SIMULATED)["E_m"] == predicted.E_m


def test_a_trial_that_is_held_out_is_never_fitted(captured, tmp_path):
    root = tmp_path / "project"
    shutil.copytree(captured, root, symlinks=True)
    settings = root / "data/cable/experiment.yaml"
    settings.write_text(settings.read_text() + "held_out: [1]\n")
    run_stage("estimate", root, "cable", 2)
    assert Estimate.read(result(root, 2, "estimate.json")).trials_used == [2]
    with pytest.raises(StrandcastError, match="trial 1 is held out") as raised:
        run_stage("estimate", root, "cable", 1)
    assert raised.value.code == "SC-E009"
    found = predict(root, "cable", 1, result(root, 2, "estimate.json"), tmp_path)
    assert 0.0 < found.points_m < 5e-3


def test_an_estimate_of_a_string_held_elsewhere_or_of_another_length_predicts_nothing(captured, tmp_path):
    file = result(captured, 1, "estimate.json")
    estimate = Estimate.read(file)
    kept = [fit for fit in estimate.parameters if not fit.name.startswith("far_")]
    shutil.copy(file.with_name("ensemble.parquet"), tmp_path)
    estimate.model_copy(update={"parameters": kept}).write(tmp_path / "estimate.json")
    with pytest.raises(StrandcastError, match="driven at other ends"):
        predict(captured, "cable", 2, tmp_path / "estimate.json", tmp_path)
    estimate.model_copy(update={"length_m": 0.83}).write(tmp_path / "estimate.json")
    with pytest.raises(StrandcastError, match="of a string of 0.83 m, and not of 0.8 m"):
        predict(captured, "cable", 2, tmp_path / "estimate.json", tmp_path)


def test_a_fit_that_is_worse_than_the_one_before_gives_both_numbers():
    def doubts(E_m: float):
        return _worse_than_before(SimpleNamespace(E_m=E_m, held_out={UNDER_PREVIOUS: 0.010}))

    (warning,) = doubts(0.012)
    assert "12.00 mm" in warning
    assert "10.00 mm" in warning
    assert doubts(0.0105) == doubts(0.005) == []


def test_the_prediction_is_in_the_files(captured):
    rows = read_table(result(captured, 2, "simulated.parquet"), SIMULATED)
    track = read_table(result(captured, 2, "track.parquet"), TRACK)
    assert set(rows["source"]) == {"fitted", "predicted", "string", "predicted_string"}
    mine, theirs = (each["point"] == 3 for each in (track, rows))
    theirs &= rows["source"] == "predicted"
    off_m = [track[name][mine] - rows[name][theirs] for name in ("x_m", "y_m", "z_m")]
    assert np.linalg.norm(off_m, axis=0).mean() < 8e-3


def test_the_pages_show_two_views_and_one_that_turns(captured):
    page = result(captured, 2, "report.html").read_text()
    titles = re.findall(r"<h2[^>]*>([^<]+)", page)
    assert {"The string from two sides", "The string, to be turned", "String parameters"} <= set(titles)
    assert "could not be made" not in page
    # One script, allowed by its hash; nothing from a network.
    assert len(re.findall(r"script-src 'sha256-", page)) == 1
    assert not re.findall(r"""(?:src|href)=["']?(?:https?:)?//""", page)
    summary = ExperimentSummary.read(captured / "results" / "cable" / "summary.json")
    assert (summary.verdict, summary.unread) == ("no target", {})


def test_ranges_of_the_plane_and_targets_are_refused(captured):
    file = captured / "data" / "cable" / "experiment.yaml"
    text = file.read_text()
    try:
        file.write_text(text.replace("120}", "120, ranges: {k_h: [0.1, 1.0]}}"))
        with pytest.raises(StrandcastError, match=r"(?s)SC-E008.*estimate\.ranges.*bending_length"):
            run_stage("estimate", captured, "cable", 1)
        file.write_text(text + "target_m: [0.5, 0.5]\n")
        with pytest.raises(StrandcastError, match="SC-I046"):
            run_stage("register_track", captured, "cable", 1)
    finally:
        file.write_text(text)


@pytest.mark.thorough
def test_friction_that_sticks_is_fitted_on_request(tmp_path, project_root):
    root = project(tmp_path, project_root, captures.LENGTH_M)
    settings = root / "data" / "cable" / "experiment.yaml"
    settings.write_text(settings.read_text().replace("120}", "120, forces: [friction_stick]}"))
    mapping = check_mapping(captures.mapping_data(two_ends=True), CaptureMapping)
    named = captures.columns(0.2, seconds=0.6, two_ends=True)
    import_track.run(root, "cable", 1, captures.write_csv(root / "c.csv", named), mapping)
    run_trials(root, range(1, 2))
    found = Estimate.read(result(root, 1, "estimate.json"))
    assert len(found.parameters) == 11
    assert {fit.name for fit in found.parameters} >= {"friction_turn_rad", "stick_turn_rad"}
    assert set(found.string.options) >= {"bend_friction", "friction_stick_rad_m"}
    assert found.string.options["bend_friction"] > 0.0


def test_trials_that_are_driven_differently_are_refused(captured, tmp_path, project_root):
    root = project(tmp_path, project_root, captures.LENGTH_M)
    for trial, two_ends in ((1, True), (2, False)):
        named = captures.columns(0.2, seconds=0.6, two_ends=two_ends)
        mapping = check_mapping(captures.mapping_data(two_ends=two_ends), CaptureMapping)
        import_track.run(root, "cable", trial, captures.write_csv(root / "c.csv", named), mapping)
        run_stage("register_track", root, "cable", trial)
        run_stage("score", root, "cable", trial)
    run_stage("estimate", root, "cable", 1)
    with pytest.raises(StrandcastError, match="SC-E009"):
        run_stage("estimate", root, "cable", 2)


def test_markers_at_driven_ends_alone_are_refused(tmp_path, project_root):
    root = project(tmp_path, project_root, captures.LENGTH_M)
    data = captures.mapping_data(two_ends=True)
    mapping = check_mapping(data | {"markers": data["markers"][-1:]}, CaptureMapping)
    named = captures.columns(0.2, seconds=0.6, two_ends=True)
    import_track.run(root, "cable", 1, captures.write_csv(root / "c.csv", named), mapping)
    run_stage("register_track", root, "cable", 1)
    with pytest.raises(StrandcastError, match="SC-T004.*no marker between the driven ends is seen"):
        run_stage("estimate", root, "cable", 1)


def test_ends_with_an_orientation_and_without_do_not_mix(captured, tmp_path):
    root = Path(shutil.copytree(captured, tmp_path / "project", symlinks=True))
    for kind in ("data", "results"):
        shutil.copytree(root / kind / "cable", root / kind / "other")
    mapping = check_mapping(captures.mapping_data(pose=False, two_ends=True), CaptureMapping)

    def without(name: str, trial: int) -> None:
        import_track.run(root, name, trial, root / f"{trial}.csv", mapping, replace=True)
        run_stage("register_track", root, name, trial)

    for trial in (1, 2):
        without("other", trial)
    with pytest.raises(StrandcastError, match="SC-E009.*other: its ends, or those of cable"):
        together(root, ["cable", "other"])
    without("cable", 2)
    with pytest.raises(StrandcastError, match="SC-E009.*trials 1 and 2 have other driven ends"):
        run_stage("estimate", root, "cable", 2)
    with pytest.raises(StrandcastError, match=r"SC-E009.*cannot turn as those of the estimate do \(measured"):
        predict(root, "cable", 2, result(root, 1, "estimate.json"), tmp_path)


@pytest.mark.thorough
def test_a_real_cable_is_predicted(real_data, tmp_path, project_root):
    """Two sequences of a cable between two robots, each end given by two points, y up in millimetres."""
    sequences = np.load(real_data / "deform_dlo" / "DLO4_train.npy")[:2].astype(float)
    segments_m = np.median(np.linalg.norm(np.diff(sequences[:, :, 1:-1], axis=2), axis=3), axis=(0, 1))
    places_m = np.r_[0.0, np.cumsum(segments_m)]
    root = project(tmp_path, project_root, round(float(places_m[-1]), 3))
    last = sequences.shape[2] - 1
    data = captures.mapping_data(pose=False)
    data["hand"] = {"position": ["v1"], "behind": ["v0"]}
    data["far"] = {"position": [f"v{last - 1}"], "behind": [f"v{last}"]}
    data["markers"] = [{"place_m": float(places_m[k - 1]), "position": [f"v{k}"]} for k in range(2, last - 1)]
    for trial, sequence in enumerate(sequences, start=1):
        named = {"t": 0.01 * np.arange(len(sequence))}
        for k in range(last + 1):
            named |= captures.triple(f"v{k}", sequence[:, k])
        file = captures.write_csv(root / f"{trial}.csv", named)
        import_track.run(root, "cable", trial, file, check_mapping(data, CaptureMapping))
    run_trials(root, range(1, 3))
    estimate = Estimate.read(result(root, 2, "estimate.json"))
    predicted_m, guess_m = (estimate.held_out_m(what) for what in (UNDER_PREVIOUS, CARRIED))
    assert predicted_m is not None
    assert guess_m is not None
    assert predicted_m < 0.04
    assert predicted_m < 0.5 * guess_m
