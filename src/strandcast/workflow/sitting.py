"""A sitting at the rig: throw, wait for log and film, judge the throw, plan the next one, and again.

All state is in files, so that the same command goes on after Ctrl-C or a power loss: what was thrown and not
judged yet lies in the trial's folder, and a record says what the watched folder held before the throw.
"""

import json
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, Protocol

from strandcast.arm.load import load_arm
from strandcast.errors import StrandcastError
from strandcast.executor.drivers.registry import driver_of_arm
from strandcast.executor.dry_run_report import dry_run_report
from strandcast.executor.play import play
from strandcast.executor.preflight import PlayOptions, read_motion, run_preflight
from strandcast.imports.joints import Reading
from strandcast.imports.ros_bags import SUFFIXES as BAGS
from strandcast.progress import print_line, set_context
from strandcast.records.files import write_text
from strandcast.records.folders import (
    CONTAINERS,
    PHOTRON,
    PICTURES,
    TrialFolder,
    files_of_video,
    video_suffixes,
)
from strandcast.records.joint_log import Run
from strandcast.records.lineage import relative_to
from strandcast.records.record import read_json
from strandcast.report.expected import expected_miss
from strandcast.stages import import_joints
from strandcast.stages.context import Context, context_of
from strandcast.stages.producers import to_correct_first
from strandcast.stages.run import run_stage
from strandcast.video.reader import open_video
from strandcast.workflow.locks import lease
from strandcast.workflow.pending import tasks_of

FOLDER_BEFORE = Path("sitting", "folder.json")  # in the results of the experiment
ASIDE = "aside"  # in its raw files: trials that cannot be used
POLL_S = 0.25
STEADY_S = 1.0  # a file that has not changed for so long, and opens, is complete; chosen
LOG_SUFFIXES = (".csv", *BAGS)
FOLDER = "/"  # stands for the suffix of a folder of pictures
UNFINISHED = ("SC-V005", "SC-V022")
# Film and log are not of the same throw, or one of them does not show it.
OF_ANOTHER_THROW = ("SC-A007", "SC-A008", "SC-V023")
MOTION = "motion.json"
PLANNED = (MOTION, "predicted.parquet")
TRACKER = "tracker"  # finds the scale, from the first throw


class Person(Protocol):
    """Whom a sitting asks and tells."""

    def forget(self) -> None:
        """Drop what was typed before anything was asked."""

    def typed(self, within_s: float) -> str | None:
        """Return a line that was typed within some time; None: nothing."""

    def say(self, text: str) -> None:
        """Show a line."""

    def show(self, text: str) -> None:
        """Show how the sitting stands."""

    def show_pages(self, text: str) -> None:
        """Show that the pages have changed."""


class Unusable(Exception):
    """Why a throw cannot be used, in one sentence."""


class Elsewhere(NamedTuple):
    """In place of the driver, for an arm that another computer moves: what is asked before a throw."""

    rate_hz: float
    streams: bool = False


@dataclass(frozen=True)
class Sitting:
    """A sitting: the project, the experiment, how motions are played, and whom to ask."""

    root: Path
    name: str
    options: PlayOptions
    person: Person

    def context(self) -> Context:
        """Return the experiment as its file is now: it may be corrected within the sitting."""
        return context_of(self.root, self.name)


def hold(sitting: Sitting) -> None:
    """Throw until the person ends it.

    Raises
    ------
    StrandcastError
        Something must be corrected first; the same command goes on.
    """
    context = sitting.context()
    _refuse_unfit(context)
    if context.settings.camera.scale != TRACKER:  # nothing is thrown before it can be judged
        _make(sitting, context.folder.camera(context.settings.camera_name))
    while True:
        _finish_last(sitting)
        context = sitting.context()
        trial = context.folder.trial(max(context.folder.thrown_trials(), default=0) + 1)
        _make(sitting, trial.results / MOTION)
        if not _throw(sitting, context, trial):
            return


