"""The lab's two doors: set a virtual rig up, and throw with it."""

from __future__ import annotations

from pathlib import Path

from strandcast.arm.load import Arm
from strandcast.experiment import Experiment
from strandcast.lab.calibration import write_lens_photos, write_plane_photo
from strandcast.lab.driver import LabDriver, Throw
from strandcast.lab.scene import make_scene
from strandcast.player.play import play
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
    return play(motion_path, arm, driver, folder, move_to_start=True)
