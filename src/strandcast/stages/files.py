"""The files of one job of a stage, by role and by trial.

A role is a function that returns the files of one kind for a job, e.g.
``results(this, "track.parquet")``. A scope is a function that returns the trials that a role covers.
"""

from collections.abc import Callable
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any

from strandcast.config.bounded import load_toml, read_bounded
from strandcast.config.camera import PLANE_PHOTO
from strandcast.errors import StrandcastError
from strandcast.records.folders import VIDEO, trial_folders
from strandcast.records.listing import entries_of, file_exists, files_matching
from strandcast.stages.context import Context, context_of
from strandcast.stages.job import Job, Role

Scope = Callable[[Job], list[int]]


def this(job: Job) -> list[int]:
    """Return the trial itself."""
    return [job.trial]


def past(job: Job) -> list[int]:
    """Return the trials before this one that are not excluded."""
    return job.context.counted(range(1, job.trial))


def latest(job: Job) -> list[int]:
    """Return the last of the past trials, if any."""
    before = range(job.trial - 1, 0, -1)  # not `past`: of a late trial, that is long
    return next(([number] for number in before if job.context.counted([number])), [])


def recent(job: Job) -> list[int]:
    """Return the trials that a fit reads: the newest past ones, and this one even if it is excluded."""
    read = job.context.settings.estimate.trials_read
    before = (number for number in range(job.trial - 1, 0, -1) if job.context.counted([number]))
    return [*reversed(list(islice(before, None if read is None else read - 1))), job.trial]


def so_far(job: Job) -> list[int]:
    """Return the past trials and this one, even if this one is excluded."""
    return [*past(job), job.trial]


def every(job: Job) -> list[int]:
    """Return all trials of an experiment that are not excluded."""
    return job.context.counted(job.trials)


def every_or_excluded(job: Job) -> list[int]:
    """Return all trials of an experiment, excluded ones too."""
    return list(job.trials)


def results(scope: Scope, *names: str) -> Role:
    """Return the role of result files of trials."""
    return lambda job: [job.context.folder.trial(k).results / name for k in scope(job) for name in names]


def cameras(job: Job) -> list[Path]:
    """Return the records of the experiment's cameras."""
    return [one.folder.camera(one.settings.camera_name) for one in job.context.by_camera]


def filming(job: Job) -> list[Path]:
    """Return the record of the one camera that a trial's track is of; none where there is no such camera."""
    return cameras(job) if by_one_camera(job, job.trial) else []


def of_views(find: Role) -> Role:
    """Return the role of the files of each of several cameras."""
    return lambda job: [path for view in job.context.views.values() for path in find(Job(view, job.trial))]


# The picture of a throw by each of several cameras, with the record that vouches for it.
strobes = of_views(results(this, "track.json", "strobe.webp"))


def shared_boards(job: Job) -> list[Path]:
    """Return the photos of the lens board that several cameras took at once, each camera's in a folder."""
    folder = job.context.folder.data / CALIBRATION
    found = (path for camera in job.context.views for path in files_matching(folder / camera, SHARED_BOARDS))
    return sorted(path for path in found if path.suffix.lower() in PHOTO_SUFFIXES)


def camera_pictures(job: Job) -> list[Path]:
    """Return the pictures of the cameras' calibrations."""
    return [path.with_suffix(".webp") for path in cameras(job)]


def raw(name: str) -> Role:
    """Return the role of a raw file of the trial."""
    return lambda job: [job.folder.data / name]


def raw_if_there(scope: Scope, name: str) -> Role:
    """Return the role of a raw file of each trial that has it; the lab's trials will have it."""

    def found(job: Job) -> list[Path]:
        paths = (job.context.folder.trial(number).data / name for number in scope(job))
        return [path for path in paths if job.is_lab or file_exists(path)]

    return found


def played_motions(scope: Scope) -> Role:
    """Return the role of the motions that were played; an imported trial may have none."""
    return raw_if_there(scope, "motion.json")


def logged(scope: Scope, name: str) -> Role:
    """Return the role of joint logs or their records, of the trials that have a log."""
    records = raw_if_there(scope, "run.json")
    return lambda job: [path.with_name(name) for path in records(job)]


