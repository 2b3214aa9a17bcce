"""The command that makes a project."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

from strandcast.cli.common import AsJson, show


def new(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="The project's folder, to be made.")],
    as_json: AsJson = False,
) -> None:
    """Make a project: a folder with an example arm, the demo experiment and a Snakefile."""
    from strandcast.workflow.project import make_project

    files = make_project(folder)
    lines = [
        f"{folder}: {len(files)} files",
        "next:",
        f"  cd {shlex.quote(str(folder))}",
        "  strandcast run demo",
    ]
    show(as_json, {"folder": folder, "files": files}, lines)
