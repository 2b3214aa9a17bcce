"""Run the paper's experiments seed by seed, then write their page."""

from itertools import groupby
from pathlib import Path

from strandcast.errors import FAILED_TRIALS
from strandcast.workflow.engine import run_snakemake
from strandcast.workflow.runner import RunOptions, command, refuse_elsewhere
from strandcast_studies.paper.cases import PaperCase
from strandcast_studies.paper.records import PaperRun, PaperSummary

SNAKEFILE = Path(__file__).with_name("Snakefile")


def paper_command(root: Path, form: str, cores: int) -> list[str]:
    """Return the Snakemake command line that makes the paper's page from existing runs."""
    line = command(root, [], RunOptions(cores))
    return [
        line[0],
        "--snakefile",
        str(SNAKEFILE),
        f"results/{form}/report.html",
        *line[1:],
        "--forcerun",
        "paper",
        "--allowed-rules",
        "paper",
        "transfer",
    ]


def run_paper(root: Path, cases: list[PaperCase], cores: int, page_only: bool = False) -> int:
    """Run the paper's experiments seed by seed, then make the page from all existing runs.

    A failed run does not stop the others; the page gives its reason. Finished runs are not repeated.

    Returns
    -------
    The exit code: 0, 1 if a run is not done, or Snakemake's for the page.
    """
    refuse_elsewhere(root)
    for _, batch in [] if page_only else groupby(cases, key=lambda case: case.seed):
        # Several runs at a time use the cores better than the threads of one.
        line = command(root, [case.name for case in batch], RunOptions(cores))
        run_snakemake([*line, "--set-threads", "estimate=1", "plan=1"], root)
    form = cases[0].form
    code = run_snakemake(paper_command(root, form, cores), root)
    if code:
        return code
    page = root / "results" / form / "report.html"
    whole = PaperSummary.read(page.with_name("summary.json"))
    print("\n".join([*(_paper_line(run) for run in whole.experiments), f"  report: {page}"]))
    mine = {case.name for case in cases}
    wanting = [run for run in whole.experiments if run.experiment in mine and run.state != "done"]
    return FAILED_TRIALS if wanting else 0


def _paper_line(run: PaperRun) -> str:
    misses = ["–" if trial.miss_m is None else f"{1000 * trial.miss_m:.1f}" for trial in run.trials]
    outcome = f"hit at trial {run.hit_trial}" if run.hit_trial else "no hit"
    state = "" if run.state == "done" else f"; {run.state}: {run.reason}"
    return f"  {run.experiment}: {outcome}, misses {', '.join(misses) or '–'} mm{state}"
