from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

from strandcast.errors import ENVIRONMENT, StrandcastError, StrandcastErrors
from strandcast.imports.as_measured import not_held
from strandcast.imports.coverage import check_coverage
from strandcast.imports.joints import Reading, import_joints
from strandcast.imports.mapping import JointMapping, load_mapping
from strandcast.records.joint_log import AFTER_DUPLICATE, SYNC_HIGH, read_run

MOVING = Reading(
    mapping=JointMapping(time="t", q=["a", "b"], q_cmd=["ca", "cb"], angle_unit="deg", rate_hz=100)
)
READING = Reading(mapping=JointMapping(time="t", q=["a", "b"]))


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


@pytest.mark.parametrize("columns", [13, 19, 31])
def test_a_headerless_ur_log_with_a_cut_last_line_is_read_with_warnings(tmp_path, columns):
    time_s = np.arange(200) / 100.0
    values = np.zeros((200, columns))
    values[:, 0] = time_s
    values[:, 1:7] = 0.1 * np.sin(time_s)[:, None] + np.arange(6)
    values[:, 7:13] = 0.1 * np.cos(time_s)[:, None]
    text = "\n".join(",".join(f"{value:.6f}" for value in row) for row in values)
    (tmp_path / "log.csv").write_text(text + "\n" + text.splitlines()[-1][:40])
    run = import_joints(tmp_path / "log.csv", tmp_path / "trial-01")
    assert run.rows == 200
    assert any(f"its {columns} columns have no names" in warning for warning in run.warnings)
    assert any(f"line 201, the last, was cut (5 of {columns} cells)" in each for each in run.warnings)
    _, log = read_run(tmp_path / "trial-01")
    np.testing.assert_allclose(log.q_rad, values[:, 1:7], atol=1e-6)
    np.testing.assert_allclose(log.qd_rad_s, values[:, 7:13], atol=1e-6)


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
    run = import_joints(path, tmp_path, Reading(mapping=load_mapping(tmp_path / "m.yaml", JointMapping)))
    _, log = read_run(tmp_path)
    np.testing.assert_allclose(log.q_rad[:, 0], np.radians([90, 91, 92]))
    np.testing.assert_allclose(log.time_s, [1.0, 1.002, 1.006])
    assert [(gap.index, gap.missing) for gap in run.timing.gaps] == [(1, 1)]


def test_the_log_of_urs_own_recorder_is_read(tmp_path):
    # record.py of Universal Robots' RTDE client separates by blanks; the columns are those of its recipe.
    names = ["timestamp"] + [
        f"{kind}_{k}" for kind in ("target_q", "actual_q", "actual_qd") for k in range(6)
    ]
    names += ["actual_digital_output_bits", "robot_mode"]
    rows = [[500.0 + 0.008 * k] + [0.01 * k] * 12 + [1.25] * 6 + [8 * (k >= 10) + 1, 7] for k in range(20)]
    text = "\r\n".join(" ".join(map(str, row)) for row in [names, *rows]) + "\r\n"
    run = import_joints(log_file(tmp_path, text), tmp_path, Reading(sync_output=3))
    _, log = read_run(tmp_path)
    assert run.driver == "import: ur_rtde"
    assert run.timing.rate_hz == pytest.approx(125)
    np.testing.assert_allclose(log.q_rad[:, 5], 0.01 * np.arange(20))
    np.testing.assert_allclose(log.qd_rad_s, 1.25)
    assert log.flags.tolist() == [0] * 10 + [SYNC_HIGH] * 10
    with pytest.raises(StrandcastError, match="SC-I004"):
        import_joints(
            log_file(tmp_path, "t,a,b\n0,0,0\n0.01,0,0\n"), tmp_path / "o", replace(READING, sync_output=0)
        )


