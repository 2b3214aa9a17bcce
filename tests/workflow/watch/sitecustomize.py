"""Record which files below the working directory each Python process opens for reading; see test_loop.

Python imports this module at its start when its folder is on PYTHONPATH. Files that libraries open in C
(OpenCV, FFmpeg) are not seen.
"""

import os
import sys
from pathlib import Path

LOG = os.environ.get("STRANDCAST_OPENED_FILES")
WRITING = os.O_WRONLY | os.O_RDWR


def watch(log: str) -> None:
    """Append one line for each file opened for reading: the command's arguments, a tab, the path."""
    out = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    command, root = " ".join(sys.orig_argv[3:]), f"{Path.cwd()}{os.sep}"

    def on_event(event: str, arguments: tuple) -> None:
        if (
            event != "open"
            or arguments[2] & WRITING
            or not isinstance(arguments[0], str | bytes | os.PathLike)
        ):
            return
        path = str(Path(os.fsdecode(arguments[0])).resolve())
        if path.startswith(root):
            os.write(out, f"{command}\t{path.removeprefix(root)}\n".encode())

    sys.addaudithook(on_event)


if LOG and sys.orig_argv[1:3] == ["-m", "strandcast"]:
    watch(LOG)
