"""Throws with one fault each, as experiments with a real arm: to see whether the trial's page names it.

`python -m strandcast_studies.bad_throws` makes a project with one experiment per case. The virtual lab stands
in for the real rig: it plays the planned motion, films it and writes the log, with a fault that no file of
the project mentions. Everything else is `strandcast run`. The experiments have no `lab:` section and their
names say nothing, so that a page shows what the page of a real throw would show.
"""

import argparse
import re
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML

from strandcast.arm.load import PlanarArm, load_arm
from strandcast.config.experiment import Experiment
from strandcast.config.load import load_experiment
from strandcast.core.box import Box
from strandcast.core.trial_names import trial_name
from strandcast.executor.play import play
from strandcast.executor.preflight import run_preflight
from strandcast.lab.driver import LabDriver, LabThrow
from strandcast.lab.rig import SlipInClamp
from strandcast.lab.scene import PEDESTAL, LabScene, make_scene
from strandcast.lab.strings import PAPER_STRINGS
from strandcast.lab.throw import photograph_boards
from strandcast.workflow.project import make_project

ARM = "planar3"
UNBOUNDED_M = np.array([[-np.inf, np.inf]] * 2)  # a virtual arm can hurt nobody
WORKSPACE_M = {"x_m": [-0.75, 1.25], "y_m": [-0.32, 0.80]}
# Searches smaller than the defaults: what a page says of a fault does not depend on the next plan.
SETTINGS: dict[str, Any] = {
    "title": "A cord with a ball of clay at its end",
    "string": {"length_m": 0.30, "weights": [{"place_m": 0.30}]},
    "arm": ARM,
    "target_m": [0.50, 0.50],
    "seed": 5,
    "workspace_m": WORKSPACE_M,
    "camera": {
        "board": {"squares_x": 7, "squares_y": 5, "square_m": 0.035, "marker_m": 0.026},
        "plane": {
            "size_m": 0.08,
            "markers": [
                {"id": 0, "x_m": -0.65, "y_m": 0.70},
                {"id": 1, "x_m": 0.25, "y_m": 0.72},
                {"id": 2, "x_m": 1.15, "y_m": 0.70},
                {"id": 3, "x_m": -0.65, "y_m": -0.22},
                {"id": 4, "x_m": 0.25, "y_m": -0.24},
                {"id": 5, "x_m": 1.15, "y_m": -0.22},
            ],
        },
    },
    "estimate": {"evaluations": 1500, "profiles": False},
    "plan": {"evaluations": 400},
}


@dataclass(frozen=True)
class BadThrow:
    """One throw: what the files say, what the rig really is, and the cause that the page should name.

    Attributes
    ----------
    cause
        For the reader of this file; no file of the project holds it.
    declared
        Sections of experiment.yaml that differ from SETTINGS.
    truth
        Sections of the experiment as the rig really is, which differ from what is declared.
    urdf, toml
        (pattern, replacement) that turns the declared arm's URDF, or its file, into that of the real arm.
    slip
        How the string slips in the clamp.
    post
        Where in the plane of the throw something hides what is behind it.
    """

    cause: str
    declared: Mapping[str, Any] = field(default_factory=dict)
    truth: Mapping[str, Any] = field(default_factory=dict)
    urdf: tuple[str, str] | None = None
    toml: tuple[str, str] | None = None
    slip: SlipInClamp | None = None
    post: Box | None = None


def _string(length_m: float) -> dict[str, Any]:
    return {"length_m": length_m, "weights": [{"place_m": length_m}]}


CASES: dict[str, BadThrow] = {
    "throw-01": BadThrow("none: a good throw"),
    "throw-02": BadThrow("the string slipped 25 mm out of the clamp", slip=SlipInClamp(0.19, 0.06, 0.025)),
    "throw-03": BadThrow(
        "a post before the target hides the tip", post=Box(x_m=(0.46, 0.62), y_m=(0.46, 0.80))
    ),
    "throw-04": BadThrow(
        "the camera runs at 480 frames/s, the experiment says 500",
        declared={"camera": {**SETTINGS["camera"], "frame_rate_hz": 500.0}},
        truth={"lab": {"camera": {"frame_rate_hz": 480.0}}},
    ),
    "throw-05": BadThrow(
        "the second link is 20 mm longer than the arm's file says",
        urdf=(r'(<joint name="joint_3".*?<origin xyz=")0\.25 ', r"\g<1>0.27 "),
    ),
    "throw-06": BadThrow("the string is 30 mm shorter than declared", declared={"string": _string(0.33)}),
    # The same causes, too small to be refused.
    "throw-07": BadThrow("the string slipped 8 mm out of the clamp", slip=SlipInClamp(0.19, 0.06, 0.008)),
    "throw-08": BadThrow(
        "the camera runs at 495 frames/s, the experiment says 500",
        declared={"camera": {**SETTINGS["camera"], "frame_rate_hz": 500.0}},
        truth={"lab": {"camera": {"frame_rate_hz": 495.0}}},
    ),
    "throw-09": BadThrow(
        "the zero of the second joint is 2 degrees (35 mrad) off",
        urdf=(r'(<joint name="joint_2".*?<origin xyz="0\.30 0 0" rpy=")0 0 0"', r'\g<1>0 -0.035 0"'),
    ),
    "throw-10": BadThrow("the string is 12 mm longer than declared", declared={"string": _string(0.288)}),
}


