"""A throw in space by the commands alone: planned, played, captured, fitted, planned again."""

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import interp1d

from strandcast.arm.load import load_arm
from strandcast.errors import StrandcastError, StrandcastErrors
from strandcast.executor.dry_run_report import dry_run_report
from strandcast.executor.preflight import PlayOptions, run_preflight
from strandcast.imports.capture_mapping import capture_mapping_of
from strandcast.lab.capture import capture_mapping
from strandcast.records.alignment import Alignment, read_hand_in_space
from strandcast.records.estimate import Estimate
from strandcast.records.joint_log import read_run
from strandcast.records.lab_truth import LAB_TRUTH
from strandcast.records.motion import Motion
from strandcast.records.predicted import read_predicted
from strandcast.records.summary import ExperimentSummary
from strandcast.records.tables import read_facts, read_table
from strandcast.records.track import AXES, TrackSummary, read_track
from strandcast.records.verdict import Verdict
from strandcast.stages import import_track
from strandcast.stages.files import SUPPLIED_FILES
from strandcast.stages.run import run_stage
from strandcast.workflow.check import check_experiment
from strandcast.workflow.runner import table
from strandcast.workflow.status import status_of
from strandcast_studies.benchmarks.space.by_files import make_experiment, strandcast, true_misses_m
from strandcast_studies.benchmarks.space.drawn import drawn_case

from ..executor.test_play import PerfectArm

BUDGET = """\
plan: {evaluations: 240, duration_s: [0.5, 1.0]}
estimate: {evaluations: 300}
"""
# A motion, hit or miss.
QUICK = "plan: {evaluations: 60, duration_s: [0.5, 1.0]}\n"
LAB = "lab: {string: {linear_density_kg_m: 0.006}}\n"
YAML = """\
string: {{length_m: 0.41}}
arm: {arm}
target_m: {target}
"""


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory, project_root: Path) -> Path:
    root = tmp_path_factory.mktemp("space")
    shutil.copytree(project_root / "config/arms", root / "config/arms")
    return root


def write(
    root: Path, name: str, more: str = "", arm: str = "ur5e-space", target: str = "[0.5, 0.6, 0.6]"
) -> Path:
    file = root / "data" / name / "experiment.yaml"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(YAML.format(arm=arm, target=target) + QUICK + more)
    return file


def test_the_first_motion_is_planned_and_passes_the_checks_before_a_throw(
    root: Path, captured: Path, tmp_path: Path
) -> None:
    path = root / "results/cast/trial-01/motion.json"
    motion, arm = Motion.read(path), load_arm(root / "config/arms/ur5e-space.toml")
    assert motion.target_m == [0.5, 0.6, 0.6]
    assert motion.joint_names == list(arm.joints)
    assert motion.predicted is not None
    assert {len(place) for place in motion.predicted.tip_m} == {3}
    throws = read_predicted(path.with_name("predicted.parquet"))
    assert throws.tip_m.shape[2] == 3
    assert throws.motion_sha256 == motion.content_sha256()
    options = PlayOptions(hanging_m=0.41)
    preflight = run_preflight(path, arm, PerfectArm(), tmp_path / "trial-01", options)
    report = "\n".join(dry_run_report(preflight))
    assert "workspace x -1.50 to 1.50, y -1.50 to 1.50, z -0.70 to 1.70 m" in report
    # The hand's box in the report holds the planned path.
    low, high = preflight.reach.hand_m.T
    for place in motion.predicted.hand_m[:1]:
        assert (low - 1e-6 <= place).all()
        assert (place <= high + 1e-6).all()


@pytest.mark.parametrize(
    ("arm", "target", "words"),
    [
        ("ur5e-space", "[0.5, 0.6]", "the target has x and y, and the arm 'ur5e-space' throws in space"),
        ("planar3", "[0.5, 0.5, 0.5]", "the target has x, y and z, and the arm 'planar3' throws in a plane"),
    ],
)
def test_target_and_arm_that_do_not_fit_are_refused(root: Path, arm: str, target: str, words: str) -> None:
    file = write(root, "other", arm=arm, target=target)
    with pytest.raises(StrandcastError, match="SC-F014") as caught:
        run_stage("plan", root, "other", 1)
    assert (caught.value.file, caught.value.field) == (str(file), "target_m")
    assert words in str(caught.value)


