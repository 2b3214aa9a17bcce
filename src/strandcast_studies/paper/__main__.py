"""``python -m strandcast_studies.paper``: the paper's experiments in the virtual lab and their page."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from strandcast.cli.main import guarded

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
ROOT = Path()


@app.command("run")
def run(
    strings: Annotated[str, typer.Option(help="Only these, e.g. 1,3.")] = "",
    targets: Annotated[str, typer.Option(help="Only these, e.g. 1,2.")] = "",
    methods: Annotated[str, typer.Option(help="Only this one: paper or default.")] = "",
    seeds: Annotated[
        int | None, typer.Option(min=1, max=999, help="Number of seeds, from the first.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Few strings, one seed, small searches.")] = False,
    page_only: Annotated[
        bool, typer.Option("--page-only", help="Do not run trials; rebuild the page from existing runs.")
    ] = False,
    cores: Annotated[int, typer.Option(min=1, help="Processor cores to use.")] = 2,
) -> None:
    """Throw the paper's strings in the virtual lab with the paper's method and ours; report on one page."""
    from strandcast_studies.paper.cases import FILE, cases, load_plan, numbers_in, words_in
    from strandcast_studies.paper.run import run_paper
    from strandcast_studies.paper.write import write_experiments

    plan = load_plan(ROOT / FILE)
    chosen = cases(
        plan,
        quick=quick,
        seeds=seeds,
        strings=numbers_in(strings),
        targets=numbers_in(targets),
        methods=words_in(methods),
    )
    if not page_only:
        write_experiments(ROOT, plan, chosen)
    sys.exit(run_paper(ROOT, chosen, cores, page_only))


@app.command()
def transfer(
    experiment: Annotated[str, typer.Argument(metavar="EXPERIMENT")],
    fitted: Annotated[list[str] | None, typer.Argument(metavar="[FITTED]...")] = None,
) -> None:
    """Predict an experiment's last throw with strings fitted in other experiments."""
    from strandcast_studies.paper import transfer_stage

    transfer_stage.run(ROOT, experiment, fitted or [])


@app.command()
def page(form: Annotated[str, typer.Argument(metavar="FORM", help="paper or paper-quick.")]) -> None:
    """Write the page and the summary of the paper's experiment from existing runs."""
    from strandcast_studies.paper import page_stage

    page_stage.run(ROOT, form)


if __name__ == "__main__":
    guarded(app)
