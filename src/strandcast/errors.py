"""The one form in which strandcast tells a user that something is wrong."""

from __future__ import annotations

from pathlib import Path

# Exit codes of the command line (DESIGN §7).
FAILED_TRIALS = 1
REFUSED = 2
ENVIRONMENT = 3
INTEGRITY = 4
ABORTED = 5
STOPPED_BY_CONTROLLER = 6
LOG_INCOMPLETE = 7
INTERRUPTED = 130


class StrandcastError(Exception):
    """A problem that the user can mend: what is wrong, where, what it costs, how to fix it.

    Parameters
    ----------
    code
        "SC-" + a letter for the stage + three digits, e.g. ``SC-V012``.
    what
        What is wrong, in one sentence, with the offending value.
    file, line, field
        Where: the file, the line or frame in it, the field or column.
    cost
        What it would cost if it were let through (mm, s).
    fix
        What to do about it.
    exit_code
        The process's exit code (module constants).
    """

    def __init__(
        self,
        code: str,
        what: str,
        *,
        file: str | Path | None = None,
        line: int | None = None,
        field: str | None = None,
        cost: str | None = None,
        fix: str | None = None,
        exit_code: int = REFUSED,
    ) -> None:
        self.code = code
        self.what = what
        self.file = None if file is None else str(file)
        self.line = line
        self.field = field
        self.cost = cost
        self.fix = fix
        self.exit_code = exit_code
        super().__init__(code, what)

    def __str__(self) -> str:
        return self.message()

    def message(self) -> str:
        """Return the message: one line to grep, then what it costs and how to fix it."""
        place = ""
        if self.file is not None:
            place = self.file + (f":{self.line}" if self.line is not None else "") + ": "
        field = f"{self.field}: " if self.field else ""
        lines = [f"{self.code} ERROR  {place}{field}{self.what}"]
        if self.cost:
            lines.append(f"        Cost: {self.cost}")
        if self.fix:
            lines.append(f"        Fix: {self.fix}")
        return "\n".join(lines)


class StrandcastErrors(StrandcastError):
    """Several problems told at once, e.g. all that is wrong with one configuration file."""

    def __init__(self, problems: list[StrandcastError]) -> None:
        self.problems = problems
        first = problems[0]
        super().__init__(first.code, first.what, file=first.file, exit_code=first.exit_code)

    def message(self) -> str:
        """Return all messages, in the order in which they were found."""
        return "\n".join(problem.message() for problem in self.problems)
