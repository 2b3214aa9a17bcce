"""docs/reference/commands.md, from the help of the commands: `python -m strandcast_studies.commands_page`."""

from collections.abc import Iterator
from typing import Any

import typer

from strandcast.cli.app import app

HEAD = """# Commands

<!-- made by: python -m strandcast_studies.commands_page > docs/reference/commands.md -->

`strandcast COMMAND --help` explains arguments and options; those in brackets may be left out. With `--json`,
a command prints one JSON object, also for an error (`code`, `message`, `file`, `line`, `field`, `cost`,
`fix`, `exit_code`). `strandcast --install-completion` lets the shell complete commands, experiments and
trials.

| exit code | meaning |
|---|---|
| 0 | done |
| 1 | done, but a stage failed; all other results are made |
| 2 | refused: arguments, settings or limits |
| 3 | the computer: packages, disk, memory, permissions |
| 4 | a file is damaged or not as it was recorded |
| 5, 6, 7 | `play`: stopped by the player, stopped by the controller, log incomplete |
| 128 + n | ended by signal n, e.g. 130 by Ctrl-C |
"""


def commands_page() -> str:
    """Return the page of all commands, by group: a line for each."""
    groups: dict[str, list[str]] = {}
    group: Any = typer.main.get_command(app)
    for name, command in group.commands.items():
        groups.setdefault(command.rich_help_panel, []).extend(_lines(f"strandcast {name}", command))
    return HEAD + "".join(f"\n## {title}\n\n{''.join(lines)}" for title, lines in groups.items())


def _lines(name: str, command: Any) -> Iterator[str]:
    inner = getattr(command, "commands", None)
    if inner is None:
        yield _line(name, command)
    elif name.endswith(" stage"):  # as the rules call them: all alike
        yield f"- `{name} STAGE EXPERIMENT [TRIAL]`: {command.help[:-1]}: {', '.join(inner)}.\n"
    else:
        yield from (_line(f"{name} {each}", inner[each]) for each in inner)


def _line(name: str, command: Any) -> str:
    arguments = [each for each in command.params if each.param_type_name == "argument"]
    options = [each for each in command.params if each.param_type_name == "option" and each.name != "as_json"]
    required = [each.opts[0] for each in options if each.required]
    optional = [f"[{each.opts[0]}]" for each in options if not each.required]
    usage = " ".join([name, *map(_placeholder, arguments), *required, *optional])
    return f"- `{usage}`: {command.help.splitlines()[0]}\n"


def _placeholder(argument: Any) -> str:
    name = (argument.metavar or argument.name.upper()).rstrip(".")
    return (name if argument.required else f"[{name}]") + ("..." if argument.nargs != 1 else "")


if __name__ == "__main__":
    print(commands_page(), end="")
