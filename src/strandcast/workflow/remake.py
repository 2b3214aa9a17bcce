"""What a run would make again, and why: the decisions of Snakemake, without starting it.

Snakemake notes with each output the parameters, the inputs and their hashes (.snakemake/metadata). A step
runs again if an output that was asked for is missing, if an input is newer than an output and differs from
what was noted, or if parameters or the list of inputs changed; so does all that depends on it. A run asks for
every result that leads to the page of an experiment.
"""

import ast
import json
from base64 import urlsafe_b64encode
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from graphlib import TopologicalSorter
from pathlib import Path
from typing import Any

from strandcast.core.trial_names import in_trial_order
from strandcast.errors import StrandcastError
from strandcast.records.files import sha256_file
from strandcast.records.lineage import relative_to
from strandcast.stages.context import Context
from strandcast.stages.declarations import STAGES
from strandcast.stages.job import Files, Job
from strandcast.stages.producers import Step, producers
from strandcast.workflow.code_version import code_version, settings

TARGET = Step("summary")
MOST_HASHED_BYTES = 1_000_000  # Snakemake's: larger inputs count as changed if they are newer
LONGEST_NAME = 255  # Snakemake cuts the names of its notes into folders of this length
MOST_CHANGES = 3  # that are named; chosen


@dataclass(eq=False)
class StepState:
    """A step with its files, and the reasons for which a run would do it again.

    Attributes
    ----------
    problem
        Why its inputs cannot be listed, e.g. two videos; such a step fails.
    why
        Reasons of its own, in words.
    after
        A step that runs again and makes this one run too, if there is no reason of its own.
    """

    step: Step
    inputs: list[str]
    outputs: list[str]
    params: list[str]
    problem: StrandcastError | None = None
    why: list[str] = field(default_factory=list)
    after: Step | None = None

    @property
    def runs(self) -> bool:
        """Whether a run does this step again."""
        return bool(self.why) or self.after is not None


def tasks_of(context: Context, trials: list[int], forced: Mapping[str, str]) -> dict[Step, StepState]:
    """Return the steps that lead to the page of an experiment, in the order in which they run.

    Parameters
    ----------
    trials
        The trials that the page covers.
    forced
        Files that are made again in any case, relative to the project, and why.
    """
    found, makers = _leading_to_page(context, trials)
    needs = {step: {makers[name] for name in task.inputs if name in makers} for step, task in found.items()}
    ordered = {step: found[step] for step in TopologicalSorter(needs).static_order()}
    _decide(context.folder.root, ordered, needs, forced)
    return ordered


def lost_results(context: Context, trials: list[int]) -> list[str]:
    """Return results that must be asked for, so that all that are missing on the way to the page are made.

    A missing result that another missing one is made from is made on the way.
    """
    found, _ = _leading_to_page(context, trials)
    lost = {step: _lost(context.folder.root, task) for step, task in found.items() if task.problem is None}
    made_anyway = {name for step, names in lost.items() if names for name in found[step].inputs}
    return [name for names in lost.values() if made_anyway.isdisjoint(names) for name in names]


def _lost(root: Path, task: StepState) -> list[str]:
    """Return the results of a task that are missing; raw files are nobody's to restore but their owner's."""
    return [name for name in task.outputs if name.startswith("results/") and not (root / name).exists()]


def _leading_to_page(context: Context, trials: list[int]) -> tuple[dict[Step, StepState], dict[str, Step]]:
    """Return the steps that lead to the page of an experiment, and which step makes which file."""
    following = max(trials, default=0) + 1
    known = producers(context, range(1, following + 1))
    makers = {relative_to(context.folder.root, path): step for path, step in known.items()}
    found: dict[Step, StepState] = {}
    waiting = [TARGET]
    while waiting:
        step = waiting.pop()
        if step not in found:
            found[step] = _task(context, step, trials)
            waiting.extend(makers[name] for name in found[step].inputs if name in makers)
    return found, makers


def _task(context: Context, step: Step, trials: list[int]) -> StepState:
    stage, root = STAGES[step.stage], context.folder.root
    job = Job(context, step.trial, () if step.trial else tuple(trials))
    inputs: list[str] = []
    problem = None
    try:
        inputs = [relative_to(root, path) for paths in stage.input_files(job).values() for path in paths]
    except StrandcastError as error:
        problem = error
    outputs = [relative_to(root, path) for paths in stage.output_files(job).values() for path in paths]
    params = [code_version(step.stage)]
    if step.stage != "register_motion":
        params.append(settings(job, step.stage))
    noted = [repr(value) for value in params]
    if step == TARGET:
        noted.append(repr(trials))
    return StepState(step, inputs, outputs, noted, problem)


def log_of(context: Context, step: Step) -> Path:
    """Return the file to which a run writes what a step prints."""
    return Files(STAGES[step.stage], Job(context, step.trial)).log