def _refuse_unfit(context: Context) -> None:
    """Refuse an experiment that is not thrown by an arm and filmed (SC-W020)."""
    settings = context.settings
    unfit = (
        (settings.lab is not None, "the lab throws by itself", f"strandcast run {context.name}"),
        (settings.target_m is None, "it has no target to throw at", "add target_m"),
        (
            settings.aims_in_space,
            "a throw in space is measured by motion capture",
            "strandcast play, then strandcast import track, then strandcast run",
        ),
    )
    for is_so, what, fix in unfit:
        if is_so:
            raise StrandcastError("SC-W020", what, file=context.file, fix=fix)


def _finish_last(sitting: Sitting) -> None:
    """Bring the last throw to its verdict, or put it aside."""
    context = sitting.context()
    thrown = context.folder.thrown_trials()
    if not thrown:
        return
    trial = context.folder.trial(thrown[-1])
    if context.settings.excluded_reason(trial.number) is not None:
        return
    try:
        # A track was measured elsewhere; a film may be gone once its throw has a verdict.
        if not ((trial.data / "track.parquet").is_file() or (trial.results / "verdict.json").is_file()):
            _await_log(sitting, context, trial)
            _await_film(sitting, context, trial)
        while not _judged(sitting, trial):
            pass
    except Unusable as reason:
        put_aside(context, trial, str(reason))
        sitting.person.show(f"trial {trial.number} was put aside: {reason}")


def _judged(sitting: Sitting, trial: TrialFolder) -> bool:
    """Make a throw's verdict; where something must be corrected first, wait until the person has done it."""
    try:
        _make(sitting, trial.results / "verdict.json")
    except StrandcastError as error:
        if error.code in OF_ANOTHER_THROW:
            raise Unusable(error.what) from error
        sitting.person.say(str(error))
        sitting.person.forget()
        sitting.person.show(f"trial {trial.number}: correct this and type: again; to put it aside: none")
        while (typed := sitting.person.typed(POLL_S)) != "again":
            if typed == "none":
                raise Unusable(error.what) from error
        return False
    return True


def put_aside(context: Context, trial: TrialFolder, reason: str) -> Path:
    """Move a trial's files away, so that its number is free again and nothing counts; return where to."""
    folder, number = context.folder.data / ASIDE / trial.data.name, 1
    while folder.exists():
        number += 1
        folder = folder.with_name(f"{trial.data.name}-{number}")
    write_text(trial.data / "why.txt", reason + "\n")
    folder.parent.mkdir(exist_ok=True)
    trial.data.rename(folder)
    for path in trial.results.iterdir() if trial.results.is_dir() else ():
        if path.name not in PLANNED:
            (folder / "results").mkdir(exist_ok=True)
            path.rename(folder / "results" / path.name)
    return folder


def _await_log(sitting: Sitting, context: Context, trial: TrialFolder) -> None:
    """Return when the trial has its complete log; import one that arrives in the watched folder."""
    record = trial.data / "run.json"

    def imported() -> bool:
        for log in [] if record.is_file() else _new_files(context, trial.number, LOG_SUFFIXES):
            try:
                import_joints.run(sitting.root, sitting.name, trial.number, log, Reading(), [])
            except StrandcastError as error:
                raise Unusable(f"{log.name}: {error.what}") from error
        return record.is_file()

    if not record.is_file() and load_arm(context.arm_file).driver is not None:
        raise Unusable("the throw was cut off before its log was written")
    _wait(sitting, context, "joint log", imported)
    run = Run.read(record)
    if not run.complete:
        raise Unusable(run.reason or "its log is not complete")


def _await_film(sitting: Sitting, context: Context, trial: TrialFolder) -> None:
    """Return when the trial has its film; copy one that arrives in the watched folder."""

    def filmed() -> bool:
        films = trial.videos() or _new_files(context, trial.number, (*video_suffixes(), *PHOTRON, FOLDER))
        if len({film.stem for film in films}) > 1 or len(trial.videos()) > 1:
            raise Unusable(f"there are several films: {', '.join(film.name for film in films)}")
        if films and not trial.videos():
            _copy_film(films[-1], trial.data)
        return bool(films)

    if not trial.videos():
        try:
            _run_program(sitting, context, "after", trial)
        except Unusable as reason:  # the film may come all the same
            sitting.person.say(str(reason))
    _wait(sitting, context, "film", filmed)


