"""Shared by all rules: the experiments and trials that there are, and where their files lie."""

import os
import re
import shlex
import sys
import tomllib
from functools import cache
from pathlib import Path

from strandcast.errors import StrandcastError
from strandcast.experiment import Experiment, find_arm, find_experiment, load_experiment
from strandcast.layout import ExperimentFolder, trial_name
from strandcast.records.summary import Verdict
from strandcast.stages.depends import code_version, settings

ROOT = Path(".")

# Jobs run with the Python that runs Snakemake; one thread in the libraries, so that the bytes do not depend on cores.
PYTHON_FOLDER = shlex.quote(str(Path(sys.executable).parent))
shell.prefix(
    f"set -euo pipefail; export PATH={PYTHON_FOLDER}:$PATH OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1; "
)


def stop(error):
    """End with the message that a user can act on, without Snakemake's traceback."""
    sys.stderr.write(f"{error}\n")
    os._exit(error.exit_code)


@cache
def experiment(name) -> Experiment:
    """Return an experiment's settings; everything wrong with them is told before any job starts."""
    try:
        return load_experiment(find_experiment(name, ROOT))
    except StrandcastError as error:
        stop(error)


def known_experiments():
    """Return the names of all experiments: those under data/, and those that ship."""
    own = {path.parent.name for path in ROOT.glob("data/*/experiment.yaml")}
    return sorted(own), sorted(
        path.stem for path in ROOT.glob("config/experiments/*.yaml")
    )


def is_lab(name):
    """Return whether the lab throws an experiment; one that is not valid is told when it is asked for."""
    try:
        return load_experiment(find_experiment(name, ROOT)).lab is not None
    except StrandcastError:
        return False


def names_pattern(names):
    """Return a wildcard's pattern for just these names."""
    return "|".join(map(re.escape, names)) or "(?!)"


def folder(name):
    return ExperimentFolder(ROOT, name)


def arm_files(wildcards):
    """Return the arm's file and its URDF."""
    name = wildcards.experiment
    try:
        path = find_arm(experiment(name), find_experiment(name, ROOT), ROOT)
    except StrandcastError as error:
        stop(error)
    try:
        urdf = path.parent / tomllib.loads(path.read_text(encoding="utf-8"))["urdf"]
    except (OSError, ValueError, KeyError, TypeError):
        return [str(path)]  # the stage tells what is wrong with it
    return [str(path), *([str(urdf)] if urdf.is_file() else [])]


def stage_settings(stage):
    """Return a params function: the part of experiment.yaml that a stage reads."""
    return lambda wildcards: settings(experiment(wildcards.experiment), stage)


def counted(name, trials):
    """Return the trials that are not excluded."""
    return [
        number for number in trials if experiment(name).excluded_reason(number) is None
    ]


def earlier(wildcards):
    """Return the counted trials before this one."""
    return counted(wildcards.experiment, range(1, int(wildcards.trial)))


def so_far(wildcards):
    """Return the counted trials up to this one; this one also when it is excluded."""
    number = int(wildcards.trial)
    return [*counted(wildcards.experiment, range(1, number)), number]


def results_of(name, trials, *files):
    """Return result files of trials."""
    return [
        f"results/{name}/{trial_name(number)}/{file}"
        for number in trials
        for file in files
    ]


def played_motions(name, trials):
    """Return the motions that were played; an imported trial may have none."""
    if experiment(name).lab:
        return [f"data/{name}/{trial_name(number)}/motion.json" for number in trials]
    found = (folder(name).trial(number).played_motion for number in trials)
    return [str(path) for path in found if path]


def raw_log(wildcards):
    """Return a trial's joint log, where it has one."""
    return logs(wildcards.experiment, [int(wildcards.trial)])


def logs(name, trials):
    """Return the joint logs of trials, where there are such."""
    folders = [folder(name).trial(number).data for number in trials]
    there = [
        path for path in folders if experiment(name).lab or (path / "run.json").exists()
    ]
    return [str(path / file) for path in there for file in ("joints.csv", "run.json")]


def raw_video(wildcards):
    """Return the files of the trial's video; the lab's is called video.mp4 before it exists."""
    if experiment(wildcards.experiment).lab:
        return [f"data/{wildcards.experiment}/trial-{wildcards.trial}/video.mp4"]
    try:
        trial = folder(wildcards.experiment).trial(int(wildcards.trial))
        return [str(path) for path in trial.video_files()]
    except StrandcastError as error:
        stop(error)


