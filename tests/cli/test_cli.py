"""The command line: one clear message and the right exit code; each command imports only what it needs."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer
from tests.forked import run_module

from strandcast.cli.app import CARE, DAILY, EXCHANGE, SET_UP, app
from strandcast.cli.app import STAGES as SINGLE
from strandcast.cli.stages import stage_commands
from strandcast.stages.declarations import STAGES
from strandcast_studies.commands_page import commands_page

GROUPS = {DAILY, SET_UP, CARE, SINGLE, EXCHANGE}


@pytest.fixture
def root(tmp_path, project_root) -> Path:
    shutil.copytree(project_root / "config", tmp_path / "config")
    return tmp_path


def strandcast(root: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return run_module(root, "strandcast", *arguments)


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["check", "dmeo"], 2, "did you mean 'demo'?"),
        (["estimate", "demo", "1"], 2, "make it first: strandcast stage reconstruct demo 1"),
        (["stage", "ingest", "demo", "1"], 2, "make it first: strandcast stage lab-throw demo 1"),
        (["stage", "lab-throw", "demo", "1"], 2, "make it first: strandcast plan demo 1"),
        (["exclude", "demo", "2", "--reason", "x"], 2, "there is no trial 2"),
        (["exclude", "demo", "1"], 2, "Missing option '--reason'"),
        (["status", "dmeo"], 2, "did you mean 'demo'?"),
        (["check", "../x"], 2, "is not a valid name of an experiment"),
        (["run", "demo"], 3, "no project is here"),
        (["play", "nothing.json", "--arm", "config/arms/planar3.toml", "--out", "x"], 2, "nothing.json"),
        (["import", "joints", "demo", "1", "nothing.csv"], 4, "nothing.csv"),
        (["estimate", "demo", "0"], 2, "TRIAL"),
        (["stage", "ingest", "demo", "100"], 2, "make it first: strandcast stage lab-throw demo 100"),
        (["estimate", "demo", "1000000"], 2, "less than or equal to 999999"),
        (["run", "demo", "--jobs", "3", "--cores", "2"], 2, "3 jobs need at least 3 cores"),
        (["run", "--report-only", "--profile", "slurm"], 2, "goes with no stage, profile or dry run"),
        (["run", "demo", "--until"], 2, "strandcast run: Option '--until' requires an argument"),
        (["rn"], 2, "Did you mean 'run'?"),
        (["explain", "42"], 2, "`strandcast docs errors`"),
        (["docs", "how-to/instal"], 2, "did you mean how-to/install?"),
        (["estimate"], 2, "Missing argument 'EXPERIMENT'"),
        (["check", "demo", "--jsn"], 2, "No such option: --jsn"),
    ],
)
def test_a_users_error_is_one_message(root, arguments, code, words):
    run = strandcast(root, *arguments)
    assert run.returncode == code, run.stderr
    assert words in run.stderr
    assert "Traceback" not in run.stderr
    assert run.stderr.count("SC-") == run.stderr.count("Fix:") == 1
    assert run.stdout == ""


@pytest.mark.parametrize(
    ("stage", "words"),
    [
        ("estimate", "import motion capture (strandcast import track swung 1 FILE.csv)"),
        ("plan", "data/swung/experiment.yaml: target_m: the experiment has no target"),
        ("run --until estimate", "import its recording: strandcast import track swung 1 FILE.csv"),
    ],
)
def test_without_a_recording_and_a_target_the_message_says_how_to_begin(root, stage, words):
    (root / "Snakefile").touch()
    (root / "data" / "swung").mkdir(parents=True)
    (root / "data" / "swung" / "experiment.yaml").write_text("string: {length_m: 0.3}\n")
    command, *options = stage.split()
    run = strandcast(root, command, "swung", *(options or ["1"]))
    assert run.returncode == 2
    assert words in run.stderr
    status = strandcast(root, "status", "swung")
    assert "next: # import a recording: strandcast import track swung 1 FILE.csv" in status.stdout


@pytest.mark.parametrize(
    ("arguments", "code", "problem"),
    [
        (["verify", "dmeo", "--json"], 2, "SC-F001"),
        (["estimate", "demo", "x", "--json"], 2, "SC-W020"),
        (["estimate", "demo", "1", "--json"], 2, "SC-W030"),
    ],
)
def test_with_json_an_error_is_one_object(root, arguments, code, problem):
    run = strandcast(root, *arguments)
    printed = json.loads(run.stdout)
    assert (printed["code"], printed["exit_code"], run.returncode) == (problem, code, code)
    assert printed["message"]
    assert printed["fix"]
    assert {"file", "field", "line", "cost"} < set(printed)


def test_several_errors_are_one_object(root):
    path = root / "config" / "experiments" / "demo.yaml"
    path.write_text("string: {length_m: 300}\nsede: 3\n")
    printed = json.loads(strandcast(root, "verify", "demo", "--json", "--", "--json").stdout)
    assert printed["code"] == "SC-R032"  # after `--`, an experiment of that name
    printed = json.loads(strandcast(root, "boards", "demo", "--json").stdout)
    assert {each["field"] for each in printed["problems"]} >= {"string.length_m", "sede"}


def commands() -> Iterator[tuple[str, ...]]:
    """Yield the names of all commands, and of those within commands."""
    for name, command in typer.main.get_command(app).commands.items():
        inner = getattr(command, "commands", None)
        yield from ((name, each) for each in inner) if inner else [(name,)]


@pytest.mark.parametrize(
    "command", [each for each in commands() if each not in (("check",), ("throw",))], ids=" ".join
)
def test_every_command_has_json_and_a_group(command):
    found = typer.main.get_command(app)
    for name in command:
        found = found.commands[name]
    assert "--json" in {option for each in found.params for option in each.opts}
    assert found.help
    assert len(command) == 2 or found.rich_help_panel in GROUPS


def test_the_page_of_commands_is_current(project_root):
    page = (project_root / "docs" / "reference" / "commands.md").read_text(encoding="utf-8")
    assert page == commands_page(), (
        "run: python -m strandcast_studies.commands_page > docs/reference/commands.md"
    )


def completed(root: Path, words: str) -> list[str]:
    """Return what bash would offer at the end of a command line."""
    asked = {
        "_STRANDCAST_COMPLETE": "complete_bash",
        "COMP_WORDS": words,
        "COMP_CWORD": str(words.count(" ")),
    }
    return run_module(root, "strandcast", environment=os.environ | asked).stdout.split()


def test_names_and_trials_are_completed(root):
    (root / "data/rope/trial-03").mkdir(parents=True)
    (root / "data/rope/experiment.yaml").touch()
    (root / "results/rope/trial-12").mkdir(parents=True)
    assert completed(root, "strandcast run ro") == ["rope"]
    assert completed(root, "strandcast track d") == ["demo"]
    assert completed(root, "strandcast track rope ") == ["3", "12"]
    assert completed(root, "strandcast veri") == ["verify"]


def test_check_and_schema(root):
    assert "arm planar3" in strandcast(root, "check", "demo").stdout
    schema = (root / "config" / "experiment.schema.json").read_text()
    assert strandcast(root, "docs", "schema").stdout == schema


def test_every_declared_stage_has_a_command():
    assert {name.replace("-", "_") for name in stage_commands()} | {"summary"} == set(STAGES)


@pytest.mark.parametrize(
    ("old", "new"),
    [("schema", "docs schema"), ("unlock demo", "run --unlock demo"), ("score demo 1", "stage score demo 1")],
)
def test_a_former_command_runs_with_a_line_that_gives_the_new_one(root, old, new):
    before, after = strandcast(root, *old.split()), strandcast(root, *new.split())
    assert (before.returncode, before.stdout) == (after.returncode, after.stdout)
    named = f"warning: strandcast {old.split()[0]} is now strandcast {new.partition(' demo')[0]};"
    assert before.stderr.startswith(named)
    assert before.stderr.partition("\n")[2] == after.stderr


def test_a_renamed_setting_is_one_warning(root):
    path = root / "config" / "experiments" / "demo.yaml"
    path.write_text(path.read_text() + "track: {hand: marker}\n")
    run = strandcast(root, "check", "demo")
    assert run.returncode == 0
    assert run.stderr.startswith("warning: config/experiments/demo.yaml:")
    assert "track.hand is now called track.tracker" in run.stderr
    assert len(run.stderr.splitlines()) == 1


def test_boards_are_printed_at_true_size(root):
    run = strandcast(root, "boards", "demo")
    assert run.returncode == 0, run.stderr
    assert run.stdout.split() == [
        "results/demo/boards/lens-board.pdf",
        "results/demo/boards/plane-markers.pdf",
        "results/demo/boards/hand-markers-50mm.pdf",
    ]
    assert all((root / file).read_bytes().startswith(b"%PDF") for file in run.stdout.split())


# The words after "+" name packages, which every later stage may import; each stage is imported in a fork.
IMPORTS = """
import importlib, os, sys
for stage in sys.argv[1:]:
    if stage[0] == "+":
        importlib.import_module(stage[1:])
    elif os.fork():
        assert os.wait()[1] == 0
    else:
        importlib.import_module(f"strandcast.stages.{stage}")
        print(stage, *sys.modules, flush=True)
        os._exit(0)
