"""Check an experiment before anything runs: settings, arm, reach, markers, photos, raw files, names."""

import shlex
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from strandcast.config.find import overlooked_experiments
from strandcast.core.trial_names import TRIAL_NAMES, trial_number
from strandcast.errors import StrandcastError, StrandcastErrors, single
from strandcast.records.camera import Camera
from strandcast.records.folders import VIDEO, TrialFolder, parted, video_suffixes
from strandcast.records.verified import READERS
from strandcast.stages import files
from strandcast.stages.context import (
    Context,
    about_settings,
    context_of,
    free_length_m,
    refuse_settings_of_others,
)
from strandcast.stages.declarations import STAGES
from strandcast.stages.job import Files, Job
from strandcast.stages.made import changes_since_made
from strandcast.stages.producers import capture_command
from strandcast.stages.raw_files import missing_file
from strandcast.workflow.locks import refuse_if_held
from strandcast.workflow.pending import input_problems
from strandcast.workflow.targets import targets_of

if TYPE_CHECKING:
    from strandcast.arm.load import Arm, PlanarArm

MOST_NAMED = 5  # missing trials in a message
# A search of a few seconds, and what it should find; chosen.
QUICK_SEARCH, LIKELY = {"evaluations": 480}, 0.5
IMPORT = "import one (strandcast import track), or film a throw, with photos for the camera"
LONGEST = 2.0  # times as far as the arm reaches; longer strings are likely in another unit; chosen
RAW_RECORDS = ("motion.json", "run.json")
LOG_FILES = (("joints.csv", "run.json"), ("run.json", "joints.csv"))
RAW_NAMES = ("joints.csv", "run.json", "motion.json", "predicted.parquet", *files.SUPPLIED_FILES.values())


@dataclass
class Checked:
    """What a check found: errors, which stop stages, and warnings; in words, what is there."""

    errors: list[StrandcastError] = field(default_factory=list)
    warnings: list[StrandcastError] = field(default_factory=list)
    facts: list[str] = field(default_factory=list)
    after: str = "run {}"  # the command, with the experiment's name

    def attempt(self, check: Callable[..., object], *arguments: object) -> None:
        """Run one check and keep the problems that it raises."""
        try:
            check(*arguments)
        except StrandcastError as error:
            self.errors += single(error)


def refusal(root: Path, name: str, until: str | None = None, *, raw: bool = True) -> StrandcastError | None:
    """Return why an experiment cannot be run up to a stage; or None.

    Reasons are its settings, its arm, a misnamed trial, another run, and with `raw` its raw files.
    """
    try:
        context = context_of(root, name)
        context.arm_file  # noqa: B018  (raises if there is none)
        files.known_string(Job(context, 1))
        if context.settings.lab is None:
            trials = context.folder.recorded_trials()
            refuse_gap(context)
            if raw:
                refuse_lost_trials(context)
            targets = targets_of(name, until, root) if raw else []
            if problems := input_problems(context, trials, targets):
                return StrandcastErrors(problems)
        refuse_if_held(root, name)
    except StrandcastError as error:
        return error
    return None


def refuse_lost_trials(context: Context) -> None:
    """Refuse an experiment with the page of a trial that counts, and not its raw files (SC-W036)."""
    folder = context.folder
    lost = sorted({*context.counted(folder.reported_trials())} - {*folder.recorded_trials()})
    if lost:
        missing = "film" if folder.trial(lost[0]).raw_files() else "raw files"
        raise StrandcastError(
            "SC-W036",
            f"the results of trial {lost[0]} are there, and not its {missing}",
            file=folder.trial(lost[0]).data,
            cost="motions would be planned again, as if it had not been thrown",
            fix="copy it there, exclude it, or, to throw it again, move "
            f"{folder.trial(lost[0]).results} away",
        )


