"""Write the present names of settings into an experiment's file; every other line of it stays as it is."""

import re
from collections.abc import Sequence
from pathlib import Path

from strandcast.config.bounded import load_yaml, read_bounded
from strandcast.config.load import load_experiment
from strandcast.config.renamed import Change, with_new_names
from strandcast.errors import StrandcastError, StrandcastErrors
from strandcast.records.files import write_bytes

# A value in the same line as its key.
VALUE = r"(\{[^{}]*\}|\[[^][]*\]|\"[^\"]*\"|'[^']*'|[^][{},#\n]*?)(?=\s*(?:[,}#]|$))"


def fix_names(path: Path) -> int:
    """Replace former names and values of settings, and remove dropped ones; return how many there were.

    Raises
    ------
    StrandcastError
        The settings are invalid; SC-F003 they cannot be rewritten without changing others; SC-W002 the file
        cannot be written.
    """
    settings, text = load_experiment(path), read_bounded(path)
    changes = with_new_names(load_yaml(text, lines=True), path)
    if not changes:
        return 0
    edited = _edited(text, changes)
    try:
        left = with_new_names(load_yaml(edited, lines=True), path)
        if left or load_experiment(path, edited) != settings:
            raise ValueError
    except (ValueError, StrandcastError, StrandcastErrors) as error:
        what, fix = "former names cannot be replaced by --fix", "replace by hand what the warnings name"
        raise StrandcastError("SC-F003", what, file=path, fix=fix) from error
    write_bytes(path.resolve(), edited.encode())  # a link stays a link
    return len(changes)


def _edited(text: str, changes: Sequence[Change]) -> str:
    lines = re.findall(r"[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+$", text)  # as YAML counts them
    for change in sorted(changes, key=lambda change: (change.line, change.column), reverse=True):
        line = lines[change.line]
        old = re.compile(rf"['\"]?\w+['\"]?(\s*:[ \t]*){VALUE}").match(line, change.column)
        if old is None:
            continue
        before, after = line[: old.start()], line[old.end() :]
        if change.new is not None:
            after = f"  {after}" if after.startswith("#") else after
            value = f"{old[1]}{old[2]}" if change.value is None else f": {change.value}"
            lines[change.line] = f"{before}{change.new}{value}{after}"
            if change.value is not None and not before.strip():
                del lines[change.line + 1 : _end_of_block(lines, change.line, len(before))]
        elif before.strip():  # within braces
            joined = before + re.sub(r"^\s*,\s*", "", after)
            lines[change.line] = re.sub(r",\s*}", "}", joined) if after.lstrip().startswith("}") else joined
        else:
            last = _end_of_block(lines, change.line, len(before))
            lines[change.line : last] = [f"{before}{{}}\n"] if change.leaves_none else []
    added = [f"{change.added}\n" for change in changes if change.added]
    first = next((k for k, line in enumerate(lines) if re.match(r"\w", line)), 0)
    return "".join([*lines[:first], *added, *lines[first:]])


def _end_of_block(lines: Sequence[str], first: int, indent: int) -> int:
    """Return the line after those of a setting that has values of its own."""
    last = first + 1
    for k in range(first + 1, len(lines)):
        if re.match(rf"\s{{{indent + 1},}}\S", lines[k]):
            last = k + 1
        elif not re.match(r"\s*(#|$)", lines[k]):
            break
    return last
