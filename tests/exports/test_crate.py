"""export crate, read by rocrate; the unpacked crate is a project."""

import os
import shutil
import subprocess
import sys
import zipfile
from datetime import date
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import strandcast
from strandcast.errors import StrandcastError
from strandcast.exports.crate import METADATA, export_crate
from strandcast.records.files import sha256_file
from strandcast.stages.run import run_stage
from strandcast.workflow.verify import refuse_changed_files, verify

VIDEO, TRACK = "data/small/trial-01/video.mp4", "results/small/trial-01/track.parquet"
DAY = date(2026, 3, 14)


@pytest.fixture(scope="module")
def library():
    return pytest.importorskip("rocrate.rocrate", reason="rocrate is not installed: make test")


@pytest.fixture(scope="module")
def made(library, project, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("crate") / "small"
    export_crate(strandcast.open(project)["small"], folder, published=DAY, licence="CC-BY-4.0")
    return folder


@pytest.fixture
def crate(made, tmp_path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "crate"))


def files_in(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def test_rocrate_reads_all_files_with_their_hashes(library, made, project) -> None:
    read = library.ROCrate(made)
    files = {entity.id: entity for entity in read.data_entities}
    assert set(files) == files_in(made) - {METADATA}
    raw = files_in(project / "data" / "small")
    results = {name for name in files_in(project / "results" / "small") if "logs/" not in name}
    assert len(raw) > 15
    assert len(results) > 15
    assert {f"data/small/{name}" for name in raw} | {f"results/small/{name}" for name in results} | {
        "config/arms/planar3.toml",
        "config/arms/planar3.urdf",
        "config/experiments/small.yaml",
    } == set(files)
    for name, entity in files.items():
        assert entity["sha256"] == sha256_file(project / name) == sha256_file(made / name)
        assert entity["contentSize"] == str((project / name).stat().st_size)
    assert read.root_dataset["datePublished"] == "2026-03-14"
    assert read.license.id == "https://spdx.org/licenses/CC-BY-4.0"
    assert read.root_dataset["conformsTo"].id == "https://w3id.org/ro/wfrun/process/0.5"


def test_stages_are_actions_with_inputs_software_and_outputs(library, made) -> None:
    read = library.ROCrate(made)
    actions = {entity.id: entity for entity in read.get_by_type("CreateAction")}
    assert {each.id for each in read.root_dataset["mentions"]} == set(actions)
    assert {"#calibrate", "#lab_throw-01", "#ingest-01", "#estimate-01", "#plan-02"} <= set(actions)
    ids = {name: {each.id for each in actions["#track-01"][name]} for name in ("object", "result")}
    assert ids["result"] == {
        f"results/small/trial-01/{name}"
        for name in ("clip.json", "observations.parquet", "strobe.webp", "track.json")
    }
    assert {VIDEO, "config/experiments/small.yaml", "results/small/cameras/main.json"} < ids["object"]
    assert VIDEO in {each.id for each in actions["#lab_throw-01"]["result"]}
    # Every result was made by exactly one stage, which noted what it was made from.
    made_by = [each.id for action in actions.values() for each in action["result"]]
    assert len(made_by) == len(set(made_by))
    results = {name for name in files_in(made) if name.startswith("results/")}
    notes = {name for name in results if "/made/" in name}
    assert "results/small/trial-01/made/track.json" in notes
    assert results - notes <= set(made_by)
    software = actions["#estimate-01"]["instrument"]
    assert (software["name"], software["softwareVersion"]) == ("strandcast", strandcast.__version__)
    libraries = {each["name"]: each["softwareVersion"] for each in software["softwareRequirements"]}
    assert libraries["python"] == ".".join(map(str, sys.version_info[:3]))


def test_no_stage_works_on_what_was_made_from_its_results(library, project, tmp_path) -> None:
    root = Path(shutil.copytree(project, tmp_path / "project"))
    for stage in ("lab_throw", "ingest"):  # each trial's `ingest` looks at the other's manifest
        run_stage(stage, root, "small", 2)
    export_crate(strandcast.open(root)["small"], tmp_path / "crate")
    actions = library.ROCrate(tmp_path / "crate").get_by_type("CreateAction")
    maker = {each.id: action.id for action in actions for each in action["result"]}
    before = {
        action.id: {maker[each.id] for each in action["object"] if each.id in maker} for action in actions
    }
    assert {"#ingest-01", "#ingest-02"} < set(before)
    order = list(TopologicalSorter(before).static_order())  # a cycle is a `CycleError`
    assert order.index("#track-01") < order.index("#estimate-01")


@pytest.mark.thorough
def test_the_same_results_give_the_same_bytes(made, project, tmp_path) -> None:
    code = (
        "import sys, pathlib, strandcast\n"
        "from strandcast.exports.crate import export_crate\n"
        "export_crate(strandcast.open(sys.argv[1])['small'], pathlib.Path(sys.argv[2]))"
    )
    for number in "12":
        environment = os.environ | {"PYTHONHASHSEED": number}
        line = [sys.executable, "-c", code, project, tmp_path / f"{number}.zip"]
        subprocess.run(line, env=environment, check=True)
    assert (tmp_path / "1.zip").read_bytes() == (tmp_path / "2.zip").read_bytes()
    with zipfile.ZipFile(tmp_path / "1.zip") as archive:
        assert set(archive.namelist()) == files_in(made)


def test_a_crate_without_video_keeps_its_hash(library, project, tmp_path) -> None:
    export_crate(strandcast.open(project)["small"], tmp_path / "small", without_video=True)
    assert VIDEO not in files_in(tmp_path / "small")
    read = library.ROCrate(tmp_path / "small")
    entity = read.get(f"#{VIDEO}")
    assert entity["sha256"] == sha256_file(project / VIDEO)
    assert f"#{VIDEO}" in {each.id for each in read.get("#track-01")["object"]}


def test_an_unpacked_crate_is_a_project_that_verifies(crate) -> None:
    assert verify(crate, "small") == []
    flip(crate / TRACK)
    (crate / "results/small/trial-01/observations.parquet").unlink()
    flip(crate / VIDEO)
    states = {(each.state, each.file.relative_to(crate).as_posix()) for each in verify(crate, "small")}
    assert {("damaged", TRACK), ("damaged", VIDEO)} <= states
    assert ("missing", "results/small/trial-01/observations.parquet") in states


def flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def test_what_cannot_be_exported_is_refused(library, project, tmp_path, monkeypatch) -> None:
    root = Path(shutil.copytree(project, tmp_path / "project"))
    experiment = strandcast.open(root)["small"]
    (tmp_path / "used").mkdir()
    (tmp_path / "used" / "note").touch()
    with pytest.raises(StrandcastError, match="SC-E005"):
        export_crate(experiment, tmp_path / "used")
    flip(root / VIDEO)
    with pytest.raises(StrandcastError, match="SC-I053") as refused:
        refuse_changed_files(root, "small")
    assert VIDEO in refused.value.message()
    shutil.rmtree(root / "results")
    shutil.rmtree(root / "data" / "small" / "trial-01")
    with pytest.raises(StrandcastError, match="SC-W030"):
        export_crate(experiment, tmp_path / "out.zip")
    monkeypatch.setitem(sys.modules, "rocrate.rocrate", None)
    with pytest.raises(StrandcastError, match=r"SC-W012(.|\n)*strandcast\[crate\]"):
        try:
            export_crate(experiment, tmp_path / "out.zip")
        except StrandcastError as problem:
            raise StrandcastError(problem.code, problem.message()) from None
    assert not (tmp_path / "out.zip").exists()
