"""The state of an experiment: of each stage of each trial, what was thrown, and what to do next.

It starts nothing and changes nothing. What it calls stale is what `strandcast run` makes again.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from strandcast.errors import StrandcastError
from strandcast.records.known_hashes import remembered
from strandcast.records.lineage import relative_to
from strandcast.records.record import read_json
from strandcast.stages.context import Context, context_of
from strandcast.stages.producers import Step, play_command, recording_advice, steps_of, to_correct_first
from strandcast.workflow.locks import living_owner
from strandcast.workflow.pending import StepState, tasks_of
from strandcast.workflow.targets import known_trials
from strandcast.workflow.verify import Finding, verify

State = Literal["done", "stale", "missing", "failed", "damaged", "excluded"]
HASH_DIGITS = 8  # as `strandcast play` asks for
LOG_TAIL_BYTES = 1 << 16
CODED = re.compile(r"^(SC-[A-Z]\d{3}) ERROR  (.*)", re.MULTILINE)
UNCODED = re.compile(r"^\S*(?:Error|Exception|Interrupt)\b.*", re.MULTILINE)  # the last line of a traceback


@dataclass(frozen=True)
class StageStatus:
    """The state of one stage of one trial.

    Attributes
    ----------
    why
        What changed, is missing or went wrong; for an excluded trial, the reason.
    after
        The stage that runs again and makes this one run too, if there is no other reason.
    code
        The code of the error with which it failed, if it has one.
    runs
        Whether `strandcast run` runs it now, as far as no other stage fails before it.
    camera
        The camera that it is of, where there are several.
    """

    stage: str
    state: State
    why: list[str] = field(default_factory=list)
    after: str | None = None
    code: str | None = None
    runs: bool = False
    camera: str = ""

    @property
    def name(self) -> str:
        """Return the stage, of one of several cameras with the camera."""
        return f"{self.stage} ({self.camera})" if self.camera else self.stage

    def step(self, trial: int) -> Step:
        """Return the step of a trial that it is the state of."""
        return Step(self.stage, trial, self.camera)


@dataclass(frozen=True)
class PlayedMotion:
    """What the arm played in a trial.

    Attributes
    ----------
    motion_sha256
        Hash of the motion's content; None if no motion lies beside the raw files.
    as_planned
        Whether it is the motion that was planned for this trial.
    planned_for
        The experiment and trial that the motion names.
    """

    motion_sha256: str | None
    as_planned: bool
    planned_for: str | None

    def __str__(self) -> str:
        if self.motion_sha256 is None:
            return "unknown motion"
        short = self.motion_sha256[:HASH_DIGITS]
        return short if self.as_planned else f"{short}, planned for {self.planned_for}"


@dataclass(frozen=True)
class TrialStatus:
    """The state of one trial; trial 0: the stages of the whole experiment."""

    trial: int
    throw: PlayedMotion | None
    stages: list[StageStatus]


@dataclass(frozen=True)
class Status:
    """The state of an experiment.

    Attributes
    ----------
    next_steps
        What to do next: commands that can be pasted, and lines of advice, which begin with ``#``.
    """

    experiment: str
    trials: list[TrialStatus]
    damaged: list[Finding]
    next_steps: list[str]


def status_of(root: Path, name: str) -> Status:
    """Return the state of an experiment.

    Raises
    ------
    StrandcastError
        Its settings cannot be read, or SC-R032 a folder's name leaves open which trial it holds.
    """
    with remembered(root):
        return _status_of(context_of(root, name))


def _status_of(context: Context) -> Status:
    root, name = context.folder.root, context.name
    context.arm_file  # noqa: B018  (raises if there is none)
    numbers, more = known_trials(context)
    tasks = tasks_of(context, numbers, {})
    findings = verify(root, name, raw=False) if more or _are_open(tasks) else []
    again = {relative_to(root, each.file): each.what for each in findings if each.state == "outdated"}
    damaged = [each for each in findings if each.state in ("damaged", "misplaced")]
    if more:
        again[f"results/{name}/report.html"] = "the lab throws another trial"
    if again:
        tasks = tasks_of(context, numbers, again)
    faults = {relative_to(root, each.file): each for each in damaged}
    shown = sorted({0, *numbers, *context.folder.thrown_trials(), *(step.trial for step in tasks)})
    trials = [_trial(context, number, tasks, faults) for number in shown]
    if context.settings.target_m is None and not context.folder.thrown_trials():
        imports = f"import a recording: strandcast import track {name} 1 FILE.csv"
        next_steps = [f"# {recording_advice(context, 1) if context.views else imports}"]
    else:
        next_steps = list(_next_steps(context, trials, damaged))
    return Status(name, trials, damaged, next_steps)


def is_fresh(context: Context) -> bool:
    """Return whether a run would find nothing to do: all results are there, and as their notes say."""
    trials, more = known_trials(context)
    return not more and not _are_open(tasks_of(context, trials, {}))


def _are_open(tasks: dict[Step, StepState]) -> bool:
    return any(task.runs or task.problem for task in tasks.values())


def _trial(
    context: Context, number: int, tasks: dict[Step, StepState], faults: dict[str, Finding]
) -> TrialStatus:
    excluded = context.settings.excluded_reason(number) if number else None
    steps = [step for step in steps_of(context, number) if step in tasks or excluded is None]
    if number > max((step.trial for step in tasks if step.stage == "report"), default=0):
        steps = [step for step in steps if step in tasks]  # only its motion is asked for
    stages = [replace(_stage(context, step, tasks.get(step), faults), camera=step.camera) for step in steps]
    if excluded is not None:
        stages.insert(0, StageStatus("trial", "excluded", [excluded]))
    return TrialStatus(number, throw_of(context, number) if number else None, stages)


def _stage(context: Context, step: Step, task: StepState | None, faults: dict[str, Finding]) -> StageStatus:
    if task is None:
        return StageStatus(step.stage, "missing")
    root = context.folder.root
    wrong = [faults[name] for name in task.outputs if name in faults]
    if wrong:
        why = [f"{relative_to(root, each.file)} {each.what}" for each in wrong]
        return StageStatus(step.stage, "damaged", why)
    if task.problem is not None:
        return StageStatus(step.stage, "failed", [task.problem.what], None, task.problem.code, True)
    lost = [name for name in task.outputs if not (root / name).exists()]
    after = None if task.after is None else str(task.after)
    if not lost:
        return StageStatus(step.stage, "stale" if task.runs else "done", task.why, after, None, task.runs)
    code, what = failure_in(task.files.log)
    if what is not None:
        return StageStatus(step.stage, "failed", [what], None, code, task.runs)
    return StageStatus(step.stage, "missing", task.why, after, None, task.runs)


def failure_in(log: Path) -> tuple[str | None, str | None]:
    """Return the code and the words of the error with which a log ends, if any."""
    try:
        text = log.read_bytes()[-LOG_TAIL_BYTES:].decode(errors="replace")
    except OSError:
        return None, None
    coded = CODED.findall(text)
    if coded:
        code, what = coded[0]
        return code, what
    uncoded = UNCODED.findall(text) if "Traceback (most recent call last)" in text else []
    return None, f"{uncoded[-1]} ({log})" if uncoded else None


def throw_of(context: Context, trial: int) -> PlayedMotion | None:
    """Return what the arm played in a trial; None if nothing was thrown."""
    folder = context.folder.trial(trial)
    if not folder.raw_files():
        return None
    try:
        played = read_json(folder.data / "motion.json")
    except StrandcastError:
        return PlayedMotion(None, False, None)
    sha256, planned_for = str(played.get("content_sha256")), (played.get("experiment"), played.get("trial"))
    try:
        planned = str(read_json(folder.results / "motion.json").get("content_sha256"))
    except StrandcastError:
        planned = sha256
    as_planned = sha256 == planned and planned_for == (context.name, trial)
    return PlayedMotion(sha256, as_planned, f"{planned_for[0]} trial {planned_for[1]}")


def _next_steps(context: Context, trials: list[TrialStatus], damaged: list[Finding]) -> Iterator[str]:
    name, found = context.name, [(trial.trial, stage) for trial in trials for stage in trial.stages]
    if damaged:
        yield f"# restore the damaged files; this lists them: strandcast verify {name}"
        return
    owner = living_owner(context.folder.root, name)
    if owner is not None:
        yield f"# wait for the run that has not ended: {owner}"
        return
    thrown = [trial.trial for trial in trials if trial.throw is not None and context.settings.lab is None]
    # With neither a video nor a supplied track.
    filmless = [number for number in thrown if number not in context.folder.recorded_trials()]
    for number in filmless:
        yield f"# {recording_advice(context, number)}"
    failed = [(number, stage) for number, stage in found if stage.state == "failed"]
    if failed:
        number, stage = failed[0]
        yield f"# correct this first: {stage.step(number)}, {stage.code or ''} {stage.why[0]}"
    if any(stage.runs for _, stage in found):
        yield f"strandcast run {name}"
        return
    unmade = [stage.step(number) for number, stage in found if stage.state == "missing"]
    yield from (step.command(name) for step in unmade)  # no result needs them: a run leaves them out
    if any(step.trial for step in unmade):
        return
    following = max((trial.trial for trial in trials), default=0)
    if context.settings.lab is None and not filmless:
        motion = context.folder.trial(following).results / "motion.json"
        if motion.is_file() and not context.folder.trial(following).raw_files():
            first = to_correct_first(context, following)
            yield play_command(context, following) if first is None else f"# {first}; then throw again"
            return
    if not unmade and not filmless:
        yield f"# nothing is to be done; the page is {context.folder.results / 'report.html'}"