@pytest.mark.parametrize(
    "more",
    [
        "workspace_m: {x_m: [-1, 1], y_m: [-1, 1]}\n",
        "objective: {kind: point, least_speed_m_s: 4}\n",
        "start_string: minima\n",
    ],
)
def test_settings_of_the_plane_are_refused_with_a_target_in_space(root: Path, more: str) -> None:
    write(root, "plane", more)
    with pytest.raises(StrandcastError, match=f"SC-F003.*{more.split(':', maxsplit=1)[0]}.*in the plane"):
        run_stage("plan", root, "plane", 1)


def test_what_needs_an_arm_in_the_plane_refuses_one_in_space(root: Path) -> None:
    with pytest.raises(StrandcastError, match="SC-F207"):
        load_arm(root / "config/arms/ur5e-space.toml").planar()


def test_the_labs_experiment_of_the_how_to_is_right(root: Path, project_root: Path) -> None:
    page = (project_root / "docs/how-to/throw-in-space.md").read_text()
    settings = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)[0]
    assert "lab:" in settings
    write(root, "shown").write_text(settings)
    assert check_experiment(root, "shown").errors == []


@pytest.mark.parametrize(
    ("settings", "field"),
    [
        ("lab: {camera: {frame_rate_hz: 200}}", "lab.camera"),
        ("camera: {frame_rate_hz: 200}", "camera"),
        ("track: {polarity: dark}", "track"),
        ("align: {led: {place_m: [0.1, 0.1]}}", "align"),
    ],
)
def test_what_videos_need_is_refused_with_a_target_in_space(root: Path, settings: str, field: str) -> None:
    file = write(root, "filmed", f"{settings}\n")
    with pytest.raises(StrandcastErrors, match=r"SC-F003.*measured by motion capture") as caught:
        run_stage("plan", root, "filmed", 1)
    [error] = caught.value.problems
    assert (error.file, error.field) == (str(file), field)
    assert error.fix == "leave it out, or give a target with x and y"


def test_a_string_with_pipes_is_refused_in_space(root: Path) -> None:
    write(root, "pipe", "lab: {string: paper-6}\n").write_text(
        YAML.format(arm="ur5e-space", target="[0.5, 0.6, 0.6]").replace("0.41", "0.51")
        + "lab: {string: paper-6}\n"
    )
    with pytest.raises(StrandcastError, match=r"(?s)SC-L003.*lab\.string.*not paper-5, paper-6"):
        run_stage("lab_rehearse", root, "pipe")
    [error] = check_experiment(root, "pipe").errors
    assert (error.code, error.file) == ("SC-L003", str(root / "data/pipe/experiment.yaml"))


def test_what_only_films_have_is_refused_before_the_throw(root: Path) -> None:
    file = write(root, "fitted", LAB)
    file.write_text(file.read_text().replace("lab:", "estimate: {camera_offset_sd_m: 0.01}\nlab:"))
    [error] = check_experiment(root, "fitted").errors
    assert (error.code, error.file, error.field) == ("SC-E008", str(file), "estimate.camera_offset_sd_m")


def test_the_lab_does_not_replace_the_files_of_a_real_arm(root: Path, captured: Path, tmp_path: Path) -> None:
    project = Path(shutil.copytree(root, tmp_path / "project"))
    folder = project / "data/cast/trial-01"
    run, _ = read_run(folder)
    run.model_copy(update={"driver": "ur"}).write(folder / "run.json")
    shutil.copytree(folder, project / "data/cast/rehearsal")
    write(project, "cast", LAB)
    before = {path: path.read_bytes() for path in (project / "data/cast").glob("*/*")}
    for stage, trial in (("lab_capture", 1), ("lab_rehearse", 0)):
        with pytest.raises(StrandcastError, match=r"(?s)SC-L008.*'ur'.*take `lab` out"):
            run_stage(stage, project, "cast", trial)
    assert {path: path.read_bytes() for path in (project / "data/cast").glob("*/*")} == before


