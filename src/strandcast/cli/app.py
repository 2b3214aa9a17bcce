"""The commands: a thin layer over the functions that the rules call.

Commands import what they need when they run: `strandcast stage score` must not load OpenCV.
"""

import logging
import sys
from collections.abc import Callable
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup
from typer.exceptions import TyperException

from strandcast import __version__
from strandcast.cli.checks import boards, check, doctor, new, preview, verify
from strandcast.cli.exchange import import_joints, import_track
from strandcast.cli.exclusions import exclude, include
from strandcast.cli.exports import EXPORTS
from strandcast.cli.film import film
from strandcast.cli.manual import docs, explain
from strandcast.cli.play import EXIT_CODES, play, throw
from strandcast.cli.results import compare, predict, rig, strings, together
from strandcast.cli.run import RESUMING, run
from strandcast.cli.simulate import simulate
from strandcast.cli.stages import campaign, stage_commands, summary
from strandcast.cli.status import status
from strandcast.errors import StrandcastError
from strandcast.stages import CALLED_BY_NAME

log = logging.getLogger(__name__)


class Commands(TyperGroup):
    """Commands that their help lists by panel, in plain text: importing rich would take most of its time."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write a section of commands for each panel."""
        width = max(map(len, self.commands))
        panels: dict[str, list[tuple[str, str]]] = {}
        for name, command in self.commands.items():
            row = name.ljust(width), command.get_short_help_str(limit=1000)
            panels.setdefault(getattr(command, "rich_help_panel", None) or "Commands", []).append(row)
        for panel, rows in panels.items():
            with formatter.section(panel):
                formatter.write_dl(rows)


app = typer.Typer(
    name="strandcast",
    help="From raw high-speed video and a robot log to fitted string physics, the next throw, and a report.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
    pretty_exceptions_enable=False,
    cls=Commands,
    rich_markup_mode=None,
)


def run_command() -> NoReturn:
    """Run the command of the command line, and end as it ends; former names count for one version."""
    old = sys.argv[1] if len(sys.argv) > 1 else ""
    if old in FORMER:
        new = FORMER[old]
        log.warning("strandcast %s is now strandcast %s; the next version refuses the old name", old, new)
        sys.argv[1:2] = new.split()
    try:
        sys.exit(app(prog_name="strandcast", standalone_mode=False))
    except TyperException as error:
        raise _wrong_usage(error) from error


def _wrong_usage(error: TyperException) -> StrandcastError:
    """Return an error of typer, with the command that it belongs to, as one of ours."""
    context = getattr(error, "ctx", None)
    if type(error).__name__ == "NoArgsIsHelpError":  # typer has printed the help
        sys.exit(error.exit_code)
    name = _named_command() if context is None else context.command_path
    what = " ".join(error.format_message().split()).rstrip(".")
    fix = f"see {name} --help"
    return StrandcastError("SC-W020", f"{name}: {what}", fix=fix, exit_code=error.exit_code)


def _named_command() -> str:
    """Return the command that the command line names, as typer does not say it of a missing value."""
    names = ["strandcast"]
    command: Any = typer.main.get_command(app)
    for word in sys.argv[1:]:
        command = getattr(command, "commands", {}).get(word)
        if command is None:
            break
        names.append(word)
    return " ".join(names)


class PlainCommand(TyperCommand):
    """A command, without Python types of its arguments (`<str>`) in its help."""

    def get_params(self, ctx: Any) -> Any:
        """Return the parameters, arguments without a type to show."""
        found = super().get_params(ctx)
        for each in found:
            if isinstance(each, TyperArgument):
                setattr(each, "display_type_rich", lambda ctx: None)  # noqa: B010  (it is a method)
        return found


@app.callback(invoke_without_command=True)
def options(
    version: Annotated[bool, typer.Option("--version", help="Print the version.", is_eager=True)] = False,
) -> None:
    """Handle the options that come before a command."""
    if version:
        print(f"strandcast {__version__}")
        raise typer.Exit


# The help lists groups and commands in this order; commands that have commands of their own come last.
DAILY, SET_UP, CARE = "Every day", "Setting up", "Looking after files"
STAGES, EXCHANGE = "Single stages", "Data exchange"

IMPORTS: dict[str, Callable[..., Any]] = {
    "joints": import_joints,
    "track": import_track,
}
GROUPS: dict[str, tuple[Callable[..., None], ...]] = {
    DAILY: (new, check, status, run, play, throw, exclude, include, predict, together),
    SET_UP: (doctor, docs, explain, boards, preview),
    CARE: (strings, compare, rig, verify),
    EXCHANGE: (film, simulate),
}
EPILOGS = {play: EXIT_CODES, run: RESUMING}

for panel, commands in GROUPS.items():
    for command in commands:
        app.command(cls=PlainCommand, epilog=EPILOGS.get(command), rich_help_panel=panel)(command)
staging = typer.Typer(no_args_is_help=True)
for name, (stage, text) in stage_commands().items():
    group = app if name in CALLED_BY_NAME else staging
    group.command(name, cls=PlainCommand, help=text, rich_help_panel=STAGES)(stage)
for command in (summary, campaign):
    staging.command(cls=PlainCommand, rich_help_panel=STAGES)(command)
app.add_typer(
    staging, name="stage", help="Run one of the other stages, as the rules do.", rich_help_panel=STAGES
)
# Commands of version 0.2, accepted by 0.3.
OTHERS = ["summary", "campaign", *(name for name in stage_commands() if name not in CALLED_BY_NAME)]
FORMER = {name: f"stage {name}" for name in OTHERS} | {"schema": "docs schema", "unlock": "run --unlock"}


def _add_group(name: str, text: str, commands: dict[str, Callable[..., Any]]) -> None:
    group = typer.Typer(no_args_is_help=True)
    for each, command in commands.items():
        group.command(each, cls=PlainCommand)(command)
    app.add_typer(group, name=name, help=text, rich_help_panel=EXCHANGE)


_add_group("import", "Import data that was measured elsewhere.", IMPORTS)
_add_group("export", "Export motions, trials and strings for other programs.", EXPORTS)
