"""A throw in space by the commands alone: planned, played, captured, fitted, planned again."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.load import load_arm
from strandcast.arm.spatial import hand_path, load_any_arm
from strandcast.errors import StrandcastError
from strandcast.executor.dry_run_report import dry_run_report
from strandcast.executor.preflight import PlayOptions, run_preflight
from strandcast.imports.mapping import check_mapping
from strandcast.imports.space_mapping import SpaceMapping, space_mapping_of
from strandcast.records.alignment import Alignment, read_hand_in_space
from strandcast.records.estimate import Estimate
from strandcast.records.joint_log import read_run
from strandcast.records.motion import Motion
from strandcast.records.predicted import read_predicted
from strandcast.records.summary import ExperimentSummary
from strandcast.records.track import TrackSummary, read_track
from strandcast.records.verdict import Verdict
from strandcast.stages import import_track
from strandcast.stages.files import SUPPLIED_FILES
from strandcast.stages.run import run_stage
from strandcast.workflow.check import check_experiment
from strandcast.workflow.runner import table
from strandcast.workflow.status import status_of
from strandcast_studies.benchmarks.space.by_files import make_experiment, strandcast, throw_by_files
from strandcast_studies.benchmarks.space.drawn import SpaceCase, drawn_case
from strandcast_studies.benchmarks.space.rig import (
    CAPTURE_AXES,
    CAPTURE_CLOCK_S,
    CAPTURE_ORIGIN_M,
    SpaceRig,
    play_motion,
    write_capture,
)

from ..executor.test_play import PerfectArm

ARMS = "config/arms"
BUDGET = """\
plan: {screening: 200, evaluations: 240, ensemble: 4, duration_s: [0.5, 1.0]}
estimate: {evaluations: 300, ensemble: 4}
"""
YAML = """\
string: {{length_m: 0.41}}
arm: {arm}
target_m: {target}
"""


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory, project_root: Path) -> Path:
    root = tmp_path_factory.mktemp("space")
    for arms in (ARMS,):
        shutil.copytree(project_root / arms, root / "config/arms", dirs_exist_ok=True)
    return root


def write(
    root: Path, name: str, more: str = "", arm: str = "ur5e-space", target: str = "[0.5, 0.6, 0.6]"
) -> Path:
    file = root / "data" / name / "experiment.yaml"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(YAML.format(arm=arm, target=target) + BUDGET + more)
    return file


def test_the_first_motion_is_planned_and_passes_the_checks_before_a_throw(root: Path) -> None:
    write(root, "first")
    run_stage("plan", root, "first", 1)
    path = root / "results/first/trial-01/motion.json"
    motion, arm = Motion.read(path), load_any_arm(root / "config/arms/ur5e-space.toml")
    assert motion.target_m == [0.5, 0.6, 0.6]
    assert motion.joint_names == list(arm.joints)
    assert motion.predicted is not None
    assert {len(place) for place in motion.predicted.tip_m} == {3}
    throws = read_predicted(path.with_name("predicted.parquet"))
    assert throws.tip_m.shape[2] == 3
    assert throws.motion_sha256 == motion.content_sha256()
    options = PlayOptions(hanging_m=0.41)
    preflight = run_preflight(path, arm, PerfectArm(), root / "data/first/trial-01", options)
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
        "lab: {string: paper-1, servo: soft}\n",
    ],
)
def test_settings_of_the_plane_are_refused_with_a_target_in_space(root: Path, more: str) -> None:
    write(root, "plane", more)
    with pytest.raises(StrandcastError, match=f"SC-F003.*{more.split(':', maxsplit=1)[0]}.*in the plane"):
        run_stage("plan", root, "plane", 1)


def test_what_needs_an_arm_in_the_plane_refuses_one_in_space(root: Path) -> None:
    with pytest.raises(StrandcastError, match="SC-F207"):
        load_arm(root / "config/arms/ur5e-space.toml")


def case_in(root: Path, name: str) -> SpaceCase:
    """Return a case whose arm's file is the project's, and write its experiment."""
    case = drawn_case(7002)
    text = YAML.format(arm=case.arm.name, target=case.target_m.tolist()) + BUDGET
    file = root / "data" / name / "experiment.yaml"
    file.parent.mkdir(parents=True)
    file.write_text(text.replace("length_m: 0.41", f"length_m: {case.whole_length_m():g}"))
    return case


def thrown(root: Path, name: str, case: SpaceCase, trial: int) -> tuple[SpaceRig, float]:
    """Play a trial's planned motion; return the rig and the true miss [m]."""
    rig, folder = SpaceRig(case, np.random.default_rng(trial)), f"{name}/trial-{trial:02d}"
    motion_s = play_motion(rig, case, root / "results" / folder / "motion.json", root / "data" / folder)
    return rig, rig.true_miss_m(motion_s)


