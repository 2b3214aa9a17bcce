from __future__ import annotations

import numpy as np
import pytest

from strandcast.errors import StrandcastError, StrandcastErrors
from strandcast.imports.joints import import_joints
from strandcast.imports.mapping import JointMapping, load_mapping
from strandcast.records.joint_log import AFTER_DUPLICATE, read_run

MAPPING = JointMapping(time="t", q=["a", "b"])


def log_file(tmp_path, text: str):
    path = tmp_path / "log.csv"
    path.write_text(text)
    return path


def test_the_libfranka_log_is_read_with_its_lost_samples(real_data, tmp_path):
    run = import_joints(real_data / "robot_logs/franka_ocp_Xdown_25cm_0.44s_1.csv", tmp_path)
    assert run.driver == "import: libfranka"
    assert (run.rows, run.timing.nominal_rate_hz, run.timing.duplicates) == (5000, 1000.0, 0)
    assert sorted(gap.missing for gap in run.timing.gaps) == [1, 1, 1, 1, 1, 1, 2, 2, 3]
    assert "9 gaps, 13 samples missing; the longest is 4.0 ms" in run.warnings[0]
    again, log = read_run(tmp_path)
    assert again == run
    assert log.q_rad.shape == (5000, 7)
    assert log.time_s[0] == pytest.approx(2407.328)
    assert log.q_rad[0, 0] == -1.57091
    assert log.q_cmd_rad[0, 0] == -1.5708
    assert run.motion_end_s - run.motion_start_s == pytest.approx(0.42, abs=0.03)
    speed = np.gradient(log.q_rad[:, 3], log.time_s)
    assert np.sqrt(np.mean((speed - log.qd_rad_s[:, 3]) ** 2)) < 0.1 * np.abs(log.qd_rad_s[:, 3]).max()


def test_the_headerless_ur_log_is_read_with_its_uneven_steps(real_data, tmp_path):
    run = import_joints(real_data / "robot_logs/ur10e_20_02_10-20sec_7harm.csv", tmp_path)
    assert run.driver == "import: ur"
    assert run.rows == 2974
    assert run.timing.uneven == 969
    assert any("10.0 to 12.0 ms): 93.9 Hz" in warning for warning in run.warnings)
    _, log = read_run(tmp_path)
    assert log.time_s[0] == 1301.948
    assert log.q_rad[0, 1] == -1.612853
    assert np.isnan(log.q_cmd_rad).all()
    speed = np.gradient(log.q_rad[:, 0], log.time_s)
    assert np.corrcoef(speed, log.qd_rad_s[:, 0])[0, 1] > 0.99


def test_ur_rtde_columns_are_known(tmp_path):
    header = ["timestamp"] + [
        f"{kind}_{k}" for kind in ("actual_q", "actual_qd", "target_q") for k in range(6)
    ]
    rows = [[10 + 0.002 * k] + [0.1 * k] * 6 + [50.0] * 6 + [0.1 * k + 0.01] * 6 for k in range(50)]
    text = "\n".join(",".join(map(str, row)) for row in [header, *rows])
    run = import_joints(log_file(tmp_path, text), tmp_path, namings=[[f"j{k}" for k in range(6)]])
    _, log = read_run(tmp_path)
    assert run.driver == "import: ur_rtde"
    assert log.joint_names == [f"j{k}" for k in range(6)]
    np.testing.assert_allclose(log.q_cmd_rad - log.q_rad, 0.01, atol=1e-12)
    assert log.since_start_s[[0, 49]] == pytest.approx([0.0, 0.098])
    assert run.timing.gaps == []


def test_a_mapping_from_a_file_with_degrees_and_milliseconds(tmp_path):
    (tmp_path / "m.yaml").write_text(
        "time: ms\nq: [one, two]\ntime_unit: ms\nangle_unit: deg\nrate_hz: 500\n"
    )
    path = log_file(tmp_path, "ms;one;two\n1000;90;0\n1002;91;1\n1006;92;2\n")
    run = import_joints(path, tmp_path, mapping=load_mapping(tmp_path / "m.yaml", JointMapping))
    _, log = read_run(tmp_path)
    np.testing.assert_allclose(log.q_rad[:, 0], np.radians([90, 91, 92]))
    np.testing.assert_allclose(log.time_s, [1.0, 1.002, 1.006])
    assert [(gap.index, gap.missing) for gap in run.timing.gaps] == [(1, 1)]


def test_doubled_rows_are_left_out_and_counted(tmp_path):
    path = log_file(tmp_path, "t,a,b\n0,0,0\n0.01,1,0\n0.01,1,0\n0.02,2,0\n0.03,3,0\n")
    run = import_joints(path, tmp_path, mapping=MAPPING)
    _, log = read_run(tmp_path)
    assert run.timing.duplicates == 1
    assert run.rows == 4
    assert log.flags.tolist() == [0, 0, AFTER_DUPLICATE, 0]
    assert "1 rows repeat a time" in run.warnings[0]


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("t,a,b\n0,0,0\n0.02,0,0\n0.01,0,0\n", 4, "time runs back by 0.01 s"),
        ("t,a,b\n0,0,0\n0.01,nan,0\n", 3, "empty or not a number"),
        ("t,a,b\n0,0,0\n,1,0\n", 3, "empty or not a number"),
        ("t,a,b\n0,0,0\n0.01,90,0\n", 3, "an angle of 90.0 rad"),
    ],
)
def test_rows_that_are_no_log_are_refused_with_the_line(tmp_path, text, line, words):
    with pytest.raises(StrandcastError, match=words) as refusal:
        import_joints(log_file(tmp_path, text), tmp_path / "out", mapping=MAPPING)
    assert refusal.value.line == line
    assert not (tmp_path / "out").exists()


def test_unknown_columns_dialects_and_keys_are_refused(tmp_path):
    path = log_file(tmp_path, "t,a,b\n0,0,0\n0.01,0,0\n")
    with pytest.raises(StrandcastError, match="no known joint log: t, a, b"):
        import_joints(path, tmp_path / "out")
    with pytest.raises(StrandcastError, match="no dialect 'kuka'"):
        import_joints(path, tmp_path / "out", dialect="kuka")
    with pytest.raises(StrandcastError, match="the log has 2 joints, and 3 names are known"):
        import_joints(path, tmp_path / "out", mapping=MAPPING, namings=[["x", "y", "z"]])
    (tmp_path / "m.toml").write_text('time = "t"\nangles = ["a"]\n')
    with pytest.raises(StrandcastErrors, match="angles") as refusal:
        load_mapping(tmp_path / "m.toml", JointMapping)
    assert len(refusal.value.problems) == 2  # `angles` is unknown, `q` is missing
