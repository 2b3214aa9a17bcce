"""Python code under limits of the computer: small disks, read-only folders, memory, processes."""

import ctypes
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

PR_CAPBSET_DROP = CAP_SYS_RESOURCE = 24  # linux/prctl.h, linux/capability.h
# The child prints a StrandcastError's code and message, as `strandcast` does.
PRINTED = """
import sys
from pathlib import Path
from strandcast.errors import StrandcastError
try:
{code}
except StrandcastError as error:
    print(error)
"""


def run_python(
    code: str, limits: Callable[[], None] | None = None, folder: Path | None = None, **env: str
) -> str:
    """Return what code prints in a Python of its own, after `limits` were set there."""
    return _output([sys.executable, "-c", _printing(code)], limits, folder, env)


def run_mounted(mounts: str, code: str, **env: str) -> str:
    """Return what code prints where file systems were mounted by shell commands, for it alone."""
    if shutil.which("unshare") is None or subprocess.run(["unshare", "-m", "true"], check=False).returncode:
        pytest.skip("mounting needs root and unshare")
    script = f'set -e\n{mounts}\nexec "$@"'
    return _output(
        ["unshare", "-m", "bash", "-c", script, "-", sys.executable, "-c", _printing(code)], None, None, env
    )


def _printing(code: str) -> str:
    return PRINTED.format(code="\n".join(f"    {line}" for line in code.strip().splitlines()))


def _output(
    line: list[str], limits: Callable[[], None] | None, folder: Path | None, env: dict[str, str]
) -> str:
    done = subprocess.run(
        line,
        capture_output=True,
        text=True,
        check=False,
        env={name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
        | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        | env,
        preexec_fn=limits,
        cwd=folder,
        timeout=120,
    )
    assert "Traceback" not in done.stderr, done.stderr
    return done.stdout + done.stderr


def keep_hard_limits() -> None:
    """Take from root, in the program started next, the right to raise hard limits; others have none."""
    if os.geteuid() == 0 and sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, CAP_SYS_RESOURCE, 0, 0, 0)


def small_disk(folder: Path, size: str = "1m") -> str:
    """Return the command that mounts a disk of this size."""
    return f"mount -t tmpfs -o size={size} small {folder}"
