"""Export a planned motion for an arm that has no driver."""

from pathlib import Path

from strandcast.arm.load import load_arm
from strandcast.config.experiment import Experiment
from strandcast.config.find import find_arm, find_experiment, named_arm
from strandcast.config.load import load_experiment
from strandcast.errors import StrandcastError
from strandcast.executor.handover.export import ExportForm, export_motion
from strandcast.executor.handover.handover import Handover, prepare
from strandcast.executor.preflight import read_motion
from strandcast.records.folders import ExperimentFolder
from strandcast.records.kept_motions import keep_motion


def run(
    root: Path,
    motion: Path,
    out: Path,
    form: ExportForm,
    arm_file: Path | None,
    hanging_m: float | None,
    time_scale: float,
) -> Handover:
    """Export a motion.

    By default, the arm and the length hanging from the hand are those of the motion's experiment.
    """
    planned = read_motion(motion)
    if arm_file is None or hanging_m is None:
        settings, file = _experiment(root, motion, planned.experiment)
        arm_file = arm_file or find_arm(settings, file, root)
        hanging_m = settings.string.length_m if hanging_m is None else hanging_m
    arm = load_arm(named_arm(arm_file, root))
    handover = prepare(motion, arm, hanging_m, time_scale)
    export_motion(handover, form, out)
    folder = ExperimentFolder(root, planned.experiment)
    if folder.results.is_dir():
        keep_motion(folder, planned, motion.with_name("predicted.parquet"))
    return handover


def _experiment(root: Path, motion: Path, name: str) -> tuple[Experiment, Path]:
    """Return the motion's experiment and its file (SC-W020 if there is none)."""
    try:
        file = find_experiment(name, root)
    except StrandcastError:
        raise StrandcastError(
            "SC-W020",
            f"there is no experiment {name!r} here that gives the arm and the length hanging from its hand",
            file=motion,
            fix="give both: --arm, the arm's file, and --hanging, the string's length with its weights [m]",
        ) from None
    return load_experiment(file), file