def test_a_log_without_time_has_the_stated_rate_or_says_what_to_record(tmp_path):
    names = [f"actual_q_{k}" for k in range(6)]
    path = log_file(tmp_path, " ".join(names) + "\n" + "0 0 0 0 0 0\n" * 3)
    with pytest.raises(StrandcastError, match="no column of the time") as refusal:
        import_joints(path, tmp_path / "out")
    assert "timestamp" in refusal.value.fix
    assert "--rate" in refusal.value.fix
    run = import_joints(path, tmp_path / "out", Reading(rate_hz=500.0))
    np.testing.assert_allclose(read_run(tmp_path / "out")[1].time_s, [0.0, 0.002, 0.004])
    assert run.clock == "500.0 rows per second"


def test_columns_that_are_not_used_do_not_matter(tmp_path):
    path = log_file(tmp_path, "t,a,b,mode,i,i\n0,0,0,RUNNING,1,2\n0.01,1,0,RUNNING,3,4\n0.02,2,0,,5,6\n")
    assert import_joints(path, tmp_path, READING).rows == 3
    for column, words in (("mode", "'RUNNING' is not a number"), ("i", "twice.*(?s:.*)give one of i@5, i@6")):
        with pytest.raises(StrandcastError, match=words):
            import_joints(path, tmp_path / "o", Reading(mapping=JointMapping(time="t", q=["a", column])))
    import_joints(path, tmp_path, Reading(mapping=JointMapping(time="t", q=["a", "i@6"])))
    np.testing.assert_array_equal(read_run(tmp_path)[1].q_rad[:, 1], [2, 4, 6])


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_utf_16_is_read(tmp_path, encoding):
    (tmp_path / "log.csv").write_bytes("t,a,b\r\n0,0,0\r\n0.01,1,2\r\n".encode(encoding))
    import_joints(tmp_path / "log.csv", tmp_path, READING)
    np.testing.assert_array_equal(read_run(tmp_path)[1].q_rad, [[0, 0], [1, 2]])


@pytest.mark.parametrize(
    "form",
    ["2026-11-25T15:59:59.{}", "2026-11-25 15:59:59.{}000+01:00", "2026-11-25T15:59:59.{}Z", "15:59:59.{}"],
)
@pytest.mark.parametrize("header", ["t,a,b\n", ""])
def test_iso_times_are_seconds_whatever_the_unit(tmp_path, form, header):
    rows = "".join(f"{form.format(980 + 4 * k)},{0.1 * k},0\n" for k in range(3))
    names = ("t", "a", "b") if header else ("1", "2", "3")
    mapping = JointMapping(time=names[0], q=list(names[1:]), time_unit="ms")
    run = import_joints(log_file(tmp_path, header + rows), tmp_path, Reading(mapping=mapping))
    assert run.timing.rate_hz == pytest.approx(250, rel=1e-3)
    np.testing.assert_allclose(read_run(tmp_path)[1].q_rad[:, 0], [0, 0.1, 0.2])


def test_the_state_is_the_first_of_libfrankas_columns_of_one_name(tmp_path):
    names = [f"{kind}[{k}]" for kind in ("q", "q_d", "dq", "dq_d", "q_d", "dq_d") for k in range(7)]
    rows = [[k, 1.0, *(i + 0.001 * k for i in range(6) for _ in range(7))] for k in range(4)]
    text = "\n".join(
        [", ".join(["duration", "success_rate", *names])] + [",".join(map(str, r)) for r in rows]
    )
    run = import_joints(log_file(tmp_path, text), tmp_path)
    _, log = read_run(tmp_path)
    assert run.driver == "import: libfranka"
    for values, first in ((log.q_rad, 0), (log.q_cmd_rad, 1), (log.qd_rad_s, 2), (log.qd_cmd_rad_s, 3)):
        np.testing.assert_allclose(values, first + 0.001 * np.arange(4)[:, None] + np.zeros(7))


