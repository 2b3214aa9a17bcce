"""A sitting at the rig: throw, wait for log and film, judge the throw, plan the next one, and again.

All state is in files, so that the same command goes on after Ctrl-C or a power loss: what was thrown and not
judged yet lies in the trial's folder, and a record says what the watched folder held before the throw.
"""

import errno
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from strandcast.arm.load import load_arm
from strandcast.errors import LOG_INCOMPLETE, StrandcastError
from strandcast.executor.drivers.protocol import Driver
from strandcast.executor.drivers.registry import driver_of_arm
from strandcast.executor.dry_run_report import dry_run_report
from strandcast.executor.play import play
from strandcast.executor.preflight import Elsewhere, PlayOptions, Preflight, read_motion, run_preflight
from strandcast.imports.joints import Reading
from strandcast.imports.ros_bags import SUFFIXES as BAGS
from strandcast.progress import print_line, set_context
from strandcast.records.files import write_text
from strandcast.records.folders import PHOTRON, TrialFolder, video_suffixes
from strandcast.records.joint_log import Run
from strandcast.records.lineage import relative_to
from strandcast.records.record import read_json
from strandcast.report.expected import expected_miss
from strandcast.stages import import_joints
from strandcast.stages.context import Context, context_of
from strandcast.stages.producers import to_correct_first
from strandcast.stages.run import run_stage
from strandcast.workflow.display import printable
from strandcast.workflow.locks import lease, living_owner
from strandcast.workflow.pending import tasks_of
from strandcast.workflow.terminal import Terminal
from strandcast.workflow.watched_folder import (
    PICTURE_FOLDER,
    Unusable,
    are_complete,
    copy_film,
    facts_of,
    listing,
    new_files,
)

RECORD = Path("sitting", "last-throw.json")  # in the results of the experiment
ASIDE = "aside"  # in its raw files: trials that cannot be used
YES_LASTS_S = 10.0  # after a longer program, a person is asked again before the arm moves; chosen
LOG_SUFFIXES = (".csv", *BAGS)
# Film and log are not of the same throw, or one of them does not show it.
OF_ANOTHER_THROW = ("SC-A007", "SC-A008", "SC-V023")
MOTION = "motion.json"
PLANNED = (MOTION, "predicted.parquet")
CUT_OFF = "the throw was cut off before its log was written, or refused"


@dataclass(frozen=True)
class Sitting:
    """A sitting: the project, the experiment, how motions are played, and the person."""

    root: Path
    name: str
    options: PlayOptions
    person: Terminal

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
    place = context.folder.results / RECORD.parent
    place.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(place / "lock", timeout=0):
            _hold(sitting, context)
    except Timeout:
        what = "another sitting of this experiment has not ended"
        raise StrandcastError("SC-W010", what, file=place, fix="end it first") from None


def _hold(sitting: Sitting, context: Context) -> None:
    if not context.settings.tracker_finds_scale:  # nothing is thrown before it can be judged
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
    record = _record(context)
    if record.get("thrown") and not context.folder.trial(record["trial"]).raw_files():
        context.folder.trial(record["trial"]).data.mkdir(parents=True, exist_ok=True)
        _put_aside(sitting, context, context.folder.trial(record["trial"]), CUT_OFF)
    thrown = context.folder.thrown_trials()
    if not thrown or context.settings.excluded_reason(thrown[-1]) is not None:
        return
    trial = context.folder.trial(thrown[-1])
    if (trial.results / "verdict.json").is_file():  # a run makes it again where something has changed
        return
    try:
        if not (trial.data / "track.parquet").is_file():  # that one was measured elsewhere
            arrived = _arrivals(context, record, trial)
            _await_log(sitting, context, trial, arrived, by_us=record.get("trial") == trial.number)
            _await_film(sitting, context, trial, arrived)
        while not _judged(sitting, trial):
            pass
    except Unusable as reason:
        _put_aside(sitting, context, trial, str(reason))


def _put_aside(sitting: Sitting, context: Context, trial: TrialFolder, reason: str) -> None:
    folder = put_aside(context, trial, reason)
    _write_record(context, {})  # its listing is not that before the next throw of this number
    sitting.person.show(f"trial {trial.number} was put aside, in {folder}: {reason}")


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
        while (typed := sitting.person.typed()) != "again":
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
    write_text(trial.data / "why.txt", printable(reason) + "\n")
    made = trial.data / f"results-{folder.name}"
    for path in trial.results.iterdir() if trial.results.is_dir() else ():
        if path.name not in PLANNED:
            made.mkdir(exist_ok=True)
            shutil.move(path, made / path.name)
    # As long as this says what the motion was made from, it is not planned again.
    note = Path("made", "plan.json")
    if (made / note).is_file():
        (trial.results / note).parent.mkdir()
        shutil.move(made / note, trial.results / note)
    folder.parent.mkdir(exist_ok=True)
    trial.data.rename(folder)  # last: cut off before, the trial is judged and put aside again
    return folder