def refuse_gap(context: Context) -> None:
    """Refuse recorded trials with a number missing between: later fits and plans would wait for that trial.

    Raises
    ------
    StrandcastError
        SC-W036 a trial that counts has no raw files, and a later one has.
    """
    thrown = context.folder.thrown_trials()
    missing = sorted(set(context.counted(range(1, max(thrown, default=0)))) - set(thrown))
    if missing:
        entries = [f"{{trial: {number}, reason: not thrown}}" for number in missing]
        more = ", …" if len(entries) > MOST_NAMED else ""
        raise StrandcastError(
            "SC-W036",
            f"trial {missing[0]} has no raw files, but trial {thrown[-1]} has",
            file=context.folder.trial(missing[0]).data,
            cost="the trials after it would wait for its results",
            fix="copy its files there, give the later folders the numbers before, or write to "
            f"{context.file}: excluded: [{', '.join(entries[:MOST_NAMED])}{more}]",
        )


def runnable(
    root: Path, names: list[str], until: str | None = None, *, raw: bool = True
) -> tuple[list[str], list[StrandcastError]]:
    """Return the experiments that can be run, and why others cannot: a bad one stops only itself.

    `until` and `raw` are those of `refusal`.

    Raises
    ------
    StrandcastErrors
        None can be run.
    """
    found = {name: refusal(root, name, until, raw=raw) for name in names}
    refused = {name: problem for name, problem in found.items() if problem is not None}
    if len(refused) == len(names):
        raise StrandcastErrors([each for error in refused.values() for each in single(error)])
    return [name for name in names if name not in refused], list(refused.values())


def check_experiment(root: Path, name: str) -> Checked:
    """Return everything that is wrong with an experiment, as far as it shows before its stages run."""
    found = Checked()
    found.errors += [each for each in overlooked_experiments(root) if Path(str(each.file)).name == name]
    found.attempt(_check_all, root, name, found)
    return found


def _check_all(root: Path, name: str, found: Checked) -> None:
    context = context_of(root, name)
    found.attempt(_check_arm, context, found)
    found.attempt(_check_string, context)
    _check_plugins(context, found)
    found.attempt(files.known_string, Job(context, 1))
    _compare_radii(context, found)
    if context.settings.lab is None:
        for one in [] if context.settings.aims_in_space else context.by_camera:
            found.attempt(_check_photos, one, found)
        _check_folders(context, found)


def _check_plugins(context: Context, found: Checked) -> None:
    """Refuse a tracker or a search that no package has; those by default take a second to import."""
    settings = context.settings
    if "tracker" in settings.track.model_fields_set:
        from strandcast.tracking.registry import TRACKERS

        found.attempt(TRACKERS.get, settings.track.tracker, context.file)
    if "search" in settings.estimate.model_fields_set:
        from strandcast.estimation.optimisers.registry import OPTIMISERS

        found.attempt(OPTIMISERS.get, settings.estimate.search, context.file)


def _check_arm(context: Context, found: Checked) -> None:
    from strandcast.arm.limits import torque_gap
    from strandcast.planning.reachability import refuse_unreachable
    from strandcast.stages.arms import arm_of
    from strandcast.stages.plan_inputs import task_of

    arm, settings = arm_of(context), context.settings
    string = settings.string
    if settings.target_m is None and (captured := _supplied_track(context)) is not None:
        found.facts.append(_as_captured(context, captured))
        return
    if settings.target_m is None and not context.folder.thrown_trials():
        found.facts.append(f"string of {string.length_m:g} m, no target and no recording yet; {IMPORT}")
        found.after = "run {}" if context.views else "import track {} 1 FILE.csv"
        return
    task = task_of(context, arm)
    found.facts.append(f"string of {string.length_m:g} m as {task.model.points} points, arm {arm.name}")
    if string.weights:
        free_m = free_length_m(context, arm.clamp.clamped_length_m)
        before_m = free_m - max(weight.place_m for weight in string.weights)
        end = f"{1e3 * before_m:.0f} mm before its end" if before_m > 5e-4 else "at its end"
        found.facts.append(f"the last weight's middle is {end}; the miss is that of the end")
    for one in context.by_camera if arm.axes == 2 else []:
        _check_marker_ids(one, arm.planar(), found)
    _, reach_m = arm.reach()
    if string.length_m > LONGEST * reach_m:
        found.facts.append(
            f"warning: the string is {string.length_m / reach_m:.1f} times as long as the arm reaches "
            f"({reach_m:.2f} m): is string.length_m right, in metres?"
        )
    gap = torque_gap(arm)
    if gap is not None:
        found.facts.append(f"warning: {gap}")
    if settings.target_m is None:
        found.facts.append("no target: recordings are fitted; nothing is scored or planned")
        return
    with about_settings(context):
        refuse_unreachable(task)
    if arm.limits.whole_arm_limited.any() and not context.folder.thrown_trials():
        _search_within_limits(context, arm, found)


