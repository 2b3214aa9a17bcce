"""The command for a sitting at the rig: throw, wait for the film, judge, plan, and again."""

import json
import os
import select
import signal
import sys
from importlib.resources import files
from pathlib import Path

import typer

from strandcast.cli.common import ROOT, ExperimentName
from strandcast.cli.play import MoveToStart, Settle, SoftRealtime
from strandcast.errors import Ended, StrandcastError
from strandcast.records.files import write_text

LONGEST_LINE = 4096  # a terminal gives no longer one


def throw(
    experiment: ExperimentName,
    move_to_start: MoveToStart = False,
    settle: Settle = 0.0,
    accept_soft_realtime: SoftRealtime = False,
) -> None:
    """Hold a sitting at the rig: play the next motion, wait for its film, judge it, plan, and again.

    The arm moves only after the short hash of the motion has been typed. After Ctrl-C, the same command
    goes on.
    """
    if not sys.stdin.isatty():
        raise StrandcastError(
            "SC-X012",
            "a sitting needs a keyboard: each motion is confirmed by a person",
            cost="nothing was sent to the arm",
            fix="start it in a terminal",
        )
    from strandcast.executor.preflight import PlayOptions
    from strandcast.records.folders import ExperimentFolder
    from strandcast.stages.context import context_of
    from strandcast.workflow.sitting import Sitting, hold

    context_of(ROOT, experiment)  # refuses one that does not exist before anything is written

    options = PlayOptions(move_to_start=move_to_start, settle_s=settle, soft_realtime=accept_soft_realtime)
    person = Terminal(ExperimentFolder(ROOT, experiment).results)
    typer.echo(f"page that follows: {person.page}")
    hold(Sitting(ROOT, experiment, options, person))


class Terminal:
    """The person at the terminal, with a page in the browser that follows."""

    def __init__(self, results: Path) -> None:
        self.page = results / "sitting" / "index.html"
        self._text, self._pages = "", 0
        self.page.parent.mkdir(parents=True, exist_ok=True)
        template = files("strandcast.report") / "templates" / "sitting.html"
        write_text(self.page, template.read_text(encoding="utf-8"))

    def forget(self) -> None:
        """Drop what was typed before anything was asked."""
        import termios  # not on Windows

        termios.tcflush(sys.stdin, termios.TCIFLUSH)

    def typed(self, within_s: float) -> str | None:
        """Return a line that was typed within some time; None: nothing."""
        if not select.select([sys.stdin], [], [], within_s)[0]:
            return None
        line = os.read(sys.stdin.fileno(), LONGEST_LINE)
        if not line:  # Ctrl-D
            raise Ended(signal.SIGINT)
        return line.decode(errors="replace").strip()

    def say(self, text: str) -> None:
        """Show a line."""
        print(text.replace("\u00a0", " "), flush=True)

    def show(self, text: str) -> None:
        """Show how the sitting stands, in the browser too."""
        self.say(text)
        self._text = text
        self._write()

    def show_pages(self, text: str) -> None:
        """Have the browser show the pages again."""
        self.say(text)
        self._pages += 1
        self._write()

    def _write(self) -> None:
        state = json.dumps({"text": self._text, "pages": f"{os.getpid()}-{self._pages}"})
        write_text(self.page.with_name("state.js"), f"show({state})\n")
