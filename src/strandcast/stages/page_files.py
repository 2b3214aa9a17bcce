"""The results that the pages show: of one trial, of all trials, and the motion that comes next."""

from pathlib import Path

from strandcast.core.trial_names import LAST_TRIAL, trial_number
from strandcast.records.listing import file_exists
from strandcast.stages import files
from strandcast.stages.files import Scope, played_motions
from strandcast.stages.job import Job, Role

MEASURED_FILES = ("track.parquet", "track.json", "alignment.json", "hand.parquet", "verdict.json")
FITTED_FILES = ("estimate.json", "ensemble.parquet", "simulated.parquet")
TRIAL_FILES = (*MEASURED_FILES, *FITTED_FILES)
BY_CAMERA = ("manifest.json", "strobe.webp", "clip.json")
# Files that a page shows if they exist, also of excluded and supplied trials.
MOTION_FILES = ("motion.json", "predicted.parquet")
ON_PAGE = (*TRIAL_FILES, *BY_CAMERA, *MOTION_FILES, "lab_truth.parquet")


def shown(scope: Scope) -> Role:
    """Return the role of the results that a page shows of trials that are not excluded, or held out."""

    def found(job: Job) -> list[Path]:
        excluded = {each.trial for each in job.context.settings.excluded}
        paths = [path for number in scope(job) if number not in excluded for path in _shown_of(job, number)]
        return list(dict.fromkeys(paths))

    return found


def _shown_of(job: Job, trial: int) -> list[Path]:
    context = job.context
    by_camera = files.by_one_camera(job, trial)
    names = [*MEASURED_FILES, *(BY_CAMERA if by_camera else [])]
    names += [] if trial in context.settings.held_out else FITTED_FILES
    names += ["lab_truth.parquet"] if job.is_lab else []
    names += MOTION_FILES if _is_played(job, trial) else []
    camera = files.cameras(job) if by_camera else []
    strobes = [] if files.supplied(job, trial) else files.strobes(Job(context, trial))
    return [context.folder.trial(trial).results / name for name in names] + camera + strobes


def next_motion(job: Job) -> list[Path]:
    """Return the motion of the next trial; none follows a supplied track without its motion.

    The page of an excluded trial shows none, that of the experiment does, also after the last trial was
    excluded.
    """
    last = job.trial or max(job.trials, default=0)
    planned = _has_target(job) and (not files.supplied(job, last) or _is_played(job, last))
    shown = not job.trial or job.context.counted([last])
    return _to_be_had(job, motion_after(job)) if last and planned and shown else []


def next_throw(job: Job) -> list[Path]:
    """Return the throws that are expected of the next motion, where they are there or can be made."""
    return _to_be_had(job, [path.with_name("predicted.parquet") for path in next_motion(job)])


def first_motion(job: Job) -> list[Path]:
    """Return the motion to begin with, for a real experiment without a recorded trial."""
    begun = job.is_lab or not _has_target(job) or job.context.folder.recorded_trials()
    return [] if begun else _to_be_had(job, [job.context.folder.trial(1).results / "motion.json"])


def _to_be_had(job: Job, paths: list[Path]) -> list[Path]:
    """Return those results of a plan that are there or can be made: an unknown motion is not planned."""
    numbers = [trial_number(path.parent.name) for path in paths]
    return [
        path
        for path, number in zip(paths, numbers, strict=True)
        if file_exists(path) or _is_played(job, number) or not job.context.folder.trial(number).raw_files()
    ]


def _has_target(job: Job) -> bool:
    return job.context.settings.target_m is not None


def _is_played(job: Job, trial: int) -> bool:
    return bool(played_motions(lambda _: [trial])(job))


def motion_after(job: Job) -> list[Path]:
    """Return the place of the motion after the last trial, which may not be planned yet."""
    last = job.trial or max(job.trials, default=0)
    return [] if last == LAST_TRIAL else [job.context.folder.trial(last + 1).results / "motion.json"]


def throws_after(job: Job) -> list[Path]:
    """Return the place of the throws that are expected of that motion."""
    return [path.with_name("predicted.parquet") for path in motion_after(job)]