def _search_within_limits(context: Context, arm: "Arm", found: Checked) -> None:
    """Search for a first motion within the limits of the whole arm, and without if it is unlikely to hit."""
    import numpy as np

    from strandcast.report.expected import expected_miss
    from strandcast.stages.plan import first_motion

    plan = context.settings.plan.model_copy(update=QUICK_SEARCH)
    quick = replace(context, settings=context.settings.model_copy(update={"plan": plan}))
    within = first_motion(quick, arm)
    expected = expected_miss(within)
    assert expected is not None
    kind, who, share = max(within.limits_used(), key=lambda used: used[2])
    found.facts.append(
        f"within the limits of the whole arm, a quick search finds a miss of {expected.middle()}, "
        f"{expected.likely()}; nearest to a limit of {kind}: {who}, {100 * share:.0f} % used"
    )
    if expected.hit_probability < LIKELY:
        unlimited = replace(arm.limits, whole_arm=np.full_like(arm.limits.whole_arm, np.inf))
        without = expected_miss(first_motion(quick, replace(arm, limits=unlimited)))
        assert without is not None
        found.warnings.append(
            StrandcastError(
                "SC-P002",
                f"the limits of the whole arm leave no likely hit; without them a throw misses by "
                f"{without.middle()}, {without.likely()}",
                file=context.file,
                field="target_m",
                fix="choose a nearer target or a longer string, or raise these limits as far as is safe",
            )
        )


def _supplied_track(context: Context) -> Path | None:
    """Return the first track that was measured elsewhere; None if there is none."""
    folders = map(context.folder.trial, context.folder.recorded_trials())
    return next((path for each in folders if (path := each.data / "track.parquet").is_file()), None)


def _as_captured(context: Context, track: Path) -> str:
    """Return in words what is fitted to captures; refuse settings that do not apply to them."""
    from strandcast.estimation.cable_space import POINTS
    from strandcast.records.tables import read_arrow
    from strandcast.records.track import TRACK, is_in_space

    string = context.settings.string
    in_space = is_in_space(read_arrow(track, TRACK).column_names)
    refuse_settings_of_others(context, in_space=in_space)
    points, where = (string.points or POINTS, "space") if in_space else (string.n, "the plane")
    fitted = f"string of {string.length_m:g} m as {points} points, captured in {where}"
    return f"{fitted}: recordings are fitted; nothing is scored or planned"


def _check_string(context: Context) -> None:
    """Check the lab's string, and the settings of a throw in space before it is thrown."""
    from strandcast.lab.strings import physical_string

    in_space = context.settings.aims_in_space or bool(context.views)
    refuse_settings_of_others(context, in_space=in_space)
    if context.settings.lab is not None:
        with about_settings(context):
            physical_string(context.settings)


def _check_marker_ids(context: Context, arm: "PlanarArm", found: Checked) -> None:
    plane = context.settings.camera.plane
    shared = {m.id for m in arm.markers} & {m.id for m in plane.markers}
    if shared and arm.marker_dictionary == plane.dictionary:
        what = f"the hand's markers have the ids {sorted(shared)} too"
        fix = "give the plane's markers other ids"
        found.errors.append(
            StrandcastError("SC-C021", what, file=context.file, field="camera.plane.markers", fix=fix)
        )