"""


def test_a_stage_imports_only_what_it_needs():
    heavy = {"cv2", "numba", "scipy", "pandas", "matplotlib", "mujoco", "av", "skimage"}
    forbidden = {
        "score": heavy,
        "register_track": heavy,
        "ingest": heavy - {"av"},
        "track": {"pandas", "matplotlib"},
        "align": {"cv2", "pandas", "matplotlib", "av"},
        "estimate": {"cv2", "pandas", "av", "skimage"},
        "plan": {"cv2", "pandas", "av", "skimage"},
        "report": {"pandas", "av", "skimage"},
    }
    first, then = list(forbidden)[:3], list(forbidden)[3:]
    order = ["+numpy", "+pydantic", "+pyarrow", *first, "+numba", "+scipy.optimize", *then]
    run = subprocess.run([sys.executable, "-c", IMPORTS, *order], capture_output=True, text=True, check=True)
    found = {stage: {*modules} for stage, *modules in map(str.split, run.stdout.splitlines())}
    assert {stage: modules & forbidden[stage] for stage, modules in found.items()} == {
        stage: set() for stage in forbidden
    }


def test_help_and_completion_import_no_package_that_computes():
    code = "import sys, strandcast.cli.app; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (
        set(run.stdout.split()) & {"cv2", "numba", "numpy", "pandas", "pyarrow", "pydantic", "scipy"} == set()
    )


def test_the_manual_comes_along(root):
    listed = strandcast(root, "docs")
    assert "tutorial " in listed.stdout
    page = strandcast(root, "docs", "docs/how-to/install.md#install")  # as messages name it
    assert page.stdout.startswith("# Install\n")
    assert '\nname = "planar3"\n' in strandcast(root, "docs", "reference/arm-file").stdout  # included
    for code in ("SC-A012 ERROR", "a013"):  # the second is a former one
        said = strandcast(root, "explain", code).stdout
        assert said.startswith("SC-A012: Joint log and arm's file differ in joint names")
        assert "\nFix: Import the log again, with" in said


def test_the_help_names_no_types_of_python(root):
    for command in (["run"], ["stage", "summary"], ["import", "joints"]):
        shown = strandcast(root, *command, "--help").stdout
        assert "Usage: strandcast" in shown
        assert not re.search(r"<bool>|<list|\]\.\.\.\]", shown)
