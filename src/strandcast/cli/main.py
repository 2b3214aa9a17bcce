"""The command line: it runs a command, and reports how it ends.

It imports no other package before the command does: a package that is broken is one message, too.
"""

import gc
import io
import json
import logging
import os
import signal
import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

from strandcast.errors import ENDING_SIGNALS, Ended, StrandcastError


def main() -> None:
    """Run a command of strandcast."""
    guarded(_run_command)


def _run_command() -> None:
    from strandcast.cli.app import run_command

    run_command()


def configure_logging() -> None:
    """Send log messages of the level in STRANDCAST_LOG (default: warning) and above to standard error."""
    level = logging.getLevelNamesMapping().get(os.environ.get("STRANDCAST_LOG", "").upper(), logging.WARNING)
    logging.addLevelName(logging.WARNING, "warning")
    logging.basicConfig(level=level, format="%(levelname)s: %(message)s")


def guarded(command: Callable[[], Any]) -> None:
    """Run a command; report a user's error as one message and an exit code, never as a traceback."""
    # Collections among the many objects of imports take 5 to 10 % of a short command.
    gc.set_threshold(50_000)
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.encoding.lower() != "utf-8":
        sys.stdout.reconfigure(errors="replace")  # an 8-bit locale has no …
    configure_logging()
    for number in ENDING_SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:  # ignored by nohup, or as a job in the background
            signal.signal(number, _end)
    try:
        command()
    except StrandcastError as error:
        _end_with(error)
    except Exception as error:
        from strandcast.cli.host_problems import problem_of

        problem = problem_of(error)
        if problem is None:
            raise
        _end_with(problem)
    except Ended as ended:
        try:
            print(f"stopped by {ended}: {ended.kept}", file=sys.stderr, flush=True)
        except OSError:  # the terminal is closed; Python would try again at its exit, and end with 120
            _write_nowhere()
        sys.exit(ended.exit_code)


def _write_nowhere() -> None:
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        os.dup2(nowhere, stream.fileno())


def _end_with(problem: StrandcastError) -> None:
    """Print a problem and end; as one JSON object if the command line, wrong or not, asks for JSON."""
    words = sys.argv[1:]
    if "--json" in words[: words.index("--") if "--" in words else len(words)]:
        print(json.dumps(problem.to_json(), ensure_ascii=False), flush=True)
    else:
        print(problem, file=sys.stderr, flush=True)
    sys.exit(problem.exit_code)


def _end(number: int, frame: FrameType | None) -> None:
    raise Ended(number)
