"""Answers for the rules: experiments that exist, files that a stage reads and writes, trials to make.

All paths are relative to the project's root, where Snakemake runs.
"""

import difflib
import re
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path

from strandcast.config.find import NAME as EXPERIMENT
from strandcast.core.trial_names import PREFIX, TRIAL_DIGITS, trial_digits, trial_name
from strandcast.errors import StrandcastError
from strandcast.records.folders import ExperimentFolder, known_experiments, own_experiments, trial_folders
from strandcast.records.listing import file_exists
from strandcast.records.verdict import Verdict
from strandcast.stages import code_version, files
from strandcast.stages.context import Context, context_named
from strandcast.stages.declarations import STAGES
from strandcast.stages.job import Files, Job, Pattern
from strandcast.stages.producers import BY_CAMERA, JOIN

ROOT = Path()
DEMO = "demo"
NEVER = "(?!)"  # the pattern that matches nothing
TRIAL = TRIAL_DIGITS
ANY_TRIAL = [f"{PREFIX}(?:{TRIAL_DIGITS})"]
CAMERA = r"[a-z0-9][a-z0-9_-]{0,31}"
OR_CAMERA = rf"(?:/(?!{PREFIX}){CAMERA})?"  # of an experiment with several cameras, one: cable/left


def default_experiments(root: Path = ROOT) -> list[str]:
    """Return the experiments that are run if none is named: those under data/, or the demonstration."""
    return own_experiments(root) or [DEMO]


def lab_experiments(*, captures: bool | None = None) -> list[str]:
    """Return the experiments that the lab throws; an invalid one is reported when it is asked for.

    With `captures`, only those that it captures in space, or only those that it films.
    """
    lab = [name for name in known_experiments(ROOT) if _is_lab(name)]
    return [name for name in lab if captures in (None, experiment(name).settings.lab_captures)]


def real_experiments() -> list[str]:
    """Return the experiments with recordings of a real rig, invalid ones too."""
    lab = lab_experiments()
    return [name for name in known_experiments(ROOT) if name not in lab]


def _is_lab(name: str) -> bool:
    return _is_valid(name) and experiment(name).settings.lab is not None


def _is_valid(name: str) -> bool:
    try:
        experiment(name)
    except StrandcastError:
        return False
    return True


@cache
def experiment(name: str, root: Path = ROOT) -> Context:
    """Return an experiment, or one of its several cameras, read once."""
    return context_named(root, name)


def names_pattern(names: Iterable[str]) -> str:
    """Return the pattern of a wildcard that matches just these names."""
    return "|".join(map(re.escape, names)) or NEVER


def other_names_pattern(names: Iterable[str]) -> str:
    """Return the pattern of a wildcard that matches the name of every other experiment."""
    return f"(?!(?:{names_pattern(names)})/){EXPERIMENT}"


def with_files(*names: str, experiments: Iterable[str]) -> dict[str, list[str]]:
    """Return the trials that have all of some raw files, by experiment."""
    found = {}
    for name in experiments:
        folders = trial_folders(ROOT / "data" / name).values()
        trials = [folder.name for folder in folders if all(file_exists(folder / file) for file in names)]
        if trials:
            found[name] = trials
    return found


@cache
def supplied_trials() -> dict[str, list[str]]:
    """Return the trials with a track and an alignment measured elsewhere, by experiment; read once.

    Of the lab's captures, that is a pattern of them all: they can be named before they exist.
    """
    there = with_files(*files.SUPPLIED_FILES.values(), experiments=known_experiments(ROOT))
    return there | {name: ANY_TRIAL for name in lab_experiments(captures=True)}


def joined_trials() -> dict[str, list[str]]:
    """Return a pattern of all trials of each experiment with several cameras."""
    several = [name for name in real_experiments() if _is_valid(name) and experiment(name).views]
    return dict.fromkeys(several, ANY_TRIAL)


def played_trials() -> dict[str, list[str]]:
    """Return the trials that a real arm has played with a known motion, by experiment."""
    return with_files("motion.json", experiments=real_experiments())


def thrown_trials() -> dict[str, list[str]]:
    """Return the trials with raw files of a real rig, by experiment: no motion is planned over theirs."""
    found = {name: ExperimentFolder(ROOT, name).thrown_trials() for name in real_experiments()}
    return {name: [trial_name(number) for number in numbers] for name, numbers in found.items() if numbers}


def experiment_pattern(trials: dict[str, list[str]], *, other: bool = False) -> str:
    """Return the pattern of the wildcard `experiment` in paths of just these trials, or of all `other` ones.

    A pattern is for one wildcard; it looks ahead at the trial that follows in the path.
    """
    pairs = "|".join(f"{re.escape(name)}/(?:{'|'.join(numbers)})" for name, numbers in trials.items())
    if not pairs:
        return EXPERIMENT if other else NEVER
    return f"(?{'!' if other else '='}(?:{pairs})/){EXPERIMENT}"