@pytest.fixture(scope="module")
def captured(root: Path) -> tuple[SpaceCase, Path]:
    """Return a throw that was planned and played, and the file of its capture."""
    case = case_in(root, "cast")
    run_stage("plan", root, "cast", 1)
    rig, _ = thrown(root, "cast", case, 1)
    return case, write_capture(rig, root / "capture.csv")


def test_the_first_motion_is_planned_again_after_a_rehearsal(root: Path) -> None:
    case = case_in(root, "rehearsed")
    run_stage("plan", root, "rehearsed", 1)
    path = root / "results/rehearsed/trial-01/motion.json"
    first = Motion.read(path)
    rig = SpaceRig(case, np.random.default_rng(4), empty=True)
    play_motion(rig, case, path, root / "data/rehearsed/rehearsal")
    run_stage("plan", root, "rehearsed", 1)
    again = Motion.read(path)
    assert again.provenance is not None
    assert (again.provenance.kind, list(again.provenance.planned_from)) == (
        "rehearsed",
        ["rehearsal/run.json"],
    )
    assert again.start == first.start
    assert again.bezier != first.bezier


def mapping_of(case: SpaceCase, hand: bool = True) -> SpaceMapping:
    markers = [{"place_m": m, "position": [f"m{k}"]} for k, m in enumerate(case.marker_places_m(), start=1)]
    given = {"up": "y", "length_unit": "mm", "time": "t", "time_unit": "s", "markers": markers}
    return check_mapping(given | ({"hand": {"position": ["hand"]}} if hand else {}), SpaceMapping)


def test_the_joint_log_is_the_driven_end_of_an_imported_track(
    root: Path, captured: tuple[SpaceCase, Path]
) -> None:
    case, file = captured
    import_track.run(root, "cast", 1, file, mapping_of(case), replace=True)
    folder = root / "data/cast/trial-01"
    alignment = Alignment.read(folder / "alignment.json")
    assert alignment.offset_s == pytest.approx(CAPTURE_CLOCK_S, abs=1e-3)
    run, log = read_run(folder)
    assert (alignment.motion_start_s, alignment.motion_end_s) == (run.motion_start_s, run.motion_end_s)
    time_s, pose = read_hand_in_space(folder / "hand.parquet")
    np.testing.assert_array_equal(time_s, log.time_s)
    np.testing.assert_allclose(pose, hand_path(case.arm.chain, log.q_rad), atol=8e-3)
    # The markers are in the arm's frame.
    summary = TrackSummary.read(folder / "track.json")
    track = read_track(folder / "track.parquet", summary.points)
    rows = np.genfromtxt(file, delimiter=",", names=True)
    tip_m = np.column_stack([rows["m14x"], -rows["m14z"], rows["m14y"]])[track.frame] / 1e3
    off_m = track.points_m[:, -1] - CAPTURE_AXES.inv().apply(tip_m - CAPTURE_ORIGIN_M)
    assert np.nanmax(np.linalg.norm(off_m, axis=1)) < 4e-3
    assert alignment.residual_rms_m is not None
    assert summary.median_sigma_m == pytest.approx(np.hypot(1e-3, alignment.residual_rms_m))


def test_a_capture_in_the_arms_frame_needs_the_clocks_offset_alone(
    root: Path, captured: tuple[SpaceCase, Path]
) -> None:
    case, file = captured
    rows = np.genfromtxt(file, delimiter=",", names=True)
    columns, named = [rows["t"]], ["t"]
    for k in range(1, len(case.marker_places_m()) + 1):
        there_m = np.column_stack([rows[f"m{k}x"], -rows[f"m{k}z"], rows[f"m{k}y"]]) / 1e3
        here_m = CAPTURE_AXES.inv().apply(there_m - CAPTURE_ORIGIN_M)
        columns += list(1e3 * here_m.T * [[1.0], [1.0], [1.0]])
        named += [f"m{k}.{axis}" for axis in "xyz"]
    own = root / "own.csv"
    np.savetxt(own, np.column_stack(columns), delimiter=",", header=",".join(named), comments="", fmt="%.6f")
    own.write_text(own.read_text().replace("nan", ""))
    mapping = mapping_of(case, hand=False).model_copy(update={"up": "z"})
    import_track.run(root, "cast", 1, own, mapping, replace=True, offset_s=CAPTURE_CLOCK_S)
    assert Alignment.read(root / "data/cast/trial-01/alignment.json").offset_s == CAPTURE_CLOCK_S
    with pytest.raises(StrandcastError, match=r"SC-I054.*neither"):
        import_track.run(root, "cast", 1, own, mapping, replace=True)
    file = root / "data/hung/experiment.yaml"
    file.parent.mkdir()
    file.write_text("string: {length_m: 0.41}\n")
    with pytest.raises(StrandcastError, match=r"SC-I061.*offset") as caught:
        import_track.run(root, "hung", 1, own, mapping, offset_s=CAPTURE_CLOCK_S)
    assert caught.value.file == str(file)


