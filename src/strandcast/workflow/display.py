"""What a person sees of a run: plain lines, or on a terminal a live table of the running stages."""

import json
import re
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from strandcast.workflow.events import MARK, RunState, StageRun

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

REFRESHES_PER_S = 4
PREAMBLE = "Using workflow specific profile"  # Snakemake prints it before any logger is there
EXIT_STATUS = re.compile(r"CalledProcessError.* non-zero exit status (\d+)", re.DOTALL)
SIGNALLED = 128  # a shell adds it to the number of the signal that ended a command


class Display:
    """Print what jobs print, and which of them failed."""

    def __init__(self, state: RunState | None = None) -> None:
        self.state = state or RunState()
        self.stopped_by: str | None = None  # set by a signal's handler, which must not print
        self._said_so = False
        self._cause = ""

    @contextmanager
    def shown(self) -> Iterator[None]:
        """Keep what is shown at the bottom of a terminal, if anything, until the end of the block."""
        yield

    def feed(self, line: str) -> None:
        """Show one line of Snakemake's standard error: an event, or what a job printed."""
        if self.stopped_by is not None:  # what is printed from then on is of no use
            if not self._said_so:
                self.say(f"{self.stopped_by}: the running stages are stopped; finished results are kept")
            self._said_so = True
        elif line.startswith(MARK):
            self.show_event(json.loads(line[1:]))
        elif line.strip() and not line.startswith(PREAMBLE):
            self.show_line(printable(line.rstrip()))

    def show_event(self, event: dict[str, Any]) -> None:
        """Show what an event changes."""
        job = self.state.take(event)
        if event["event"] in ("job_error", "group_error") and job is not None:
            log = f"; its log: {job.log}" if job.log else ""
            cause = event.get("cause") or self._cause
            self.say(f"{job.subject}: {job.stage} failed{cause}{log}")
        elif event["event"] == "message":
            # Of a job: it has said why it failed, unless it was killed.
            status = EXIT_STATUS.search(event["text"])
            if status is not None:
                code = int(status[1])
                self._cause = f": it was killed ({signal_name(code)})" if code > SIGNALLED else ""
            elif not self.state.failed:
                self.say(printable(event["text"]))

    def show_line(self, line: str) -> None:
        """Show a line of a job."""
        self.say(line)

    def say(self, text: str) -> None:
        """Print lines on standard error."""
        with suppress(OSError):  # the terminal may be closed
            sys.stderr.write(text + "\n")
            sys.stderr.flush()


class LiveDisplay(Display):
    """A table of the running stages that stays below the printed lines."""

    def __init__(self, state: RunState, console: "Console") -> None:
        from rich.live import Live

        super().__init__(state)
        self._console = console
        self._began_s = time.monotonic()
        self._live = Live(
            console=console,
            get_renderable=self.table,
            transient=True,
            refresh_per_second=REFRESHES_PER_S,
            redirect_stdout=False,
            redirect_stderr=False,
        )

    @contextmanager
    def shown(self) -> Iterator[None]:
        """Show the table until the end of the block."""
        self._live.start()
        try:
            yield
        finally:
            with suppress(OSError):
                self._live.stop()  # shows the cursor again

    def show_event(self, event: dict[str, Any]) -> None:
        """Show an event; a finished stage becomes a line that stays."""
        job = self.state.running.get(event["id"]) if event["event"] == "job_finished" else None
        super().show_event(event)
        if job is not None:
            self.say(f"✓ {job.subject}  {job.stage}  {clock(time.monotonic() - job.began_s)}")

    def show_line(self, line: str) -> None:
        """Show a line of progress in its job's row, any other above the table."""
        for job in self.state.running.values():
            if line.startswith(f"{job.subject} "):
                job.note = line.removeprefix(f"{job.subject} ").removeprefix(f"{job.stage}: ")
                return
        self.say(line)

    def say(self, text: str) -> None:
        """Print lines above the table."""
        with suppress(OSError):
            self._console.print(text, markup=False, highlight=False, soft_wrap=True)

    def table(self) -> "Table":
        """Return the table of the running stages, as it is now."""
        from rich.table import Table
        from rich.text import Text

        now = time.monotonic()
        table = Table.grid(padding=(0, 2))
        for _ in range(4):
            table.add_column(no_wrap=True, overflow="ellipsis")
        table.add_column(no_wrap=True, overflow="ellipsis", ratio=1)
        for job in list(self.state.running.values()):
            took_s = now - job.began_s
            note = "" if job.note == job.stage else job.note
            row = (job.subject, job.stage, clock(took_s), expectation(job, took_s), note)
            table.add_row(*(Text(each) for each in row))
        left_s = self.state.left_s()
        left = "" if left_s is None or not self.state.total else f", about {clock(left_s)} left"
        known = f"{self.state.done} of {self.state.total} stages" if self.state.total else "reading files"
        words = "stopping" if self.stopped_by else known + left
        table.add_row("", Text(words), Text(clock(now - self._began_s)), "", "")
        return table


def display_for(state: RunState) -> Display:
    """Return the display that suits standard error: live on a terminal, else plain lines."""
    if not sys.stderr.isatty():
        return Display(state)
    from rich.console import Console

    console = Console(stderr=True)
    is_live = console.is_terminal and not console.is_dumb_terminal
    return LiveDisplay(state, console) if is_live else Display(state)


def expectation(job: StageRun, took_s: float) -> str:
    """Return how long a job will take, from earlier runs."""
    if job.expected_s is None:
        return ""
    left_s = job.expected_s - took_s
    return f"about {clock(left_s)} left" if left_s > 0 else f"usually {clock(job.expected_s)}"


def clock(seconds: float) -> str:
    """Return a duration as minutes and seconds, with hours if there are any."""
    minutes, rest = divmod(round(max(seconds, 0.0)), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def signal_name(code: int) -> str:
    """Return the signal that ended a command, from its exit code in a shell."""
    try:
        return signal.Signals(code - SIGNALLED).name
    except ValueError:
        return f"exit code {code}"


def printable(text: str) -> str:
    """Return a text without characters that a terminal would obey, as in the name of a hostile file."""
    return "".join(each if each.isprintable() or each in "\n\t" else "�" for each in text)
