"""The existing runs of the paper's experiment: which are done, which failed and why."""

from pathlib import Path

from strandcast.core.trial_names import trial_name
from strandcast.errors import StrandcastError
from strandcast.records.folders import ExperimentFolder
from strandcast.records.summary import ExperimentSummary
from strandcast.records.verdict import Verdict
from strandcast_studies.paper.cases import PaperCase, case_of

DONE, FAILED, UNFINISHED = "done", "failed", "unfinished"
PIECES = ("verdict.json", "estimate.json")  # a stage that fails leaves no file


def found(root: Path, form: str) -> list[PaperCase]:
    """Return the paper's experiments under data/ in order; `form` is paper or paper-quick."""
    names = (path.parent.name for path in (root / "data").glob(f"{form}-string*/experiment.yaml"))
    return sorted(case for case in map(case_of, names) if case is not None and case.form == form)


def state(folder: ExperimentFolder) -> tuple[str, str | None]:
    """Return the state of an experiment, and the reason if it is not done."""
    try:
        if _complete(folder):
            return DONE, None
    except StrandcastError as damaged:
        return FAILED, str(damaged).splitlines()[0]
    reason = first_error(folder.results)
    return (FAILED, reason) if reason else (UNFINISHED, "not all of it has been run")


def states(root: Path, form: str) -> list[str]:
    """Return every run with its state: a parameter of rules that must run again when one changes."""
    return [f"{case.name} {state(ExperimentFolder(root, case.name))[0]}" for case in found(root, form)]


def finished(root: Path, form: str) -> list[str]:
    """Return the names of the finished experiments."""
    names = (case.name for case in found(root, form))
    return [name for name in names if state(ExperimentFolder(root, name))[0] == DONE]


def same_string(root: Path, name: str) -> list[str]:
    """Return the finished runs with a run's string, seed and method at all targets; none if only one."""
    mine = case_of(name)
    if mine is None:
        return []
    pattern = f"{mine.form}-string{mine.string}-target*-seed{mine.seed}-{mine.method}"
    names = sorted(path.parent.name for path in (root / "data").glob(f"{pattern}/experiment.yaml"))
    kin = [each for each in names if state(ExperimentFolder(root, each))[0] == DONE]
    return kin if len(kin) > 1 and name in kin else []


def summaries(root: Path, form: str) -> list[str]:
    """Return the summaries of the finished runs, relative to the root."""
    return [f"results/{name}/summary.json" for name in finished(root, form)]


def transfers(root: Path, form: str) -> list[str]:
    """Return the paths of the transfer records of the finished runs."""
    return [f"results/{name}/transfer.json" for name in finished(root, form) if same_string(root, name)]


def last_of(root: Path, names: list[str], *files: str) -> list[str]:
    """Return result files of the last trials of finished runs, relative to the root."""
    folders = {name: trial_name(last_trial(root / "results" / name)) for name in names}
    return [f"results/{name}/{trial}/{file}" for name, trial in folders.items() for file in files]


def last_trial(results: Path) -> int:
    """Return the trial that hit; without a hit, the last one that is not excluded.

    Raises
    ------
    StrandcastError
        SC-Z005 there is none.
    """
    summary = ExperimentSummary.read(results / "summary.json")
    counted = [line.trial for line in summary.trials if line.excluded is None]
    if not counted:
        what, fix = "no trial of the experiment counts", "run the experiment first"
        raise StrandcastError("SC-Z005", what, file=results, fix=fix)
    return summary.hit_trial or counted[-1]


def first_error(results: Path) -> str | None:
    """Return the first error in the logs of an experiment's stages, with the stage's name, or None.

    A log is overwritten when its stage runs again, so that resolved errors disappear.
    """
    for path in sorted(results.glob("**/logs/*.log")):
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
        errors = [line.strip() for line in lines if " ERROR  " in line]
        if not errors and any(line.startswith("Traceback ") for line in lines):
            errors = [line.strip() for line in lines if line.strip()][-1:]
        if errors:
            trial = path.parent.parent.name
            where = path.stem if trial == results.name else f"{trial} {path.stem}"
            return f"{where}: {errors[0]}"
    return None


def _complete(folder: ExperimentFolder) -> bool:
    """Return whether an experiment has its summary, made at its end, and all its pieces."""
    path = folder.results / "summary.json"
    if not path.is_file():
        return False
    summary = ExperimentSummary.read(path)
    counted = [folder.trial(line.trial).results for line in summary.trials if line.excluded is None]
    if not counted or not all((trial / piece).is_file() for trial in counted for piece in PIECES):
        return False
    for trial in counted:  # a run whose verdicts are damaged is not counted, whatever its summary says
        Verdict.read(trial / "verdict.json")
    return summary.verdict != "unknown"
