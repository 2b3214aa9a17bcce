"""`strandcast.load` gives tables with units, and records as typed objects."""

import inspect
import pkgutil
import subprocess
import sys
from importlib import import_module

import numpy as np
import pytest

import strandcast
import strandcast.records
from strandcast.errors import StrandcastError
from strandcast.records.alignment import HAND
from strandcast.records.joint_log import JointLog, write_joint_log
from strandcast.records.load import RECORDS, TABLES
from strandcast.records.record import Record
from strandcast.records.tables import TableSpec, write_table
from strandcast.records.verdict import Verdict


def test_a_table_has_units_and_provenance(tmp_path) -> None:
    path = tmp_path / "hand.parquet"
    columns = {"robot_time_s": [0.0, 0.5], "x_m": [1.0, 2.0], "y_m": [0.0, 0.0], "angle_rad": [0.1, 0.2]}
    write_table(path, HAND, {"source": ["measured"] * 2} | columns, {"frames": 2})
    frame = strandcast.load(path)
    assert frame["x_m"].tolist() == [1.0, 2.0]
    assert frame["source"].tolist() == ["measured", "measured"]
    assert frame.attrs["units"] == {
        "source": "1",
        "robot_time_s": "s",
        "x_m": "m",
        "y_m": "m",
        "angle_rad": "rad",
    }
    assert frame.attrs["schema"] == "strandcast/hand"
    assert frame.attrs["version"] == 1
    assert frame.attrs["facts"] == {"frames": 2}
    assert frame.attrs["made_by"]["numpy"] == np.__version__


def test_a_record_is_its_typed_object(tmp_path) -> None:
    verdict = Verdict(
        experiment="e",
        trial=1,
        target_m=[0.5, 0.5],
        hit_radius_m=0.02,
        miss_m=None,
        miss_sigma_m=None,
        hit=False,
        closest_frame=None,
        closest_robot_time_s=None,
        closest_m=None,
        reason="the tip was not tracked",
    )
    verdict.write(tmp_path / "verdict.json")
    again = strandcast.load(str(tmp_path / "verdict.json"))
    assert isinstance(again, Verdict)
    assert again == verdict


def test_a_joint_log_is_a_table_with_units(tmp_path) -> None:
    rows = np.arange(3.0)[:, None]
    log = JointLog(
        ["a"],
        time_s=rows[:, 0],
        q_rad=rows,
        qd_rad_s=rows * np.nan,
        q_cmd_rad=rows + 0.5,
        qd_cmd_rad_s=rows,
        since_start_s=rows[:, 0] - 1,
        flags=np.zeros(3, np.int32),
        host_time_ns=np.array([2**60, 2**60 + 1, 2**60 + 2]),
    )
    write_joint_log(tmp_path / "joints.csv", log)
    frame = strandcast.load(tmp_path / "joints.csv")
    assert frame["q_cmd_a_rad"].tolist() == [0.5, 1.5, 2.5]
    assert frame["host_time_ns"].tolist() == [2**60, 2**60 + 1, 2**60 + 2]
    units = frame.attrs["units"]
    assert (units["host_time_ns"], units["controller_time_s"], units["since_start_s"]) == ("ns", "s", "s")
    assert [units[name] for name in ("q_a_rad", "qd_a_rad_s", "flags")] == ["rad", "rad/s", "1"]


@pytest.mark.parametrize(
    ("name", "content", "code"),
    [("a.txt", "", "SC-R002"), ("a.json", '{"schema": "x"}', "SC-R002"), ("a.parquet", "no", "SC-R001")],
)
def test_other_files_are_refused(tmp_path, name, content, code) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(StrandcastError, match=code):
        strandcast.load(tmp_path / name)


def test_every_record_and_table_can_be_loaded() -> None:
    modules = [
        import_module(each.name)
        for each in pkgutil.iter_modules(strandcast.records.__path__, "strandcast.records.")
    ]
    things = {name: thing for module in modules for name, thing in inspect.getmembers(module)}.values()
    records = {
        thing.SCHEMA
        for thing in things
        if isinstance(thing, type) and issubclass(thing, Record) and thing is not Record
    }
    assert records == set(RECORDS)
    assert {thing.schema for thing in things if isinstance(thing, TableSpec)} == set(TABLES)


def test_importing_strandcast_does_not_import_pandas() -> None:
    code = "import sys, strandcast; print([m for m in ('pandas', 'pyarrow', 'pydantic') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
