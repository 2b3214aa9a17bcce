"""Let the system refuse the k-th open, write, fsync, rename or close of every stage, for all k, and go on.

    python -m tests.faults.refused_calls [--sample 20] [--seed 1] [--stages ingest,score]

A stage must end with an error code, leave no part of a file under its name, and give the same bytes when it
is run again; or it ends well, with the same bytes. `make faults-nightly` calls this module; the exit code is
1 if a stage did anything else.
"""

import argparse
import ctypes
import errno
import mmap
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from strandcast.errors import INTEGRITY

from .small import JOBS, Job, differences, fork_job, hashes, hidden_files, make_whole, outputs

SOURCE = Path(__file__).with_suffix(".c")
PLAN = "STRANDCAST_REFUSED_CALLS"  # the plan's file, for processes that a stage starts
ERRORS = (errno.EIO, errno.ENOSPC, errno.ESTALE, errno.EDQUOT)
CODE = re.compile(r"^SC-[A-Z]\d{3} ERROR ", re.MULTILINE)
PAGES = ("report.html", "summary.json")
BAD = ("silent", "traceback", "torn", "lost", "without a code", "not healed", "left over")


class Plan(ctypes.Structure):
    """Which call to refuse, as the C file declares it."""

    calls: int
    refused: int
    error: int
    folder: bytes
    what: bytes
    _fields_ = [
        ("calls", ctypes.c_long),
        ("refused", ctypes.c_long),
        ("error", ctypes.c_int),
        ("folder", ctypes.c_char * 1024),
        ("what", ctypes.c_char * 1024),
    ]


class Refusals:
    """Runs jobs of one project while the system refuses calls, and counts what came of it."""

    def __init__(self, whole: Path, work: Path) -> None:
        self.whole, self.root = whole, work / "project"
        self.log, self.file = work / "job.log", work / "plan"
        self._restore()
        self.file.write_bytes(bytes(ctypes.sizeof(Plan)))
        with self.file.open("r+b") as file:
            self.plan = Plan.from_buffer(mmap.mmap(file.fileno(), 0))
        self.plan.folder = f"{self.root}/".encode()
        self.expected = hashes(self.root)
        self.tally: Counter[str] = Counter()

    def run(self, job: Job, refused: int = 0, error: int = 0) -> tuple[int, str]:
        """Run a job; return its exit code and what it said."""
        self.plan.calls, self.plan.refused, self.plan.error, self.plan.what = 0, refused, error, b""
        _, status = os.waitpid(fork_job(self.root, *job, self.log, self._begin), 0)
        return os.waitstatus_to_exitcode(status), self.log.read_text(errors="replace")

    def _restore(self) -> None:
        shutil.rmtree(self.root, ignore_errors=True)
        shutil.copytree(self.whole, self.root)

    def _begin(self) -> None:
        os.environ[PLAN] = str(self.file)
        assert ctypes.CDLL(None).use_plan(str(self.file).encode()) == 0

    def count_calls(self, job: Job) -> int:
        """Return how many calls an undisturbed job makes."""
        code, said = self.run(job)
        assert code == 0, said
        assert hashes(self.root) == self.expected
        return self.plan.calls

    def refuse(self, job: Job, call: int, error: int) -> None:
        """Refuse one call of a job, every second time without its results of before; then run it again."""
        there = call % 2 == 0
        for path in [] if there else outputs(self.root, *job):
            path.unlink()
        code, said = self.run(job, call, error)
        subject = f"{job[0]}, call {call}: {errno.errorcode[error]} at {self.plan.what.decode()}"
        self.tally["tried"] += 1
        for kind in self._faults(job, code, said, there):
            self._count(kind, subject, said)
        if hashes(self.root) != self.expected or hidden_files(self.root):
            code, said = self.run(job)
            if code or hashes(self.root) != self.expected:
                self._count("not healed", subject, said)
                self._restore()
            for name in hidden_files(self.root):
                self._count("left over", f"{name} after {subject}", said)

    def _faults(self, job: Job, code: int, said: str, there: bool) -> Iterator[str]:
        changed = {name for _, name in differences(self.root, self.expected)}
        if code == INTEGRITY:  # the page says what could not be read
            changed = {name for name in changed if not name.endswith(PAGES)}
        missing = [path.name for path in outputs(self.root, *job) if not path.is_file()]
        if code == 0 and (changed or missing):
            yield "silent"
        if code < 0 or "Traceback" in said:
            yield "traceback"
        elif code and not CODE.search(said):
            yield "without a code"
        if code and changed:
            yield "torn"
        # The lab removes run.json first: it says that the other files are complete.
        if code and there and set(missing) - {"run.json"}:
            yield "lost"
        yield "unharmed" if code == 0 else "refused"

    def _count(self, kind: str, subject: str, said: str) -> None:
        self.tally[kind] += 1
        if kind in BAD:
            print(f"{kind}: {subject}\n{said[-2000:]}", flush=True)


def load_library(work: Path) -> None:
    """Start this program again with the library that refuses calls, unless it is loaded."""
    if hasattr(ctypes.CDLL(None), "use_plan"):
        return
    library = work / "refused_calls.so"
    line = ["cc", "-shared", "-fPIC", "-O1", "-o", str(library), str(SOURCE), "-ldl"]
    subprocess.run(line, check=True)
    line = [sys.executable, "-m", "tests.faults.refused_calls", *sys.argv[1:]]
    sys.exit(subprocess.run(line, env=os.environ | {"LD_PRELOAD": str(library)}, check=False).returncode)


def main() -> None:
    """Refuse calls, print the counts, and end with 1 if anything was bad."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sample", type=int, help="so many calls, drawn at random (default: every call)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--stages", help="of these stages only, e.g. ingest,score")
    parser.add_argument("--whole", type=Path, help="a project that has been run to its end")
    chosen = parser.parse_args()
    rng = random.Random(chosen.seed)
    with tempfile.TemporaryDirectory(prefix="strandcast-refused-") as name:
        work = Path(name).resolve()
        load_library(work)
        whole = chosen.whole or work / "whole"
        if not chosen.whole:
            make_whole(whole)
        refusals = Refusals(whole, work)
        jobs = [job for job in JOBS if not chosen.stages or job[0] in chosen.stages.split(",")]
        calls = [(job, call) for job in jobs for call in range(1, refusals.count_calls(job) + 1)]
        errors = [(*each, ERRORS[k % len(ERRORS)]) for k, each in enumerate(calls)]
        for job, call, error in rng.sample(errors, chosen.sample) if chosen.sample else errors:
            refusals.refuse(job, call, error)
            if call == 1 or refusals.tally["tried"] % 50 == 0:
                print(f"{job[0]}, call {call}: {dict(refusals.tally)}", flush=True)
    print("refused calls: " + ", ".join(f"{count} {kind}" for kind, count in sorted(refusals.tally.items())))
    sys.exit(any(refusals.tally[kind] for kind in BAD))


if __name__ == "__main__":
    main()
