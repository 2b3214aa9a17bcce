"""The person at the rig: a terminal, with a page in the browser that follows."""

import json
import os
import select
import signal
import sys
from importlib.resources import files
from pathlib import Path

from strandcast.errors import Ended
from strandcast.records.files import write_text

LONGEST_LINE = 4096  # a terminal gives no longer one
POLL_S = 0.25  # chosen


class Terminal:
    """What a sitting asks the person at the rig, and what it shows."""

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

    def typed(self) -> str | None:
        """Return a line that was typed within `POLL_S`; None: nothing."""
        if not select.select([sys.stdin], [], [], POLL_S)[0]:
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