@pytest.mark.thorough
def test_the_first_motion_is_planned_again_after_a_rehearsal(root: Path) -> None:
    file = write(root, "rehearsed", LAB)
    file.write_text(file.read_text().replace(QUICK, BUDGET))
    run_stage("lab_rehearse", root, "rehearsed")
    first = Motion.read(root / "data/rehearsed/rehearsal/motion.json")
    run_stage("plan", root, "rehearsed", 1)
    again = Motion.read(root / "results/rehearsed/trial-01/motion.json")
    assert again.provenance is not None
    assert (again.provenance.kind, list(again.provenance.planned_from)) == (
        "rehearsed",
        ["rehearsal/run.json"],
    )
    assert again.start == first.start
    assert again.bezier != first.bezier


@pytest.fixture(scope="module")
def captured(root: Path) -> Path:
    """Return the file of the capture of a throw in the lab, whose experiment then becomes a real arm's."""
    file = write(root, "cast", LAB.replace("}\n", ", rehearsal: false}\n"))
    run_stage("plan", root, "cast", 1)
    run_stage("lab_capture", root, "cast", 1)
    write(root, "cast")
    assert "lab" not in file.read_text()
    return root / "data/cast/trial-01/capture.csv"


def truth_of(root: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    path = root / "results/cast/trial-01/lab_truth.parquet"
    return read_table(path, LAB_TRUTH), read_facts(path, LAB_TRUTH)


def test_the_track_of_a_capture_is_where_the_string_was(root: Path, captured: Path) -> None:
    folder = captured.parent
    rows, facts = truth_of(root)
    alignment = Alignment.read(folder / "alignment.json")
    assert alignment.offset_s == pytest.approx(facts["offset_s"], abs=1e-3)
    assert alignment.motion_start_s == facts["motion_start_s"]
    summary = TrackSummary.read(folder / "track.json")
    assert list(summary.places_m()) == pytest.approx(np.linspace(0.0, 0.40, 9))
    assert summary.median_sigma_m == pytest.approx(np.hypot(1e-3, alignment.residual_rms_m))
    track = read_track(folder / "track.parquet", summary.points)
    # Of a string that the clamp holds 1 or 2 mm farther from its tip, the markers are farther from the clamp.
    longer_m = facts["variation"]["grasp_length_m"]
    assert abs(longer_m) > 1e-4
    frames = len(np.unique(rows["frame"]))
    nodes_m = np.column_stack([rows[name] for name in AXES]).reshape(frames, -1, 3)
    places_m = rows["place_m"].reshape(frames, -1)[0]
    assert places_m[-1] == pytest.approx(0.40 + longer_m)
    for k, place_m in enumerate(summary.places_m()[1:], start=1):
        true_m = interp1d(places_m, nodes_m, axis=1)(min(place_m + longer_m, places_m[-1]))
        off_m = np.linalg.norm(track.points_m[:, k] - true_m[track.frame], axis=1)
        assert np.sqrt(np.nanmean(off_m**2)) < 3e-3
        assert np.nanmax(off_m) < 8e-3


def test_a_capture_of_mirrored_axes_or_another_clock_is_refused(root: Path, captured: Path) -> None:
    for wrong in ({"handedness": "left"}, {"time_unit": "ms"}):
        with pytest.raises(StrandcastError, match="SC-I054|SC-I028"):
            import_track.run(
                root, "cast", 1, captured, capture_mapping(0.40).model_copy(update=wrong), replace=True
            )


def test_the_joint_log_is_the_driven_end_of_an_imported_track(root: Path, captured: Path) -> None:
    folder, arm = captured.parent, load_arm(root / "config/arms/ur5e-space.toml")
    run, log = read_run(folder)
    alignment = Alignment.read(folder / "alignment.json")
    assert (alignment.motion_start_s, alignment.motion_end_s) == (run.motion_start_s, run.motion_end_s)
    time_s, (hand,) = read_hand_in_space(folder / "hand.parquet", thrown=True)
    np.testing.assert_array_equal(time_s, log.time_s)
    np.testing.assert_allclose(np.hstack(list(hand)), arm.hand_path(log.q_rad), atol=8e-3)


def test_a_capture_in_the_arms_frame_needs_the_clocks_offset_alone(root: Path, captured: Path) -> None:
    rows, (_, facts) = np.genfromtxt(captured, delimiter=",", names=True), truth_of(root)
    turn, origin_m = (np.array(facts["capture"][name]) for name in ("turn", "origin_m"))
    columns, named = [rows["t"]], ["t"]
    for k in range(1, 9):
        there_m = np.column_stack([rows[f"m{k}x"], -rows[f"m{k}z"], rows[f"m{k}y"]]) / 1e3
        columns += list(1e3 * ((there_m - origin_m) @ turn).T)
        named += [f"m{k}.{axis}" for axis in "xyz"]
    own = root / "own.csv"
    np.savetxt(own, np.column_stack(columns), delimiter=",", header=",".join(named), comments="", fmt="%.6f")
    own.write_text(own.read_text().replace("nan", ""))
    mapping, folder = capture_mapping(0.40).model_copy(update={"up": "z", "hand": None}), captured.parent
    placed = read_track(folder / "track.parquet", 8)
    import_track.run(root, "cast", 1, own, mapping, replace=True, offset_s=facts["offset_s"])
    assert Alignment.read(folder / "alignment.json").offset_s == facts["offset_s"]
    given = read_track(folder / "track.parquet", 8)
    np.testing.assert_allclose(placed.points_m[:, 1:], given.points_m[:, 1:], atol=4e-3)
    with pytest.raises(StrandcastError, match=r"SC-I054.*neither"):
        import_track.run(root, "cast", 1, own, mapping, replace=True)
    file = root / "data/hung/experiment.yaml"
    file.parent.mkdir()
    file.write_text("string: {length_m: 0.41}\n")
    with pytest.raises(StrandcastError, match=r"SC-E008.*offset") as caught:
        import_track.run(root, "hung", 1, own, mapping, offset_s=1.0)
    assert caught.value.file == str(own)


def test_a_throw_without_its_log_or_its_tip_is_refused(root: Path, captured: Path) -> None:
    mapping = capture_mapping(0.40)
    with pytest.raises(StrandcastError, match=r"(?s)SC-I056.*joint log.*import joints cast 2 LOG"):
        import_track.run(root, "cast", 2, captured, mapping)
    fewer = mapping.model_copy(update={"markers": mapping.markers[:-2]})
    with pytest.raises(StrandcastError, match="SC-I013"):
        import_track.run(root, "cast", 1, captured, fewer, replace=True)


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"far": "m1"}, "far"),
        ({"behind": "m1"}, "hand.behind"),
        ({"behind": "m1", "far": "m2", "far_behind": "m3"}, "far and hand.behind"),
    ],
)
def test_a_second_end_or_a_direction_of_a_throw_is_refused(
    root: Path, captured: Path, options: dict[str, str], field: str
) -> None:
    markers = [f"{0.05 * k}:m{k}" for k in range(1, 9)]
    given = {"up": "y", "length_unit": "mm", "time": "t", "time_unit": "s"}
    mapping = capture_mapping_of("hand", markers, **given, **options)
    with pytest.raises(StrandcastError, match=rf"(?s)SC-E008.*leave {field} out") as caught:
        import_track.run(root, "cast", 1, captured, mapping, replace=True)
    assert caught.value.file == str(captured)
    alone = capture_mapping_of("hand", markers, **given)
    assert alone.hand is not None
    turned = alone.hand.model_copy(update={"quaternion": ["qx", "qy", "qz", "qw"], "leaves": [0.0, 0.0, 1.0]})
    with pytest.raises(StrandcastError, match=r"(?s)SC-E008.*leave hand\.quaternion out"):
        import_track.run(root, "cast", 1, captured, alone.model_copy(update={"hand": turned}), replace=True)


