"""Real measured data through the same doors that a user has."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from strandcast.imports.capture_mapping import capture_mapping_of
from strandcast.imports.joints import Reading
from strandcast.records.estimate import Estimate
from strandcast.records.joint_log import read_run
from strandcast.records.track import read_track
from strandcast.stages import import_joints, import_track
from strandcast.stages.run import run_stage


@pytest.fixture
def root(tmp_path, project_root) -> Path:
    shutil.copytree(project_root / "config" / "arms", tmp_path / "config" / "arms")
    return tmp_path


def experiment(root: Path, name: str, text: str) -> Path:
    folder = root / "data" / name
    folder.mkdir(parents=True)
    (folder / "experiment.yaml").write_text(text)
    return folder


@pytest.mark.thorough
def test_the_pendulum_video_gives_its_period(root, real_data):
    folder = experiment(
        root,
        "pendulum",
        "string: {length_m: 0.62}\ntarget_m: [0, 0]\ntrack: {tracker: pendulum}\n",
    )
    (folder / "trial-01").mkdir()
    shutil.copy(
        real_data / "string_pendulum" / "rope_pendulum_0.62m_60fps.mp4", folder / "trial-01" / "video.mp4"
    )
    run_stage("ingest", root, "pendulum", 1)
    run_stage("calibrate", root, "pendulum")
    run_stage("track", root, "pendulum", 1)
    run_stage("reconstruct", root, "pendulum", 1)
    track = read_track(root / "results/pendulum/trial-01/track.parquet", 21)
    x, time_s = track.points_m[:, -1, 0], track.camera_time_s
    rising = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0) & (np.diff(time_s) < 0.05))
    crossing = time_s[rising] - x[rising] * np.diff(time_s)[rising] / np.diff(x)[rising]
    count = np.round((crossing - crossing[0]) / 1.6)
    assert len(crossing) >= 15
    assert np.polyfit(count, crossing, 1)[0] == pytest.approx(1.600, abs=0.005)


@pytest.mark.thorough
def test_a_cable_fitted_on_its_free_swing_predicts_the_driven_one(root, real_data):
    experiment(
        root,
        "cable",
        "string: {length_m: 0.6, points: 12}\ntarget_m: [0, 0]\n"
        "estimate:\n  evaluations: 1500\n  horizon_s: null\n  rest_curl: true\n"
        "  ranges: {k_h: [1.0e-3, 1.0e3], k_sh: [1.0e-3, 1.0e3], k_ph: [1.0e-3, 1.0e3]}\n",
    )
    mapping = capture_mapping_of(
        "x_base,z_base,phi",
        ["0.3:x_mid,z_mid", "0.6:x_end,z_end"],
        time="t",
        angle_sign=-1,
        angle_offset_rad=-np.pi / 2,
    )
    for trial, series in ((1, "free_swing"), (2, "dynamic")):
        file = real_data / "pac_cable" / series / "black_weighted.markers_rebuilt.csv"
        import_track.run(root, "cable", trial, file, mapping)
        run_stage("register_track", root, "cable", trial)
        run_stage("score", root, "cable", trial)
    run_stage("estimate", root, "cable", 1)
    run_stage("estimate", root, "cable", 2)
    first = Estimate.read(root / "results/cable/trial-01/estimate.json")
    second = Estimate.read(root / "results/cable/trial-02/estimate.json")
    (forecast,) = (held.E_m for held in second.held_out if "estimate before" in held.what)
    assert first.E_m < 0.020
    assert forecast < 0.035  # 6 % of the cable; a rigid cable at rest is 70 mm off


@pytest.mark.parametrize(
    ("file", "arm", "joints", "rows", "lost"),
    [
        ("franka_ocp_Xdown_25cm_0.44s_1.csv", "planar3", [f"panda_{k}" for k in range(1, 8)], 5000, 13),
        ("ur10e_20_02_10-20sec_7harm.csv", "ur5e-example", [], 2974, 0),
    ],
)
def test_a_real_robot_log_becomes_a_joint_log(root, real_data, file, arm, joints, rows, lost):
    folder = experiment(root, "log", f"string: {{length_m: 0.3}}\ntarget_m: [0.5, 0.5]\narm: {arm}\n")
    import_joints.run(root, "log", 1, real_data / "robot_logs" / file, Reading(), joints)
    run, log = read_run(folder / "trial-01")
    assert run.rows == len(log.time_s) == rows
    assert sum(gap.missing for gap in run.timing.gaps) == lost
    assert run.warnings
