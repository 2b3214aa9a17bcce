"""The motions of an experiment that an arm may have played: each is kept under its hash.

When settings change, another motion is planned in place of one that may be on the robot's computer.
"""

import os
from contextlib import suppress
from pathlib import Path

from strandcast.errors import StrandcastError
from strandcast.records.files import write_bytes
from strandcast.records.folders import ExperimentFolder
from strandcast.records.listing import LISTING
from strandcast.records.motion import Motion

HASH_DIGITS = 16  # enough to tell the motions of one experiment apart


def keep_motion(folder: ExperimentFolder, motion: Motion, predicted: Path) -> None:
    """Keep a motion, and the throws that are expected of it if that file is there.

    With object storage it is not kept: only what a rule declares goes there.
    """
    if LISTING in os.environ:
        return
    place = folder.motions / motion.content_sha256()[:HASH_DIGITS]
    if predicted.is_file():
        write_bytes(place / "predicted.parquet", predicted.read_bytes())
    motion.write(place / "motion.json")


def kept_motions(folder: ExperimentFolder, trial: int) -> dict[Path, Motion]:
    """Return the motions that were planned for a trial, by path: the present one, then the newest first."""
    kept = sorted(folder.motions.glob("*/motion.json"), key=lambda path: -path.stat().st_mtime_ns)
    found = {}
    for path in [folder.trial(trial).results / "motion.json", *kept]:
        with suppress(StrandcastError):  # `verify` says what is wrong with it
            motion = Motion.read(path, inputs=False)
            if motion.trial == trial:
                found[path] = motion
    return found


def take_motion(path: Path, folder: Path) -> None:
    """Copy a kept motion, and the throws that were expected of it, beside the raw files of a trial."""
    predicted = path.with_name("predicted.parquet")
    (folder / predicted.name).unlink(missing_ok=True)
    if predicted.is_file():
        write_bytes(folder / predicted.name, predicted.read_bytes())
    Motion.read(path, inputs=False).write(folder / path.name)
