"""Every command in the documentation exists with its options, and a test runs it unless it needs a robot."""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import typer
from snakemake.cli import get_argument_parser

import strandcast
from strandcast.cli.app import app
from strandcast.workflow.project import make_project

from ..imports import space_captures
from .pages import ROOT, Command, block_commands, blocks, inline_commands

COMMANDS = block_commands()
WALKS = (
    "bring-a-ur5e",
    "capture-in-space",
    "motion-capture",
    "throw-again",
    "use-a-recorded-throw",
)  # pages of docs/how-to that are run from top to bottom
RUN_BY = {  # the beginning of a command, and the test or script that runs it elsewhere
    "strandcast new": "tests/workflow/test_project.py",
    "strandcast run": "tests/workflow/test_loop.py",
    "strandcast check": "tests/workflow/test_check.py",
    "strandcast estimate": "tests/cli/test_cli.py",
    "strandcast preview": "tests/tracking/test_preview.py",
    "strandcast together": "tests/stages/test_together.py",
    "strandcast strings": "tests/exports/test_strings.py",
    "strandcast compare": "tests/workflow/test_comparison.py",
    "strandcast rig": "tests/stages/test_plan_stage.py",
    "strandcast verify": "tests/cli/test_cli.py",
    "strandcast export": "tests/exports",
    "strandcast import track cast": "tests/stages/test_throw_in_space.py",
    "strandcast film": "tests/film/test_film.py",
    "strandcast simulate": "tests/dynamics/test_physical.py",
    "strandcast plan": "tests/stages/test_throw_in_space.py",
    "strandcast play": "tests/executor",
    "strandcast throw": "tests/workflow/test_sitting.py",
    "snakemake": "tests/workflow/test_loop.py",
    "make demo": "tests/regression",
    "make test": ".ci/run",
    "make paper": "tests/studies",
    "python -m strandcast_studies": "tests/studies",
}
QUICK = """
estimate: {evaluations: 100, profiles: false}
plan: {evaluations: 240}
"""
CAPTURE = """\
import strandcast
trial = strandcast.open(ROOT)["small"].trials[1]
wide = trial.track.pivot(index="camera_time_s", columns="point", values=["x_m", "y_m"])
wide.columns = [f"m{point}_{name[0]}" for name, point in wide.columns]
wide = wide.rename(columns={"m0_x": "hand_x", "m0_y": "hand_y"}).reset_index(names="t")
hand = trial.hand.query("source == 'measured'")
wide["t"] = trial.alignment.robot_time_s(wide["t"])
import numpy
wide["hand_angle"] = numpy.interp(wide["t"], hand["robot_time_s"], hand["angle_rad"])
wide[wide["t"].between(hand["robot_time_s"].min(), hand["robot_time_s"].max())].to_csv("capture.csv")
"""


def place(word: str) -> str:
    """Return a value for a placeholder: a trial's number for TRIAL, any name for others."""
    return "1" if word == "TRIAL" else word.lower() if word.isupper() else word


def parse(words: tuple[str, ...], partial: bool = False) -> None:
    """Parse the words of `strandcast …` as the command line does; `partial`: arguments may be missing."""
    command = typer.main.get_command(app)
    rest, name = list(map(place, words[1:])), "strandcast"
    while hasattr(command, "commands") and rest and not rest[0].startswith("-"):
        name = f"{name} {rest[0]}"
        assert rest[0] in command.commands, f"there is no command `{name}`"
        command = command.commands[rest.pop(0)]
    options = {option for each in command.params for option in (*each.opts, *each.secondary_opts)}
    unknown = {word.split("=")[0] for word in rest if word.startswith("--")} - options - {"--help"}
    assert not unknown, f"`{name}` has no option {sorted(unknown)}"
    if not partial:
        command.make_context(name, rest, resilient_parsing=False)


def check(command: Command, partial: bool) -> None:
    words = command.words
    if words[0] == "strandcast":
        parse(tuple(word for word in words if word != "..."), partial or "..." in words or "COMMAND" in words)
    elif words[0] == "make":
        targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
        assert words[1] in targets, f"there is no target {words[1]}"
    elif words[0] == "snakemake":
        get_argument_parser().parse_args(list(words[1:]))
    elif words[1] == "-m":
        assert importlib.util.find_spec(words[2]) is not None, f"there is no module {words[2]}"


def test_the_documentation_has_commands():
    assert len(COMMANDS) > 50
    assert sum(command.robot for command in COMMANDS) > 4


@pytest.mark.parametrize("command", sorted(set(COMMANDS)), ids=str)
def test_a_command_of_a_block_is_valid(command):
    check(command, partial=False)


@pytest.mark.parametrize("command", sorted(set(inline_commands())), ids=str)
def test_a_command_in_the_text_exists(command):
    if "COMMAND" not in command.words and "--install-completion" not in command.words:
        check(command, partial=True)


def test_every_command_is_run_or_needs_a_robot():
    walked = {f"docs/how-to/{page}.md" for page in WALKS}
    left = [
        str(command)
        for command in COMMANDS
        if not command.robot
        and command.page not in walked
        and not any(" ".join(command.words).startswith(begins) for begins in RUN_BY)
    ]
    assert left == [], f"mark the block with {'<!-- robot -->'}, or run it in a test"
    assert [each for each in RUN_BY.values() if not (ROOT / each).exists()] == []