def swinging(rate_hz: float, seconds: float = 2.0):
    """Return times and two joints that rest, then swing, in an encoder's counts; the second is slow."""
    time_s = np.arange(0.0, seconds, 1.0 / rate_hz)
    swing = np.clip(time_s - 0.5, 0.0, 1.0) * 2 * np.pi
    q = np.column_stack([0.5 * (1 - np.cos(swing)), 0.001 * swing])
    noise = np.random.default_rng(3).normal(0.0, 2e-5, q.shape)
    return time_s, np.round((q + noise) / 4e-5) * 4e-5


@pytest.mark.parametrize("spike", [False, True])
@pytest.mark.parametrize(
    ("held_hz", "rate_hz"), [(125, 500), (100, 240), (250, 1000), (500, 1000), (333, 500), (62.5, 100)]
)
def test_held_rows_are_taken_at_their_true_rate(tmp_path, held_hz, rate_hz, spike):
    time_s = np.arange(0.0, 2.0, 1.0 / rate_hz)
    new_s, q = swinging(held_hz)
    shown = np.searchsorted(new_s, time_s + 1e-9, side="right") - 1
    q[len(q) // 10] += 2.0 * spike  # at rest
    text = "t,a,b\n" + "".join(
        f"{t:.6f},{a:.6f},{b:.6f}\n" for t, (a, b) in zip(time_s, q[shown], strict=True)
    )
    run = import_joints(log_file(tmp_path, text), tmp_path, READING)
    _, log = read_run(tmp_path)
    assert any(f"{held_hz} times per second" in each for each in run.warnings) or held_hz in (100, 333, 62.5)
    assert "each value is taken at its first row" in run.warnings[0]
    assert len(log.time_s) == pytest.approx(2.0 * held_hz, rel=0.05)
    moving = (log.time_s > 0.6) & (log.time_s < 1.4)
    late_rad = np.abs(np.interp(log.time_s, new_s, q[:, 0]) - log.q_rad[:, 0])[moving]
    # The first row is at most one row late; held rows are up to a whole hold.
    assert late_rad.max() < 1.1 * np.abs(np.gradient(q[:, 0], new_s)[new_s > 0.5]).max() / rate_hz


def test_rows_around_gaps_are_kept():
    time_s = np.arange(240) / 240.0
    values = np.column_stack([np.sin(7.0 * time_s), np.cos(9.0 * time_s)])
    values[::8] = np.nan
    assert not_held(time_s, values, "markers")[1] == []
    values[np.random.default_rng(0).random(240) < 0.1, 1] = np.nan
    assert not_held(time_s, values, "markers")[1] == []


def test_a_stated_unit_of_angles_is_used(tmp_path):
    text = "t,a_deg,v_rad_s\n" + "".join(f"{0.002 * k:.3f},{0.1 * k:.2f},1\n" for k in range(30))
    for columns in (
        JointMapping(time="t", q=["a_deg"], angle_unit="rad"),
        JointMapping(time="t", q=["a_deg"], qd=["v_rad_s"]),
    ):
        import_joints(log_file(tmp_path, text), tmp_path, Reading(mapping=columns))
        assert read_run(tmp_path)[1].q_rad[-1, 0] == pytest.approx(2.9)
    import_joints(log_file(tmp_path, text), tmp_path, Reading(mapping=JointMapping(time="t", q=["a_deg"])))
    assert read_run(tmp_path)[1].q_rad[-1, 0] == pytest.approx(np.radians(2.9))


def test_angles_whose_names_end_in_deg_are_degrees(tmp_path):
    text = "t,a_deg,b [deg]\n" + "".join(f"{0.002 * k:.3f},{0.5 * k:.2f},0\n" for k in range(30))
    columns = JointMapping(time="t", q=["a_deg", "b [deg]"])
    run = import_joints(log_file(tmp_path, text), tmp_path, Reading(mapping=columns))
    assert read_run(tmp_path)[1].q_rad[-1, 0] == pytest.approx(np.radians(14.5))
    assert "taken as degrees" in run.warnings[0]


@pytest.mark.parametrize("exchanged", [False, True])
def test_exchanged_columns_of_measured_and_commanded_joints_are_named(tmp_path, exchanged):
    time_s = np.arange(600) * 0.002
    swing = [0.8 * np.sin(4.0 * np.maximum(time_s - late_s, 0.0)) for late_s in (0.0, 0.03)]
    measured, commanded = swing if exchanged else swing[::-1]
    noise = np.random.default_rng(2).normal(0.0, 3e-4, len(time_s))
    rows = [f"{t:.6f},{q:.7f},{c:.7f}" for t, q, c in zip(time_s, measured + noise, commanded, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(["t,a,c", *rows]) + "\n")
    reading = Reading(mapping=JointMapping(time="t", q=["a"], q_cmd=["c"]))
    warnings = import_joints(tmp_path / "log.csv", tmp_path / "trial", reading).warnings
    named = [each for each in warnings if "move 30 ms before their commands" in each]
    assert len(named) == exchanged


@pytest.mark.parametrize("seed", range(3))
def test_rows_of_a_slow_joint_are_not_held(tmp_path, seed):
    random = np.random.default_rng(seed)
    counts = np.cumsum(random.random((600, 2)) < 0.25, axis=0) * 1e-3
    text = "t,a,b\n" + "".join(f"{0.002 * k:.3f},{a:.4f},{b:.4f}\n" for k, (a, b) in enumerate(counts))
    assert import_joints(log_file(tmp_path, text), tmp_path, READING).rows == 600
    time_s, q = swinging(500)
    text = "t,a,b\n" + "".join(f"{t:.3f},{a:.6f},{b:.6f}\n" for t, (a, b) in zip(time_s, q, strict=True))
    assert import_joints(log_file(tmp_path, text), tmp_path, READING).rows == 1000


def test_measured_joints_that_follow_other_commands_are_refused(tmp_path):
    time_s, q = swinging(250)
    rows = [["t", "a", "b", "ca", "cb"], *np.column_stack([time_s, q[:, ::-1], q]).tolist()]
    path = log_file(tmp_path, "\n".join(",".join(map(str, row)) for row in rows))
    both = Reading(mapping=JointMapping(time="t", q=["a", "b"], q_cmd=["ca", "cb"]))
    with pytest.raises(StrandcastError, match="SC-I006.*measured joint_1 follows the command of joint_2"):
        import_joints(path, tmp_path / "o", both)
    right = Reading(mapping=JointMapping(time="t", q=["b", "a"], q_cmd=["ca", "cb"]))
    import_joints(path, tmp_path / "o", right)


def test_measured_joints_are_in_the_turn_of_their_commands(tmp_path):
    text = "t,a,b,ca,cb\n" + "".join(f"{0.01 * k},{0.1 * k - 2 * np.pi},0,{0.1 * k},0\n" for k in range(20))
    both = Reading(mapping=JointMapping(time="t", q=["a", "b"], q_cmd=["ca", "cb"]))
    run = import_joints(log_file(tmp_path, text), tmp_path, both)
    np.testing.assert_allclose(read_run(tmp_path)[1].q_rad[:, 0], 0.1 * np.arange(20), atol=1e-9)
    assert any("whole turns" in warning for warning in run.warnings)


def test_a_rate_is_compared_with_the_times(tmp_path):
    path = log_file(tmp_path, "t,a,b\n" + "".join(f"{0.01 * k},0.1,0.2\n" for k in range(20)))
    with pytest.raises(StrandcastError, match="SC-I028.*those of 100 rows per second, the rate is 50"):
        import_joints(path, tmp_path / "o", replace(READING, rate_hz=50.0))
    run = import_joints(path, tmp_path / "o", replace(READING, rate_hz=200.0))
    assert any("has 100 rows per second by its times, not 200" in warning for warning in run.warnings)


def test_lists_in_cells_are_columns(tmp_path):
    text = "timestamp,actual_q\n" + "".join(
        f'{0.01 * k},"[0.1, {0.2 + k}, 3, 4, 5, 6.0]"\n' for k in range(5)
    )
    import_joints(log_file(tmp_path, text), tmp_path)
    np.testing.assert_allclose(read_run(tmp_path)[1].q_rad[4], [0.1, 4.2, 3, 4, 5, 6])


def test_an_angle_that_wraps_goes_on(tmp_path):
    time_s, q = swinging(250)
    q[:, 0] += 2.7  # swings beyond π
    text = "t,a,b,ca,cb\n" + "".join(
        f"{t:.3f},{(a + np.pi) % (2 * np.pi) - np.pi:.6f},{b:.6f},{a:.6f},{b:.6f}\n"
        for t, (a, b) in zip(time_s, q, strict=True)
    )
    mapping = JointMapping(time="t", q=["a", "b"], q_cmd=["ca", "cb"])
    run = import_joints(log_file(tmp_path, text), tmp_path, Reading(mapping=mapping))
    np.testing.assert_allclose(read_run(tmp_path)[1].q_rad, q, atol=2e-6)
    assert "whole turns (2π) were added to joint_1" in run.warnings[0]


def test_rows_that_ur_rtde_records_twice_or_late_are_reported(tmp_path):
    # Its thread samples the newest state at its own rate: rows come twice, and now and then one is missed.
    cycles = [0, 1, 1, 2, 3, 3, 3, 4, 22, 23, 24, 24, 25]
    header = ["timestamp"] + [f"actual_q_{k}" for k in range(6)]
    rows = [[10 + 0.002 * k] + [0.1 * k] * 6 for k in cycles]
    text = "\n".join(",".join(map(str, row)) for row in [header, *rows])
    run = import_joints(log_file(tmp_path, text), tmp_path)
    _, log = read_run(tmp_path)
    np.testing.assert_allclose(log.q_rad[:, 0], 0.1 * np.array([0, 1, 2, 3, 4, 22, 23, 24, 25]))
    assert run.timing.duplicates == 4
    assert [(gap.missing, round(gap.duration_s, 6)) for gap in run.timing.gaps] == [(17, 0.036)]
    assert "17 samples missing; the longest is 36.0 ms" in run.warnings[0]
    assert "4 rows repeat a time" in run.warnings[1]


def test_libfrankas_own_csv_is_in_milliseconds(tmp_path):
    groups = [(f"state.{name}", 7) for name in ("q", "q_d", "dq", "dq_d", "tau_J", "tau_ext_hat_filtered")]
    groups += [
        ("cmd.q_d", 7),
        ("cmd.dq_d", 7),
        ("cmd.O_T_EE_d", 16),
        ("cmd.O_dP_EE_d", 6),
        ("cmd.tau_J_d", 7),
    ]
    header = "time, success_rate, " + ",".join(
        ", ".join(f"{name}[{k}]" for k in range(count)) for name, count in groups
    )
    values = [0.1 * i for i, (_, count) in enumerate(groups) for _ in range(count)]
    lines = [",".join(map(str, [71000 + k, 1.0, *values])) for k in (0, 1, 2, 4, 5)]
    run = import_joints(log_file(tmp_path, "\n".join([header, *lines])), tmp_path)
    _, log = read_run(tmp_path)
    assert run.driver == "import: libfranka"
    np.testing.assert_allclose(log.time_s, [71.0, 71.001, 71.002, 71.004, 71.005])
    assert [gap.missing for gap in run.timing.gaps] == [1]
    assert (log.q_rad == 0.0).all()
    np.testing.assert_allclose(log.q_cmd_rad, 0.1)
    np.testing.assert_allclose(log.qd_rad_s, 0.2)


def test_a_log_in_degrees_is_refused_with_that_hint(tmp_path):
    header = ["timestamp"] + [f"actual_q_{k}" for k in range(6)]
    rows = [[0.002 * k] + [90.0] * 6 for k in range(5)]
    path = log_file(tmp_path, "\n".join(",".join(map(str, row)) for row in [header, *rows]))
    with pytest.raises(StrandcastError, match="SC-I008") as refusal:
        import_joints(path, tmp_path)
    assert "--degrees" in refusal.value.fix
    import_joints(path, tmp_path, Reading(degrees=True))
    np.testing.assert_allclose(read_run(tmp_path)[1].q_rad, np.pi / 2)
    path.write_text(path.read_text().replace("90.0", "1.57"))
    with pytest.raises(StrandcastError, match=r"SC-I008.*no angle is beyond 1\.6 degrees\n.*leave out"):
        import_joints(path, tmp_path, Reading(degrees=True))


def test_a_bag_without_the_package_says_what_to_install(tmp_path):
    if find_spec("rosbags"):
        pytest.skip("rosbags is installed: tests/executor/drivers/test_rosbag.py reads bags")
    (tmp_path / "log.mcap").write_bytes(b"")
    with pytest.raises(StrandcastError, match="SC-W012") as refusal:
        import_joints(tmp_path / "log.mcap", tmp_path / "out")
    assert "strandcast[ros]" in refusal.value.fix
    assert refusal.value.exit_code == ENVIRONMENT


def test_doubled_rows_are_left_out_and_counted(tmp_path):
    path = log_file(tmp_path, "t,a,b\n0,0,0\n0.01,1,0\n0.01,1,0\n0.02,2,0\n0.03,3,0\n")
    run = import_joints(path, tmp_path, READING)
    _, log = read_run(tmp_path)
    assert run.timing.duplicates == 1
    assert run.rows == 4
    assert log.flags.tolist() == [0, 0, AFTER_DUPLICATE, 0]
    assert "1 rows repeat a time" in run.warnings[0]


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        pytest.param(
            "t,a,b\n0,0,0\n0.02,0,0\n0.01,0,0\n", 4, "time runs back by 0.01 s", id="row34-unsorted"
        ),
        pytest.param("t,a,b\n0,0,0\n0.01,nan,0\n", 3, "empty or not a number", id="row36-nan"),
        pytest.param("t,a,b\n0,0,0\n,1,0\n", 3, "empty or not a number", id="row36-empty"),
        pytest.param("t,a,b\n0,0,0\n0.01,90,0\n", 3, "an angle of 90.0 rad", id="row37-degrees"),
    ],
)
def test_rows_that_are_no_log_are_refused_with_the_line(tmp_path, text, line, words):
    with pytest.raises(StrandcastError, match=words) as refusal:
        import_joints(log_file(tmp_path, text), tmp_path / "out", READING)
    assert refusal.value.line == line
    assert not (tmp_path / "out").exists()


