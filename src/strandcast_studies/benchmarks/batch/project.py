"""Projects with batches of recorded experiments: of one throw in the lab, or of stages that do nothing."""

import os
import shutil
import struct
import subprocess
import sys
from pathlib import Path

from ruamel.yaml import YAML

from strandcast.core.trial_names import trial_name
from strandcast.records.folders import own_experiments
from strandcast.stages.context import context_of
from strandcast.stages.declarations import STAGES
from strandcast.stages.made import made_from, write_note
from strandcast.workflow.pending import tasks_of
from strandcast.workflow.project import make_project

DONOR = "demo"


def throw_once(root: Path) -> Path:
    """Make a project, throw the demo once in the lab, and return the folder of its raw files."""
    make_project(root)
    line = [sys.executable, "-m", "strandcast", "run", DONOR, "--until", "lab-throw"]
    subprocess.run(line, cwd=root, check=True)
    return root / "data" / DONOR


def record(root: Path, donor: Path, experiments: int, trials: int) -> None:
    """Add experiments with as many trials of a real rig, all with the recording of a demo.

    A free box at the end of each video makes it another file with the same frames.
    """
    settings = YAML(typ="safe").load(root / "config" / "experiments" / f"{DONOR}.yaml")
    del settings["lab"]
    video = (donor / trial_name(1) / "video.mp4").read_bytes()
    for folder in (root / "data" / f"batch-{number:03d}" for number in range(1, experiments + 1)):
        folder.mkdir(parents=True)
        with (folder / "experiment.yaml").open("w", encoding="utf-8") as out:
            YAML(typ="safe").dump(settings, out)
        shutil.copytree(donor / "calibration", folder / "calibration")
        for trial in range(1, trials + 1):
            shutil.copytree(donor / trial_name(1), folder / trial_name(trial))
            free = struct.pack(">I4sI", 12, b"free", trial)
            (folder / trial_name(trial) / "video.mp4").write_bytes(video + free)


def record_empty(root: Path, experiments: int, trials: int) -> None:
    """Add experiments with as many trials of a real rig, all with empty files, for stages that do nothing."""
    for folder in (root / "data" / f"batch-{number:03d}" for number in range(1, experiments + 1)):
        (folder / "calibration").mkdir(parents=True)
        (folder / "experiment.yaml").write_text("string: {length_m: 0.3}\ntarget_m: [0.5, 0.5]\n")
        for name in ("lens-01.png", "plane.png"):
            (folder / "calibration" / name).touch()
        for trial in range(1, trials + 1):
            (folder / trial_name(trial)).mkdir()
            for name in ("video.mp4", "joints.csv", "run.json", "motion.json", "predicted.parquet"):
                (folder / trial_name(trial) / name).touch()


def python_without_stages(folder: Path) -> Path:
    """Return a Python in a folder with a `python` for the jobs that only writes the outputs of stages.

    Must be called in a virtual environment, which the returned Python shares.
    """
    (folder / "bin").mkdir(parents=True)
    shutil.copy(Path(sys.prefix) / "pyvenv.cfg", folder)
    (folder / "lib").symlink_to(Path(sys.prefix) / "lib")
    (folder / "bin" / "python3").symlink_to(os.path.realpath(sys.executable))
    cases = []
    for name, stage in STAGES.items():
        patterns = [
            p for given in stage.outputs.values() for p in ([given] if isinstance(given, str) else given)
        ]
        files = " ".join(p.format(experiment="$2", trial="$3", camera="main") for p in patterns)
        cases.append(f"{name.replace('_', '-')}) files='{files}';;")
    script = (
        "#!/bin/bash",
        "# python -m strandcast [stage] STAGE EXPERIMENT [TRIAL], or python -IS CLIENT SERVER STAGE ...",
        *("[ $1 = -m ] && shift 2 || shift 3", "[ $1 = stage ] && shift", "case $1 in"),
        *(case.replace("'", '"') for case in cases),
        *("campaign) files=results/report.html;;", "esac", 'for file in $files; do echo > "$file"; done'),
    )
    (folder / "bin" / "python").write_text("\n".join(script) + "\n", encoding="utf-8")
    (folder / "bin" / "python").chmod(0o755)
    return folder / "bin" / "python3"


def note_results(root: Path) -> None:
    """Write the notes of what results were made from, as the stages would have."""
    for name in own_experiments(root):
        context = context_of(root, name)
        for task in tasks_of(context, context.folder.recorded_trials(), {}).values():
            write_note(task.files, made_from(task.files))