@pytest.fixture
def walk(tmp_path):
    """Return a function that runs the blocks of a page as a reader would, without installing packages."""
    shim = tmp_path / "bin" / "strandcast"
    shim.parent.mkdir()
    shim.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m strandcast "$@"\n')
    shim.chmod(0o755)
    path = f"{shim.parent}{os.pathsep}{os.environ['PATH']}"

    def run(page: str, folder: Path, after: dict[str, str], **replaced: str) -> str:
        """Run a page; `after`: lines for the shell after a line that contains a text."""
        lines = ["set -euo pipefail"]
        for text, robot in blocks(ROOT / "docs" / "how-to" / f"{page}.md"):
            known = r"(strandcast|cp|cd|sed|mkdir) "
            if robot or not re.match(rf"{known}|pip ", text):
                continue
            for line in text.replace("\\\n", " ").splitlines():
                if re.match(known, line):
                    lines += [line, *(more for word, more in after.items() if word in line)]
        script = "\n".join(lines)
        for old, new in replaced.items():
            script = re.sub(rf"\b{old}\b", new, script)
        environment = os.environ | {"PATH": path, "PYTHONPATH": str(ROOT / "src")}
        done = subprocess.run(
            ["bash", "-c", script], cwd=folder, env=environment, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return run


@pytest.fixture
def lab(tmp_path, finished) -> Path:
    folder = tmp_path / "lab"
    make_project(folder)
    shutil.copytree(finished, folder, dirs_exist_ok=True)
    return folder


@pytest.mark.thorough
def test_a_ur5e_is_brought_to_its_dry_run(walk, tmp_path):
    out = walk(
        "bring-a-ur5e", tmp_path, {"cp config/examples": f"echo '{QUICK}' >> data/cord/experiment.yaml"}
    )
    assert "cord: 2 warnings" in out
    assert "plane-markers.pdf" in out
    assert "dry run: nothing was sent" in out


@pytest.mark.thorough
def test_a_recorded_throw_gets_its_verdict(walk, lab):
    page = (ROOT / "docs/how-to/use-a-recorded-throw.md").read_text()
    (settings,) = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    (mapping,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    (lab / "tuesday.yaml").write_text(settings + QUICK)
    (lab / "columns.toml").write_text(mapping)
    log = pd.read_csv(lab / "data/small/trial-01/joints.csv")
    columns = {"t_ms": 1e3 * log["controller_time_s"]}
    for name, of in (("cmd", "q_cmd"), ("act", "q")):
        columns |= {f"{name}_{'abc'[k]}": np.degrees(log[f"{of}_joint_{k + 1}_rad"]) for k in range(3)}
    pd.DataFrame(columns).to_csv(lab / "throw_log.csv", index=False)
    copied = (
        "cp data/small/calibration/* data/tuesday/calibration/",
        *(f"cp data/small/trial-01/{name} data/tuesday/trial-01/" for name in ("video.mp4", "motion.json")),
        "cp tuesday.yaml data/tuesday/experiment.yaml",
    )
    out = walk("use-a-recorded-throw", lab, {"mkdir": "\n".join(copied)})
    assert "tuesday: nothing is wrong" in out
    small = strandcast.load(lab / "results/small/trial-01/verdict.json")
    found = strandcast.load(lab / "results/tuesday/trial-01/verdict.json")
    assert found.miss_m == pytest.approx(small.miss_m, abs=2e-3)
    assert (lab / "results/tuesday/trial-02/motion.json").is_file()


@pytest.mark.thorough
def test_a_string_is_fitted_to_a_csv(walk, tmp_path, lab):
    page = (ROOT / "docs/how-to/motion-capture.md").read_text()
    (lab / "data/mocap").mkdir()
    (settings,) = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    (lab / "data/mocap/experiment.yaml").write_text(settings + QUICK)
    code = CAPTURE.replace("ROOT", repr(str(lab)))
    subprocess.run([sys.executable, "-c", code], cwd=lab, check=True)
    out = walk("motion-capture", lab, {})
    assert "10 mass points" in out
    assert "mocap: nothing is wrong" in out
    assert (lab / "results/mocap/trial-01/estimate.json").is_file()
    assert (lab / "results/mocap/report.html").is_file()


@pytest.mark.thorough
def test_a_cable_in_space_is_fitted(walk, tmp_path):
    folder = tmp_path / "lab"
    make_project(folder)
    named = space_captures.columns(0.2, seconds=1.5)
    for old, new in (("hand_behind", "base"), ("m2", "m1"), ("m4", "m2")):
        named |= {f"{new}.{axis}": named[f"{old}.{axis}"] for axis in "xyz"}
    space_captures.write_csv(folder / "capture-1.csv", named)
    page = (ROOT / "docs/how-to/capture-in-space.md").read_text()
    (settings,) = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    quick = settings + "estimate: {evaluations: 100}\n"
    out = walk("capture-in-space", folder, {"mkdir": f"echo '{quick}' > data/cable/experiment.yaml"})
    assert "trial 1: 75 samples, 2 markers in space" in out
    assert re.search(r"trial 1: fitted to E = \d", out)
    assert (folder / "results/cable/trial-01/report.html").is_file()


@pytest.mark.thorough
def test_a_throw_is_excluded_and_included_again(walk, lab):
    settings = lab / "config/experiments/small.yaml"
    before = settings.read_text()
    (lab / "data/small/experiment.yaml").write_text(before)
    out = walk("throw-again", lab, {}, cord="small", **{"small 2": "small 1"})
    assert "run.json is no longer an input" in out
    assert (lab / "data/small/experiment.yaml").read_text() == before
