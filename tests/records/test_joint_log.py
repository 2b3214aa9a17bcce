"""The joint log: round trip, and one error with line and column for a damaged one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from strandcast.errors import StrandcastError
from strandcast.records.joint_log import (
    JointLog,
    Run,
    read_joint_log,
    read_run,
    timing_of,
    write_joint_log,
)


def log_of(rows: int, joints: int, seed: int) -> JointLog:
    random = np.random.default_rng(seed)
    q = random.normal(size=(4, rows, joints))
    since = np.arange(rows) * 0.002
    since[: rows // 3] = np.nan
    return JointLog(
        [f"joint_{k}" for k in range(joints)],
        np.arange(rows) * 0.002 + 17.3,
        q[0],
        q[1],
        q[2],
        q[3],
        since,
        random.integers(0, 9, rows).astype(np.int32),
        random.integers(2**60, 2**62, rows),
    )


@given(rows=st.integers(2, 20), joints=st.integers(1, 7), seed=st.integers(0, 9))
@settings(max_examples=25, deadline=None)
def test_round_trip_is_exact(tmp_path_factory, rows, joints, seed):
    path = tmp_path_factory.mktemp("log") / "joints.csv"
    log = log_of(rows, joints, seed)
    log.qd_cmd_rad_s[:] = np.nan  # not every controller logs it
    write_joint_log(path, log)
    again = read_joint_log(path)
    assert again.joint_names == log.joint_names
    for name in (
        "time_s",
        "q_rad",
        "qd_rad_s",
        "q_cmd_rad",
        "qd_cmd_rad_s",
        "since_start_s",
        "flags",
        "host_time_ns",
    ):
        np.testing.assert_array_equal(getattr(again, name), getattr(log, name))


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda t: t.replace("\n3,", "\n3,,", 1), r"joints\.csv:5: \d+ cells"),
        (lambda t: "a,b\n" + t.split("\n", 1)[1], r"joints\.csv:1: .*header"),
        (
            lambda t: t.replace("17.3,", "17;3,", 1),
            r"joints\.csv:2: controller_time_s: '17;3' is not a number",
        ),
        (lambda t: t.replace("17.3,", "nan,", 1), r"joints\.csv:2: controller_time_s: 'nan' is not a finite"),
        (lambda t: t.replace("17.3,", ",", 1), r"joints\.csv:2: a time or a joint position is missing"),
        (lambda t: "", "no rows"),
    ],
)
def test_damage_is_named_with_its_line(tmp_path, damage, words):
    path = tmp_path / "joints.csv"
    write_joint_log(path, log_of(6, 2, 0))
    path.write_text(damage(path.read_text()))
    with pytest.raises(StrandcastError, match=words):
        read_joint_log(path)


def run_of(sha: str, rows: int, complete: bool = True) -> Run:
    return Run(
        complete=complete,
        status="ok",
        reason=None if complete else "power cut",
        joints_sha256=sha,
        rows=rows,
        motion_sha256=None,
        arm_sha256=None,
        driver="lab",
        controller={},
        joint_names=["joint_0", "joint_1"],
        clock="controller",
        motion_start_s=17.3,
        motion_end_s=17.31,
        sync_events=[],
        timing=timing_of(np.arange(6) * 0.002, 500.0),
        video={},
    )


def test_a_log_that_run_json_does_not_describe_is_refused(tmp_path):
    sha = write_joint_log(tmp_path / "joints.csv", log_of(6, 2, 0))
    run_of(sha, 6).write(tmp_path / "run.json")
    run, log = read_run(tmp_path)
    assert run.rows == len(log.time_s) == 6
    text = (tmp_path / "joints.csv").read_text()
    (tmp_path / "joints.csv").write_text(text[: text.rindex("\n", 0, -1) + 1])
    with pytest.raises(StrandcastError, match="is not the log that run.json describes"):
        read_run(tmp_path)
    run_of(sha, 6, complete=False).write(tmp_path / "run.json")
    with pytest.raises(StrandcastError, match="not complete .power cut"):
        read_run(tmp_path)


@pytest.mark.parametrize("damage", ['"', "\0", "x" * 140_000, "1_0", "\n"])
def test_a_log_with_another_hash_is_not_parsed(tmp_path, monkeypatch, damage):
    sha = write_joint_log(tmp_path / "joints.csv", log_of(6, 2, 0))
    run_of(sha, 6).write(tmp_path / "run.json")
    head, rows = (tmp_path / "joints.csv").read_text().split("\n", 1)
    (tmp_path / "joints.csv").write_text(f"{head}\n{damage}{rows}")
    with pytest.raises(StrandcastError, match=f"SC-X020 .* is [0-9a-f]{{12}}, not {sha[:12]}"):
        read_run(tmp_path)
    # The reader itself refuses it too, or reads the numbers that are there.
    if damage != "\n":
        with pytest.raises(StrandcastError, match=r"SC-J001 .*joints\.csv:2: "):
            read_joint_log(tmp_path / "joints.csv")


@pytest.mark.parametrize("flags", ["-1", "4294967296", "1.5", "1e300"])
def test_flags_that_are_no_bits_are_refused(tmp_path, flags):
    write_joint_log(tmp_path / "joints.csv", log_of(3, 2, 0))
    head, row, *rest = (tmp_path / "joints.csv").read_text().splitlines()
    (tmp_path / "joints.csv").write_text("\n".join([head, row.rsplit(",", 1)[0] + "," + flags, *rest]))
    with pytest.raises(StrandcastError, match=r"SC-J001 .*joints\.csv:2: flags"):
        read_joint_log(tmp_path / "joints.csv")


def test_timing_finds_gaps_and_duplicates():
    time_s = np.delete(np.arange(100) * 0.01, [40, 41, 70])
    time_s = np.insert(time_s, 10, time_s[10])
    timing = timing_of(time_s, 100.0)
    assert timing.duplicates == 1
    assert [gap.missing for gap in timing.gaps] == [2, 1]
    assert timing.gaps[0].duration_s == pytest.approx(0.03)


@given(
    st.lists(
        st.tuples(st.floats(allow_nan=False, allow_infinity=False), st.integers(0, 2**63 - 1)), min_size=1
    )
)
@settings(max_examples=50, deadline=None)
def test_every_bit_of_a_number_survives(tmp_path_factory, numbers):
    path = tmp_path_factory.mktemp("log") / "joints.csv"
    values, host = (np.array(column) for column in zip(*numbers, strict=True))
    log = log_of(len(numbers), 1, 0)
    log.q_rad[:, 0], log.host_time_ns = values, host
    write_joint_log(path, log)
    again = read_joint_log(path)
    assert again.q_rad.tobytes() == log.q_rad.tobytes()
    assert again.host_time_ns.tolist() == host.tolist()