Arrivals = Callable[[tuple[str, ...]], list[Path]]  # of some suffixes: files that came since the throw


def _arrivals(context: Context, record: dict[str, Any], trial: TrialFolder) -> Arrivals:
    """Return a function that finds what has come into the watched folder since a trial was thrown."""
    given, before = context.settings.sitting.folder, None
    folder = context.folder.root / (given or "")
    with suppress(Unusable):
        if given is not None:  # thrown by another command: what comes from now on
            before = (record["folder"] if record.get("trial") == trial.number else None) or listing(folder)
    return lambda suffixes: [] if before is None else new_files(folder, before, suffixes)


def _await_log(
    sitting: Sitting, context: Context, trial: TrialFolder, arrived: Arrivals, *, by_us: bool
) -> None:
    """Return when the trial has its complete log; import one that arrives in the watched folder.

    `by_us`: it was thrown in a sitting.
    """
    record, refused = trial.data / "run.json", set[str]()

    def imported() -> bool:
        for log in [] if record.is_file() else arrived(LOG_SUFFIXES):
            try:
                import_joints.run(sitting.root, sitting.name, trial.number, log, Reading(), [])
            except StrandcastError as error:  # it may be another file, or not whole yet
                if log.name not in refused:
                    sitting.person.say(str(error))
                refused.add(log.name)
        return record.is_file()

    if not record.is_file() and load_arm(context.arm_file).driver is not None:
        if by_us:
            raise Unusable(CUT_OFF)
        return  # it was recorded without a log
    # No time limit: a person plays it when everything is ready.
    _wait(sitting.person, "joint log", _places(context, record), imported, None)
    run = Run.read(record)
    if not run.complete:
        raise Unusable(run.reason or "its log is not complete")


def _await_film(sitting: Sitting, context: Context, trial: TrialFolder, arrived: Arrivals) -> None:
    """Return when the trial has its film; copy one that arrives in the watched folder."""

    def filmed() -> bool:
        there = [path for path in trial.videos() if path.suffix.lower() != PHOTRON[0]]  # has no header yet
        films = there or arrived((*video_suffixes(), *PHOTRON, PICTURE_FOLDER))
        if len({film.stem if film.suffix.lower() in PHOTRON else film.name for film in films}) > 1:
            raise Unusable(f"there are several films: {', '.join(film.name for film in films)}")
        if there:
            facts = facts_of(trial.data) or {}
            return are_complete(trial.data, {path: facts[path] for path in there if path in facts})
        try:
            for film in films[-1:]:
                copy_film(film, trial.data)
        except OSError as error:
            if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EACCES, errno.EROFS):
                raise
            return False  # a network folder may go, and come back
        return bool(films)

    if filmed():
        return
    try:
        _run_program(sitting, context, "after", trial, trial.data / MOTION)
    except Unusable as reason:  # the film may come all the same
        sitting.person.say(str(reason))
    limit_s = context.settings.sitting.wait_s
    _wait(sitting.person, "film", _places(context, trial.data / "video.*"), filmed, limit_s)


def _places(context: Context, file: Path) -> str:
    given = context.settings.sitting.folder
    return str(file) if given is None else f"{given}, or {file}"


def _wait(person: Terminal, what: str, where: str, there: Callable[[], bool], limit_s: float | None) -> None:
    """Wait for what a throw leaves, until it is there, the time is over, or the person gives it up."""
    if there():
        return
    person.forget()
    person.show(f"waiting for the {what} in {where}; if there is none, type: none")
    end_s = None if limit_s is None else time.monotonic() + limit_s
    while not there():
        typed = person.typed()
        if typed == "none":
            raise Unusable(f"there is no {what}")
        if typed is not None:
            person.say(f"type none if there is no {what}; Ctrl-C ends, and the same command goes on")
        if end_s is not None and time.monotonic() > end_s:
            raise Unusable(f"no complete {what} came within {limit_s:g} s")


def _record(context: Context) -> dict[str, Any]:
    """Return the record of the last throw: `trial`, `folder` (a `listing` before it), whether `thrown`."""
    with suppress(StrandcastError):
        return dict(read_json(context.folder.results / RECORD))
    return {}


def _write_record(context: Context, record: dict[str, Any]) -> None:
    write_text(context.folder.results / RECORD, json.dumps(record))


