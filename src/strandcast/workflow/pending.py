"""What a run would make again, and why, without starting it.

A step runs again if a result that was asked for is missing, or if what it was made from has changed
(`strandcast.stages.made`); so does all that depends on it. A run asks for every result that leads to the page
of an experiment.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from graphlib import TopologicalSorter
from pathlib import Path

from strandcast.core.trial_names import in_trial_order
from strandcast.errors import StrandcastError, StrandcastErrors, single
from strandcast.records.lineage import relative_to
from strandcast.stages.context import Context
from strandcast.stages.declarations import STAGES
from strandcast.stages.job import Files
from strandcast.stages.made import changed_files, changes_since_made
from strandcast.stages.producers import Step, producers
from strandcast.stages.raw_files import missing_file

TARGET = Step("summary")


@dataclass(eq=False)
class StepState:
    """A step with its files, and the reasons for which a run would do it again.

    Attributes
    ----------
    problem
        Why it has not the inputs that it needs: one is missing, or there are two videos; such a step fails.
    why
        Reasons of its own, in words.
    after
        A step that runs again and makes this one run too, if there is no reason of its own.
    """

    files: Files
    inputs: list[str]
    outputs: list[str]
    problem: StrandcastError | None = None
    why: list[str] = field(default_factory=list)
    after: Step | None = None

    @property
    def runs(self) -> bool:
        """Whether a run does this step again."""
        return bool(self.why) or self.after is not None


def tasks_of(
    context: Context,
    trials: list[int],
    forced: Mapping[str, str],
    targets: Iterable[str] | None = None,
) -> dict[Step, StepState]:
    """Return the steps that lead to some files, by default an experiment's page, in the order of a run.

    Parameters
    ----------
    trials
        The trials that the page covers.
    forced
        Files that are made again in any case, relative to the project, and why.
    """
    found, makers = _leading_to(context, trials, targets)
    needs = {step: {makers[name] for name in task.inputs if name in makers} for step, task in found.items()}
    ordered = {step: found[step] for step in TopologicalSorter(needs).static_order()}
    _decide(context.folder.root, ordered, needs, forced)
    return ordered


def lost_results(context: Context, trials: list[int]) -> list[str]:
    """Return results that must be asked for, so that all that are missing on the way to the page are made.

    A missing result that another missing one is made from is made on the way.
    """
    found, _ = _leading_to(context, trials)
    lost = {step: _lost(context.folder.root, task) for step, task in found.items() if task.problem is None}
    made_anyway = {name for step, names in lost.items() if names for name in found[step].inputs}
    return [name for names in lost.values() if made_anyway.isdisjoint(names) for name in names]


def changed_raw_files(context: Context, trials: list[int]) -> list[str]:
    """Return the raw files that are not those that results were made from."""
    tasks = _leading_to(context, trials)[0].values()
    changed = {name for task in tasks if task.problem is None for name in changed_files(task.files)}
    return in_trial_order(name for name in changed if name.startswith("data/"))


def input_problems(context: Context, trials: list[int], targets: Iterable[str]) -> list[StrandcastError]:
    """Return why a run cannot make some files: raw ones are missing, or it is open which one counts."""
    tasks = _leading_to(context, trials, targets)[0].values()
    problems = [each for task in tasks if task.problem is not None for each in single(task.problem)]
    return list({(each.code, each.file): each for each in problems}.values())


def _lost(root: Path, task: StepState) -> list[str]:
    """Return the results of a task that are missing; raw files are nobody's to restore but their owner's."""
    return [name for name in task.outputs if name.startswith("results/") and not (root / name).exists()]


def _leading_to(
    context: Context, trials: list[int], targets: Iterable[str] | None = None
) -> tuple[dict[Step, StepState], dict[str, Step]]:
    """Return the steps that lead to some files, by default the experiment's page, and which makes what."""
    following = max(trials, default=0) + 1
    known = producers(context, range(1, following + 1))
    makers = {relative_to(context.folder.root, path): step for path, step in known.items()}
    found: dict[Step, StepState] = {}
    waiting = [TARGET] if targets is None else [makers[name] for name in targets if name in makers]
    while waiting:
        step = waiting.pop()
        if step not in found:
            found[step] = _task(context, step, trials, makers)
            waiting.extend(makers[name] for name in found[step].inputs if name in makers)
    return found, makers


def _task(context: Context, step: Step, trials: list[int], makers: Mapping[str, Step]) -> StepState:
    root, job = context.folder.root, step.job(context, tuple(trials) if step == TARGET else ())
    files = Files(STAGES[step.stage], job)
    inputs: list[str] = []
    problem: StrandcastError | None = None
    try:
        paths = files.all_inputs()
        inputs = [relative_to(root, path) for path in paths]
        unmade = (path for path, name in zip(paths, inputs, strict=True) if name not in makers)
        if missing := [missing_file(job.context, path) for path in unmade if not path.exists()]:
            problem = StrandcastErrors(missing)
    except StrandcastError as error:
        problem = error
    outputs = [relative_to(root, path) for path in files.all_outputs()]
    return StepState(files, inputs, outputs, problem)


def _decide(
    root: Path, tasks: dict[Step, StepState], needs: Mapping[Step, set[Step]], forced: Mapping[str, str]
) -> None:
    """Fill in why each task runs again: first for reasons of its own, then because of the others."""
    needed_by: dict[Step, set[Step]] = {step: set() for step in tasks}
    for step, others in needs.items():
        for other in others:
            needed_by[other].add(step)
    for task in tasks.values():
        made_again = [forced[name] for name in task.outputs if name in forced]
        task.why = _own_reasons(root, task) or made_again[:1]
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


def _own_reasons(root: Path, task: StepState) -> list[str]:
    """Return why a task would run again if no other did."""
    if task.problem is not None:
        return []
    if lost := _lost(root, task):
        return [f"{lost[0]} is missing"]
    return changes_since_made(task.files, task.inputs)
