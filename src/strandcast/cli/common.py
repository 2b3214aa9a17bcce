"""Arguments that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

ROOT = Path()

ExperimentName = Annotated[
    str, typer.Argument(metavar="EXPERIMENT", help="The experiment's name: its folder under data/.")
]
TrialNumber = Annotated[
    int, typer.Argument(metavar="TRIAL", min=1, max=99, help="The trial's number, counted from 1.")
]
