"""The table's columns are named with their units, and its numbers are the motion's."""

import numpy as np
import pytest

from strandcast.errors import StrandcastError
from strandcast.executor.preflight import times_ns
from strandcast.imports.table import read_numbers
from strandcast.planning.bezier import Curve, rest_heights
from strandcast.planning.bezier import sample as sample_curve
from strandcast.records.motion import Motion, points_of


def test_the_table_is_the_motion_bit_for_bit(export, planar3, planar_file):
    motion = Motion.read(planar_file)
    out = export(planar_file, planar3, "csv", "motion.csv")
    table = read_numbers(out)
    assert table.names[:3] == ["time_s", "q_joint_1_rad", "q_joint_2_rad"]
    assert table.names[4] == "qd_joint_1_rad_s"
    assert table.names[-1] == "qdd_joint_3_rad_s2"
    assert np.rint(table.column("time_s") * 1e9).astype(int).tolist() == times_ns(motion).tolist()
    planned = motion.trajectory()
    columns = np.hstack([planned.q_rad, planned.qd_rad_s, planned.qdd_rad_s2])
    np.testing.assert_array_equal(table.values[:, 1:], columns)
    assert f"# motion_sha256: {motion.content_sha256()}" in out.read_text().splitlines()


@pytest.mark.parametrize("rate_hz", [125.0, 1000.0])
def test_another_rate_is_the_quintic_between_the_points(export, ur5e, ur_file, rate_hz):
    out = export(ur_file, ur5e, "csv", "motion.csv", rate_hz=rate_hz)
    table = read_numbers(out)
    expected = Motion.read(ur_file).trajectory().resampled(1.0 / rate_hz)
    np.testing.assert_allclose(table.column("time_s"), expected.time_s, atol=1e-9)
    s = expected.time_s / 0.511
    np.testing.assert_allclose(
        table.column("q_elbow_joint_rad"), 1.0 - 0.4 * s**3 * (10 - 15 * s + 6 * s**2), atol=1e-9
    )
    assert table.column("time_s")[-1] == 0.511
    assert "# held_rad: shoulder_pan_joint 3.14159265" in out.read_text()


def test_rows_too_far_apart_are_refused(export, planar3, planar_file):
    heights = rest_heights(np.array([[3.0, -2.0, 1.0], [-2.0, 3.0, 1.0], [2.0, -3.0, 2.0]]))
    swing = sample_curve(Curve(np.array([0.4, -0.6, -0.3]), 0.5, heights), 0.002)
    ns = np.rint(1e9 * swing.time_s).astype(np.int64)
    motion = Motion.read(planar_file)
    motion.points[:] = points_of(ns, swing.q_rad, swing.qd_rad_s, swing.qdd_rad_s2)
    motion.write(planar_file)
    with pytest.raises(StrandcastError, match="SC-E004"):
        export(planar_file, planar3, "csv", "motion.csv", rate_hz=4.0)
    assert not planar_file.with_name("motion.csv").exists()
    assert export(planar_file, planar3, "csv", "motion.csv", rate_hz=50.0).is_file()
