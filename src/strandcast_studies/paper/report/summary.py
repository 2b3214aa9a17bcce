"""The paper's experiment in numbers: hit rates and misses of every method."""

from collections.abc import Iterator, Sequence

from strandcast.records.summary import TrialSummary
from strandcast_studies.hit_rates import Run, hit_rates, misses_at, nearest_by
from strandcast_studies.paper.records import MissLine, PaperRun, PaperSummary, RateLine

TRIALS = (1, 2, 3, 4, 5)
METHODS = ("paper", "default")
OVER = ("own", "all")


def misses_of(trials: Sequence[TrialSummary]) -> Run:
    """Return the misses of a run's trials in order; None if unknown or of an excluded trial."""
    return [line.miss_m if line.excluded is None else None for line in trials]


def chosen(runs: Sequence[PaperRun], method: str, over: str = "all") -> list[PaperRun]:
    """Return a method's runs at the strings' own targets or at all, without unfinished ones."""
    return [
        run
        for run in runs
        if run.method == method and run.state != "unfinished" and (over == "all" or run.own_target)
    ]


def summarise_paper(runs: list[PaperRun], hit_radius_m: float) -> PaperSummary:
    """Return the summary of all runs."""
    groups = [
        (method, over, [misses_of(run.trials) for run in chosen(runs, method, over)])
        for method in METHODS
        for over in OVER
    ]
    return PaperSummary(
        hit_radius_m=hit_radius_m,
        experiments=runs,
        rates=[line for group in groups for line in _rates(*group)],
        misses=[line for group in groups for line in _misses(*group)],
    )


def _rates(method: str, over: str, runs: list[Run]) -> Iterator[RateLine]:
    for rate in hit_rates(runs, trials=TRIALS) if runs else []:
        yield RateLine(method=method, over=over, **rate._asdict())


def _misses(method: str, over: str, runs: list[Run]) -> Iterator[MissLine]:
    longest = max(map(len, runs), default=0)
    for of, spread in (("thrown", misses_at), ("nearest", nearest_by)):
        for trial in range(1, longest + 1):
            yield MissLine(method=method, over=over, of=of, **spread(runs, trial)._asdict())
