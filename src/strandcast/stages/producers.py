"""Which stage makes which file of an experiment, and the command that runs it."""

import shlex
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from strandcast.records.listing import file_exists
from strandcast.stages import CALLED_BY_NAME, files
from strandcast.stages.context import Context
from strandcast.stages.declarations import STAGES
from strandcast.stages.job import Files, Job

BY_CAMERA = ("ingest", "track", "reconstruct", "align")  # a supplied track needs none of them
JOIN = "join_views"  # of several cameras


class Step(NamedTuple):
    """A stage of one trial; trial 0: of the whole experiment."""

    stage: str
    trial: int = 0
    camera: str = ""  # its name, where the experiment has several

    def __str__(self) -> str:
        trial = f"trial {self.trial}" if self.trial else ""
        of = ", ".join(part for part in (trial, self.camera) if part)
        return f"{self.stage} of {of}" if of else self.stage

    def command(self, experiment: str) -> str:
        """Return the command that runs it alone."""
        name = ("" if self.stage in CALLED_BY_NAME else "stage ") + self.stage.replace("_", "-")
        of = f"{experiment}/{self.camera}" if self.camera else experiment
        return f"strandcast {name} {of}" + (f" {self.trial}" if self.trial else "")

    def job(self, context: Context, trials: tuple[int, ...] = ()) -> Job:
        """Return its job, of the experiment or of its camera."""
        return Job(context.views[self.camera] if self.camera else context, self.trial, trials)


def steps_of(context: Context, trial: int) -> list[Step]:
    """Return the stages of a trial, in the order in which they run; trial 0: those of the experiment."""
    is_lab, captures = context.settings.lab is not None, context.settings.lab_captures
    if not trial:
        recorded = [] if is_lab else context.folder.recorded_trials()
        supplied = recorded and all(files.supplied(Job(context), each) for each in recorded)
        calibrated = [] if supplied or context.settings.aims_in_space else _by_camera(context, ["calibrate"])
        lab = ["lab_calibrate"] if is_lab and not captures else []
        lab += ["lab_rehearse"] if context.settings.lab_rehearses else []
        return [*map(Step, lab), *calibrated, Step("summary")]
    folder = context.folder.trial(trial)
    if is_lab:
        motion = ["plan", lab_throw(context)]
    elif file_exists(folder.data / "motion.json"):
        motion = ["register_motion"]
    else:
        motion = [] if folder.raw_files() or context.settings.target_m is None else ["plan"]
    measured = [Step("register_track", trial)]
    if not files.supplied(Job(context), trial):
        measured = _by_camera(context, BY_CAMERA, trial) + [Step(JOIN, trial)] * bool(context.views)
    after = [Step(stage, trial) for stage in ("score", "estimate", "report")]
    return [*(Step(stage, trial) for stage in motion), *measured, *after]


def _by_camera(context: Context, stages: Iterable[str], trial: int = 0) -> list[Step]:
    """Return some stages of each camera."""
    return [Step(stage, trial, camera) for camera in context.views or [""] for stage in stages]


def lab_throw(context: Context) -> str:
    """Return the stage that throws in the lab."""
    return "lab_capture" if context.settings.lab_captures else "lab_throw"


def producers(context: Context, trials: Iterable[int]) -> dict[Path, Step]:
    """Return the step that makes each file, for an experiment and some of its trials."""
    steps = (step for trial in (0, *trials) for step in steps_of(context, trial))
    return {
        path: step for step in steps for path in Files(STAGES[step.stage], step.job(context)).all_outputs()
    }


def recording_advice(context: Context, trial: int) -> str:
    """Return how a trial that was thrown gets its recording: a video, or in space a capture."""
    if context.settings.aims_in_space:
        return f"import the capture of trial {trial}: {capture_command(context, trial)}"
    folder = context.folder.trial(trial)
    films = " and ".join(f"{film}.*" for film in folder.films)
    return f"copy the video of trial {trial} to {folder.data}/{films}"


def capture_command(context: Context, trial: int) -> str:
    """Return the command that imports the capture of a throw in space."""
    axes = "--up AXIS --length-unit UNIT --hand BODY --marker PLACE:NAME …"
    return f"strandcast import track {shlex.quote(context.name)} {trial} CAPTURE {axes}"


def play_command(context: Context, trial: int) -> str:
    """Return the command that throws a planned motion; exports it, if the arm has no driver."""
    if context.settings.lab is not None:
        return Step(lab_throw(context), trial).command(context.name)
    folder = context.folder.trial(trial)
    motion = folder.results / "motion.json"
    if not files.has_driver(context):
        return f"strandcast export motion {shlex.quote(str(motion))} --as ros --out FILE"
    options = [str(motion), "--arm", str(context.arm_file), "--out", str(folder.data)]
    return shlex.join(["strandcast", "play", *options])


def to_correct_first(context: Context, trial: int) -> str | None:
    """Return what the trials before this one say must be done before it is thrown; None: nothing."""
    from strandcast.report import causes, results  # heavy too

    before = [each for each in context.counted(context.folder.recorded_trials()) if each < trial]
    if not before:
        return None
    return causes.to_correct_first(results.read_results(context.folder.trial(max(before)).results))
