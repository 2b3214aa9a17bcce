"""Time of the first call in a fresh process, with and without cached machine code."""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator

from strandcast_studies.benchmarks.simulation.entries import Entry, of_spread
from strandcast_studies.benchmarks.simulation.timing import spread

_FIRST_CALL = """
from strandcast_studies.benchmarks.simulation import ours
from strandcast_studies.benchmarks.simulation.swing import CAST, table_2
import numpy as np
ways = {"f64": ours.F64, "f32": ours.F32}
measured = np.zeros((len(ours.FRAMES_S), ours.SEGMENTS, 2))
ours.errors(ways["%s"], CAST, table_2(16, 1), 1e-3, measured)
"""


def _seconds(precision: str, cache: str) -> float:
    environment = os.environ | {"NUMBA_CACHE_DIR": cache}
    begin = time.perf_counter()
    subprocess.run([sys.executable, "-c", _FIRST_CALL % precision], env=environment, check=True)
    return time.perf_counter() - begin


def entries(repeats: int) -> Iterator[Entry]:
    """Yield the wall time from the start of Python to the first errors of 16 strings."""
    with tempfile.TemporaryDirectory() as cache:
        for precision in ("f64", "f32"):
            yield Entry(f"first_call_compiling_s_{precision}", _seconds(precision, cache), "s")
            warm = spread([_seconds(precision, cache) for _ in range(repeats)])
            yield of_spread(f"first_call_s_{precision}", warm, "s")
