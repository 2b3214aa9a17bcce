"""The command line: a thin layer over the functions that the rules call.

Commands import what they need when they run: `strandcast score` must not load OpenCV.
"""

import logging
import os
import signal
import sys
from contextlib import suppress
from types import FrameType
from typing import Annotated

import typer

from strandcast import __version__
from strandcast.cli.checks import boards, check, preview, schema
from strandcast.cli.common import ROOT
from strandcast.cli.exchange import export_motion, import_joints, import_track
from strandcast.cli.integrity import unlock, verify
from strandcast.cli.play import EXIT_CODES, play
from strandcast.cli.stages import stage_commands, summary
from strandcast.errors import ENDING_SIGNALS, Ended, StrandcastError

app = typer.Typer(
    name="strandcast",
    help="From raw high-speed video and a robot log to fitted string physics, the next throw, and a report.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def main() -> None:
    """Run a command of strandcast."""
    guarded(app)


def configure_logging() -> None:
    """Send log messages of the level in STRANDCAST_LOG (default: warning) and above to standard error."""
    level = logging.getLevelNamesMapping().get(os.environ.get("STRANDCAST_LOG", "").upper(), logging.WARNING)
    logging.addLevelName(logging.WARNING, "warning")
    logging.basicConfig(level=level, format="%(levelname)s: %(message)s")


def guarded(app: typer.Typer) -> None:
    """Run a command; report a user's error as one message and an exit code, never as a traceback."""
    configure_logging()
    for number in ENDING_SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:  # ignored by nohup, or as a job in the background
            signal.signal(number, _end)
    try:
        app()
    except StrandcastError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
    except Exception as error:
        from strandcast.cli.host_problems import problem_of

        problem = problem_of(error)
        if problem is None:
            raise
        print(problem, file=sys.stderr)
        sys.exit(problem.exit_code)
    except Ended as ended:
        with suppress(OSError):  # the terminal may be closed
            print(f"stopped by {ended}: {ended.kept}", file=sys.stderr, flush=True)
        sys.exit(ended.exit_code)


def _end(number: int, frame: FrameType | None) -> None:
    raise Ended(number)


@app.callback(invoke_without_command=True)
def options(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    """Handle the options that come before a command."""
    if version:
        print(f"strandcast {__version__}")
        raise typer.Exit


@app.command()
def run(
    experiments: Annotated[list[str] | None, typer.Argument(metavar="[EXPERIMENT]...")] = None,
    cores: Annotated[int, typer.Option(min=1, help="Number of processor cores to use.")] = 2,
) -> None:
    """Make the reports of experiments, and everything they need (default: all under data/)."""
    from strandcast.workflow.runner import run_experiments

    sys.exit(run_experiments(ROOT, experiments or [], cores))


for command in (check, schema, boards, preview, verify, unlock):
    app.command()(command)
for name, (stage, text) in stage_commands().items():
    app.command(name, help=text)(stage)
app.command()(summary)
app.command(epilog=EXIT_CODES)(play)

importing = typer.Typer(help="Import data that was measured elsewhere.", no_args_is_help=True)
importing.command("joints")(import_joints)
importing.command("track")(import_track)
app.add_typer(importing, name="import")
exporting = typer.Typer(help="Export motions for other programs.", no_args_is_help=True)
exporting.command("motion")(export_motion)
app.add_typer(exporting, name="export")
