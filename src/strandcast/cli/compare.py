"""The command that compares two sets of results."""

from pathlib import Path
from typing import Annotated

import typer

from strandcast.cli.common import ROOT, AsJson, complete_experiment, show

HELP = "An experiment, or a folder of results, e.g. a copy from before a change."


def compare(
    a: Annotated[str, typer.Argument(metavar="A", help=HELP, autocompletion=complete_experiment)],
    b: Annotated[str, typer.Argument(metavar="B", help=HELP, autocompletion=complete_experiment)],
    out: Annotated[Path | None, typer.Option(help="The page (default: results/compare-A-B.html).")] = None,
    as_json: AsJson = False,
) -> None:
    """Compare two settings, versions or experiments, trial by trial, as a table and a page."""
    from strandcast.records.page import write_page
    from strandcast.report.comparison_page import comparison_lines, comparison_page
    from strandcast.workflow.comparison import compare_results

    found = compare_results(ROOT, a, b)
    page = out or ROOT / "results" / f"compare-{Path(a).name}-{Path(b).name}.html"
    write_page(page, comparison_page(found))
    lines = [*comparison_lines(found), f"page: {page}"]
    show(as_json, found.to_json() | {"page": page}, lines)
