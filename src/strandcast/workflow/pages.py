"""All pages again, from the results that there are: no stage runs, and Snakemake is not asked."""

import signal
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from strandcast.errors import StrandcastError
from strandcast.records.folders import ExperimentFolder, trial_folders
from strandcast.stages.run import run_stage
from strandcast.workflow.locks import lease

SCORED = ("verdict.json", "track.json", "report.html")  # a trial that has one of these has a page
Page = tuple[str, int]  # experiment and trial; trial 0: the page of the experiment
Mapping = Callable[..., Iterator[StrandcastError | None]]


def render_pages(root: Path, names: list[str], cores: int) -> list[StrandcastError]:
    """Render the pages of trials, then those of experiments, on some cores; return what is wrong with them.

    An experiment without a page is left to a run, which would take a new page for a finished one.
    """
    made = [name for name in names if (ExperimentFolder(root, name).results / "report.html").is_file()]
    for name in sorted({*names} - {*made}):
        print(f"{name} has no page yet; make it: strandcast run {name}", file=sys.stderr, flush=True)
    names = made
    trials = [(name, number) for name in names for number in _with_results(root, name)]
    with ExitStack() as stack:
        for name in names:
            stack.enter_context(lease(root, name))
        mapped = stack.enter_context(_mapping_on(cores))
        problems = _rendered(mapped, root, trials)
        return [*problems, *_rendered(mapped, root, [(name, 0) for name in names])]


@contextmanager
def _mapping_on(cores: int) -> Iterator[Mapping]:
    """Yield what maps pages to their problems on some cores; on one, where processes can share no locks."""
    try:
        # New processes, not copies of this one: threads of libraries do not survive a fork.
        pool = ProcessPoolExecutor(cores, get_context("spawn"), initializer=_leave_signals)
    except OSError as error:  # of the semaphores, which are in /dev/shm
        print(f"pages are rendered on one core: /dev/shm: {error.strerror}", file=sys.stderr, flush=True)
        yield map
        return
    try:
        yield pool.map
    finally:
        pool.shutdown(cancel_futures=True)


def _leave_signals() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that started this one ends it


def _rendered(mapped: Mapping, root: Path, pages: list[Page]) -> list[StrandcastError]:
    problems: list[StrandcastError] = []
    for done, problem in enumerate(mapped(partial(render_page, root), pages), 1):
        problems += [problem] if problem is not None else []
        if done % 50 == 0 or done == len(pages):
            what = "pages of trials" if pages[0][1] else "pages of experiments"
            print(f"{done} of {len(pages)} {what}", file=sys.stderr, flush=True)
    return problems


def render_page(root: Path, page: Page) -> StrandcastError | None:
    """Render one page; return what is wrong with it, e.g. which results could not be read."""
    name, trial = page
    stage = "report" if trial else "summary"
    numbers = () if trial else ExperimentFolder(root, name).reported_trials()
    try:
        run_stage(stage, root, name, trial, numbers)
    except StrandcastError as problem:
        return problem.with_traceback(None)  # which holds the page
    return None


def _with_results(root: Path, name: str) -> Iterator[int]:
    for number, folder in trial_folders(root / "results" / name).items():
        if any((folder / file).is_file() for file in SCORED):
            yield number