def test_unknown_columns_dialects_and_keys_are_refused(tmp_path):
    path = log_file(tmp_path, "t,a,b\n0,0,0\n0.01,0,0\n")
    with pytest.raises(StrandcastError, match="no known joint log: t, a, b"):
        import_joints(path, tmp_path / "out")
    with pytest.raises(StrandcastError, match="no dialect 'kuka'"):
        import_joints(path, tmp_path / "out", Reading(dialect="kuka"))
    with pytest.raises(StrandcastError, match="the log has 2 joints, and 3 names are known"):
        import_joints(path, tmp_path / "out", READING, namings=[["x", "y", "z"]])
    (tmp_path / "m.toml").write_text('time = "t"\nangles = ["a"]\n')
    with pytest.raises(StrandcastErrors, match="angles") as refusal:
        load_mapping(tmp_path / "m.toml", JointMapping)
    assert len(refusal.value.problems) == 2  # `angles` is unknown, `q` is missing


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        (range(300), []),
        (range(155), ["the log ends 40 ms after the motion"]),
        (
            [*range(120), *range(127, 300)],
            ["1 gaps, 7 samples", "the log misses 80 ms of the motion itself"],
        ),
        ([*range(50), *range(60, 300)], ["1 gaps, 10 samples"]),
    ],
)
def test_a_log_that_does_not_cover_the_motion_gives_a_warning(tmp_path, rows, expected):
    run = import_joints(moving_log(tmp_path, rows), tmp_path, MOVING)
    expected = [*expected, "there is no motion.json"]
    assert len(run.warnings) == len(expected), run.warnings
    assert all(words in warning for words, warning in zip(expected, run.warnings, strict=True))