def _copy_film(film: Path, folder: Path) -> None:
    """Copy a film, with all files that belong to it, into a trial's folder."""
    part = folder / ".film.part"
    if film.is_dir():
        shutil.rmtree(part, ignore_errors=True)
        shutil.copytree(film, part)
        part.rename(folder / "video")
        return
    for file in files_of_video(film):
        shutil.copyfile(file, part)
        part.replace(folder / f"video{file.suffix.lower()}")


def _wait(sitting: Sitting, context: Context, what: str, there: Callable[[], bool]) -> None:
    """Wait for what a throw leaves, until it is there, the time is over, or the person gives it up."""
    if there():
        return
    limit_s = context.settings.sitting.wait_s
    where = context.settings.sitting.folder or context.folder.data
    sitting.person.forget()
    sitting.person.show(f"waiting for the {what} in {where}; if there is none, type: none")
    end_s = time.monotonic() + limit_s
    while not there():
        if sitting.person.typed(POLL_S) == "none":
            raise Unusable(f"there is no {what}")
        if time.monotonic() > end_s:
            raise Unusable(f"no {what} came within {limit_s:g} s")


def _new_files(context: Context, trial: int, suffixes: tuple[str, ...]) -> list[Path]:
    """Return the complete files of some kinds that have come into the watched folder since the throw."""
    found = _watched(context)
    if found is None:
        return []
    before = _before(context, trial)
    new = {
        path: facts
        for path, facts in found.items()
        if before.get(path.name) != facts and (FOLDER if path.is_dir() else path.suffix.lower()) in suffixes
    }
    if new:
        time.sleep(STEADY_S)
        now = _watched(context) or {}
        new = {path: facts for path, facts in new.items() if now.get(path) == facts and _opens(path)}
    return sorted(new)


def _opens(path: Path) -> bool:
    """Return whether a file is more than the beginning of a film."""
    if path.suffix.lower() in CONTAINERS:
        try:
            with open_video(path):
                pass
        except StrandcastError as error:
            return error.code not in UNFINISHED
    return True


def _watched(context: Context) -> dict[Path, list[int]] | None:
    """Return what lies in the watched folder: of each file, or of all pictures in a folder, size and time.

    None: it cannot be read, as a network folder that is away for a while.
    """
    given = context.settings.sitting.folder
    found: dict[Path, list[int]] = {}
    try:
        for path in [] if given is None else sorted((context.folder.root / given).iterdir()):
            inside = (each for each in path.iterdir() if each.suffix.lower() in PICTURES)
            facts = [each.stat() for each in (inside if path.is_dir() else (path,))]
            if facts and not path.name.startswith("."):
                size, changed = sum(each.st_size for each in facts), max(each.st_mtime_ns for each in facts)
                found[path] = [len(facts), size, changed]
    except OSError:
        return None
    return found


def _before(context: Context, trial: int) -> dict[str, list[int]]:
    """Return what the watched folder held before a trial was thrown."""
    with suppress(StrandcastError):
        record = read_json(context.folder.results / FOLDER_BEFORE)
        if record.get("trial") == trial:
            return dict(record["folder"])
    return _remember(context, trial)


def _remember(context: Context, trial: int) -> dict[str, list[int]]:
    """Write down what the watched folder holds before a trial is thrown."""
    found = _watched(context)
    if found is None:
        raise Unusable(f"sitting.folder, {context.settings.sitting.folder}, cannot be read")
    folder = {path.name: facts for path, facts in found.items()}
    write_text(context.folder.results / FOLDER_BEFORE, json.dumps({"trial": trial, "folder": folder}))
    return folder