def stage_inputs(
    stage: str, name: str, trial: int = 0, trials: Iterable[int] = (), *, all_read: bool = False
) -> dict[str, list[str]]:
    """Return a stage's input files by role, for an experiment and its trial, or all its trials.

    With `all_read`, these are also the files that it reads without depending on them: raw files, and pictures
    that were made with an input.
    """
    job = Job(experiment(name), trial, tuple(trials))
    found = {role: find(job) for role, find in STAGES[stage].inputs.items()}
    if all_read:
        records = {path for paths in found.values() for path in paths}
        found |= {
            role: [
                path
                for path in find(job)
                if path.is_relative_to(job.context.folder.data)
                or (path.suffix == ".webp" and path.with_suffix(".json") in records)
            ]
            for role, find in STAGES[stage].may_read.items()
        }
    return {role: [str(path) for path in paths] for role, paths in found.items()}


def stage_outputs(stage: str) -> dict[str, Pattern]:
    """Return a stage's output files by role, with the wildcards `experiment`, `trial` and `camera`."""
    return dict(STAGES[stage].outputs)


def stage_settings(stage: str, name: str, trial: int = 0) -> str:
    """Return the settings that a stage reads, as one line of JSON."""
    return code_version.settings(Job(experiment(name), trial), stage)


def trials_of(name: str, verdict_of: Callable[[str], str]) -> list[int]:
    """Return the trials of an experiment: those recorded, or in the lab, all until a hit.

    Parameters
    ----------
    verdict_of
        Returns the path of the verdict of a trial, given as ``01`` or ``100``, once it exists.
    """
    context = experiment(name)
    if context.settings.lab is None:
        return context.folder.recorded_trials()
    return list(_trials_in_lab(context, lambda number: verdict_of(trial_digits(number))))


def known_trials(context: Context) -> tuple[list[int], bool]:
    """Return the trials that the page covers, and whether the lab throws one that has no verdict yet."""
    if context.settings.lab is None:
        return context.folder.recorded_trials(), False
    numbers: list[int] = []
    try:
        for number in _trials_in_lab(context, lambda k: context.folder.trial(k).results / "verdict.json"):
            numbers.append(number)
    except StrandcastError:
        return numbers, True
    return numbers, False


def _trials_in_lab(context: Context, verdict_of: Callable[[int], str | Path]) -> Iterator[int]:
    """Yield the trials of the lab until a hit; each verdict is read before the next trial."""
    for number in range(1, context.settings.max_trials + 1):
        yield number
        if context.counted([number]):
            verdict = Verdict.read(verdict_of(number))
            if context.is_last(number, bool(verdict.hit)):
                return


def targets_of(name: str, until: str | None = None, root: Path = ROOT) -> list[str]:
    """Return the files to make of an experiment: its page, or what a stage writes for the trials so far.

    In the lab, the trials so far include the one to be thrown next, if the tip has not hit yet.

    Raises
    ------
    StrandcastError
        SC-W021 there is no such stage in this experiment, or no trial yet.
    """
    if until is None:
        return [f"results/{name}/report.html"]
    stage, context = until.replace("-", "_"), experiment(name, root)
    known = [each for each in STAGES if _runs(each, context)]
    if stage not in known:
        near = difflib.get_close_matches(stage, known, n=1)
        what = f"{name} has no stage {until!r}"
        fix = (f"did you mean {near[0]}?" if near else f"one of {', '.join(known)}").replace("_", "-")
        raise StrandcastError("SC-W021", what, field="--until", fix=fix)
    trials, _ = known_trials(context)
    if stage == "plan":
        trials = [max(trials, default=0) + 1]  # the next motion
    found: list[str] = []
    for trial in trials or [0]:
        job, of_camera = Job(context, trial, tuple(trials)), stage in (*BY_CAMERA, JOIN)
        made_by = "register_track" if of_camera and files.supplied(job, trial) else stage
        of_one = made_by in (*BY_CAMERA, "calibrate")
        jobs = [Job(one, trial) for one in context.by_camera] if of_one else [job]
        outputs = [path for each in jobs for path in Files(STAGES[made_by], each).all_outputs()]
        if not trials and any(trial_name(0) in path.parts for path in outputs):
            raise StrandcastError(
                "SC-W021",
                f"{name} has no trial yet, and {until} needs one",
                field="--until",
                fix=f"import its recording: strandcast import track {name} 1 FILE.csv"
                if context.settings.target_m is None
                else f"plan the first motion: strandcast plan {name} 1; then throw it, or import its track",
            )
        found += [path.relative_to(root).as_posix() for path in outputs]
    return list(dict.fromkeys(found))


def _runs(stage: str, context: Context) -> bool:
    if stage == "lab_rehearse":
        return context.settings.lab_rehearses
    if stage in ("lab_calibrate", "lab_throw", "lab_capture") and context.settings.lab is not None:
        return (stage == "lab_capture") == context.settings.lab_captures
    return bool(context.views) if stage == JOIN else not stage.startswith("lab_")
