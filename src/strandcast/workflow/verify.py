"""Check every file of an experiment: its content, the trial that it belongs to, its inputs, its versions."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Literal, NamedTuple, get_args

from strandcast.core.trial_names import in_trial_order
from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.folders import ExperimentFolder, TrialFolder
from strandcast.records.joint_log import Run, read_run
from strandcast.records.lineage import MISPLACED, OUTDATED, Lineage, check_picture
from strandcast.records.manifest import Manifest
from strandcast.records.motion import Motion
from strandcast.records.predicted import read_predicted
from strandcast.records.provenance import current_versions
from strandcast.records.verified import READERS, Verified
from strandcast.stages.context import context_of

State = Literal["damaged", "misplaced", "missing", "outdated", "versions"]
ORDER: tuple[State, ...] = get_args(State)
STATES: dict[str, State] = {MISPLACED: "misplaced", OUTDATED: "outdated"}


class Finding(NamedTuple):
    """A file that is not as it was made: its state, and the sentence that says so."""

    file: Path
    state: State
    what: str
    fix: str | None = None


def verify(root: Path, experiment: str, *, raw: bool = True) -> list[Finding]:
    """Return what is wrong with an experiment's files; with `raw`, videos and joint logs are hashed too."""
    folder = ExperimentFolder(root, experiment)
    numbers, folders = folder.all_trials(), (folder, *_folders_of_cameras(root, experiment))
    trials = [each.trial(number) for each in folders for number in numbers]
    places = [place for each in folders for place in (each.results, each.results / "cameras")]
    places += [trial.results for trial in trials]
    lineages: list[Lineage] = []
    findings = [finding for place in places for finding in _verify_results(place, lineages)]
    findings += _missing(root, lineages)
    # A kept motion stays what it is, whatever becomes of what it was planned from.
    findings += [
        finding for place in sorted(folder.motions.glob("*")) for finding in _verify_results(place, [])
    ]
    rehearsal = TrialFolder(folder.rehearsal, folder.results / folder.rehearsal.name, 0)
    for trial in (rehearsal, *map(folder.trial, numbers)):
        findings += _verify_raw_records(trial)
        findings += _verify_played(trial) if raw else []
    findings += [finding for trial in trials if raw for finding in _verify_video(trial)]
    return sorted(findings, key=lambda finding: ORDER.index(finding.state))


def _folders_of_cameras(root: Path, experiment: str) -> list[ExperimentFolder]:
    """Return the folders of several cameras; none where the settings, which name them, cannot be read."""
    with suppress(StrandcastError):
        return [view.folder for view in context_of(root, experiment).views.values()]
    return []


def refuse_changed_files(root: Path, experiment: str) -> None:
    """Refuse an experiment with files that are not as they were recorded or made.

    Raises
    ------
    StrandcastError
        SC-I053 a file is damaged, misplaced, missing or outdated.
    """
    faults = [finding for finding in verify(root, experiment) if finding.state != "versions"]
    if faults:
        first = faults[0]
        others = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        fix = f"strandcast verify {experiment} lists all, with a fix for each"
        what = f"{first.what}{others}"
        raise StrandcastError("SC-I053", what, file=first.file, fix=fix, exit_code=INTEGRITY)


def _missing(root: Path, lineages: list[Lineage]) -> Iterator[Finding]:
    """Yield the files that results were made from and that are not there."""
    users: dict[str, set[str]] = {}
    for lineage in lineages:
        for name in lineage.inputs:
            users.setdefault(name, set()).add(lineage.stage)
    for name in in_trial_order(users):
        if not (root / name).exists():
            what = f"is missing; {', '.join(sorted(users[name]))} used it"
            yield Finding(
                root / name, "missing", what, "restore it; `strandcast status` says what makes it again"
            )


def _verify_results(folder: Path, lineages: list[Lineage]) -> Iterator[Finding]:
    """Yield what is wrong with a folder of results; add the lineages of its records to `lineages`."""
    here: list[Lineage | None] = []
    for path in sorted(folder.iterdir()) if folder.is_dir() else []:
        if path.suffix in READERS and not path.name.startswith("."):
            found = _checked(path, READERS[path.suffix])
            if isinstance(found, Finding):
                yield found
                continue
            here.append(found.lineage)
            yield from _other_versions(path, found.made_by)
    for path in sorted(folder.glob("*.webp")):
        for lineage in here:
            try:
                check_picture(path, lineage)
            except StrandcastError as problem:
                yield _finding(path, problem)
    lineages += [lineage for lineage in here if lineage is not None]


def _verify_raw_records(trial: TrialFolder) -> Iterator[Finding]:
    for path in sorted(trial.data.glob("*.*")):
        if path.suffix in (".json", ".parquet"):
            found = _checked(path, READERS[path.suffix])
            if isinstance(found, Finding):
                yield found


def _verify_played(trial: TrialFolder) -> Iterator[Finding]:
    """Check a trial's log and motion against what the run says of them."""
    run: Run | None = None
    try:
        if (trial.data / "run.json").is_file():
            run, _ = read_run(trial.data)
        played = trial.data / "motion.json"
        planned_sha256 = run.motion_sha256 if run is not None else None
        if played.is_file():
            sha256 = Motion.read(played).content_sha256()
            if planned_sha256 not in (None, sha256):
                yield Finding(played, "misplaced", "is not the motion that run.json says was played")
            expected = trial.data / "predicted.parquet"
            if expected.is_file() and read_predicted(expected).motion_sha256 not in ("", sha256):
                yield Finding(expected, "misplaced", "was predicted for another motion")
    except StrandcastError as problem:
        yield _finding(Path(problem.file or trial.data), problem)


def _verify_video(trial: TrialFolder) -> Iterator[Finding]:
    """Check a trial's video against the manifest."""
    from strandcast.video.checks import check_same

    try:
        manifest = trial.results / "manifest.json"
        if manifest.is_file():
            facts = Manifest.read(manifest, inputs=False).video
            if (trial.data / facts.file).exists():
                check_same(trial.data / facts.file, facts)
    except StrandcastError as problem:
        yield _finding(Path(problem.file or trial.data), problem)


def _checked(path: Path, read: Callable[[Path], Verified]) -> Verified | Finding:
    try:
        return read(path)
    except StrandcastError as problem:
        return _finding(path, problem)


def _finding(path: Path, problem: StrandcastError) -> Finding:
    return Finding(path, STATES.get(problem.code, "damaged"), problem.what, problem.fix)


def _other_versions(path: Path, made_by: dict[str, str]) -> Iterator[Finding]:
    now = current_versions()
    changed = [f"{name} {old}" for name, old in made_by.items() if now.get(name, old) != old]
    if changed:
        yield Finding(path, "versions", f"was made by {', '.join(changed)}")
