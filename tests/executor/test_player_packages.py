"""A robot's computer needs only the packages of requirements/player.lock."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from strandcast.arm.load import load_arm
from strandcast.workflow.project import make_project

from .test_outside_driver import toy_arm
from .test_play import make_motion

__all__ = ["toy_arm"]

# Import nothing but this package, Python's own modules and those of the distributions that are given.
WITH_THESE_ALONE = """
import re, runpy, sys
from importlib.metadata import Distribution, PackageNotFoundError, packages_distributions

def plain(name):
    return re.sub(r"[-_.]+", "-", name).lower()

allowed = {*sys.argv.pop(1).split(","), "strandcast", "toy-arm"}
refused = {
    module for module, names in packages_distributions().items() if not set(map(plain, names)) & allowed
}
listed = Distribution.from_name

def from_name(name):
    if plain(name) not in allowed:
        raise PackageNotFoundError(name)
    return listed(name)

Distribution.from_name = from_name

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name in refused:
            raise ModuleNotFoundError(f"{name} is not installed on the robot's computer", name=name)

sys.meta_path.insert(0, Refuse())
runpy.run_module("strandcast", run_name="__main__")
"""


def locked(project_root: Path) -> set[str]:
    lock = (project_root / "requirements" / "player.lock").read_text()
    return set(re.findall(r"^([a-z0-9-]+)==", lock, re.MULTILINE))


def test_the_lock_holds_the_extra_and_no_workflow(project_root):
    extras = tomllib.loads((project_root / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    packages = locked(project_root)
    assert {name.replace(".", "-") for name in extras["player"]} <= packages
    assert not packages & {"snakemake", "matplotlib", "av", "pandas", "pyarrow", "scikit-image"}
    assert not [name for name in packages if name.startswith("opencv")]


@pytest.mark.usefixtures("toy_arm")  # the lab's own driver films with OpenCV
@pytest.mark.parametrize(
    ("command", "says"),
    [
        ("play planned.json --arm arm.toml --out out --hanging 0.3", "dry run: nothing was sent"),
        pytest.param(
            "export motion planned.json --as ros --arm arm.toml --out goal.json --hanging 0.3",
            "goal.json",
            marks=pytest.mark.thorough,
        ),
    ],
)
def test_the_player_runs_with_the_locked_packages_alone(tmp_path, project_root, command, says):
    make_project(tmp_path / "lab")
    make_motion(load_arm(tmp_path / "arm.toml").planar()).write(tmp_path / "lab" / "planned.json")
    for name in ("arm.toml", "planar3.urdf"):
        (tmp_path / name).rename(tmp_path / "lab" / name)
    line = [sys.executable, "-c", WITH_THESE_ALONE, ",".join(locked(project_root)), *command.split()]
    paths = os.pathsep.join([str(tmp_path / "site"), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = os.environ | {"PYTHONPATH": paths}
    done = subprocess.run(
        line, cwd=tmp_path / "lab", capture_output=True, text=True, check=False, env=environment
    )
    assert done.returncode == 0, done.stderr
    assert says in done.stdout


@pytest.mark.thorough
def test_what_the_player_cannot_do_is_one_message(tmp_path, project_root):
    make_project(tmp_path / "lab")
    line = [sys.executable, "-c", WITH_THESE_ALONE, ",".join(locked(project_root)), "run", "demo"]
    done = subprocess.run(line, cwd=tmp_path / "lab", capture_output=True, text=True, check=False)
    assert done.returncode == 3
    assert done.stderr.startswith("SC-W012 ERROR")
    assert "Traceback" not in done.stderr