def _compare_radii(context: Context, found: Checked) -> None:
    settings, touch_m = context.settings, context.settings.estimate.contact_radius_m
    chosen = "contact_radius_m" in settings.estimate.model_fields_set
    if (
        settings.target_m is not None
        and touch_m is not None
        and settings.hit_radius_m != touch_m
        and not chosen
    ):
        found.facts.append(
            f"warning: a miss of up to {1e3 * settings.hit_radius_m:g} mm is a hit, but fits leave out what "
            f"follows a touch up to {1e3 * touch_m:g} mm only: set estimate.contact_radius_m to the "
            "radius of what stands at the target"
        )


def _check_photos(context: Context, found: Checked) -> None:
    """Check that the photos of the calibration are there, and that the plane's shows its markers.

    Before the first throw, missing ones are warnings: the first motion is planned without a camera.
    """
    job = Job(context)
    thrown = context.folder.thrown_trials()
    supplied = [number for number in thrown if files.supplied(job, number)]
    if context.settings.tracker_finds_scale or (thrown and supplied == thrown):
        return
    [photo] = files.plane(job)
    needed = (*files.lens(job), photo, *files.background(job))
    missing = [missing_file(context, path) for path in needed if not path.is_file()]
    if thrown or context.settings.target_m is not None:
        (found.errors if thrown else found.warnings).extend(missing)
    if photo.is_file():
        found.attempt(_check_calibration, Files(STAGES["calibrate"], job), photo, found)


def _check_calibration(calibration: Files, photo: Path, found: Checked) -> None:
    """Calibrate if the photos of the lens are there, else find only the plane's markers."""
    from strandcast.camera.find_markers import find_markers
    from strandcast.stages.calibrate import camera_by_markers, plane_markers_of, read_photos_of

    context = calibration.job.context
    _, camera_name = parted(context.name)
    of_camera = f"{camera_name}: " if camera_name else ""
    if not all(path.is_file() for path in calibration.inputs("lens")):
        [picture] = read_photos_of(context, [photo])
        markers, dictionary, shown, warnings = plane_markers_of(context.settings.camera, picture, str(photo))
        wanted = {marker.marker: marker for marker in markers}
        ids, _, of_markers = find_markers(shown, wanted, dictionary, str(photo))
        count, warnings = len(ids), warnings + of_markers
    else:
        if changes_since_made(calibration):
            camera, _ = camera_by_markers(context, calibration)
        else:
            camera = Camera.read(calibration.output("camera"))
        count, warnings = len(camera.plane_markers), camera.lens.warnings + camera.warnings
    found.facts += [f"warning: {of_camera}{words}" for words in warnings]
    found.facts.append(f"{count} plane markers are in {photo}")


def _check_folders(context: Context, found: Checked) -> None:
    """Check the names of folders, and the raw files of each trial."""
    folder = context.folder
    misnamed = folder.misnamed_trials()
    found.errors += misnamed
    if not misnamed:  # each may be the missing one
        found.attempt(refuse_gap, context)
        found.attempt(refuse_lost_trials, context)
    reported = {each.file for each in misnamed}
    numbers = folder.thrown_trials()
    for path in sorted(folder.data.glob("[tT][rR][iI][aA][lL]*")):
        if not (path.is_dir() and trial_number(path.name)) and str(path) not in reported:
            what = f"is not used: trials are folders {TRIAL_NAMES}"
            fix = "rename it to a trial's name if it holds a throw, e.g. trial-01"
            if path.is_symlink() and not path.exists():
                what, fix = "is a link to nothing", "mount or restore what it links to"
            found.warnings.append(StrandcastError("SC-R032", what, file=path, fix=fix))
    for path in (folder.trial(number).data / name for number in numbers for name in RAW_RECORDS):
        if path.is_file():
            found.attempt(READERS[".json"], path)
    for number in numbers:
        excluded = context.settings.excluded_reason(number) is not None
        problems = list(_problems_of_trial(context, folder.trial(number)))
        (found.warnings if excluded else found.errors).extend(problems)
    found.facts.append(f"trials with raw files: {', '.join(map(str, numbers)) or 'none'}")