def test_what_a_throw_without_its_capture_needs_is_named(root: Path, captured: Path, tmp_path: Path) -> None:
    project = Path(shutil.copytree(root, tmp_path / "project"))
    for name in SUPPLIED_FILES.values():
        (project / "data/cast/trial-01" / name).unlink(missing_ok=True)
    command = "strandcast import track cast 1 CAPTURE --up AXIS"
    [error] = check_experiment(project, "cast").errors
    assert (error.code, Path(str(error.file)).name) == ("SC-V020", "trial-01")
    assert command in str(error)
    state = status_of(project, "cast")
    assert [stage.stage for stage in state.trials[0].stages] == ["summary"]
    assert command in state.next_steps[0]
    assert not any("nothing is to be done" in step for step in state.next_steps)
    run_stage("summary", project, "cast", trials=[])
    summary = ExperimentSummary.read(project / "results/cast/summary.json")
    assert any(
        line.startswith(f"  next:   import the capture of trial 1: {command}")
        for line in table(project, summary)
    )


@pytest.mark.thorough
def test_the_lab_throws_in_space_until_it_hits_by_commands_alone(tmp_path: Path) -> None:
    root, results = tmp_path / "lab", tmp_path / "lab/results/cast"
    make_experiment(root, drawn_case(7002), BUDGET + "min_trials: 2\nmax_trials: 3\n")
    assert "nothing is wrong" in strandcast(root, "check", "cast")
    # A motion is made from the throws before it, and nothing else is.
    line = [sys.executable, "-m", "snakemake", "--cores", "2", "--quiet", "all", "--"]
    subprocess.run([*line, "results/cast/trial-02/motion.json"], cwd=root, check=True, capture_output=True)
    assert sorted(path.name for path in results.glob("trial-*")) == ["trial-01", "trial-02"]
    assert not (root / "data/cast/trial-02").exists()
    said = strandcast(root, "run", "cast")
    true_m, count = true_misses_m(root), len(list(root.glob("data/cast/trial-*")))
    assert len(true_m) == count >= 2
    verdicts = [Verdict.read(results / f"trial-{k:02d}/verdict.json") for k in range(1, count + 1)]
    # The capture places the tip to some millimetres, by the joints' zeros of 1 mrad.
    assert [verdict.miss_m for verdict in verdicts] == pytest.approx(true_m, abs=6e-3)
    for trial, verdict in enumerate(verdicts, start=1):
        assert f"trial {trial}: {'HIT' if verdict.hit else 'miss'}" in said
    assert true_m[1] < true_m[0]
    assert verdicts[-1].hit or count == 3
    estimates = [Estimate.read(results / f"trial-{trial:02d}" / "estimate.json") for trial in (1, 2)]
    assert [each.points for each in estimates] == [14, 14]
    assert [each.E_m for each in estimates] == pytest.approx([0.0, 0.0], abs=0.02)
    assert estimates[1].trials_used == [1, 2]
    first, second, third = (Motion.read(results / f"trial-{k:02d}" / "motion.json") for k in (1, 2, 3))
    assert first.provenance.kind == "rehearsed"
    assert second.provenance.parent_motion_sha256 in (first.content_sha256(), None)
    assert third.predicted.miss_m < 0.02
    page = (results / "trial-02/report.html").read_text()
    titles = re.findall(r"<h2[^>]*>([^<]+)", page)
    assert {"The string from two sides", "The next motion", "Lab truth"} <= set(titles)
    every = page + (results / "report.html").read_text()
    assert "could not be made" not in every
    assert not re.search(r"""href=["']?#strobe\b""", every)
    assert "all files are as made" in strandcast(root, "verify", "cast")
    assert "nothing is to be done" in strandcast(root, "status", "cast")
    assert strandcast(root, "run", "cast", "--until", "track", "--dry-run")
    (root / "data/cast/trial-01/capture.csv").unlink()
    assert "next: strandcast stage lab-capture cast 1" in strandcast(root, "status", "cast")
    with pytest.raises(RuntimeError, match="verify"):
        strandcast(root, "verify", "cast")
