"""What a run does, from Snakemake's events: running, finished and failed jobs, and how long is left."""

import json
import statistics
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from strandcast.core.trial_names import trial_name, trial_number

MARK = "\x1e"  # begins a line that is an event, as in JSON text sequences (RFC 7464)
STAGES = {
    "score_lab": "score",
    "report_trial": "report",
    "report_experiment": "summary",
}  # rules with other names than their stages
# What this many changed files or settings have in common is not worth more words.
MOST_NAMES = 3

Durations = dict[tuple[str, str], dict[str, float]]  # experiment and rule -> subject -> seconds


@dataclass
class StageRun:
    """One job: a stage of an experiment, or of one of its trials."""

    stage: str
    experiment: str
    trial: int | None
    reason: str = ""
    expected_s: float | None = None
    began_s: float = field(default_factory=time.monotonic)
    note: str = ""  # its last line of progress
    log: str | None = None

    @property
    def subject(self) -> str:
        """Return what the job works on, as its lines of progress begin."""
        return self.experiment if self.trial is None else f"{self.experiment} {trial_name(self.trial)}"

    def to_json(self) -> dict[str, Any]:
        """Return the job as plain data."""
        data = {"experiment": self.experiment, "trial": self.trial, "stage": self.stage}
        return data | ({"reason": self.reason} if self.log is None else {"log": self.log})


class RunState:
    """The jobs of a run, kept by its events."""

    def __init__(self, durations: Durations | None = None) -> None:
        self.durations = durations or {}
        self.seen: list[StageRun] = []
        self.running: dict[int, StageRun] = {}
        self.failed: list[StageRun] = []
        self.done, self.total = 0, 0
        self._left: Counter[str] = Counter()  # jobs by stage that are known and not finished

    def take(self, event: dict[str, Any]) -> StageRun | None:
        """Take in an event; return the job that it is about."""
        kind = event["event"]
        if kind == "run_info":
            counts = {STAGES.get(rule, rule): count for rule, count in event["counts"].items()}
            self.total = counts.pop("total", 0)
            self._left = Counter(counts)
        elif kind == "progress":
            self.done, self.total = event["done"], event["total"]
        elif kind == "job_info":
            job = self.running[event["id"]] = self._job(event)
            self.seen.append(job)
            return job
        elif kind == "group_error":
            for number in event["stopped"]:
                self._end(number)
            failed = [self._fail(number, event["log"]) for number in event["failed"]]
            return next((job for job in failed if job), None)
        elif kind == "job_error":
            return self._fail(event["id"], event["log"])
        elif kind == "job_finished":
            return self._end(event["id"])
        return None

    def _end(self, number: int) -> StageRun | None:
        job = self.running.pop(number, None)
        if job is not None:
            self._left[job.stage] -= 1
            # A job that failed before and was repeated has not failed.
            self.failed = [
                each for each in self.failed if (each.subject, each.stage) != (job.subject, job.stage)
            ]
        return job

    def _fail(self, number: int, logs: list[str]) -> StageRun | None:
        job = self._end(number)
        if job is not None:
            job.log = next(iter(logs), None)
            self.failed.append(job)
        return job

    def _job(self, event: dict[str, Any]) -> StageRun:
        names = event["wildcards"]
        stage = STAGES.get(event["rule"], event["rule"])
        trial = int(names["trial"]) if "trial" in names else None
        job = StageRun(stage, names.get("experiment", ""), trial, event["reason"])
        past = self.durations.get((job.experiment, stage), {})
        if past:
            job.expected_s = past.get(job.subject, statistics.median(past.values()))
        return job

    def left_s(self) -> float | None:
        """Return about how long the known jobs take one after the other [s]; None without earlier runs."""
        now = time.monotonic()
        waiting = self._left - Counter(job.stage for job in self.running.values())
        typical: dict[str, list[float]] = {}
        for (_, stage), past in self.durations.items():
            typical.setdefault(stage, []).extend(past.values())
        running = list(self.running.values())
        if any(job.expected_s is None for job in running) or waiting.keys() - typical.keys():
            return None
        rest = sum(max((job.expected_s or 0.0) - (now - job.began_s), 0.0) for job in running)
        return rest + sum(count * statistics.median(typical[stage]) for stage, count in waiting.items())


def past_durations(root: Path, experiments: list[str]) -> Durations:
    """Return how long the stages took in earlier runs, from their benchmark files [s]."""
    found: Durations = {}
    folders = {name: root / "results" / name for name in experiments}
    for name, results in list(folders.items()):  # each of several cameras has a folder there
        folders |= {f"{name}/{path.parent.name}": path.parent for path in results.glob("*/cameras")}
    for name, results in folders.items():
        for folder, stage, seconds in benchmarks(results):
            subject = f"{name} {folder}" if trial_number(folder) else name
            found.setdefault((name, stage), {})[subject] = seconds
    return found


def benchmarks(results: Path) -> Iterator[tuple[str, str, float]]:
    """Yield the folder, the stage and the wall time [s] of each benchmark file of an experiment's results."""
    for path in sorted(results.glob("**/logs/*.jsonl")):
        try:
            seconds = float(json.loads(path.read_text(encoding="utf-8").splitlines()[-1])["s"])
        except (OSError, ValueError, LookupError, TypeError):
            continue  # a run that was killed may leave half a line
        yield path.parent.parent.name, path.stem, seconds


def in_words(reason: str) -> str:
    """Return Snakemake's reason to run a job in plain words."""
    for begin, words in REASONS.items():
        if begin in reason:
            return words(reason.partition(begin)[2])
    return reason


def _names(files: str) -> str:
    names = sorted({Path(file).name for file in files.partition("; ")[0].split(", ")})
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return ", ".join(names[:MOST_NAMES]) + more


# The first that a reason holds is shown: what is missing before what has changed.
REASONS: dict[str, Callable[[str], str]] = {
    "Missing output files: ": lambda files: f"missing: {_names(files)}",
    "Params have changed since last execution: ": str,  # what `strandcast.workflow.by_content` says
    "Input files updated by another job: ": lambda files: f"is made again: {_names(files)}",
    "Forced execution": lambda _: "an input has changed since",
}
