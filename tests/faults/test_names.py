"""Rows 77, 79 and 80 of the fault list: names that are commands, twins or too long; pickled files."""

import os
import pickle
import shutil
import subprocess
import unicodedata
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.forked import run_module

import strandcast
from strandcast.arm.load import load_arm
from strandcast.config.find import find_experiment
from strandcast.config.load import load_experiment
from strandcast.errors import StrandcastError
from strandcast.imports.joints import import_joints
from strandcast.imports.mapping import JointMapping, load_mapping
from strandcast.records.joint_log import read_run
from strandcast.video.ingest import inspect_video
from strandcast.video.isolated import read_photos

from .conftest import write_film

GOOD = "string: {length_m: 0.3}\ntarget_m: [0.5, 0.5]\n"
COMMANDS = ["$(touch run)", "`touch run`", "a;touch run", "a b", "a'b", 'a"b', "a\nb", "-rf", "{experiment}"]
CAFE = [unicodedata.normalize(form, "café") for form in ("NFC", "NFD")]
TWINS = [*CAFE, "Demo", "DEMO", "ｄemo", "dem\u043e", "x" * 65, "x" * 255]


@pytest.fixture
def root(tmp_path: Path, project_root: Path) -> Path:
    """Return a project with one good experiment, beside which a test puts another one."""
    for name in ("workflow", "config"):
        shutil.copytree(project_root / name, tmp_path / name)
    shutil.copy(project_root / "Snakefile", tmp_path)
    add_experiment(tmp_path, "demo")
    return tmp_path


def add_experiment(root: Path, name: str) -> None:
    folder = root / "data" / name / "trial-01"
    folder.mkdir(parents=True)
    (folder.parent / "experiment.yaml").write_text(GOOD)
    write_film(folder / "video.mp4")


def run_in(root: Path, *command: str) -> subprocess.CompletedProcess[str]:
    done = run_module(root, *command)
    assert "Traceback" not in done.stderr, done.stderr
    return done


@pytest.mark.parametrize("name", COMMANDS + TWINS)
def test_rows77_and_79_an_experiment_of_another_name_is_refused(root: Path, name: str) -> None:
    add_experiment(root, name)
    with pytest.raises(StrandcastError, match="SC-R032"):
        find_experiment(name, root)
    assert find_experiment("demo", root) == root / "data/demo/experiment.yaml"


def test_row77_no_command_is_run(root: Path) -> None:
    name = "$(touch run) `touch run`; touch run"
    add_experiment(root, name)
    done = run_in(root, "strandcast", "run")
    assert done.returncode == 2
    assert "SC-R032" in done.stderr
    for target in (f"results/{name}/report.html", f"results/{name}/trial-01/manifest.json"):
        done = run_in(root, "snakemake", target, "--cores", "1")
        assert done.returncode == 1
        assert "Missing" in done.stderr
    assert list(root.rglob("run")) == []


def test_row79_a_name_of_64_letters_can_be_used(root: Path) -> None:
    add_experiment(root, "x" * 64)
    assert load_experiment(find_experiment("x" * 64, root)).string.length_m == 0.3


class Harmful:
    """What runs a command when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self.mark),)


def read_trials_run(path: Path) -> None:
    read_run(path.parent)


READERS: list[tuple[str, Callable[[Path], object]]] = [
    ("run.json", read_trials_run),
    ("verdict.json", strandcast.load),
    ("joints.csv", strandcast.load),
    ("track.parquet", strandcast.load),
    ("experiment.yaml", load_experiment),
    ("arm.toml", load_arm),
    ("columns.yaml", lambda path: load_mapping(path, JointMapping)),
    ("log.csv", lambda path: import_joints(path, path.parent / "out")),
    *((f"video.{kind}", inspect_video) for kind in ("mp4", "avi", "tif", "mraw", "cine")),
]


@pytest.mark.parametrize("protocol", [0, 5])
@pytest.mark.parametrize(("name", "read"), READERS, ids=[name for name, _ in READERS])
def test_row80_a_pickle_is_never_loaded(
    tmp_path: Path, name: str, read: Callable[[Path], object], protocol: int
) -> None:
    mark = tmp_path / "mark"
    path = tmp_path / name
    path.write_bytes(pickle.dumps(Harmful(mark), protocol))
    with pytest.raises(StrandcastError, match=r"SC-[A-Z]\d{3}"):
        read(path)
    assert not mark.exists()
    pickle.loads(path.read_bytes())
    assert mark.exists()  # the file does what it is feared for


def test_row80_a_pickle_is_no_photo(tmp_path: Path) -> None:
    path = tmp_path / "photo.png"
    path.write_bytes(pickle.dumps(Harmful(tmp_path / "mark")))
    assert list(read_photos([path], 0)) == [None]
    assert not (tmp_path / "mark").exists()
