"""What there is of the paper's experiment: which runs are done, which failed and why."""

from __future__ import annotations

from pathlib import Path

from strandcast.errors import StrandcastError
from strandcast.layout import ExperimentFolder, trial_name
from strandcast.paper.cases import Case, case_of
from strandcast.records.summary import Summary

DONE, FAILED, UNFINISHED = "done", "failed", "unfinished"
PIECES = ("verdict.json", "estimate.json")  # a stage that fails leaves no file


def found(root: Path, form: str) -> list[Case]:
    """Return the experiments under data/ that are the paper's (`form`: paper or paper-quick), in order."""
    names = (path.parent.name for path in (root / "data").glob(f"{form}-string*/experiment.yaml"))
    return sorted(case for case in map(case_of, names) if case is not None and case.form == form)


def state(folder: ExperimentFolder) -> tuple[str, str | None]:
    """Return how far an experiment is, and why it is not done."""
    if _complete(folder):
        return DONE, None
    reason = first_error(folder.results)
    return (FAILED, reason) if reason else (UNFINISHED, "not all of it has been run")


def states(root: Path, form: str) -> list[str]:
    """Return every run with its state, for what must be made anew when one changes."""
    return [f"{case.name} {state(ExperimentFolder(root, case.name))[0]}" for case in found(root, form)]


def finished(root: Path, form: str) -> list[str]:
    """Return the names of the experiments that are done."""
    names = (case.name for case in found(root, form))
    return [name for name in names if state(ExperimentFolder(root, name))[0] == DONE]


def same_string(root: Path, name: str) -> list[str]:
    """Return the finished runs of a run's string, seed and method at all targets; none if at one alone."""
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
    """Return where it is told how the finished runs' fits predict each other's throws."""
    return [f"results/{name}/transfer.json" for name in finished(root, form) if same_string(root, name)]


def last_of(root: Path, names: list[str], *files: str) -> list[str]:
    """Return result files of the last trials of finished runs, relative to the root."""
    folders = {name: trial_name(last_trial(root / "results" / name)) for name in names}
    return [f"results/{name}/{trial}/{file}" for name, trial in folders.items() for file in files]


def last_trial(results: Path) -> int:
    """Return the trial that hit; of an experiment without a hit, its last one that counts."""
    summary = Summary.read(results / "summary.json")
    counted = [line.trial for line in summary.trials if line.excluded is None]
    return summary.hit_trial or counted[-1]


def first_error(results: Path) -> str | None:
    """Return what the logs of an experiment's stages say of a failure, with the stage's name, or None.

    A log is written anew when its stage is run again, so that a mended failure is forgotten.
    """
    for path in sorted(results.glob("**/logs/*.log")):
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
        told = [line.strip() for line in lines if " ERROR  " in line]
        if not told and any(line.startswith("Traceback ") for line in lines):
            told = [line.strip() for line in lines if line.strip()][-1:]
        if told:
            trial = path.parent.parent.name
            where = path.stem if trial == results.name else f"{trial} {path.stem}"
            return f"{where}: {told[0]}"
    return None


def _complete(folder: ExperimentFolder) -> bool:
    """Tell whether an experiment has its summary, which is made when it has ended, and all pieces of it."""
    try:
        summary = Summary.read(folder.results / "summary.json")
    except StrandcastError:
        return False
    counted = [line.trial for line in summary.trials if line.excluded is None]
    pieces = [folder.trial(number).results / piece for number in counted for piece in PIECES]
    return bool(counted) and all(path.is_file() for path in pieces)
