"""Import a robot's own log into the folder of a trial or of the rehearsal: joints.csv and run.json."""

import shlex
from contextlib import suppress
from pathlib import Path

from strandcast.arm.load import AnyArm
from strandcast.arm.spatial import load_any_arm
from strandcast.errors import StrandcastError
from strandcast.imports.joints import IMPORTED, Played, Reading, import_joints
from strandcast.records.joint_log import Run
from strandcast.records.motion import Motion
from strandcast.stages.context import Context, context_of, refuse_replacing

ALIGNED_BEFORE = (
    "the capture beside the log was aligned with the one before: import it again, "
    "`strandcast import track` with --replace"
)


def run(
    root: Path,
    name: str,
    trial: int | None,
    log: Path,
    reading: Reading,
    joints: list[str],
    replace: bool = False,
) -> Run:
    """Import a log, of a trial or else of the rehearsal; a motion.json in its folder is the played motion."""
    context = context_of(root, name)
    folder = context.folder.rehearsal if trial is None else context.folder.trial(trial).data
    arm = load_any_arm(context.arm_file)
    motion, record = folder / "motion.json", folder / "run.json"
    if trial is None and not motion.is_file():
        planned = context.folder.trial(1).results / "motion.json"
        raise StrandcastError(
            "SC-I059",
            "is missing: a rehearsal shows how the joints follow the motion that was played",
            file=motion,
            fix=f"copy it there before planning again: {shlex.join(['cp', str(planned), str(motion)])}",
        )
    if record.is_file() and not Run.read(record).driver.startswith(IMPORTED):  # the only copy of that run
        raise StrandcastError(
            "SC-I023",
            "this trial was played and logged by `strandcast play`",
            file=record,
            fix="import as another trial, or move joints.csv and run.json away first",
        )
    refuse_replacing(record, replace)
    aligned_before = record.is_file() and (folder / "alignment.json").is_file()
    found = import_joints(
        log,
        folder,
        reading,
        namings=[joints] if joints else [list(arm.joints), list(arm.all_joints)],
        played=_played(context, motion, arm) if motion.is_file() else None,
    )
    if aligned_before:
        found = found.model_copy(update={"warnings": [*found.warnings, ALIGNED_BEFORE]})
        found.write(record)
    return found


def _played(context: Context, file: Path, arm: AnyArm) -> Played:
    """Return the motion of a file, with the experiment's other motions, planned or played."""
    motion = Motion.read(file)
    by_hash = {motion.content_sha256(): (str(file), motion)}
    folders = context.folder.data, context.folder.results
    for path in (path for folder in folders for path in sorted(folder.glob("*/motion.json"))):
        with suppress(StrandcastError):  # what is wrong with it concerns another trial
            other = Motion.read(path)
            by_hash.setdefault(other.content_sha256(), (str(path), other))
    return Played(motion, arm, dict(list(by_hash.values())[1:]))
