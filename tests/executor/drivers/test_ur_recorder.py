"""The log that ur_rtde's own recorder writes, recorded from the stand-in, is taken in."""

import importlib.util
import time
from pathlib import Path

import numpy as np
import pytest

from strandcast.imports.joints import Reading, import_joints
from strandcast.records.joint_log import SYNC_HIGH, read_run

rtde_receive = pytest.importorskip("rtde_receive", reason="ur_rtde is not installed: make test-drivers")
rtde_io = pytest.importorskip("rtde_io", reason="ur_rtde is not installed: make test-drivers")

SPEC = importlib.util.spec_from_file_location("rtde_standin", Path(__file__).with_name("rtde_standin.py"))
HOST = "127.0.0.91"
Q = [3.1, -0.4, 0.8, 0.2, 1.6, 0.05]
NAMES = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
COLUMNS = ["timestamp", "target_q", "actual_q", "actual_qd", "actual_digital_output_bits"]


def test_ur_rtdes_own_recording_is_read(tmp_path):
    import sys

    standin = importlib.util.module_from_spec(SPEC)
    sys.modules["rtde_standin"] = standin  # its dataclasses look their module up
    SPEC.loader.exec_module(standin)
    robot = standin.StandIn(standin.Setting(host=HOST, q_rad=Q))
    try:
        receive = rtde_receive.RTDEReceiveInterface(HOST, 500.0, COLUMNS)
        receive.startFileRecording(str(tmp_path / "robot.csv"), COLUMNS)
        time.sleep(0.4)
        switch = rtde_io.RTDEIOInterface(HOST)
        switch.setStandardDigitalOut(2, True)
        time.sleep(0.4)
        receive.stopFileRecording()
        switch.disconnect()
        receive.disconnect()
    finally:
        robot.end()
    run = import_joints(tmp_path / "robot.csv", tmp_path / "trial", Reading(sync_output=2), [NAMES])
    _, log = read_run(tmp_path / "trial")
    assert run.driver == "import: ur_rtde"
    assert log.joint_names == NAMES
    np.testing.assert_allclose(log.q_rad, np.tile(Q, (run.rows, 1)), atol=1e-3)
    np.testing.assert_allclose(log.q_cmd_rad, np.tile(Q, (run.rows, 1)), atol=1e-3)
    assert (np.diff(log.time_s) > 0).all()
    assert 50 < run.rows <= 1 + round((log.time_s[-1] - log.time_s[0]) * 500)
    high = (log.flags & SYNC_HIGH) > 0
    assert not high[0]
    assert high[-1]
    assert (np.diff(high.astype(int)) == 1).sum() == 1
