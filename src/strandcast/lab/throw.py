"""The lab's two doors: set a virtual rig up, and throw with it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from strandcast.arm.load import Arm, Box
from strandcast.experiment import Experiment
from strandcast.lab.calibration import write_lens_photos, write_plane_photo
from strandcast.lab.driver import LabDriver, Throw
from strandcast.lab.scene import make_scene
from strandcast.player.play import play
from strandcast.player.rehearsal import rehearse
from strandcast.records.joint_log import Run


def set_up(experiment: Experiment, name: str, arm: Arm, data_dir: str | Path) -> None:
    """Take the calibration photos of a virtual rig: lens-01.png … and plane.png.

    Parameters
    ----------
    experiment, name
        The experiment and its name, from which its random numbers follow.
    arm
        The arm in the scene.
    data_dir
        The experiment's raw folder, ``data/<name>``.
    """
    scene = make_scene(experiment, name, arm)
    write_lens_photos(experiment, name, scene.view, Path(data_dir))
    write_plane_photo(experiment, name, scene, Path(data_dir))


def throw(
    experiment: Experiment,
    name: str,
    arm: Arm,
    trial: int,
    motion_path: str | Path,
    data_dir: str | Path,
    truth_path: str | Path,
) -> Run:
    """Play a motion on the virtual rig and film it.

    Parameters
    ----------
    experiment, name, arm
        As in `set_up`.
    trial
        Counted from 1.
    motion_path
        The planned motion.
    data_dir
        ``data/<name>``; ``trial-NN/`` in it gets video.mp4, motion.json, joints.csv and, last, run.json.
    truth_path
        Where lab_truth.parquet is to be written.
    """
    driver = LabDriver(Throw(name, experiment, trial, Path(truth_path)), arm)
    folder = Path(data_dir) / f"trial-{trial:02d}"
    # Unlike a real throw, a virtual one can be had again.
    (folder / "run.json").unlink(missing_ok=True)
    # A virtual arm hits nothing and hurts nobody: it may go where it likes, and nobody need confirm it.
    anywhere = (-np.inf, np.inf)
    rehearsal = rehearse(motion_path, replace(arm, workspace=Box(anywhere, anywhere)), driver, folder)
    driver.move_to_start(rehearsal.motion.joints()[0][0])
    return play(rehearsal, driver, rehearsal.short_hash)