def test_a_throw_without_its_log_or_its_tip_is_refused(root: Path, captured: tuple[SpaceCase, Path]) -> None:
    case, file = captured
    mapping = mapping_of(case)
    with pytest.raises(StrandcastError, match=r"(?s)SC-I056.*joint log.*import joints cast 2 LOG"):
        import_track.run(root, "cast", 2, file, mapping)
    fewer = mapping.model_copy(update={"markers": mapping.markers[:-2]})
    with pytest.raises(StrandcastError, match="SC-I055"):
        import_track.run(root, "cast", 1, file, fewer, replace=True)


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"far": "m1"}, "far"),
        ({"behind": "m1"}, "hand.behind"),
        ({"behind": "m1", "far": "m2", "far_behind": "m3"}, "far and hand.behind"),
    ],
)
def test_a_second_end_or_a_direction_of_a_throw_is_refused(
    root: Path, captured: tuple[SpaceCase, Path], options: dict[str, str], field: str
) -> None:
    case, file = captured
    markers = [f"{place_m}:m{k}" for k, place_m in enumerate(case.marker_places_m(), start=1)]
    given = {"up": "y", "length_unit": "mm", "time": "t", "time_unit": "s"}
    mapping = space_mapping_of("hand", markers, **given, **options)
    with pytest.raises(StrandcastError, match=rf"(?s)SC-I058.*leave {field} out") as caught:
        import_track.run(root, "cast", 1, file, mapping, replace=True)
    assert caught.value.file == str(file)
    alone = space_mapping_of("hand", markers, **given)
    assert alone.hand is not None
    turned = alone.hand.model_copy(update={"quaternion": ["qx", "qy", "qz", "qw"], "leaves": [0.0, 0.0, 1.0]})
    with pytest.raises(StrandcastError, match=r"(?s)SC-I058.*leave hand\.quaternion out"):
        import_track.run(root, "cast", 1, file, alone.model_copy(update={"hand": turned}), replace=True)


def test_what_a_throw_without_its_capture_needs_is_named(
    root: Path, captured: tuple[SpaceCase, Path], tmp_path: Path
) -> None:
    project = Path(shutil.copytree(root, tmp_path / "project"))
    for name in SUPPLIED_FILES.values():
        (project / "data/cast/trial-01" / name).unlink(missing_ok=True)
    command = "strandcast import track cast 1 CAPTURE --up AXIS"
    [error] = check_experiment(project, "cast").errors
    assert (error.code, Path(str(error.file)).name) == ("SC-W033", "trial-01")
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


@pytest.mark.slow
def test_two_throws_by_commands_alone(tmp_path: Path) -> None:
    root, case, true_m = tmp_path / "lab", drawn_case(7002), []
    make_experiment(root, case, BUDGET)
    assert "nothing is wrong" in strandcast(root, "check", "cast")
    strandcast(root, "plan", "cast", "1")
    results = root / "results/cast"
    for trial in (1, 2):
        done = throw_by_files(root, case, trial, np.random.default_rng(trial))
        true_m.append(done.true_miss_m)
        # The capture places the tip to some millimetres, by the joints' zeros of 0.7 mrad.
        assert done.miss_m == pytest.approx(done.true_miss_m, abs=6e-3)
        found = Verdict.read(results / f"trial-{trial:02d}" / "verdict.json")
        assert f"trial {trial}: {'HIT ' if found.hit else 'miss'}" in done.said
        assert f"trial-{trial + 1:02d}/motion.json" in done.said
    estimates = [Estimate.read(results / f"trial-{trial:02d}" / "estimate.json") for trial in (1, 2)]
    assert [each.points for each in estimates] == [14, 14]
    assert [each.E_m for each in estimates] == pytest.approx([0.0, 0.0], abs=0.02)
    assert true_m[1] < true_m[0]
    assert estimates[1].trials_used == [1, 2]
    first, second, third = (Motion.read(results / f"trial-{k:02d}" / "motion.json") for k in (1, 2, 3))
    assert [each.provenance.kind for each in (first, second)] == ["first", "refined"]
    assert second.provenance.parent_motion_sha256 == first.content_sha256()
    assert third.predicted.miss_m < 0.02
    page = (results / "trial-02/report.html").read_text()
    titles = re.findall(r"<h2[^>]*>([^<]+)", page)
    assert {"The string from two sides", "The next motion", "The next throw, as predicted"} <= set(titles)
    every = page + (results / "report.html").read_text()
    assert "could not be made" not in every
    assert not re.search(r"""href=["']?#strobe\b""", every)
