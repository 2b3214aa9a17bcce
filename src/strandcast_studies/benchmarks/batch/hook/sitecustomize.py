"""Write what a Python process spends on its start, on imports, and in all: one line of JSON at its end.

Python imports this module at its start when its folder is on PYTHONPATH; see `benchmarks.batch.accounts`.
"""

import atexit
import json
import os
import resource
import sys
import time
from importlib import _bootstrap
from pathlib import Path
from typing import Any

STARTED_S = time.process_time()


NESTED = "STRANDCAST_ACCOUNTS_NESTED"


def peak_mb() -> float:
    """Return the most memory that this process has had, without that of the one which started it."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return float(status.partition("VmHWM:")[2].split()[0]) / 1024


def account(file: str) -> None:
    """Time the outermost imports from now on, and write the line when the process ends."""
    importing: Any = _bootstrap  # every import comes through it, also one by importlib.import_module
    find_and_load = importing._find_and_load
    imports_s, depth, nested = 0.0, 0, NESTED in os.environ
    if "snakemake" not in sys.orig_argv:
        os.environ[NESTED] = "1"  # for processes that this one starts

    def timed(*arguments: object) -> object:
        nonlocal imports_s, depth
        before_s, depth = time.process_time(), depth + 1
        try:
            return find_and_load(*arguments)
        finally:
            depth -= 1
            if not depth:
                imports_s += time.process_time() - before_s

    def write() -> None:
        own, children = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
        spent = {
            "line": sys.orig_argv[1:],
            "nested": nested,
            "start_s": STARTED_S,
            "imports_s": imports_s,
            "cpu_s": own.ru_utime + own.ru_stime,
            "children_s": children.ru_utime + children.ru_stime,
            "peak_mb": peak_mb(),
        }
        with Path(file).open("a", encoding="utf-8") as out:
            out.write(json.dumps(spent) + "\n")

    def begin_fork() -> None:  # a stage, in a fork of the stage server
        nonlocal imports_s, depth
        global STARTED_S
        STARTED_S, imports_s, depth = 0.0, 0.0, 0

    importing._find_and_load = timed
    os.register_at_fork(after_in_child=begin_fork)
    atexit.register(write)


if "STRANDCAST_ACCOUNTS" in os.environ:
    account(os.environ["STRANDCAST_ACCOUNTS"])
