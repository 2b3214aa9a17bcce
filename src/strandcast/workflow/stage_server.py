"""A server that runs stages in forks of itself, so that their imports are paid for once and not in every job.

Snakemake starts it (workflow/rules/common.smk), and it ends with Snakemake. The commands of the jobs go
through `strandcast.workflow.stage_client`; `strandcast.cli.serve_stages` is the server.
"""

import atexit
import os
import secrets
import shlex
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

from strandcast.records.folders import WITHIN_WORKFLOW
from strandcast.workflow import stage_client

DIRECTLY = "python -m strandcast"
SERVER = "strandcast.cli.serve_stages"
BACKLOG = 1000  # more jobs than start while a module is imported
PATIENCE_S = 5.0  # chosen: without jobs, the server ends within milliseconds


def start(folder: Path = Path()) -> str:
    """Start a server that ends with this process; return the shell command that stands for `strandcast`.

    Its commands run in a folder.

    Only Linux has what ends forks with their server, and sockets without files: elsewhere each command is a
    process of its own.
    """
    if sys.platform != "linux":
        return DIRECTLY
    name = f"strandcast-{secrets.token_hex(8)}"
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(f"\0{name}")  # no file: nothing is left behind, even by a kill
        listener.listen(BACKLOG)
        server = subprocess.Popen(
            [sys.executable, "-m", SERVER, str(listener.fileno())],
            stdin=subprocess.PIPE,  # never written: it closes when this process ends
            stdout=subprocess.DEVNULL,
            pass_fds=[listener.fileno()],
            env=os.environ | {WITHIN_WORKFLOW: "1"},
            cwd=folder,
        )
    atexit.register(_end, server)
    return f"python -IS {shlex.quote(str(Path(stage_client.__file__)))} {name}"


def _end(server: subprocess.Popen[bytes]) -> None:
    assert server.stdin is not None
    server.stdin.close()
    with suppress(subprocess.TimeoutExpired):  # jobs that still run keep it
        server.wait(PATIENCE_S)