REHEARSED_FILES = {"motion": "motion.json", "joints": "joints.csv", "run": "run.json"}


def rehearsal(name: str) -> Role:
    """Return the role of a file of the rehearsal; none without one, or where a throw has shown the joints."""

    def found(job: Job) -> list[Path]:
        folder = job.context.folder.rehearsal
        there = job.context.settings.lab_rehearses if job.is_lab else file_exists(folder / "run.json")
        return [folder / name] if there and not past(job) else []

    return found


def known_string(job: Job) -> list[Path]:
    """Return estimate and ensemble of the string that was thrown elsewhere, for the first motion.

    Raises
    ------
    StrandcastError
        SC-F010 the file that `start_string` names is outside of the project; SC-F003 the experiment that it
        names is this one, or nothing that counts was fitted there; SC-F001 there is none.
    """
    context, name = job.context, job.context.settings.known_string
    if name is None or past(job):
        return []
    root, estimate = context.folder.root, (context.folder.root / name).resolve()
    if name.endswith(".json"):
        if estimate.is_relative_to(root.resolve()):
            estimate = root / estimate.relative_to(root.resolve())
            return [estimate, estimate.with_name("ensemble.parquet")]
        code, what, fix = "SC-F010", "lies outside of the project", "copy its folder into the project"
    else:
        other = context_of(root, name)
        trials = other.counted(trial_folders(other.folder.results))
        fits = [other.folder.trial(number).results / "estimate.json" for number in trials]
        there = [path for path in fits if path.is_file()]
        if there and name != context.name:
            return [there[-1], there[-1].with_name("ensemble.parquet")]
        code, what, fix = "SC-F003", "has no fitted trial that counts", f"strandcast run {name}"
        if name == context.name:
            what, fix = "is this experiment", "name the one that has thrown the string"
    raise StrandcastError(code, f"{name} {what}", file=context.file, field="start_string", fix=fix)


def known_experiment(job: Job) -> list[Path]:
    """Return the settings of the experiment that the string comes from: they say which trials count."""
    name = job.context.settings.known_string
    if name is None or past(job) or name.endswith(".json"):
        return []
    return [context_of(job.context.folder.root, name).file]


def video(job: Job) -> list[Path]:
    """Return the files of the trial's video; the lab's is video.mp4."""
    return [job.folder.data / "video.mp4"] if job.is_lab else job.folder.video_files()


def ingested(job: Job) -> list[Path]:
    """Return the files of the trial's video.

    There are none if there is no video, which `ingest` then reports; if one of several cameras has none, an
    error is raised.
    """
    of_several = job.folder.films != (VIDEO,)
    return video(job) if job.is_lab or of_several or job.folder.videos() else []


def other_manifests(job: Job) -> list[Path]:
    """Return the manifests of the experiment's other trials that have been ingested."""
    folder = job.context.folder
    numbers = (number for number in folder.recorded_trials() if number != job.trial)
    return [path for number in numbers if (path := folder.trial(number).results / "manifest.json").is_file()]


def arm(job: Job) -> list[Path]:
    """Return the arm's file and its URDF."""
    path = job.context.arm_file
    try:
        urdf = path.parent / _arm_keys(read_bounded(path))["urdf"]
    # An error of the disk is raised: without its URDF, the lineage would be wrong in silence.
    except (FileNotFoundError, ValueError, KeyError, TypeError):
        return [path]  # the stage reports what is wrong with it
    return [path, urdf] if urdf.is_file() else [path]


def has_driver(context: Context) -> bool:
    """Whether the arm's file names a driver: without the arm itself, which takes a second to load."""
    try:
        return bool(_arm_keys(read_bounded(context.arm_file))["driver"]["name"])
    except (FileNotFoundError, ValueError, KeyError, TypeError):
        return False


@lru_cache(maxsize=64)  # the engine asks for every trial
def _arm_keys(arm_toml: str) -> dict[str, Any]:
    return load_toml(arm_toml)


SHARED_BOARDS = "both-*"
CALIBRATION = Path(PLANE_PHOTO).parent
PHOTO_SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp")
LAB_PHOTOS = tuple(f"calibration/lens-{number:02d}.png" for number in range(1, 13))


