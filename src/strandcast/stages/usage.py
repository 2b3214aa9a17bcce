"""Time and memory of a job, in the fields of Snakemake's `benchmark`.

Snakemake looks at all processes of the computer twice a second, which takes 3 % of a busy one, and it would
not find the forks of the stage server.
"""

import json
import resource
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

MAX_RSS_PER_MB = 1 << (20 if sys.platform == "darwin" else 10)


@contextmanager
def usage_written(path: Path) -> Iterator[None]:
    """Write the block's wall time [s] and the process's CPU time [s] and peak memory [MB], if it succeeds."""
    began_s = time.monotonic()
    yield
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    record = {
        "s": round(time.monotonic() - began_s, 4),
        "cpu_time": round(sum(each.ru_utime + each.ru_stime for each in used), 4),
        "max_rss": round(max(each.ru_maxrss for each in used) / MAX_RSS_PER_MB, 1),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(record) + "\n", encoding="utf-8")
