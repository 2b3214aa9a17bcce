"""A log is imported whole or not at all, and never over a run that was played."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import typer
from tests.executor.motions import motion_of

from strandcast.arm.load import PlanarArm, load_arm
from strandcast.cli.exchange import trial_or_rehearsal
from strandcast.errors import StrandcastError
from strandcast.imports.joints import Reading
from strandcast.imports.mapping import JointMapping
from strandcast.planning.bezier import Curve, rest_heights, sample
from strandcast.records.folders import ExperimentFolder
from strandcast.records.joint_log import Run, read_run
from strandcast.records.kept_motions import keep_motion
from strandcast.records.motion import Motion
from strandcast.records.predicted import UNPREDICTED, write_predicted
from strandcast.stages import import_joints
from strandcast.stages.context import context_of
from strandcast.stages.plan_inputs import first_inputs, rehearsal_of
from strandcast.stages.run import files_of

READING = Reading(mapping=JointMapping(time="t", q=["a", "b", "c"], q_cmd=["ca", "cb", "cc"]))
SETTINGS = "string: {length_m: 0.3}\ntarget_m: [0.5, 0.5]\narm: planar3\n"


@dataclass
class Bench:
    """An experiment's root, its first trial's folder, and a log of its throw, which begins at 1 s."""

    root: Path
    trial: Path
    log: Path

    def take(self, replace: bool = False, trial: int | None = 1) -> Run:
        return import_joints.run(self.root, "thrown", trial, self.log, READING, [], replace)

    def cut(self, from_s: float, to_s: float) -> None:
        head, *rows = self.log.read_text().splitlines()
        kept = [row for row in rows if from_s <= float(row.split(",")[0]) <= to_s]
        self.log.write_text("\n".join([head, *kept]) + "\n")


def played(arm: PlanarArm, speed: float = 1.0) -> Motion:
    heights = speed * rest_heights(np.array([[3.0, 2.0, -1.0], [2.0, 4.0, 1.0], [-2.0, 3.0, 5.0]]))
    points = sample(Curve(np.array([0.4, -0.5, 0.3]), 0.5, heights), 1.0 / arm.log_rate_hz)
    ns = np.round(points.time_s * 1e9).astype(int)
    motion = motion_of(arm, ns, points.q_rad, points.qd_rad_s, points.qdd_rad_s2)
    return motion.model_copy(update={"experiment": "thrown"})


@pytest.fixture
def bench(tmp_path: Path, project_root: Path) -> Bench:
    (tmp_path / "config").symlink_to(project_root / "config")
    trial = tmp_path / "data" / "thrown" / "trial-01"
    trial.mkdir(parents=True)
    (trial.parent / "experiment.yaml").write_text(SETTINGS)
    motion = played(load_arm(project_root / "config" / "arms" / "planar3.toml").planar())
    motion.write(trial / "motion.json")
    time_s = np.arange(1100) * 0.002
    planned = motion.trajectory()
    q = np.stack([np.interp(time_s - 1.0, planned.time_s, joint) for joint in planned.q_rad.T], axis=1)
    rows = [",".join(f"{value:.6f}" for value in row) for row in np.column_stack([time_s, q, q])]
    log = tmp_path / "log.csv"
    log.write_text("\n".join(["t,a,b,c,ca,cb,cc", *rows]) + "\n")
    return Bench(tmp_path, trial, log)


def test_an_import_that_fails_leaves_the_one_before_it(bench: Bench) -> None:
    run = bench.take()
    assert run.warnings == []
    with pytest.raises(StrandcastError, match="SC-I022"):
        bench.take()
    whole = bench.log.read_text()
    bench.log.write_text(whole.replace("t,a,b", "t,a,x"))
    with pytest.raises(StrandcastError):
        bench.take(replace=True)
    assert read_run(bench.trial)[0] == run
    bench.log.write_text(whole)
    assert bench.take(replace=True) == run
    (bench.trial / "alignment.json").touch()
    assert "import it again" in bench.take(replace=True).warnings[-1]


def test_a_run_that_was_played_is_not_written_over(bench: Bench) -> None:
    run = bench.take().model_copy(update={"driver": "ur"})
    run.write(bench.trial / "run.json")
    for replace in (False, True):
        with pytest.raises(StrandcastError, match="SC-I022"):
            bench.take(replace)
    assert read_run(bench.trial)[0].driver == "ur"


@pytest.mark.parametrize(
    ("from_s", "to_s", "words"),
    [
        (0.0, 1.35, "misses 150 ms of the motion's end"),
        (1.10, 9.0, "misses 100 ms of the motion's beginning"),
        (1.05, 1.40, "misses 50 ms of the motion's beginning and 100 ms of the motion's end"),
    ],
)
def test_part_of_a_throw_is_refused(bench: Bench, from_s: float, to_s: float, words: str) -> None:
    bench.cut(from_s, to_s)
    with pytest.raises(StrandcastError, match=words) as refusal:
        bench.take()
    assert refusal.value.code == "SC-I032"
    assert not (bench.trial / "run.json").exists()


def test_a_log_that_begins_with_the_motion_is_accepted(bench: Bench) -> None:
    bench.cut(1.002, 9.0)
    assert bench.take().motion_start_s == pytest.approx(1.0, abs=1e-3)


def test_a_log_without_its_motion_is_accepted_with_a_warning(bench: Bench) -> None:
    (bench.trial / "motion.json").unlink()
    run = bench.take()
    assert run.motion_sha256 is None
    assert ["there is no motion.json" in warning for warning in run.warnings] == [True]


def test_a_run_that_was_slowed_down_is_no_throw(bench: Bench) -> None:
    bench.take().model_copy(update={"time_scale": 4.0}).write(bench.trial / "run.json")
    with pytest.raises(StrandcastError, match="4 times slower than planned"):
        read_run(bench.trial)


def test_the_log_of_a_rehearsal_is_planned_with(bench: Bench) -> None:
    with pytest.raises(StrandcastError, match=r"(?s)SC-V020.*cp MOTION .*rehearsal/motion.json") as caught:
        bench.take(trial=None)
    folder = bench.trial.with_name("rehearsal")
    assert caught.value.file == str(folder / "motion.json")
    folder.mkdir()
    (bench.trial / "motion.json").rename(folder / "motion.json")
    bench.trial.rmdir()
    run = bench.take(trial=None)
    assert run.motion_start_s == pytest.approx(1.0, abs=1e-3)
    with pytest.raises(StrandcastError, match="SC-I022"):
        bench.take(trial=None)
    arm = load_arm(bench.root / "config/arms/planar3.toml").planar()
    task, _ = first_inputs(context_of(bench.root, "thrown"), arm, np.random.default_rng(1))
    rehearsed = rehearsal_of(files_of("plan", bench.root, "thrown", 1), task)
    assert rehearsed is not None
    planned = Motion.read(folder / "motion.json").trajectory()
    np.testing.assert_allclose(rehearsed.q_rad[0], planned.q_rad[0], atol=1e-3)


def test_a_trial_is_a_number_or_the_rehearsal() -> None:
    assert [trial_or_rehearsal(word) for word in ("rehearsal", "12")] == ["rehearsal", "12"]
    for word in ("0", "one", "-1", "²", "rehearsals"):
        with pytest.raises(typer.BadParameter):
            trial_or_rehearsal(word)


def test_the_log_of_another_trial_is_refused(bench: Bench) -> None:
    arm = load_arm(bench.root / "config/arms/planar3.toml").planar()
    other = bench.root / "results/thrown/trial-02/motion.json"
    other.parent.mkdir(parents=True)
    played(arm).model_copy(update={"trial": 2}).write(other)
    played(arm, 0.97).write(bench.trial / "motion.json")
    (other.parent.with_name("trial-03")).mkdir()
    (other.parent.with_name("trial-03") / "motion.json").write_text("damaged")
    with pytest.raises(
        StrandcastError, match="SC-I031.*the log is that of .*results/thrown/trial-02/motion.json"
    ):
        bench.take()
    other.unlink()
    bench.take()  # nothing else is known


def test_the_motion_that_was_played_is_found_among_those_that_were_planned(bench: Bench) -> None:
    folder, file = ExperimentFolder(bench.root, "thrown"), bench.trial / "motion.json"
    first, later = Motion.read(file), played(load_arm(bench.root / "config/arms/planar3.toml").planar(), 0.97)
    write_predicted(bench.root / "expected.parquet", UNPREDICTED)
    keep_motion(folder, first, bench.root / "expected.parquet")
    keep_motion(folder, later, bench.root / "none")
    later.write(folder.trial(1).results / "motion.json")  # planned in its place
    for beside in (None, later, first):
        file.unlink(missing_ok=True)
        if beside is not None:
            beside.write(file)
        run = bench.take(replace=True)
        assert run.motion_sha256 == Motion.read(file).content_sha256() == first.content_sha256()
        assert ("/motions/" in " ".join(run.warnings)) == (beside is not first)
        assert (bench.trial / "predicted.parquet").is_file()
    # The same points with another expectation are the same motion: what lies there stays.
    again = first.model_copy(update={"target_m": [0.5, 0.51]})
    keep_motion(folder, again, bench.root / "none")
    again.write(file)
    assert bench.take(replace=True).motion_sha256 == again.content_sha256()
    own = played(load_arm(bench.root / "config/arms/planar3.toml").planar(), 0.96)
    own.write(file)  # kept nowhere else
    with pytest.raises(StrandcastError, match="SC-I031.*the log is that of .*/motions/"):
        bench.take(replace=True)
    assert Motion.read(file) == own


def test_commands_that_are_not_those_of_the_motion_are_refused(bench: Bench) -> None:
    played(load_arm(bench.root / "config/arms/planar3.toml").planar(), 0.90).write(
        bench.trial / "motion.json"
    )
    with pytest.raises(StrandcastError, match="SC-I031.*which no lag of commands explains"):
        bench.take()


def test_a_joint_that_is_a_whole_turn_off_the_motion_is_turned_back(bench: Bench) -> None:
    bench.take()
    whole = read_run(bench.trial)[1]
    head, *rows = bench.log.read_text().splitlines()
    values = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    values[:, [1, 4]] -= 2.0 * np.pi
    turned = [",".join(f"{value:.9f}" for value in row) for row in values]
    bench.log.write_text("\n".join([head, *turned]) + "\n")
    assert any("whole turns (2π) were added to" in each for each in bench.take(replace=True).warnings)
    np.testing.assert_allclose(read_run(bench.trial)[1].q_rad, whole.q_rad, atol=1e-8)