def raw_files(wildcards):
    """Return what was recorded: video, joint log, played motion; a video without a robot stands alone."""
    name, files = wildcards.experiment, ("joints.csv", "run.json", "motion.json")
    trial = folder(name).trial(int(wildcards.trial))
    wanted = [
        file for file in files if experiment(name).lab or (trial.data / file).exists()
    ]
    return [*raw_video(wildcards), *(str(trial.data / file) for file in wanted)]


def calibration_files(wildcards):
    """Return the board photos and the plane's; or the pendulum whose arc gives the scale."""
    name = wildcards.experiment
    if experiment(name).camera.scale == "arc":
        return [f"results/{name}/trial-01/manifest.json"]
    return [
        *lens_photos(wildcards),
        f"data/{name}/{experiment(name).camera.plane_photo}",
    ]


def background_file(wildcards):
    """Return the picture of the empty scene, where the experiment gives one."""
    name = wildcards.experiment
    picture = experiment(name).track.background_picture
    return [f"data/{name}/{picture}"] if picture else []


def lens_photos(wildcards):
    """Return the board photos, or the board's video; the lab's photos are named before they exist."""
    name = wildcards.experiment
    if experiment(name).camera.lens_video:
        return [f"data/{name}/{experiment(name).camera.lens_video}"]
    if experiment(name).lab:
        return [
            f"data/{name}/calibration/lens-{number:02d}.png" for number in range(1, 13)
        ]
    return sorted(map(str, folder(name).data.glob(experiment(name).camera.lens_photos)))


def recorded(name):
    """Return the trials of a real experiment that hold a recording."""
    trials = (
        (number, folder(name).trial(number))
        for number in folder(name).recorded_trials()
    )
    return [
        number
        for number, trial in trials
        if trial.has_video() or (trial.data / "track.parquet").exists()
    ]


def first_motion(wildcards):
    """Return the motion to begin with, for a real experiment that has thrown nothing yet."""
    name = wildcards.experiment
    begun = experiment(name).lab or recorded(name)
    return [] if begun else results_of(name, [1], "motion.json")


def trials(name):
    """Return the trials of an experiment: those that were recorded, or in the lab, until a hit.

    In the lab the number is not known ahead; each verdict is a checkpoint that says whether to go on.
    """
    if not experiment(name).lab:
        return recorded(name)
    thrown = []
    for number in range(1, experiment(name).max_trials + 1):
        thrown.append(number)
        if counted(name, [number]):
            verdict = checkpoints.judge.get(
                experiment=name, trial=f"{number:02d}"
            ).output.verdict
            if Verdict.read(verdict).hit and number >= experiment(name).min_trials:
                break
    return thrown


def trial_results(wildcards):
    """Return what the page of one trial shows; an excluded trial shows its reason."""
    name, number = wildcards.experiment, int(wildcards.trial)
    if not counted(name, [number]):
        return []
    supplied = (folder(name).trial(number).data / "track.parquet").is_file()
    filmed = [] if supplied else ["manifest.json", "strobe.webp"]
    camera = [] if supplied else [f"results/{name}/camera.json"]
    # What was not thrown by a motion of ours cannot be planned on.
    planned = not supplied or played_motions(name, [number])
    next_motion = results_of(name, [number + 1], "motion.json") if planned else []
    filmed += ["lab_truth.parquet"] if experiment(name).lab else []
    filmed += ["motion.json"] if played_motions(name, [number]) else []
    return results_of(name, [number], *TRIAL_FILES, *filmed) + camera + next_motion


TRIAL_FILES = [
    "track.parquet",
    "track.json",
    "alignment.json",
    "hand.parquet",
    "verdict.json",
    "estimate.json",
    "ensemble.parquet",
    "simulated.parquet",
]
OWN, SHIPPED = known_experiments()
EXPERIMENTS = OWN or ["demo"]
LAB = [name for name in {*OWN, *SHIPPED} if is_lab(name)]
LAB_EXPERIMENTS = names_pattern(sorted(LAB))
REAL_EXPERIMENTS = names_pattern([name for name in OWN if name not in LAB])
