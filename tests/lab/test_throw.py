from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.kinematics import hand_pose
from strandcast.arm.load import PlanarArm
from strandcast.config.experiment import Experiment
from strandcast.core.trial_names import trial_name
from strandcast.errors import StrandcastError
from strandcast.lab.strings import PAPER_STRINGS, physical_string
from strandcast.lab.throw import rehearse, throw
from strandcast.lab.truth import LAB_TRUTH
from strandcast.records.files import sha256_file
from strandcast.records.joint_log import read_run
from strandcast.records.motion import Motion
from strandcast.records.tables import read_facts, read_table

from .conftest import Thrown, make_experiment, swing_command, write_motion

SMALL = {"size_px": (400, 320), "frame_rate_hz": 100.0}


def test_a_throw_writes_the_files_of_a_real_rig(thrown: Thrown) -> None:
    assert {p.name for p in thrown.trial.iterdir()} == {"video.mp4", "joints.csv", "run.json", "motion.json"}
    run, log = read_run(thrown.trial)
    assert run.complete
    assert run.motion_sha256 == Motion.read(thrown.motion).content_sha256()
    assert run.arm_sha256 == thrown.arm.sha256
    assert run.timing.rate_hz == pytest.approx(500.0)
    assert not run.timing.gaps
    assert log.time_s[-1] >= run.motion_end_s + 0.5
    swing = np.isfinite(log.since_start_s)
    assert log.time_s[swing][0] == pytest.approx(run.motion_start_s)
    assert log.since_start_s[swing][[0, -1]] == pytest.approx([0.0, 0.4])
    np.testing.assert_allclose(log.q_cmd_rad[swing], swing_command().q_rad, atol=1e-9)


def test_the_log_is_noisy_and_the_string_hangs_on_the_hand(thrown: Thrown) -> None:
    run, log = read_run(thrown.trial)
    before = log.time_s < run.motion_start_s
    assert log.q_rad[before].std(axis=0) == pytest.approx([5e-4] * 3, rel=0.25)
    truth, facts = read_table(thrown.truth, LAB_TRUTH), read_facts(thrown.truth, LAB_TRUTH)
    clamped = truth["place_m"] == 0.0
    clamp = np.column_stack([truth["x_m"][clamped], truth["y_m"][clamped]])
    commanded = np.stack(
        [np.interp(truth["robot_time_s"][clamped], log.time_s, log.q_rad[:, j]) for j in range(3)], axis=1
    )
    hand = hand_pose(thrown.arm.chain, thrown.arm.clamp, commanded).position_m
    assert np.median(np.linalg.norm(clamp - hand, axis=1)) < 0.004
    assert 0.0 < facts["miss_m"] < 1.0


def test_a_rehearsal_shows_the_joints_and_nothing_of_the_string(thrown: Thrown, tmp_path: Path) -> None:
    joints = []
    for string in ("paper-1", "paper-3"):
        experiment = make_experiment(string=string, servo="soft")
        folder = tmp_path / string
        rehearse(experiment, "lab-test", thrown.arm, thrown.motion, folder)
        assert {path.name for path in folder.iterdir()} == {"joints.csv", "run.json", "motion.json"}
        run, log = read_run(folder)
        assert run.complete
        assert run.motion_sha256 == Motion.read(thrown.motion).content_sha256()
        joints.append((folder / "joints.csv").read_bytes())
    assert joints[0] == joints[1]
    off_rad = np.abs(log.q_rad - log.q_cmd_rad)[np.isfinite(log.since_start_s)]
    assert off_rad.max() > 0.05  # soft joints lag and sag


def test_repeating_a_throw_gives_the_same_bytes(thrown: Thrown, tmp_path: Path) -> None:
    throw(thrown.experiment, "lab-test", thrown.arm, 1, thrown.motion, tmp_path, tmp_path / "truth.parquet")
    for name in ("video.mp4", "joints.csv", "run.json", "motion.json"):
        assert sha256_file(tmp_path / "trial-01" / name) == sha256_file(thrown.trial / name), name
    assert sha256_file(tmp_path / "truth.parquet") == sha256_file(thrown.truth)


@pytest.mark.thorough
def test_without_noise_trials_differ_only_in_their_clocks(arm: PlanarArm, tmp_path: Path) -> None:
    experiment = make_experiment(noise=0.0, camera=SMALL)
    motion = write_motion(tmp_path / "motion.json", arm, swing_command())
    for trial in (1, 2):
        throw(experiment, "lab-test", arm, trial, motion, tmp_path, tmp_path / f"truth-{trial}.parquet")
    (first_run, first), (second_run, second) = (read_run(tmp_path / trial_name(trial)) for trial in (1, 2))
    np.testing.assert_array_equal(first.q_rad, second.q_rad)
    assert first_run.motion_start_s != second_run.motion_start_s
    facts = [read_facts(tmp_path / f"truth-{trial}.parquet", LAB_TRUTH) for trial in (1, 2)]
    assert facts[0]["miss_m"] == facts[1]["miss_m"]
    assert facts[0]["offset_s"] != facts[1]["offset_s"]


def test_with_noise_trials_differ(thrown: Thrown, tmp_path: Path) -> None:
    small, truth = make_experiment(camera=SMALL), tmp_path / "t.parquet"
    throw(small, "lab-test", thrown.arm, 2, thrown.motion, tmp_path, truth)
    misses = [read_facts(path, LAB_TRUTH)["miss_m"] for path in (thrown.truth, truth)]
    assert 1e-4 < abs(misses[0] - misses[1]) < 0.05


def test_strings_by_name_and_by_value() -> None:
    assert physical_string(make_experiment(string="paper-2")) == PAPER_STRINGS["paper-2"]
    own = physical_string(make_experiment(string={"linear_density_kg_m": 0.004}))
    assert (own.length_m, own.linear_density_kg_m, own.weights) == (0.3, 0.004, ())


def test_a_clamp_shortens_the_string_from_its_beginning() -> None:
    """Places count from where the string leaves the clamp; a weight on the tip stays there."""
    whole = PAPER_STRINGS["paper-5"]
    string = replace(whole, weights=((0.170, 0.01), (0.510, 0.02))).clamped(0.01)
    assert string.length_m == pytest.approx(0.50)
    assert string.weights == ((0.170, 0.01), (pytest.approx(0.50), 0.02))
    assert string.pipes == whole.pipes


def test_a_string_that_does_not_fit_is_refused() -> None:
    with pytest.raises(StrandcastError, match="SC-L003"):
        physical_string(make_experiment(string="paper-4"))


def test_markers_must_be_declared_and_inside_the_picture(arm: PlanarArm, tmp_path: Path) -> None:
    from strandcast.lab.scene import make_scene

    bare = make_experiment().model_dump()
    bare["cameras"]["main"]["plane"]["markers"] = []
    with pytest.raises(StrandcastError, match="SC-C022"):
        make_scene(Experiment.model_validate(bare), "x", arm)
    bare["cameras"]["main"]["plane"]["markers"] = [{"id": 1, "x_m": 3.0, "y_m": 0.0}]
    with pytest.raises(StrandcastError, match="SC-T033"):
        make_scene(Experiment.model_validate(bare), "x", arm)