def _problems_of_trial(context: Context, trial: TrialFolder) -> Iterator[StrandcastError]:
    there = {path.name: path for path in trial.raw_files()}
    for name, path in there.items():
        right = name.lower()
        if right in RAW_NAMES and right not in there:
            yield _wrong(f"is not read: its name must be {right}", path, _rename(path, trial.data / right))
    supplied = [name for name in files.SUPPLIED_FILES.values() if name in there]
    if not supplied and context.settings.aims_in_space:
        fix = f"import it: {capture_command(context, trial.number)} (docs/how-to/throw-in-space.md)"
        yield _wrong("the trial was thrown, and its capture has not been imported", trial.data, fix)
    elif not supplied:
        for one in context.by_camera:
            yield from _problems_of_video(one, one.folder.trial(trial.number), trial.films)
        yield from _problems_of_log(context, trial)
    needed = [*(files.SUPPLIED_FILES.values() if supplied else ())]
    needed += [other for one, other in LOG_FILES if one in there]
    yield from (
        missing_file(context, trial.data / name) for name in needed if name not in map(str.lower, there)
    )


def unlogged_trials(root: Path, name: str) -> list[StrandcastError]:
    """Return a problem for each film without a joint log: `align` fails, after it has been tracked."""
    context = context_of(root, name)
    if context.settings.lab is not None or context.settings.aims_in_space:
        return []
    numbers = context.counted(context.folder.recorded_trials())
    trials = [context.folder.trial(number) for number in numbers if not files.supplied(Job(context), number)]
    return [problem for trial in trials for problem in _problems_of_log(context, trial)]


def _problems_of_log(context: Context, trial: TrialFolder) -> Iterator[StrandcastError]:
    there = {path.name.lower() for path in trial.raw_files()}
    if trial.videos() and not there & {*LOG_FILES[0]}:
        importing = f"strandcast import joints {shlex.quote(context.name)} {trial.number} LOG"
        fix = f"copy joints.csv and run.json from the arm's computer, or import a log: {importing}"
        yield _wrong("the trial has a video, but no joint log", trial.data, fix)


def _problems_of_video(
    context: Context, trial: TrialFolder, of_cameras: tuple[str, ...]
) -> Iterator[StrandcastError]:
    if not trial.videos():
        films = [path for path in trial.raw_files() if path.suffix.lower() in video_suffixes()]
        like = [path for path in films if path.stem.lower() not in of_cameras]
        [film] = trial.films
        fix = f"copy the recording there as {film}.mp4 (or .avi, .mkv, .mov …), or `strandcast import track`"
        if len(like) == 1:
            fix = _rename(like[0], trial.data / f"{film}{like[0].suffix.lower()}")
        missing = VIDEO if film == VIDEO else f"{VIDEO} {film}.*"
        yield _wrong(f"the trial has raw files, but no {missing}", trial.data, fix)
        return
    camera = context.settings.camera
    try:
        video = trial.video()  # refuses several
        if not (trial.results / "manifest.json").is_file():  # `ingest` has not seen it yet
            from strandcast.video.ingest import inspect_video

            inspect_video(video, camera.frame_rate_hz, camera.missing_policy)
    except StrandcastError as error:
        yield error


def _wrong(what: str, file: Path, fix: str) -> StrandcastError:
    return StrandcastError("SC-V020", what, file=file, fix=fix)


def _rename(path: Path, new: Path) -> str:
    return "rename it: " + shlex.join(["mv", str(path), str(new)])
