"""The motions of an experiment that an arm may have played: each is kept under its hash.

When settings change, another motion is planned in place of one that may be on the robot's computer.
"""

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from strandcast.errors import StrandcastError
from strandcast.records.files import write_bytes
from strandcast.records.folders import ExperimentFolder
from strandcast.records.motion import Motion

if TYPE_CHECKING:
    from strandcast.records.predicted import PredictedThrows

HASH_DIGITS = 16  # enough to tell the motions of one experiment apart


def keep_motion(folder: ExperimentFolder, motion: Motion, throws: "PredictedThrows | None" = None) -> None:
    """Keep a motion, and the throws that are expected of it."""
    place = folder.motions / motion.content_sha256()[:HASH_DIGITS]
    if throws is not None:
        from strandcast.records.predicted import write_predicted  # the player has no library for tables

        write_predicted(place / "predicted.parquet", throws)
    motion.write(place / "motion.json")


def kept_motions(folder: ExperimentFolder, trial: int) -> dict[Path, Motion]:
    """Return the motions that were planned for a trial, by path; the present one among them."""
    found = {}
    for path in [*sorted(folder.motions.glob("*/motion.json")), folder.trial(trial).results / "motion.json"]:
        with suppress(StrandcastError):  # `verify` says what is wrong with it
            motion = Motion.read(path)
            if (motion.experiment, motion.trial) == (folder.name, trial):
                found[path] = motion
    return found


def take_motion(path: Path, folder: Path) -> None:
    """Copy a kept motion, and the throws that were expected of it, beside the raw files of a trial."""
    predicted = path.with_name("predicted.parquet")
    (folder / predicted.name).unlink(missing_ok=True)
    if predicted.is_file():
        write_bytes(folder / predicted.name, predicted.read_bytes())
    Motion.read(path).write(folder / path.name)
