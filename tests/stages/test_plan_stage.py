"""The plan stage: it plans, and the score stage scores, for the objective of experiment.yaml."""

import re
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from tests.forked import run_module

from strandcast.arm.load import load_arm
from strandcast.arm.servo import Servo, respond
from strandcast.arm.yielding_joints import YieldingJoints
from strandcast.core.objectives import (
    AimedPoint,
    Objective,
    SegmentObjective,
    ShapeObjective,
    ShapePlace,
    SwingObjective,
)
from strandcast.errors import StrandcastError
from strandcast.planning.plan import fitted_servo
from strandcast.progress import Progress
from strandcast.records.estimate import Estimate
from strandcast.records.folders import ExperimentFolder
from strandcast.records.joint_log import read_run, write_joint_log
from strandcast.records.kept_motions import kept_motions
from strandcast.records.motion import Motion
from strandcast.records.tables import read_table, write_table
from strandcast.records.track import TRACK
from strandcast.report import causes
from strandcast.report.expected import expected_miss
from strandcast.stages.arms import arm_of
from strandcast.stages.context import context_of
from strandcast.stages.past_trials import read_trial, smooth_joints
from strandcast.stages.plan import first_motion
from strandcast.stages.plan_inputs import first_inputs, rehearsal_of
from strandcast.stages.producers import play_command, to_correct_first
from strandcast.stages.rig import rig_state
from strandcast.stages.run import files_of, run_stage
from strandcast.workflow.verify import verify
from strandcast_studies.benchmarks.loop.throw import LoopRig, throw

ARM = "config/arms/planar3.toml"
SMALL = "plan: {evaluations: 100}\n"
BAR = "objective: {kind: segment, ends_m: [[0.8, 0.25], [0.8, 0.45]]}\n"


@pytest.fixture
def root(tmp_path: Path, project_root: Path) -> Path:
    shutil.copytree(project_root / "config/arms", tmp_path / "config/arms")
    return tmp_path


def write(root: Path, name: str, text: str) -> None:
    folder = root / "data" / name
    folder.mkdir(parents=True, exist_ok=True)
    string = "string: {length_m: 0.30, weights: [{place_m: 0.30}]}\n"
    (folder / "experiment.yaml").write_text(string + text, encoding="utf-8")


def planned(root: Path, name: str) -> Motion:
    run_stage("plan", root, name, 1)
    return Motion.read(root / "results" / name / "trial-01" / "motion.json")


