"""The one form in which strandcast reports a problem to its user."""

import signal
from pathlib import Path
from typing import Any

# Exit codes of the command line (docs/how-to/play-on-an-arm.md lists them for `strandcast play`).
FAILED_TRIALS = 1
REFUSED = 2
ENVIRONMENT = 3
INTEGRITY = 4
ABORTED = 5
STOPPED_BY_CONTROLLER = 6
LOG_INCOMPLETE = 7
ENDING_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # exit code: 128 + the signal's number


LONGEST = 600  # characters of one text in a message, which may quote a damaged file


class Ended(BaseException):
    """A signal ended the process; not an `Exception`, so that no handler of errors holds it back."""

    def __init__(self, number: int, kept: str = "finished files are kept; run the command again") -> None:
        self.kept = kept
        self.exit_code = 128 + number
        super().__init__(signal.Signals(number).name)


class StrandcastError(Exception):
    """A problem that the user can fix: what is wrong, where, what it costs, how to fix it.

    Parameters
    ----------
    code
        "SC-" + a letter for the subject + three digits, e.g. ``SC-V012``: stands for what the user has to do;
        declared in ``errors/codes.toml``.
    what
        What is wrong, in one sentence, with the offending value.
    file, line, field
        Where: the file, the line or frame in it, the field or column.
    cost
        What ignoring the problem would cost (mm, s).
    fix
        What to do about it; by default what ``errors/codes.toml`` says for the code.
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
        self.what = shortened(what)
        self.file = None if file is None else str(file)
        self.line = line
        self.field = None if field is None else shortened(field)
        self.cost = cost
        self.fix = fix or _general_fix(code)
        self.exit_code = exit_code
        super().__init__(code, self.what)

    def __str__(self) -> str:
        return self.message()

    def message(self, severity: str = "ERROR") -> str:
        """Return the message: one line to grep, then the cost and the fix."""
        place = ""
        if self.file is not None:
            place = self.file + (f":{self.line}" if self.line is not None else "") + ": "
        field = f"{self.field}: " if self.field else ""
        lines = [f"{self.code} {severity}  {place}{field}{self.what}"]
        if self.cost:
            lines.append(f"        Cost: {self.cost}")
        if self.fix:
            lines.append(f"        Fix: {self.fix}")
        return "\n".join(lines)

    def to_json(self) -> dict[str, Any]:
        """Return the problem as plain data, for programs."""
        names = ("code", "file", "line", "field", "cost", "fix", "exit_code")
        return {"message": self.what} | {name: getattr(self, name) for name in names}


def _general_fix(code: str) -> str | None:
    from strandcast.errors.registry import general_fixes

    try:
        return general_fixes().get(code)
    except (OSError, MemoryError):  # perhaps what is reported
        return None


def shortened(text: str) -> str:
    """Return a text without its middle if it is too long to be read."""
    half = LONGEST // 2
    return text if len(text) <= LONGEST else f"{text[:half]} … {text[-half:]}"


class StrandcastErrors(StrandcastError):
    """Several problems reported together, e.g. all invalid settings of one file."""

    def __init__(self, problems: list[StrandcastError]) -> None:
        self.problems = problems
        first = problems[0]
        super().__init__(first.code, first.what, file=first.file, exit_code=first.exit_code)

    def __reduce__(self) -> tuple[type, tuple[list[StrandcastError]]]:
        return StrandcastErrors, (self.problems,)  # pages are rendered in other processes

    def message(self, severity: str = "ERROR") -> str:
        """Return all messages, in the order in which the problems were found."""
        return "\n".join(problem.message(severity) for problem in self.problems)

    def to_json(self) -> dict[str, Any]:
        """Return the first problem as plain data, and all of them as `problems`."""
        return self.problems[0].to_json() | {"problems": [each.to_json() for each in self.problems]}


def single(error: StrandcastError) -> list[StrandcastError]:
    """Return the problems that an error reports."""
    return error.problems if isinstance(error, StrandcastErrors) else [error]