def moving_log(tmp_path, rows):
    # The command moves from 1.00 to 1.50 s, a row every 10 ms.
    text = "t,a,b,ca,cb\n" + "".join(f"{0.01 * k:.2f},0,0,{min(max(k, 100), 150)},0\n" for k in rows)
    return log_file(tmp_path, text)


@pytest.mark.parametrize("first", [97, 147], ids=["start", "end"])
def test_a_gap_over_the_motions_start_or_end_is_one_of_the_motion(first):
    time_s = 0.01 * np.delete(np.arange(300), np.arange(first, first + 7))
    [warning] = check_coverage(time_s, 1.0, 1.5, "log.csv")
    assert "the log misses 80 ms of the motion itself" in warning


def test_an_import_that_breaks_off_leaves_no_run_json(tmp_path, monkeypatch):
    def full(path, log):
        raise OSError("no space left on device")

    path = log_file(tmp_path, "t,a,b\n0,0,0\n0.01,1,0\n")
    import_joints(path, tmp_path, READING)
    monkeypatch.setattr("strandcast.imports.joints.write_joint_log", full)
    with pytest.raises(OSError, match="no space"):
        import_joints(path, tmp_path, READING)
    assert not (tmp_path / "run.json").exists()


def test_a_long_gap_within_the_motion_is_refused(tmp_path):
    with pytest.raises(StrandcastError, match="SC-I032 .* misses 110 ms within the motion"):
        import_joints(moving_log(tmp_path, [*range(120), *range(130, 300)]), tmp_path / "out", MOVING)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("header", "rows", "code", "words"),
    [
        ("t,a,b", ["0,0,0", "0.01,0,0", "1e300,0,0"], "SC-I028", r"span 1e\+300 s"),
        ("t,a,b", ["1e12,0,0", "1.00001e12,0,0", "1.00002e12,0,0"], "SC-I028", r"span 2e\+07 s"),
        ("t,a,b", ["0,0,0", "1e-9,0,0", "2e-9,0,0"], "SC-I028", "rows are 1e-09 s apart"),
        ("t,a,b", ["0,0,0", "2,0,0", "4,0,0"], "SC-I028", "rows are 2 s apart, 0.5 per second"),
        ("t,a,b", ["5,0,0", "5,0,0"], "SC-I028", "all 2 rows are at 5 s"),
        ("t,a,b,o", ["0,0,0,0", "0.01,0,0,1.5"], "SC-I025", "1.5 is no set of digital outputs"),
        ("t,a,b,o", ["0,0,0,0", "0.01,0,0,1e300"], "SC-I025", r"1e\+300 is no set of digital outputs"),
    ],
)
def test_times_and_outputs_that_no_log_has_are_refused(tmp_path, header, rows, code, words):
    outputs = "o" if header.endswith("o") else None
    mapping = JointMapping(time="t", q=["a", "b"], outputs=outputs)
    reading = Reading(mapping=mapping, sync_output=0 if outputs else None)
    with pytest.raises(StrandcastError, match=f"{code} .*{words}"):
        import_joints(log_file(tmp_path, "\n".join([header, *rows])), tmp_path / "out", reading)
    assert not (tmp_path / "out").exists()