def _good(number: int) -> BadThrow:
    """Return a good throw of one of the paper's strings."""
    known = PAPER_STRINGS[f"paper-{number}"]
    string = {
        "length_m": known.length_m,
        "weights": [{"place_m": place_m} for place_m, _ in known.weights],
        "stiff_sections": [{"from_m": from_m, "to_m": to_m} for from_m, to_m, _ in known.pipes],
    }
    truth = {"string": string, "lab": {"string": f"paper-{number}"}}
    return BadThrow(f"none: a good throw of string {number}", declared={"string": string}, truth=truth)


CASES |= {f"throw-{10 + number}": _good(number) for number in range(2, 8)}


def make_bad_throws(root: Path, cases: Mapping[str, BadThrow], cores: int, trials: int = 1) -> None:
    """Make the project and, in it, each case's experiment with its throws."""
    if not (root / "Snakefile").exists():
        make_project(root)
    for name, case in cases.items():
        folder = root / "data" / name
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / "experiment.yaml").open("w") as file:
            YAML().dump({**SETTINGS, **case.declared}, file)
        for trial in range(1, trials + 1):
            if (folder / trial_name(trial) / "run.json").exists():
                continue
            rig = real_experiment(load_experiment(folder / "experiment.yaml"), case)
            arm = real_arm(root, case, name)
            if trial == 1:
                photograph_boards(rig, name, arm, folder)
            strandcast_run(root, name, cores)  # plans the motion
            throw(root, name, trial, case, rig, arm)
        strandcast_run(root, name, cores)


def real_experiment(declared: Experiment, case: BadThrow) -> Experiment:
    """Return the experiment as the rig really is."""
    string = {"string": _string(0.30), "lab": {"string": "paper-1"}}
    truth = {key: {**string.get(key, {}), **section} for key, section in (string | dict(case.truth)).items()}
    return Experiment.model_validate({**declared.model_dump(), **truth})


def real_arm(root: Path, case: BadThrow, name: str) -> PlanarArm:
    """Return the arm as it really is; its files are outside config/, which nothing else reads."""
    source = root / "config" / "arms" / f"{ARM}.toml"
    if case.urdf is None and case.toml is None:
        return load_arm(source).planar()
    folder = root / "rig" / name
    folder.mkdir(parents=True, exist_ok=True)
    for file, change in ((source.with_suffix(".urdf"), case.urdf), (source, case.toml)):
        text, count = file.read_text(), 1
        if change is not None:
            text, count = re.subn(*change, text, flags=re.DOTALL)
        if count != 1:
            raise ValueError(f"{name}: the pattern occurs {count} times in {file.name}")
        (folder / file.name).write_text(text)
    return load_arm(folder / source.name).planar()


def throw(root: Path, name: str, trial: int, case: BadThrow, rig: Experiment, arm: PlanarArm) -> None:
    """Play the planned motion on the rig with its fault, and film it."""
    planned = root / "results" / name / trial_name(trial) / "motion.json"
    declared = load_arm(root / "config" / "arms" / f"{ARM}.toml").planar()
    scene = make_scene(rig, name, arm)
    if case.post is not None:
        scene = with_post(scene, case.post)
    truth = root / "rig" / f"{name}-{trial}-truth.parquet"
    driver = LabDriver(LabThrow(name, rig, trial, truth, case.slip), arm, scene)
    out = root / "data" / name / trial_name(trial)
    preflight = run_preflight(planned, replace(declared, box_m=UNBOUNDED_M), driver, out)
    driver.move_to_start(preflight.motion.trajectory().q_rad[0])
    play(preflight, driver, preflight.short_hash)


def with_post(scene: LabScene, post: Box) -> LabScene:
    """Return the scene with something in one grey before a box of the plane of the throw."""
    corners_px = scene.view.pixels(np.array([(x_m, y_m) for x_m in post.x_m for y_m in post.y_m]))
    (left, top), (right, bottom) = (bound.round().astype(int) for bound in np.sort(corners_px, 0)[[0, -1]])
    hidden = slice(max(top, 0), bottom), slice(max(left, 0), right)
    still = scene.still.copy()
    still[hidden] = PEDESTAL
    return replace(scene, still=still, in_front=hidden)


def strandcast_run(root: Path, name: str, cores: int) -> None:
    """Run the pipeline as a user would; a stage that refuses the throw leaves the page that says so."""
    command = [sys.executable, "-m", "strandcast", "run", name, "--cores", str(cores)]
    subprocess.run(command, cwd=root, check=False)


def main(arguments: list[str] | None = None) -> None:
    """Make the throws that are named, or all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", choices=[[], *CASES], default=[], help="default: all")
    parser.add_argument("--root", type=Path, default=Path("results/bad-throws"))
    parser.add_argument("--cores", type=int, default=2)
    given = parser.parse_args(arguments)
    names = given.cases or list(CASES)
    make_bad_throws(given.root, {name: CASES[name] for name in names}, given.cores)
    for name in names:
        print(f"{given.root}/results/{name}/trial-01/report.html: {CASES[name].cause}")


if __name__ == "__main__":
    main()