def _make(sitting: Sitting, result: Path) -> None:
    """Make a result and what it needs, stage by stage."""
    context = sitting.context()
    targets = [relative_to(context.folder.root, result)]
    for step, task in tasks_of(context, context.folder.thrown_trials(), {}, targets).items():
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
    person = sitting.person
    preflight, driver = _proposed(sitting, context, trial)
    _write_pages(sitting, context)
    if not _allowed(person, preflight.short_hash):
        return False
    asked_s = time.monotonic()
    try:
        _make_ready(sitting, context, trial, preflight, hand_over=driver is None)
    except Unusable as reason:
        if {path.name for path in trial.raw_files()} <= {*PLANNED}:
            shutil.rmtree(trial.data, ignore_errors=True)  # only copies are in it
        person.show(f"nothing was thrown: {reason}")
        return True
    if driver is None:
        if not (trial.data / "run.json").is_file():  # `before` has not played it
            person.show(f"play it now: {trial.data / MOTION}")
        return True
    if time.monotonic() - asked_s > YES_LASTS_S:
        person.say("the arm has not moved since you typed the hash")
        if not _allowed(person, preflight.short_hash):
            return False
    _write_record(context, _record(context) | {"thrown": True})
    person.show(f"trial {trial.number} is thrown")
    try:
        play(preflight, driver, preflight.short_hash)
    except StrandcastError as error:  # what it left behind is put aside
        person.say(str(error))
        thrown = bool(trial.raw_files()) or error.exit_code == LOG_INCOMPLETE
        _write_record(context, _record(context) | {"thrown": thrown})
        if not thrown:  # refused, or stopped on the way to the start
            person.show("nothing was thrown")
    return True


def _proposed(sitting: Sitting, context: Context, trial: TrialFolder) -> tuple[Preflight, Driver | None]:
    """Check the next motion and show what it does, and how likely it hits; return its driver, if any."""
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
    return preflight, driver


def _write_pages(sitting: Sitting, context: Context) -> None:
    """Make what is left: the pages, and the clips in them."""
    log = context.folder.results / RECORD.with_name("run.log")
    sitting.person.say("the pages are being written")
    with log.open("wb") as out:
        line = [sys.executable, "-m", "strandcast", "run", sitting.name]
        code = subprocess.run(line, stdin=subprocess.DEVNULL, stdout=out, stderr=out, check=False).returncode
    sitting.person.show_pages("the pages are up to date" if code == 0 else f"a page failed: see {log}")


def _allowed(person: Terminal, short_hash: str) -> bool:
    """Ask for a motion's hash until it is typed, or q."""
    person.forget()  # a hash that was typed twice must not move the arm twice
    answer: str | None = ""
    while answer not in (short_hash, "q"):
        if answer is not None:
            person.say(f"type {short_hash} to throw it, or q to end")
        answer = person.typed()
    return answer == short_hash


def _make_ready(
    sitting: Sitting, context: Context, trial: TrialFolder, preflight: Preflight, *, hand_over: bool
) -> None:
    """Do what comes before a throw; raise `Unusable` if it must not be."""
    motion, given = preflight.motion_path, context.settings.sitting.folder
    if read_motion(motion).content_sha256() != preflight.motion.content_sha256():
        raise Unusable("another motion was planned meanwhile")
    if (owner := living_owner(sitting.root, sitting.name)) is not None:
        raise Unusable(f"another run has not ended: {owner}")
    before = None if given is None else listing(context.folder.root / given)
    _write_record(context, {"trial": trial.number, "folder": before, "thrown": False})
    if hand_over:
        trial.data.mkdir(parents=True, exist_ok=True)
        for name in PLANNED:
            shutil.copyfile(trial.results / name, trial.data / name)
    _run_program(sitting, context, "before", trial, motion)


def _run_program(sitting: Sitting, context: Context, name: str, trial: TrialFolder, motion: Path) -> None:
    """Run the lab's own program before or after a throw, with all that it starts; its output is shown."""
    settings = context.settings.sitting
    given = settings.before if name == "before" else settings.after
    if given is None:
        return
    words = shlex.split(given)
    places = {"{trial}": trial.number, "{motion}": motion.resolve(), "{data}": trial.data.resolve()}
    for name_of_place, value in places.items():
        words = [word.replace(name_of_place, str(value)) for word in words]
    sitting.person.say(f"sitting.{name}: {shlex.join(words)}")
    try:
        program = subprocess.Popen(
            words, cwd=context.folder.root, stdin=subprocess.DEVNULL, start_new_session=True
        )
    except OSError as error:
        raise Unusable(f"sitting.{name} failed: {error}") from error
    try:
        code = program.wait(settings.wait_s)
    except BaseException as error:
        with suppress(OSError):
            os.killpg(program.pid, signal.SIGKILL)
        program.wait()
        if isinstance(error, subprocess.TimeoutExpired):
            raise Unusable(f"sitting.{name} took longer than {settings.wait_s:g} s") from error
        raise
    if code:
        raise Unusable(f"sitting.{name} ended with exit code {code}")
