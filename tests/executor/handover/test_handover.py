"""Before it is written a motion is checked as the player checks it; slow motion keeps the path."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from strandcast.cli.app import app
from strandcast.errors import REFUSED, StrandcastError
from strandcast.executor.handover.export import ExportForm
from strandcast.executor.handover.handover import prepare
from strandcast.executor.preflight import times_ns
from strandcast.records.motion import Motion
from strandcast.stages import export_motion as stage


def test_slow_motion_keeps_the_path_and_gives_both_hashes(planar3, planar_file):
    motion = Motion.read(planar_file)
    slow = prepare(planar_file, planar3, 0.3, 4.0)
    assert times_ns(slow.motion).tolist() == [4 * ns for ns in times_ns(motion).tolist()]
    np.testing.assert_array_equal(slow.motion.trajectory().q_rad, motion.trajectory().q_rad)
    np.testing.assert_allclose(
        slow.motion.trajectory().qd_rad_s * 4, motion.trajectory().qd_rad_s, rtol=1e-15
    )
    assert slow.sha256 != slow.planned_sha256 == motion.content_sha256()
    assert slow.about()[1] == f"motion_sha256: {slow.sha256}"
    assert slow.about()[2] == f"time_scale: 4 (slow: not a throw), of motion {motion.content_sha256()}"
    same = prepare(planar_file, planar3, 0.3)
    assert same.sha256 == motion.content_sha256()
    assert same.about()[2] == "time_scale: 1"


@pytest.mark.parametrize("scale", [0.5, -1.0, float("nan"), float("inf")])
def test_faster_than_planned_is_refused(planar3, planar_file, scale):
    with pytest.raises(StrandcastError, match="SC-W020"):
        prepare(planar_file, planar3, 0.3, scale)


def test_a_motion_refused_by_the_preflight_is_not_exported(export, planar3, ur5e, planar_file):
    out = planar_file.with_name("goal.json")
    with pytest.raises(StrandcastError, match="SC-X004"):
        export(planar_file, ur5e, "ros", out.name)
    with pytest.raises(StrandcastError, match="SC-X004"):  # the string would leave the workspace
        prepare(planar_file, planar3, 3.0)
    motion = Motion.read(planar_file)
    motion.points[100].positions[0] += 3.0  # too far, too fast
    motion.write(planar_file)
    with pytest.raises(StrandcastError, match=r"SC-X00[24]"):
        export(planar_file, planar3, "csv", out.name)
    planar_file.write_text(planar_file.read_text().replace('"trial": 1', '"trial": 2'))
    with pytest.raises(StrandcastError, match="SC-R001") as refusal:
        export(planar_file, planar3, "ros", out.name)
    assert refusal.value.exit_code == REFUSED
    assert not out.exists()


@pytest.mark.parametrize(
    ("kind", "options", "code"),
    [
        ("step", {}, "SC-W021"),
        ("csv", {"rate_hz": 0.0}, "SC-E004.*a rate of"),
        ("csv", {"rate_hz": float("nan")}, "SC-E004.*a rate of"),
        ("ros", {"rate_hz": 500.0}, "SC-E004.*has no rate"),
        ("csv", {"sync_output": 1}, "SC-E004.*has no sync output"),
        ("urscript", {}, "SC-E004.*six joints"),
    ],
)
def test_invalid_export_options_are_refused(export, planar3, planar_file, kind, options, code):
    with pytest.raises(StrandcastError, match=code) as refusal:
        export(planar_file, planar3, kind, "out", **options)
    assert refusal.value.fix
    assert not planar_file.with_name("out").exists()


def test_arm_file_and_string_length_come_from_the_experiment_or_are_required(
    project_root, planar_file, tmp_path
):
    out = tmp_path / "motion.csv"
    with pytest.raises(StrandcastError, match="SC-W020") as refusal:
        stage.run(tmp_path, planar_file, out, ExportForm("csv"), None, 0.3, 1.0)
    assert "--hanging" in refusal.value.fix
    assert "--arm" in refusal.value.fix
    # An arm's file copied under a name of its own, its `name` as it was.
    shutil.copytree(project_root / "config" / "arms", tmp_path / "config" / "arms")
    (tmp_path / "config/arms/planar3.toml").rename(tmp_path / "config/arms/mine.toml")
    (tmp_path / "data" / "e").mkdir(parents=True)
    (tmp_path / "data/e/experiment.yaml").write_text(
        "string: {length_m: 0.3}\ntarget_m: [0.5, 0.5]\narm: mine\n"
    )
    done = stage.run(tmp_path, planar_file, out, ExportForm("csv"), None, None, 1.0)
    assert done.arm.path == tmp_path / "config/arms/mine.toml"
    assert out.is_file()
    with pytest.raises(StrandcastError, match="SC-F001"):
        stage.run(tmp_path, planar_file, out, ExportForm("csv"), Path("none.toml"), 0.3, 1.0)


def test_the_command_writes_the_file_and_prints_the_short_hash(project_root, planar_file, tmp_path):
    arm = project_root / "config" / "arms" / "planar3.toml"
    arguments = ["export", "motion", str(planar_file), "--as", "ros", "--arm", str(arm), "--hanging", "0.3"]
    done = CliRunner().invoke(app, [*arguments, "--out", str(tmp_path / "goal.yaml"), "--time-scale", "4"])
    assert done.exit_code == 0, done.output
    text = (tmp_path / "goal.yaml").read_text()
    (sha256,) = [line.split()[-1] for line in text.splitlines() if line.startswith("# motion_sha256")]
    assert f"motion {sha256[:8]}, 2.044 s, 4 times slower: not a throw" in done.output
    assert "warning: the stopping distance of the controller is not known" in done.output
