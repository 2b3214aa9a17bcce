"""Stages name their files by role alone, and only by roles that they declare."""

import ast
import errno
import re

import pytest

from strandcast.records.alignment import HAND
from strandcast.records.estimate import ENSEMBLE, SIMULATED
from strandcast.records.lab_truth import LAB_TRUTH
from strandcast.records.observations import OBSERVATIONS
from strandcast.records.track import MARKERS, TRACK
from strandcast.stages.declarations import STAGES
from strandcast.stages.run import files_of

READ, WRITE = {"input", "inputs", "optional"}, {"output"}


@pytest.fixture
def files(tmp_path):
    folder = tmp_path / "data" / "rig"
    folder.mkdir(parents=True)
    text = "string: {length_m: 0.3}\ntarget_m: [0.5, 0.5]\nexcluded: [{trial: 2, reason: slipped}]\n"
    (folder / "experiment.yaml").write_text(text)
    return lambda stage, trial: files_of(stage, tmp_path, "rig", trial)


def test_files_have_roles_and_trials(files, tmp_path):
    results = tmp_path / "results" / "rig"
    estimate = files("estimate", 3)
    assert estimate.inputs("track") == [results / f"trial-0{trial}" / "track.parquet" for trial in (1, 3)]
    assert estimate.input("track", 3) == results / "trial-03" / "track.parquet"
    assert estimate.optional("track", 3) is None
    assert estimate.output("ensemble") == results / "trial-03" / "ensemble.parquet"
    assert files("calibrate", 0).output("picture") == results / "cameras" / "main.webp"


def test_an_arm_that_the_disk_refuses_is_not_taken_for_one_without_urdf(files, project_root, monkeypatch):
    arm = project_root / "config" / "arms" / "planar3.toml"
    monkeypatch.setattr("strandcast.stages.context.find_arm", lambda *_: arm)
    assert [path.suffix for path in files("plan", 1).inputs("arm")] == [".toml", ".urdf"]

    def refused(path):
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr("strandcast.stages.files.read_bounded", refused)
    with pytest.raises(OSError, match="Input/output"):
        files("plan", 1).inputs("arm")


def test_photos_count_whatever_the_kind_of_picture(files, tmp_path):
    folder = tmp_path / "data/rig/calibration"
    folder.mkdir()
    assert files("calibrate", 0).inputs("plane") == [folder / "plane.png"]
    for name in ("lens-02.JPG", "lens-01.jpeg", "lens-01.TIF", "lens-03.txt", "plane.JPG"):
        (folder / name).touch()
    found = [path.name for role in ("lens", "plane") for path in files("calibrate", 0).inputs(role)]
    assert found == ["lens-01.TIF", "lens-02.JPG", "plane.JPG"]
    (folder / "lens-04.png").touch()  # as declared
    assert files("calibrate", 0).inputs("lens") == [folder / "lens-04.png"]


def test_an_undeclared_role_is_an_error(files):
    with pytest.raises(KeyError, match="verdict"):
        files("reconstruct", 1).input("verdict")
    with pytest.raises(KeyError, match="track"):
        files("score", 1).output("track")


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_names_no_file_and_no_undeclared_role(stage, project_root):
    declared = STAGES[stage]
    module = ast.parse((project_root / "src/strandcast/stages" / f"{stage}.py").read_text())
    for function in (node for node in ast.walk(module) if isinstance(node, ast.FunctionDef)):
        for node in ast.walk(function):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                roles = {first.value for first in node.args[:1] if isinstance(first, ast.Constant)}
                if ast.unparse(node.func.value) == "files" and node.func.attr in READ:
                    assert roles <= {*declared.inputs, *declared.may_read}
                elif ast.unparse(node.func.value) == "files" and node.func.attr in WRITE:
                    assert roles <= set(declared.outputs)
            elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
                assert not re.search(r"\.(json|parquet|csv|webp|html|png)['\"]$", ast.unparse(node.right))


def test_the_reference_names_every_file_and_every_column(project_root):
    text = (project_root / "docs/reference/files.md").read_text()
    patterns = [pattern for stage in STAGES.values() for pattern in stage.outputs.values()]
    for pattern in (one for item in patterns for one in ([item] if isinstance(item, str) else item)):
        name = pattern.rsplit("/", 1)[1].replace("{camera}", "CAMERA")
        assert re.sub(r"lens-\d\d", "lens-*", name).replace("video.mp4", "video.*") in text
    for table in (OBSERVATIONS, TRACK, MARKERS, HAND, ENSEMBLE, SIMULATED, LAB_TRUTH):
        assert [name for name in (*table.columns, *table.optional) if f"`{name}`" not in text] == []