def _make(sitting: Sitting, result: Path) -> None:
    """Make a result and what it needs, stage by stage."""
    context = sitting.context()
    targets = [relative_to(context.folder.root, result)]
    for step, task in tasks_of(context, context.folder.recorded_trials(), {}, targets).items():
        if task.problem is not None:
            raise task.problem
        if not task.runs:
            continue
        set_context(f"{sitting.name} {step}")
        print_line(f"{sitting.name} {step}")
        with lease(sitting.root, sitting.name):
            run_stage(step.stage, sitting.root, sitting.name, step.trial)


def _throw(sitting: Sitting, context: Context, trial: TrialFolder) -> bool:
    """Show the next motion and throw it, if the person allows just this one; False: the sitting is over."""
    person, arm, motion = sitting.person, load_arm(context.arm_file), trial.results / MOTION
    driver = None if arm.driver is None else driver_of_arm(arm, read_motion(motion))
    options = replace(sitting.options, hanging_m=context.settings.string.length_m)
    preflight = run_preflight(motion, arm, driver or Elsewhere(arm.log_rate_hz), trial.data, options)
    for line in dry_run_report(preflight):
        person.say(line)
    if first := to_correct_first(context, trial.number):
        person.say(f"warning: {first}; then throw again")
    expected = expected_miss(preflight.motion)
    person.show(f"trial {trial.number} is next: {expected or 'nothing was predicted'}")
    if preflight.refused_live is not None:
        raise preflight.refused_live
    if not _allowed(sitting, context, preflight.short_hash):
        return False
    try:
        _remember(context, trial.number)
        _run_program(sitting, context, "before", trial)
    except Unusable as reason:
        person.show(f"nothing was thrown: {reason}")
        return True
    if driver is None:
        trial.data.mkdir(parents=True, exist_ok=True)
        for name in PLANNED:
            shutil.copyfile(trial.results / name, trial.data / name)
        person.show(f"play it now: {motion}")
        return True
    person.show(f"trial {trial.number} is thrown")
    try:
        play(preflight, driver, preflight.short_hash)
    except StrandcastError as error:  # what it left behind is put aside
        person.say(str(error))
    return True


def _allowed(sitting: Sitting, context: Context, short_hash: str) -> bool:
    """Ask for a motion's hash while the pages are written; return once they are, and nothing else runs."""
    person, log = sitting.person, context.folder.results / "sitting" / "run.log"
    person.forget()  # a hash that was typed twice must not move the arm twice
    person.say(f"type {short_hash} to throw it, or q to end")
    answer: str | None = None
    with log.open("wb") as out:
        line = [sys.executable, "-m", "strandcast", "run", sitting.name]
        pages: subprocess.Popen[bytes] | None = subprocess.Popen(line, stdout=out, stderr=out)
    while answer not in (short_hash, "q") or pages is not None:
        typed = person.typed(POLL_S)
        if typed is not None:
            answer = typed
            if answer not in (short_hash, "q"):
                person.say(f"type {short_hash} to throw it, or q to end")
            elif pages is not None:
                person.say("the pages are being written first")
        if pages is not None and pages.poll() is not None:
            person.show_pages("the pages are up to date" if pages.returncode == 0 else f"see {log}")
            pages = None
    return answer == short_hash


def _run_program(sitting: Sitting, context: Context, name: str, trial: TrialFolder) -> None:
    """Run the lab's own program before or after a throw; its output is shown."""
    settings = context.settings.sitting
    given = settings.before if name == "before" else settings.after
    if given is None:
        return
    words = shlex.split(given)
    places = {"{trial}": trial.number, "{motion}": trial.results / MOTION, "{data}": trial.data}
    for name_of_place, value in places.items():
        words = [word.replace(name_of_place, str(value)) for word in words]
    sitting.person.say(f"sitting.{name}: {shlex.join(words)}")
    try:
        code = subprocess.run(
            words, cwd=context.folder.root, stdin=subprocess.DEVNULL, timeout=settings.wait_s, check=False
        ).returncode
    except subprocess.TimeoutExpired as error:
        raise Unusable(f"sitting.{name} took longer than {settings.wait_s:g} s") from error
    except OSError as error:
        raise Unusable(f"sitting.{name} failed: {error}") from error
    if code:
        raise Unusable(f"sitting.{name} ended with exit code {code}")