def lens(job: Job) -> list[Path]:
    """Return a known lens, or photos or video of the board; none where the tracker finds the scale."""
    camera, folder = job.context.settings.camera, job.context.folder.data
    if job.context.settings.tracker_finds_scale:
        return []
    if camera.lens_kind != "photos":
        return [folder / camera.lens]
    if job.is_lab:
        return [folder / name for name in LAB_PHOTOS]
    others = [path for path in _other_photos(folder, camera.lens) if path not in _of_the_plane(job)]
    return files_matching(folder, camera.lens) or others or [folder / camera.lens]


def plane(job: Job) -> list[Path]:
    """Return the photo of the plane of motion; none where the tracker finds the scale.

    Raises
    ------
    StrandcastError
        SC-C031 several photos may be it, and the settings name none of them.
    """
    camera, folder = job.context.settings.camera, job.context.folder.data
    if job.context.settings.tracker_finds_scale:
        return []
    photo, there = folder / camera.plane_photo, _of_the_plane(job)
    if job.is_lab or ("plane_photo" in camera.model_fields_set and file_exists(photo)):
        return [photo]
    if len(there) > 1:
        raise StrandcastError(
            "SC-C031",
            f"which photo shows the plane: {', '.join(path.name for path in there)}?",
            file=photo.parent,
            field="camera.plane_photo",
            fix="name the one that was taken from where the camera filmed, e.g. camera.plane_photo: "
            f"{there[0].relative_to(folder)}, or move the others to another folder",
        )
    return [path for path in there if path.stem.lower() == photo.stem.lower()] or [photo]


def _of_the_plane(job: Job) -> list[Path]:
    """Return the photos that may show the plane: their names begin with that of the settings."""
    photo = job.context.folder.data / job.context.settings.camera.plane_photo
    named = (path for path in entries_of(photo.parent) if path.suffix.lower() in PHOTO_SUFFIXES)
    return sorted(path for path in named if path.stem.lower().startswith(photo.stem.lower()))


def _other_photos(folder: Path, pattern: str) -> list[Path]:
    """Return photos whose names fit but for the kind of picture, one a name: cameras write lens-01.JPG."""
    found = files_matching(folder, str(Path(pattern).with_suffix(".*")))
    by_name = {path.stem: path for path in reversed(found) if path.suffix.lower() in PHOTO_SUFFIXES}
    return sorted(by_name.values())


def scaling_manifest(job: Job) -> list[Path]:
    """Return the manifest of the first trial if the tracker finds the scale."""
    by_tracker = job.context.settings.tracker_finds_scale
    return [job.context.folder.trial(1).results / "manifest.json"] if by_tracker else []


def scaling_video(job: Job) -> list[Path]:
    """Return the video of the first trial if the tracker finds the scale."""
    return video(Job(job.context, 1)) if job.context.settings.tracker_finds_scale else []


def background(job: Job) -> list[Path]:
    """Return the picture of the empty scene, if the experiment gives one."""
    picture = job.context.background_picture
    return [] if picture is None else [picture]


# Role -> name of the files of a trial that was measured elsewhere.
SUPPLIED_FILES = {
    "track": "track.parquet",
    "summary": "track.json",
    "alignment": "alignment.json",
    "hand": "hand.parquet",
}


def supplied(job: Job, trial: int) -> bool:
    """Return whether a trial's track was measured elsewhere and supplied, or will be by the lab in space."""
    folder = job.context.folder.trial(trial)
    there = [file_exists(folder.data / name) for name in SUPPLIED_FILES.values()]
    return job.context.settings.lab_captures or all(there) or (there[0] and not folder.videos())


def by_one_camera(job: Job, trial: int) -> bool:
    """Return whether a trial's track is of one camera, in the plane."""
    return not (job.context.views or supplied(job, trial))


def lab_capture(job: Job) -> list[Path]:
    """Return the lab's capture in space: without it, the track that was imported from it has no source."""
    return [job.folder.data / "capture.csv"] if job.context.settings.lab_captures else []
