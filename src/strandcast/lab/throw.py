"""The lab's actions: photograph the calibration boards, rehearse, and throw."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from strandcast.arm.load import Arm, PlanarArm
from strandcast.config.experiment import Experiment
from strandcast.core.trial_names import trial_name
from strandcast.errors import StrandcastError
from strandcast.executor.drivers.protocol import Driver
from strandcast.executor.play import play
from strandcast.executor.preflight import run_preflight
from strandcast.lab.calibration import write_lens_photos, write_plane_photo
from strandcast.lab.driver import LabArm, LabRehearsal, LabThrow, driver_of
from strandcast.lab.scene import make_scene
from strandcast.records.joint_log import Run

REHEARSAL = 0  # in place of a trial's number, for its random numbers


def photograph_boards(experiment: Experiment, name: str, arm: PlanarArm, data_dir: str | Path) -> None:
    """Take the calibration photos of a virtual rig: lens-01.png … and plane.png.

    Parameters
    ----------
    name
        The experiment's, which seeds the random numbers.
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
    """Play a motion on the virtual rig, and film it or, in space, capture it.

    Parameters
    ----------
    trial
        Counted from 1.
    data_dir
        ``data/<name>``; ``trial-NN/`` in it gets video.mp4 or capture.csv, motion.json, joints.csv and, last,
        run.json.
    truth_path
        Where to write lab_truth.parquet.
    """
    driver = driver_of(LabThrow(name, experiment, trial, Path(truth_path)), arm)
    return _play(Path(motion_path), arm, driver, Path(data_dir) / trial_name(trial))


def rehearse(experiment: Experiment, name: str, arm: Arm, motion_path: Path, folder: Path) -> Run:
    """Play a planned motion on the virtual rig with an empty clamp.

    The folder gets motion.json, joints.csv and, last, run.json.
    """
    driver = LabRehearsal(LabThrow(name, experiment, REHEARSAL), arm)
    return _play(motion_path, arm, driver, folder)


def refuse_real_run(folder: Path) -> None:
    """Refuse to replace the raw files of a run that the lab did not make.

    Raises
    ------
    StrandcastError
        SC-L008 `folder` holds the run of a real arm, or an imported one.
    """
    record = folder / "run.json"
    try:
        driver = Run.read(record).driver
    except StrandcastError:  # there is none, or it is damaged: the lab makes it again
        return
    if driver != LabArm.name:
        raise StrandcastError(
            "SC-L008",
            f"this run was not made by the lab, but by {driver!r}",
            file=record,
            cost="the lab would replace its raw files",
        )


def _play(motion_path: Path, arm: Arm, driver: Driver, folder: Path) -> Run:
    driver.connect()  # refuses an experiment without a virtual rig before anything is removed
    refuse_real_run(folder)
    # Unlike a real throw, a virtual one can be repeated.
    (folder / "run.json").unlink(missing_ok=True)
    # A virtual arm can hurt nobody: it needs no workspace and no confirmation by a person.
    anywhere = replace(arm, box_m=np.tile([-np.inf, np.inf], (arm.axes, 1)))
    preflight = run_preflight(motion_path, anywhere, driver, folder)
    driver.move_to_start(preflight.motion.trajectory().q_rad[0])
    return play(preflight, driver, preflight.short_hash)
