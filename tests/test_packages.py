"""An installed package that does not work is one message with the fix, in `doctor` and in every command."""

import importlib.metadata
import json
import os
import subprocess
import sys
import sysconfig
import tomllib
from pathlib import Path

import pytest

from strandcast import packages
from strandcast.packages import OPENCV, PROBES, broken_package, fault_of
from strandcast.workflow import doctor, event_log
from strandcast.workflow.project import make_project


def run_without(tmp_path: Path, emptied: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a command where of one package only a folder without code is left, and all others are as here."""
    site = tmp_path / "site"
    site.mkdir(exist_ok=True)
    for path in Path(sysconfig.get_path("purelib")).iterdir():
        if path.name != emptied:
            (site / path.name).symlink_to(path)
    (site / emptied / "data").mkdir(parents=True)
    make_project(tmp_path / "lab")
    source = Path(packages.__file__).parents[1]
    return subprocess.run(
        [sys.executable, "-S", "-m", "strandcast", *arguments],  # without the site-packages of this Python
        cwd=tmp_path / "lab",
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(source), str(site)])},
    )


def test_every_required_package_has_a_probe(project_root):
    required = tomllib.loads((project_root / "pyproject.toml").read_text())["project"]["dependencies"]
    assert list(PROBES) == [packages.requirement_name(each) for each in required]


def test_every_required_package_works_here():
    assert {name: fault for name in PROBES if (fault := fault_of(name)) is not None} == {}
    assert broken_package(AttributeError("of our own")) is None


def test_an_emptied_folder_is_found_by_doctor(tmp_path):
    run = run_without(tmp_path, "cv2", "doctor", "--json")
    assert run.returncode == 3, run.stderr
    (found,) = [each for each in json.loads(run.stdout)["checks"] if each["state"] == "problem"]
    version = importlib.metadata.version(OPENCV)
    assert f"{OPENCV} {version} does not work: of cv2 only folders without code are left" in found["found"]
    assert found["fix"].endswith(f" --force-reinstall --no-deps {OPENCV}=={version}")


@pytest.mark.parametrize(
    ("emptied", "package", "command"),
    [("cv2", OPENCV, "boards demo"), ("typer", "typer", "--version")],
)
def test_a_command_that_needs_what_is_broken_ends_in_one_message(tmp_path, emptied, package, command):
    run = run_without(tmp_path, emptied, *command.split())
    assert run.returncode == 3, run.stderr
    assert run.stderr.count("SC-W013 ERROR") == 1
    assert f"--no-deps {package}==" in run.stderr
    assert "Traceback" not in run.stderr


def test_a_broken_snakemake_is_one_message_of_the_run(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "snakemake.cli", None)
    with pytest.raises(SystemExit) as end:
        event_log.main()
    assert end.value.code == 3
    said = capsys.readouterr().err
    assert said.startswith("SC-W013 ERROR  snakemake ")
    assert "--no-deps snakemake==" in said


def installed(monkeypatch, *others: str) -> None:
    """Let other distributions of OpenCV be in the list of installed packages."""
    actual = packages.installed_version
    monkeypatch.setattr(packages, "installed_version", lambda name: "1.0" if name in others else actual(name))


def test_another_opencv_in_the_same_folder_is_named(monkeypatch, tmp_path):
    assert list(doctor._opencv(tmp_path)) == []
    installed(monkeypatch, "opencv-python")
    (found,) = doctor._opencv(tmp_path)
    assert found.state == "note"
    assert f"{OPENCV} was installed last" in found.found
    assert "uninstall --yes opencv-python && " in found.fix


def test_an_opencv_without_its_contributed_modules_is_a_fault(monkeypatch):
    import cv2

    installed(monkeypatch, "opencv-python", "opencv-contrib-python")
    monkeypatch.delattr(cv2.ximgproc, "thinning")
    found = fault_of(OPENCV)
    assert found is not None
    assert "opencv-python and opencv-contrib-python, in the same folder, may have replaced it" in found.why
    assert "uninstall --yes opencv-python opencv-contrib-python && " in found.fix
    monkeypatch.setattr("cv2.version.contrib", False)
    assert not packages.is_own_opencv()


def test_a_fault_of_a_package_that_another_needs_is_repaired_there(monkeypatch):
    def refuse(module: object) -> None:
        raise ImportError("cannot import name 'x' from 'llvmlite'", name="llvmlite.binding")

    monkeypatch.setitem(PROBES, "numba", ("numba", refuse))
    problem = broken_package(ImportError("as the command met it"))
    assert problem is not None
    assert problem.what.startswith("numba ")
    assert problem.fix.endswith(f"--no-deps llvmlite=={importlib.metadata.version('llvmlite')}")


def test_an_environment_without_pip_is_repaired_by_uv(monkeypatch):
    monkeypatch.setattr(packages.importlib.util, "find_spec", lambda name: None)
    installed(monkeypatch, "opencv-python")
    line = packages.reinstall(OPENCV)
    first, then = line.split(" && ")
    assert first == f"uv pip uninstall --python {sys.executable} opencv-python"
    assert then.startswith(f"uv pip install --python {sys.executable} --force-reinstall --no-deps {OPENCV}==")
