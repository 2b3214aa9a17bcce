"""Record which files below the working directory each command opens for reading, and forks; see test_loop.

Python imports this module at its start when its folder is on PYTHONPATH. Files that libraries open in C
(OpenCV, FFmpeg) are not seen.
"""

import atexit
import os
import sys
from pathlib import Path

LOG = os.environ.get("STRANDCAST_OPENED_FILES")
FORKED = "."
WRITING = os.O_WRONLY | os.O_RDWR


def watch(log: str) -> None:
    """Append one line for each file opened for reading: the command's arguments, a tab, the path."""
    out = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    root = f"{Path.cwd()}{os.sep}"

    def on_event(event: str, arguments: tuple) -> None:
        if (
            event != "open"
            or arguments[2] & WRITING
            or not isinstance(arguments[0], str | bytes | os.PathLike)
        ):
            return
        path = str(Path(os.fsdecode(arguments[0])).resolve())
        if path.startswith(root):
            note("\t" + path.removeprefix(root))

    def note(what: str) -> None:
        os.write(out, f"{' '.join(sys.orig_argv[3:])}{what}\n".encode())  # a fork of the server sets its own

    process = os.getpid()
    atexit.register(lambda: note("\t" + FORKED) if os.getpid() != process else None)
    sys.addaudithook(on_event)


if LOG and sys.orig_argv[1:3] in (["-m", "strandcast"], ["-m", "strandcast.cli.serve_stages"]):
    watch(LOG)