def test_a_plan_says_what_it_expects_and_how_to_throw_it(
    root: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("strandcast.planning.global_search.Progress", partial(Progress, interval_s=0.0))
    write(root, "hopeless", "target_m: [0.5, 0.5]\nhit_radius_m: 0.000001\n" + SMALL)
    motion = planned(root, "hopeless")
    flags = motion.provenance.flags
    assert any("not expected to hit" in flag for flag in flags)
    said = capsys.readouterr().err
    assert all(f"plan: {flag}\n" in said for flag in flags)
    words = str(expected_miss(motion)).replace("\u00a0", " ")
    assert f"plan: predicted miss {words}, within 0 mm of the target\n" in said
    kind, who, share = max(motion.limits_used(), key=lambda used: used[2])
    assert f"plan: nearest to a limit of {kind}: {who}, {100 * share:.0f} % used\n" in said
    assert "plan: throw it: strandcast play " in said
    # A kept motion stays what it is, whatever becomes of what it was planned from.
    with (root / ARM).open("a") as file:
        file.write("# another comment\n")
    again = {each.file.parent.name for each in verify(root, "hopeless")}
    assert again == {"trial-01"}
    assert len(kept_motions(ExperimentFolder(root, "hopeless"), 1)) == 2
    shutil.move(root / ARM, root / "moved.toml")
    missing = [each for each in verify(root, "hopeless") if each.state == "missing"]
    assert len(missing) == 1  # for the plan; a kept motion needs nothing
    shutil.rmtree(root / "results/hopeless/trial-01")
    assert verify(root, "hopeless") == []
    shutil.move(root / "moved.toml", root / ARM)
    # Within one round of a search the best cost never rises.
    costs: dict[str, list[float]] = {}
    for what, cost in re.findall(r"plan: (search \d of \d, \d+ strings): .*best cost ([\d.]+) mm", said):
        costs.setdefault(what, []).append(float(cost))
    assert "search 3 of 3, 16 strings" in costs
    assert all(found == sorted(found, reverse=True) for found in costs.values())


def test_the_motion_of_an_arm_without_a_driver_is_exported(root: Path) -> None:
    write(root, "by-file", "target_m: [0.5, 0.5]\n" + SMALL)
    arm = root / ARM
    arm.write_text(arm.read_text().split("[driver]")[0])
    command = play_command(context_of(root, "by-file"), 1)
    assert command.startswith("strandcast export motion ")
    assert command.endswith("by-file/trial-01/motion.json --as ros --out FILE")


def test_a_fault_of_the_throw_before_is_said_instead_of_the_command_that_plays(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(root, "faulty", "target_m: [0.5, 0.5]\n" + SMALL)
    context, seen = context_of(root, "faulty"), []
    assert to_correct_first(context, 1) is None
    thrown = context.folder.trial(1).data
    thrown.mkdir(parents=True)
    (thrown / "video.mp4").write_bytes(b"")
    monkeypatch.setattr(
        causes, "to_correct_first", lambda found: seen.append(found.folder) or "first correct it"
    )
    assert to_correct_first(context, 2) == "first correct it"
    assert seen == [context.folder.trial(1).results]


def test_the_first_motion_is_planned_for_the_string_of_another_experiment(root: Path, finished: Path) -> None:
    shutil.copytree(finished, root, dirs_exist_ok=True)
    small = context_of(root, "small").folder.trial(1).results
    write(root, "again", f"target_m: [0.5, 0.5]\nstart_string: {{from: small}}\n{SMALL}")
    motion = planned(root, "again")
    assert (motion.provenance.start_string, motion.provenance.kind) == ("from small", "first")
    names = ("estimate.json", "ensemble.parquet")
    assert set(motion.provenance.planned_from) == {f"results/small/trial-01/{name}" for name in names}
    fitted = Estimate.read(small / "estimate.json").string.parameters
    assert motion.provenance.string.parameters == pytest.approx(fitted)
    by_file = f"{{from: {small.relative_to(root)}/estimate.json}}"
    write(root, "file", f"target_m: [0.5, 0.5]\nstart_string: {by_file}\n{SMALL}")
    assert planned(root, "file").provenance.string == motion.provenance.string


@pytest.mark.parametrize(
    ("settings", "string", "words"),
    [
        ("start_string: {from: again}\n", None, "again is this experiment"),
        ("start_string: {from: new}\n", None, "new has no fitted trial that counts"),
        ("start_string: {from: nobody}\n", None, "SC-F001"),
        ("start_string: {from: ../other/estimate.json}\n", None, "SC-F010"),
        (
            "start_string: {from: small}\n",
            "string: {length_m: 0.3, weights: [{place_m: 0.1}]}\n",
            "other weights",
        ),
        ("start_string: {from: small}\n", "string: {length_m: 0.30}\n", "has other weights"),
        ("start_string: {from: 3}\n", None, "is no string parameter"),
    ],
)
def test_a_known_string_that_cannot_be_is_named(
    root: Path, finished: Path, settings: str, string: str | None, words: str
) -> None:
    shutil.copytree(finished, root, dirs_exist_ok=True)
    for name in ("new", "again"):
        write(root, name, f"target_m: [0.5, 0.5]\n{settings}{SMALL}")
    file = root / "data/again/experiment.yaml"
    if string:
        file.write_text(string + file.read_text().split("\n", 1)[1])
    with pytest.raises(StrandcastError, match=words):
        planned(root, "again")


@pytest.mark.parametrize("name", ["video.mp4", "cam.avi", "joints.csv", "motion.json"])
def test_a_trial_that_a_real_arm_has_thrown_is_not_planned(root: Path, name: str) -> None:
    write(root, "thrown", "target_m: [0.5, 0.5]\n" + SMALL)
    folder = root / "data" / "thrown" / "trial-01"
    folder.mkdir()
    (folder / name).touch()
    with pytest.raises(StrandcastError, match="SC-X010") as caught:
        planned(root, "thrown")
    assert "strandcast plan thrown 2" in str(caught.value)
    folder.rename(folder.with_name("trial-1"))
    with pytest.raises(StrandcastError, match="SC-R032"):
        planned(root, "thrown")
    assert not (root / "results").exists()


@pytest.mark.thorough
def test_the_first_motion_is_planned_again_after_a_rehearsal(root: Path) -> None:
    lab = "lab: {string: paper-1, servo: soft}\n"
    write(root, "rehearsed", "target_m: [0.5, 0.5]\n" + lab + SMALL)
    with pytest.raises(StrandcastError, match="make it first: strandcast stage lab-rehearse rehearsed"):
        planned(root, "rehearsed")
    run_stage("lab_rehearse", root, "rehearsed")
    first = Motion.read(root / "data/rehearsed/rehearsal/motion.json")
    again = planned(root, "rehearsed")
    assert again.bezier != first.bezier
    assert again.start == first.start
    assert list(again.provenance.planned_from) == ["rehearsal/run.json"]
    record = root / "data/rehearsed/rehearsal/run.json"
    assert record in files_of("plan", root, "rehearsed", 1).inputs("rehearsal_run")
    assert not files_of("plan", root, "rehearsed", 2).inputs("rehearsal_run")
    # The rows' noise of 0.5 mrad, third differences of 2 mrad, is gone.
    task, _ = first_inputs(
        context_of(root, "rehearsed"), load_arm(root / ARM).planar(), np.random.default_rng(1)
    )
    played = rehearsal_of(files_of("plan", root, "rehearsed", 1), task)
    assert played is not None
    assert np.diff(played.q_rad, n=3, axis=0).std() < 1e-4
    # A soft loop without feed-forward yields to the arm's torques, in other motions by other amounts.
    task, _ = first_inputs(
        context_of(root, "rehearsed"), load_arm(root / ARM).planar(), np.random.default_rng(1)
    )
    assert isinstance(fitted_servo(task, [played]), YieldingJoints)
    on_command = replace(
        played, q_rad=respond(task.arm.servo, 0.002 * np.arange(len(played.q_rad)), played.q_command_rad)
    )
    assert isinstance(fitted_servo(task, [on_command]), Servo)
    unseen = replace(played, q_rad=played.q_command_rad, logged=False)
    assert fitted_servo(task, [unseen]) is task.arm.servo
    assert isinstance(fitted_servo(task, [played, unseen]), YieldingJoints)

    assert verify(root, "rehearsed", raw=True) == []
    recorded = {path: path.read_bytes() for path in record.parent.iterdir()}
    run, log = read_run(record.parent)
    start_s = run.motion_start_s
    assert start_s is not None
    for change, words in (
        ({"time_s": 0.1 * log.time_s + 0.9 * start_s}, "rows from"),
        ({"q_rad": np.degrees(log.q_rad)}, "rad rms from the motion"),
    ):
        sha256 = write_joint_log(record.with_name("joints.csv"), replace(log, **change))
        run.model_copy(update={"joints_sha256": sha256}).write(record)
        with pytest.raises(StrandcastError, match="SC-P021") as caught:
            planned(root, "rehearsed")
        assert words in str(caught.value)
    for path, text in recorded.items():
        path.write_bytes(text)
    files = files_of("plan", root, "rehearsed", 1)
    assert (
        rehearsal_of(files, replace(task, target_m=np.array([0.5, 0.5 + 0.9 * task.hit_radius_m])))
        is not None
    )
    for other, field, words in (
        (
            {"target_m": np.array([0.7, 0.5])},
            "target_m",
            r"target \[0.5, 0.5\], and the experiment's is \[0.7, 0.5\]",
        ),
        (
            {"arm": replace(task.arm, urdf_sha256="0")},
            "robot",
            "with another URDF than planar3.urdf",
        ),
        ({"arm": replace(task.arm, name="other")}, "robot", "planned for planar3, and the arm is other"),
    ):
        with pytest.raises(StrandcastError, match=f"SC-P021.*{words}") as caught:
            rehearsal_of(files, replace(task, **other))
        assert (caught.value.file, caught.value.field) == (str(record.with_name("motion.json")), field)
        assert "move the folder away, plan, and rehearse" in str(caught.value)
    again.write(record.with_name("motion.json"))
    wrong = {found.state: found.file for found in verify(root, "rehearsed", raw=True)}
    assert Path(wrong["misplaced"]) == record.with_name("motion.json")
    with pytest.raises(StrandcastError, match="SC-P021") as caught:
        planned(root, "rehearsed")
    assert caught.value.file == str(record)


def test_the_lab_does_not_replace_the_rehearsal_of_a_real_arm(root: Path) -> None:
    write(root, "real", "target_m: [0.5, 0.5]\n" + SMALL)
    folder = root / "data/real/rehearsal"
    folder.mkdir()
    for name in ("motion.json", "run.json"):
        (folder / name).write_text("recorded")
    with pytest.raises(StrandcastError, match="SC-L003"):
        run_stage("lab_rehearse", root, "real")
    assert [(folder / name).read_text() for name in ("motion.json", "run.json")] == ["recorded"] * 2


def test_a_bar_is_planned_for_and_the_file_is_the_same_each_time(
    root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(root, "bar", BAR + SMALL)
    first = planned(root, "bar")
    path = root / "results/bar/trial-01/motion.json"
    written = path.read_bytes()
    assert first.provenance is not None
    assert first.provenance.objective == "bar from (0.8, 0.25) to (0.8, 0.45) m"
    assert first.target_m == pytest.approx([0.8, 0.35])
    # How long it took is said in the log, and not in the file.
    assert f"{first.provenance.simulations} throws simulated in " in capsys.readouterr().err
    assert planned(root, "bar").content_sha256() == first.content_sha256()
    assert path.read_bytes() == written


def test_the_papers_planner_has_the_papers_times_and_commanded_angles(root: Path) -> None:
    text = "target_m: [0.5, 0.5]\nmethod: paper\nplan: {evaluations: 24}\n"
    write(root, "as-paper", text)
    motion = planned(root, "as-paper")
    assert motion.provenance is not None
    assert motion.provenance.planner == "paper"
    context = context_of(root, "as-paper")
    at_once = first_motion(context, arm_of(context)).provenance  # as `check` plans it
    assert at_once is not None
    assert at_once.planner == "paper"
    assert motion.bezier is not None
    assert motion.bezier.stop_ramp_from_s == motion.bezier.duration_s
    settings = context_of(root, "as-paper").settings.plan
    assert settings.duration_s == (0.2, 1.2)
    write(root, "as-paper", text.replace("}", ", duration_s: [0.4, 0.5]}"))
    assert context_of(root, "as-paper").settings.plan.duration_s == (0.4, 0.5)
    write(root, "as-paper", "target_m: [0.5, 0.5]\n")
    assert context_of(root, "as-paper").settings.plan.duration_s == (0.35, 0.9)


SHAPE = "objective: {kind: shape, places: [{along_m: 0.3, at_m: [0.9, 0.1]}]}\n"


@pytest.mark.parametrize(
    ("text", "objective"),
    [
        ("", AimedPoint(target_m=(0.5, 0.5))),
        (BAR, SegmentObjective(kind="segment", ends_m=((0.8, 0.25), (0.8, 0.45)))),
        (
            "objective: {kind: point, direction_rad: -1.5}\n",
            AimedPoint(target_m=(0.5, 0.5), direction_rad=-1.5),
        ),
        (
            "objective: {kind: point, least_speed_m_s: 4}\n",
            AimedPoint(target_m=(0.5, 0.5), least_speed_m_s=4.0),
        ),
        (SHAPE, ShapeObjective(kind="shape", places=[ShapePlace(along_m=0.3, at_m=(0.9, 0.1))])),
        ("objective: {kind: swing, speed_m_s: 12}\n", SwingObjective(kind="swing", speed_m_s=12.0)),
    ],
)
def test_planner_and_scorer_get_the_objective_of_the_experiment(
    root: Path, text: str, objective: Objective
) -> None:
    write(root, "it", "target_m: [0.5, 0.5]\n" + text)
    context = context_of(root, "it")
    task, _ = first_inputs(context, load_arm(context.arm_file).planar(), np.random.default_rng(1))
    assert task.aim == context.settings.aim == objective


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("target_m: [1.5, 0.5]\n", "experiment.yaml: target_m: the target is 1.581 m from"),
    ],
)
def test_a_plan_that_cannot_be_made_names_file_field_and_fix(root: Path, text: str, words: str) -> None:
    write(root, "not", text)
    with pytest.raises(StrandcastError) as caught:
        run_stage("plan", root, "not", 1)
    assert words in str(caught.value)


def test_the_state_of_the_rig_needs_a_fitted_string(root: Path) -> None:
    text = "target_m: [0.5, 0.5]\nlab: {string: paper-1, rehearsal: false}\n"
    write(root, "rig", text)
    with pytest.raises(StrandcastError, match="rig needs a fitted string"):
        rig_state(context_of(root, "rig"))


def test_a_motion_is_planned_after_a_throw_whose_tip_was_not_seen(
    root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One throw is also too few to examine the rig."""
    text = "target_m: [0.5, 0.5]\nlab: {string: paper-1, rehearsal: false}\n"
    write(root, "blind", text + "estimate: {evaluations: 100, profiles: false}\n" + SMALL)
    run_stage("plan", root, "blind", 1)
    throw(root, "blind", 1, LoopRig())
    track = root / "data/blind/trial-01/track.parquet"
    columns = read_table(track, TRACK)
    tip = columns["point"] == columns["point"].max()
    for name in ("x_m", "y_m", "sigma_m"):
        columns[name] = np.where(tip, np.nan, columns[name])
    write_table(track, TRACK, columns, {"source": "test"})
    for stage in ("register_track", "score", "estimate"):
        run_stage(stage, root, "blind", 1)
    assert "score: trial 1: the tip was tracked in 0 frames of the throw only\n" in capsys.readouterr().err
    # Neither fit nor planner see the noise of the log's rows, second differences of 1.2 mrad.
    trial = read_trial(files_of("estimate", root, "blind", 1), 1)
    motion_s = trial.alignment.motion_start_s, trial.alignment.motion_end_s
    for rows, raw_rows in (
        (trial.hand_pose[:, 2], trial.log.q_rad.sum(axis=1)),
        (smooth_joints(trial.log, trial.motion.joint_names, motion_s)[1], trial.log.q_rad),
    ):
        assert np.diff(raw_rows, n=2, axis=0).std() > 1e-3
        assert np.diff(rows, n=2, axis=0).std() < 2e-4
    state = rig_state(context_of(root, "blind"))
    assert (state.trials, state.offsets, state.repeats) == ([1], None, [])
    (root / "Snakefile").touch()
    printed = run_module(root, "strandcast", "rig", "blind").stdout
    assert printed == "What the arm's file states wrongly is estimated from two trials with a joint log on.\n"
    fitted = Estimate.read(root / "results/blind/trial-01/estimate.json")
    assert (fitted.tip_error_m, fitted.E_points_m[-1]) == (None, None)
    run_stage("plan", root, "blind", 2)
    motion = Motion.read(root / "results/blind/trial-02/motion.json")
    assert motion.provenance is not None
    assert "trial 1: no tip seen" in motion.provenance.flags