def _decide(
    root: Path, tasks: dict[Step, StepState], needs: Mapping[Step, set[Step]], forced: Mapping[str, str]
) -> None:
    """Fill in why each task runs again: first for reasons of its own, then because of the others."""
    needed_by: dict[Step, set[Step]] = {step: set() for step in tasks}
    for step, others in needs.items():
        for other in others:
            needed_by[other].add(step)
    oldest: dict[Step, float] = {}
    for step in reversed(tasks):  # a step without outputs is as old as what was made from them
        times = [_oldest_output(root, tasks[step]), *(oldest.get(other) for other in needed_by[step])]
        known = [time_s for time_s in times if time_s is not None]
        oldest |= {step: known[0]} if known else {}
    for step, task in tasks.items():
        made_again = [forced[name] for name in task.outputs if name in forced]
        task.why = list(_own_reasons(root, task, oldest.get(step))) or made_again[:1]
    waiting = [step for step, task in tasks.items() if task.why]
    while waiting:
        step = waiting.pop()
        for other in needs[step]:
            lost = [name for name in tasks[other].outputs if name in tasks[step].inputs]
            lost = [name for name in lost if not (root / name).exists()]
            if lost and not tasks[other].runs:
                tasks[other].why = [f"{lost[0]} is missing"]
                waiting.append(other)
        for other in sorted(needed_by[step]):
            if not tasks[other].runs:
                tasks[other].after = step
                waiting.append(other)


def _oldest_output(root: Path, task: StepState) -> float | None:
    return min((_changed_s(root / name) for name in task.outputs if (root / name).exists()), default=None)


def _changed_s(path: Path) -> float:
    return max(path.stat().st_mtime, path.lstat().st_mtime)


def _own_reasons(root: Path, task: StepState, oldest_s: float | None) -> Iterator[str]:
    """Yield why a task would run again if no other did."""
    if task.problem is not None:
        return
    if lost := _lost(root, task):
        yield f"{lost[0]} is missing"
        return
    notes = [_note(root, name) for name in task.outputs]
    newer = [name for name in task.inputs if oldest_s and _is_changed(root, name, oldest_s, notes)]
    if newer:
        yield from (f"{name} changed" for name in newer[:MOST_CHANGES])
        return
    if any(_is_incomplete(root, name) for name in task.outputs):
        yield "the run that makes it was stopped, or has not ended yet"
    if all(notes):
        yield from dict.fromkeys(reason for note in notes for reason in _differences(task, note))


def _is_changed(root: Path, name: str, oldest_s: float, notes: list[dict[str, Any]]) -> bool:
    path = root / name
    if not path.exists() or _changed_s(path) <= oldest_s:
        return False
    if path.is_dir() or path.stat().st_size > MOST_HASHED_BYTES:
        return True
    noted = {(note.get("input_checksums") or {}).get(name) for note in notes}
    return noted != {f"sha256:{sha256_file(path)}"}


def _differences(task: StepState, note: dict[str, Any]) -> Iterator[str]:
    """Yield how parameters and inputs differ from those that Snakemake noted."""
    before, now = set(note.get("params") or []), set(task.params)
    if note.get("params") is not None and before != now:
        yield from _changed_params([*before - now], [*now - before])
    inputs = sorted(task.inputs)
    if note.get("input") is not None and note["input"] != inputs:
        added, gone = set(inputs) - set(note["input"]), set(note["input"]) - set(inputs)
        yield from (f"{name} is a new input" for name in in_trial_order(added)[:MOST_CHANGES])
        yield from (f"{name} is no longer an input" for name in in_trial_order(gone)[:MOST_CHANGES])


def _changed_params(before: list[str], now: list[str]) -> Iterator[str]:
    old, new = ([ast.literal_eval(value) for value in values] for values in (before, now))
    changed = list(_changed_settings(_settings_in(old), _settings_in(new)))
    yield from changed[:MOST_CHANGES]
    if len(changed) > MOST_CHANGES:
        yield f"{len(changed) - MOST_CHANGES} other settings changed"
    if any(isinstance(value, list) for value in new):
        yield f"there are other trials: {', '.join(map(str, next(v for v in new if isinstance(v, list))))}"
    if any(isinstance(value, str) and not value.startswith("{") for value in new):
        yield "the code of this stage changed"


def _settings_in(params: list[Any]) -> Any:
    texts = (value for value in params if isinstance(value, str) and value.startswith("{"))
    return json.loads(next(texts, "{}"))


def _changed_settings(old: Any, new: Any, place: str = "") -> Iterator[str]:
    """Yield the settings that differ, with the old and the new value."""
    if isinstance(old, dict) and isinstance(new, dict) and (old or new):
        for key in sorted({*old, *new}):
            yield from _changed_settings(old.get(key), new.get(key), f"{place}.{key}".lstrip("."))
    elif old != new:
        yield f"{place}: {_short(old)} → {_short(new)}"


def _short(value: Any) -> str:
    text = "none" if value is None else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 40 else f"{text[:37]}…"


def _note(root: Path, name: str) -> dict[str, Any]:
    try:
        note = json.loads(_note_file(root, "metadata", name).read_bytes())
    except (OSError, ValueError):
        return {}
    return note if isinstance(note, dict) else {}


def _is_incomplete(root: Path, name: str) -> bool:
    return (root / name).exists() and _note_file(root, "incomplete", name).is_file()


def _note_file(root: Path, kind: str, name: str) -> Path:
    code, cut = urlsafe_b64encode(name.encode()).decode(), LONGEST_NAME - 1
    *folders, last = (code[start : start + cut] for start in range(0, len(code), cut))
    return root.joinpath(".snakemake", kind, *(f"@{part}" for part in folders), last)
