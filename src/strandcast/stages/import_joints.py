"""Import a robot's own log into the folder of a trial or of the rehearsal: joints.csv and run.json."""

from contextlib import suppress
from pathlib import Path

from strandcast.arm.load import Arm, load_arm
from strandcast.errors import StrandcastError
from strandcast.imports.joints import IMPORTED, Played, Reading, import_joints
from strandcast.records.joint_log import Run
from strandcast.records.kept_motions import kept_motions
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
    """Import a log, of a trial or else of the rehearsal, with the motion that was played."""
    context = context_of(root, name)
    folder = context.folder.rehearsal if trial is None else context.folder.trial(trial).data
    arm = load_arm(context.arm_file)
    motion, record = folder / "motion.json", folder / "run.json"
    plans = kept_motions(context.folder, trial or 1)
    if record.is_file() and not Run.read(record).driver.startswith(IMPORTED):  # the only copy of that run
        what = "this trial was played and logged by `strandcast play`"
        fix = "import as another trial, or move joints.csv and run.json away first"
        raise StrandcastError("SC-I022", what, file=record, fix=fix)
    refuse_replacing(record, replace)
    aligned_before = record.is_file() and (folder / "alignment.json").is_file()
    found = import_joints(
        log,
        folder,
        reading,
        namings=[joints] if joints else [list(arm.joints), list(arm.all_joints)],
        played=_played(context, motion, plans, arm, trial is None),
    )
    if aligned_before:
        found = found.model_copy(update={"warnings": [*found.warnings, ALIGNED_BEFORE]})
        found.write(record)
    return found


def _played(context: Context, file: Path, plans: dict[Path, Motion], arm: Arm, is_rehearsal: bool) -> Played:
    """Return the motion of a file if it is there, with the experiment's other motions, planned or played."""
    motion = Motion.read(file) if file.is_file() else None
    seen = set() if motion is None else {motion.content_sha256()}
    others = {}
    folders = context.folder.data, context.folder.results
    for path in [*plans, *(path for folder in folders for path in sorted(folder.glob("*/motion.json")))]:
        with suppress(StrandcastError):  # what is wrong with it concerns another trial
            other = Motion.read(path)
            if other.content_sha256() not in seen:
                seen.add(other.content_sha256())
                others[str(path)] = other
    return Played(motion, arm, is_rehearsal, plans, others)
